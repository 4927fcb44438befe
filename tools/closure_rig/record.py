"""Recordings of a case: bytes of a simulated hub with the declared configuration only."""

import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from closure_rig.bench import EXTENSION_STIFFNESS_MN, RING_NODES, Run
from closure_rig.bent import BentChain
from closure_rig.draw import Case
from closure_rig.outside import DisturbedChain, FaultyChain
from firmware_protocol.wire import HELLO_PERIOD_S
from gateway.core.config.toml_writer import toml_text
from gateway.core.links.source import LinkEvent, LinkEventKind
from gateway.core.recording.writer import RecordingWriter
from gateway.simulator.scenario import parse_scenario, vehicle_toml
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulated_wheel import WheelSimulator
from gateway.simulator.simulation import Simulation, simulate

SECONDS: Final = 8.0
LINK: Final = "sim:rig"
POSITION: Final = "W"
# A fixed date; runs are one minute apart.
_START_NS: Final = 1_760_000_000_000_000_000
_BETWEEN_NS: Final = 60_000_000_000
# Time constants of the coupling capacitor before the recording starts. The wheel starts where the signal is its mean.
_SETTLED: Final = 6.0
# Chunks arrive at the ends of 10 ms slots, slightly late.
_HALF_SLOT_NS: Final = 5_000_000
# Largest change of speed within a run, to either side.
_DRIFT: Final = 0.005


@dataclass(frozen=True, slots=True)
class Recorded:
    """Inputs of a diagnosis.

    Attributes:
        paths: recordings; the vehicle's configuration, as declared, is in each.
        reverse: those made rolling backwards, as stated by the user.
    """

    paths: tuple[Path, ...]
    reverse: tuple[Path, ...]


def record(case: Case, folder: Path, seconds: float = SECONDS) -> Recorded:
    """Write a case's recordings into an existing, empty folder, and `declared.json`."""
    paths, reverse = [], []
    seeds = np.random.default_rng(case.order.number + 1).integers(0, 2**31, len(case.bench.runs))
    for index, (run, seed) in enumerate(zip(case.bench.runs, seeds.tolist(), strict=True)):
        scenario = scenario_of(case, run, seed, seconds)
        path = folder / f"run-{index + 1}.mcap"
        simulation = simulation_of(case, scenario, run, seed)
        _write(simulation, declared(scenario), path, _START_NS + index * _BETWEEN_NS, settling_s(case))
        paths.append(path)
        if run.reverse:
            reverse.append(path)
    names = {"recordings": [path.name for path in paths], "reverse": [path.name for path in reverse]}
    (folder / "declared.json").write_text(json.dumps(names, indent=1), encoding="utf-8")
    return Recorded(tuple(paths), tuple(reverse))


