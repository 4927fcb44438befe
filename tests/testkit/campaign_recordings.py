"""Recordings of simulated wheels for campaigns."""

from collections.abc import Callable, Sequence
from pathlib import Path

from gateway.core.config.validation import parse_document
from gateway.core.recording.writer import RecordingWriter
from gateway.simulator.scenario import vehicle_toml
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import simulate

START_NS = 1_700_000_000 * 10**9


def write_recording(
    path: Path,
    tables: str = "",
    *,
    wheels: tuple[str, ...] = ("",),
    duration_s: float = 8.0,
    seed: int = 1,
    start_ns: int = START_NS,
    configured: bool = True,
    link: str = "sim",
    change: Callable[[str], str] = str,
    positions: Sequence[str] = (),
) -> Path:
    """Write a recording of wheels with further keys each and a changed configuration; return its path.

    The positions are W0, W1, ... unless given.
    """
    text = f"[scenario]\nseed = {seed}\n{tables}\n"
    for number, keys in enumerate(wheels):
        position = positions[number] if positions else f"W{number}"
        text += f"[[wheel]]\nposition = '{position}'\nwheel = {number}\nsensor_id = '0000b00{number}'\n{keys}\n"
    scenario = parse_document(Scenario, text, "test")
    toml = change(vehicle_toml(scenario)) if configured else None
    writer = RecordingWriter(path, start_ns=start_ns, vehicle_toml=toml, sources=(link,))
    for chunk in simulate(scenario, duration_s=duration_s).chunks(link, start_ns):
        writer.write(chunk)
    writer.close()
    return path
