"""Simulated recordings for programs, in memory or in a file."""

import math
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from gateway import __version__
from gateway.api.recording_access import Recording, recording_of
from gateway.core.clock import Clock, SystemClock
from gateway.core.config.document_tables import document_text
from gateway.core.errors import OutputError, SourceError
from gateway.core.links.source import Chunk, LinkItem
from gateway.core.reasons import Reason
from gateway.core.recording.reader import RecordingInfo, RecordingReader
from gateway.core.recording.writer import RecordingWriter, whole_recording
from gateway.core.session.program_arguments import Config, PathLike
from gateway.simulator.link_faults import parse_faults
from gateway.simulator.scenario import load_scenario, parse_scenario, vehicle_toml
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import simulate as make_simulation
from gateway.simulator.simulator_source import SimulatorSource, link_name

_IN_MEMORY = "scenario"


def simulate(
    scenario: str | Path | Mapping[str, Any],
    *,
    out: PathLike | None = None,
    duration_s: float | None = None,
    seed: int | None = None,
    faults: Sequence[str] = (),
    keys: PathLike | None = None,
    config: Config | None = None,
    estimators: str | Sequence[str] = (),
) -> Recording:
    """Simulate hubs and tires, and return the recording with `truth`, the true state of every wheel.

    Args:
        scenario: built-in name (`lab`, `demo`), TOML file, or the tables of a scenario as a dictionary:
            `{"motion": {"speed_kmh": 80}, "wheel": [{"position": "FL", "wheel": 0, "load_n": 4000}]}`.
        out: new recording (.mcap) to write; None to keep it in memory, about 70 kB per wheel and second.
        duration_s: length; None for the scenario's.
        seed: of the random numbers; None for the scenario's.
        faults: of the link, `drop:rate=0.01`, as for `--fault` of `treadlink simulate`.
        keys: file with the keys to sign frames with.
        config: vehicle configuration for the estimates; None for the one of the scenario.
        estimators: names of the estimators for `estimates`; none for the default ones.

    Raises:
        SourceError: no such scenario, or it is endless and has no length.
        ConfigError: the scenario has faults.
        OutputError: `out` is no .mcap file.
        RecordingError: `out` exists or cannot be written.
    """
    loaded, name = _loaded(scenario)
    used_seed = loaded.scenario.seed if seed is None else seed
    key_file = None if keys is None else Path(keys)
    simulation = make_simulation(
        loaded, seed=seed, duration_s=duration_s, faults=tuple(parse_faults(faults, used_seed)), key_file=key_file
    )
    if simulation.duration_s is None:
        raise SourceError(f"scenario '{name}' is endless", "Give a length, for example duration_s=30.")
    clock, toml = SystemClock(), vehicle_toml(loaded, signed=key_file is not None)
    source = SimulatorSource(simulation, link_name(name), toml, math.inf, clock)
    uri = f"sim:{quote(name)}?seed={used_seed}"
    file = SimulatedFile(source, uri, clock.now_ns()) if out is None else _written(source, Path(out), uri, clock)
    return recording_of(file, config=config, keys=key_file, estimators=estimators, truth=simulation.truth)


def _loaded(scenario: str | Path | Mapping[str, Any]) -> tuple[Scenario, str]:
    if isinstance(scenario, Mapping):
        tables = dict(scenario)
        header = tables.get("scenario")
        named = header.get("name") if isinstance(header, Mapping) else None
        return parse_scenario(document_text(tables, _IN_MEMORY), _IN_MEMORY), str(named or _IN_MEMORY)
    return load_scenario(str(scenario)), str(scenario)


class SimulatedFile:
    """A simulated recording in memory.

    Attributes:
        damage: None; everything can be read.
        position: bytes read so far in the current pass.
    """

    def __init__(self, source: SimulatorSource, uri: str, start_ns: int) -> None:
        """Run the simulation of a source to its end."""
        self.damage: Reason | None = None
        self.position = 0
        self._items = list(source.items(threading.Event()))
        size = sum(len(item.data) for item in self._items if isinstance(item, Chunk))
        self.info = RecordingInfo(
            path=Path(source.link.partition(":")[2]),
            size_bytes=size,
            finished=True,
            treadlink=__version__,
            start_ns=start_ns,
            sources=(uri,),
            vehicle_toml=source.vehicle_toml,
        )

    @property
    def vehicle_toml(self) -> str | None:
        """Vehicle configuration of the scenario."""
        return self.info.vehicle_toml

    def items(self) -> Iterator[LinkItem]:
        """Yield the items of the link in order."""
        self.position = 0
        for item in self._items:
            if isinstance(item, Chunk):
                self.position += len(item.data)
            yield item


def _written(source: SimulatorSource, path: Path, uri: str, clock: Clock) -> RecordingReader:
    """Run the simulation into a new file, which is removed when it does not become complete."""
    if path.suffix != ".mcap":
        raise OutputError(
            f"'{path}' does not end in .mcap", "`treadlink simulate --out FILE.bin` writes the bytes of the link."
        )
    part = RecordingWriter(path, start_ns=clock.now_ns(), vehicle_toml=source.vehicle_toml, sources=[uri], in_part=True)
    with whole_recording(part) as writer:
        for item in source.items(threading.Event()):
            writer.write(item)
    return RecordingReader(path)