def scenario_of(
    case: Case, run: Run, seed: int, seconds: float, *, drift: float = _DRIFT, nodes: int = RING_NODES
) -> Scenario:
    """Return the scenario of one run, undeclared effects included.

    Args:
        case: the case.
        run: one of its runs.
        seed: of the run.
        seconds: length of the recording.
        drift: largest change of speed to either side, as a share.
        nodes: of the ring.
    """
    bench = case.bench
    bs, cw, rs, ts = bench.numbers
    begin = settling_s(case)
    change = run.speed_kmh * float(np.random.default_rng(seed).uniform(-drift, drift))
    document: dict[str, dict[str, Any]] = {
        "scenario": {"name": "rig", "duration_s": begin + seconds},
        "motion": {
            "speed_kmh": [[begin, run.speed_kmh - change], [begin + seconds, run.speed_kmh + change]],
            "direction": "reverse" if run.reverse else "forward",
        },
        "tire": {
            **{"radius_mm": bench.radius_mm, "Bs": bs, "Cw": cw, "Rs": rs, "Ts": ts},
            "reference_pressure_kpa": bench.reference_kpa,
            "sidewall_pressure_share": bench.pressure_share,
            "mass_kgpm": bench.mass_kgpm,
            "extension_stiffness_mn": EXTENSION_STIFFNESS_MN,
            "tread_stiffness_mpa": bench.tread_mpa,
            "ring_nodes": nodes,
            "cord_angle_deg": 0.0,
            **bench.lateral,
        },
        "sensor": {
            "rate_hz": bench.rate_hz,
            "noise_mg_rthz": list(bench.noise_mg_rthz),
            "offset_mm": bench.offset_mm,
        },
        "hub": {"hub": 0},
        "wheel": {
            **{"position": POSITION, "hub": 0, "wheel": 0, "load_n": run.load_n},
            **{"pressure_kpa": run.pressure_kpa, "temperature_degc": run.temperature_degc},
            **({"phase_deg": 180.0} if begin else {}),
        },
        "stated": {},
    }
    for table, values in case.tables.items():
        document.setdefault(table, {}).update(values)
    for table, key in case.per_load:
        document[table][key] *= run.load_n
    if run.reverse:
        for table, key in case.mirrored:
            document[table][key] = -document[table][key]
    wheel = {**document.pop("wheel"), "stated": document.pop("stated")}
    text = toml_text({**document, "hub": [document["hub"]], "wheel": [wheel]})
    return parse_scenario(text, "rig")


def settling_s(case: Case) -> float:
    """Return how long a run must go on before it is recorded: a coupling capacitor charges before the measurement.

    Whole periods of the hello, so that a recording begins with one.
    """
    sensor = case.tables.get("sensor", {})
    if sensor.get("coupling") != "ac":
        return 0.0
    times = _SETTLED / (2.0 * math.pi * sensor["highpass_hz"])
    return HELLO_PERIOD_S * math.ceil(times / HELLO_PERIOD_S)


def simulation_of(case: Case, scenario: Scenario, run: Run, seed: int) -> Simulation:
    """Return the simulation of a run, with the effects that the simulator itself cannot make."""
    simulation = simulate(scenario, seed=seed)
    for wheel in simulation.wheels:
        fit_case(wheel, case, run)
    return simulation


def fit_case(wheel: WheelSimulator, case: Case, run: Run) -> None:
    """Put what the simulator itself cannot make before and behind a wheel's sensor."""
    if case.bend is not None:
        bent: Any = BentChain(wheel.chain, case.bend)
        wheel.chain = bent
    if case.disturbance is not None:
        rotation = wheel.plan.rotation(wheel.phase_rad)
        chain: Any = DisturbedChain(wheel.chain, rotation, case.disturbance, run.reverse)
        wheel.chain = chain
    if case.fault is not None:
        faulty: Any = FaultyChain(wheel.chain, case.fault())
        wheel.chain = faulty


def declared(scenario: Scenario) -> str:
    """Return the vehicle's configuration: stated load, radius, pressure and mounting, no dimensionless numbers."""
    config: dict[str, Any] = tomllib.loads(vehicle_toml(scenario))
    for wheel in config["wheel"]:
        tire: Mapping[str, Any] = wheel["tire"]
        wheel["tire"] = {key: tire[key] for key in ("radius_mm", "pressure_kpa", "temperature_degc")}
    return toml_text(config)


def _write(simulation: Simulation, toml: str, path: Path, start_ns: int, begin_s: float) -> None:
    first_ns = last_ns = start_ns + round(begin_s * 1e9)
    writer = RecordingWriter(path, start_ns=first_ns, vehicle_toml=toml, sources=[LINK])
    try:
        writer.write(LinkEvent(LINK, first_ns, LinkEventKind.CONNECTED, "rig"))
        for chunk in simulation.chunks(LINK, start_ns):
            if not begin_s or chunk.host_ns > first_ns + _HALF_SLOT_NS:
                writer.write(chunk)
                last_ns = chunk.host_ns
        writer.write(LinkEvent(LINK, last_ns, LinkEventKind.ENDED, "end of the run"))
    finally:
        writer.close()
