"""Sensor faults: flag, time until it is raised, and resulting estimates."""

import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

from gateway.core.clock import ManualClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.estimates.estimator import Estimate
from gateway.core.links.source import open_source
from gateway.core.session.core import SessionCore
from gateway.core.text.wording import text

_SPEED_MPS = 65.0 / 3.6
_CASES: dict[str, str] = {
    "none": "",
    "dead from 4 s": "defect = {dead_from_s = 4}",
    "radial stuck from 4 s": 'defect = {stuck_from_s = 4, axes = ["radial"]}',
    "range of 60 g": "sensor = {range_g = 60}",
    "clips at 60 g of 500": "defect = {clip_g = 60}",
    "loose, 200 Hz": "defect = {loose_hz = 200}",
    "loose, 300 Hz": "defect = {loose_hz = 300}",
    "loose, 500 Hz": "defect = {loose_hz = 500}",
    "rolled 30 deg": "sensor = {roll_deg = 30}",
    "pitched 30 deg": "sensor = {pitch_deg = 30}",
    "axes swapped": "sensor = {roll_deg = 90}",
    "pointing outward": "sensor = {radial_sign = -1, sign_declared = false}",
    "pressure stuck from 2 s": "defect = {pressure_stuck_from_s = 2}\ntemperature_degc = [[0, 20], [20, 45]]",
    "wheels swapped": "",
}
SCENARIO = """
[scenario]
seed = 5
duration_s = {duration}
[motion]
speed_kmh = 65
[tire]
radius_mm = 320
[[hub]]
hub = 0
[[wheel]]
position = "W1"
wheel = 0
sensor_id = "0000a001"
{faulty}
[[wheel]]
position = "W2"
wheel = 1
sensor_id = "0000a002"
"""


def _show(estimate: Estimate | None, true: float | None = None) -> str:
    if estimate is None:
        return "-"
    error = "" if true is None else f" ({100 * (estimate.value / true - 1):+.2f} %)"
    return f"{estimate.value:.4g} +- {estimate.std:.1g}{error} {estimate.status}"


def report() -> Iterator[str]:
    """Yield a table."""
    yield f"{'fault':24s} {'flag at W1':18s} {'after':>6s} {'W1 rev.':>7s}  speed (m/s); Cw; flags at W2"
    with tempfile.TemporaryDirectory() as folder:
        for name, faulty in _CASES.items():
            path = Path(folder) / "s.toml"
            path.write_text(SCENARIO.format(duration=20, faulty=faulty))
            source = open_source(f"sim:{path}?speed=max", ManualClock())
            toml = source.vehicle_toml or ""
            if name == "wheels swapped":
                toml = toml.replace("a001", "x").replace("a002", "a001").replace("x", "a002")
            core = SessionCore(parse_vehicle(toml, "s"))
            first_s: dict[str, float] = {}
            last: dict[str, Estimate] = {}
            count, begin_ns = 0, None
            for number, item in enumerate(source.items(threading.Event())):
                begin_ns = begin_ns if begin_ns is not None else item.host_ns
                for result in core.take(item):
                    if result.position == "W1":
                        count += 1
                        last = {estimate.name: estimate for estimate in result.estimates}
                if number % 10 == 0:
                    for alarm in core.snapshot(0.0).alarms:
                        first_s.setdefault(f"{alarm.position} {alarm.name}", (item.host_ns - begin_ns) * 1e-9)
            faults = core.snapshot(0.0).wheels[0].last
            reasons = faults.revolution.faults if faults is not None else ()
            of_wheel = {key.removeprefix("W1 "): at_s for key, at_s in first_s.items() if key.startswith("W1 ")}
            flag, after_s = next(iter(of_wheel.items()), ("-", float("nan")))
            others = ", ".join(key.removeprefix("W2 ") for key in first_s if key.startswith("W2 ")) or "none"
            yield (
                f"{name:24s} {flag:18s} {after_s:5.1f}s {count:7d}  {_show(last.get('speed_mps'), _SPEED_MPS)}; "
                f"{_show(last.get('Cw'))}; {others}" + (f"; every revolution: {text(reasons[0])}" if reasons else "")
            )
            core.finish()
