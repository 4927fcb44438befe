"""A case as recordings: the real bytes of a simulated hub, with what was declared and nothing else."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from closure_rig.bench import EXTENSION_STIFFNESS_MN, RING_NODES, Run
from closure_rig.draw import Case
from closure_rig.outside import DisturbedChain
from gateway.config.toml_writer import toml_text
from gateway.io.source import LinkEvent, LinkEventKind
from gateway.recording.writer import RecordingWriter
from gateway.simulator.scenario import parse_scenario, vehicle_toml
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import Simulation, simulate

SECONDS: Final = 8.0
LINK: Final = "sim:rig"
POSITION: Final = "W"
# A fixed day; a minute from run to run.
_START_NS: Final = 1_760_000_000_000_000_000
_BETWEEN_NS: Final = 60_000_000_000
# A run's speed changes by up to so much to either side.
_DRIFT: Final = 0.005


@dataclass(frozen=True, slots=True)
class Recorded:
    """What a diagnosis gets to see.

    Attributes:
        paths: recordings; the vehicle's configuration, as declared, is in each.
        reverse: those made rolling the other way round, which the user states.
    """

    paths: tuple[Path, ...]
    reverse: tuple[Path, ...]


def record(case: Case, folder: Path, seconds: float = SECONDS) -> Recorded:
    """Write a case's recordings into an existing, empty folder, and `declared.json` beside them."""
    paths, reverse = [], []
    seeds = np.random.default_rng(case.order.number + 1).integers(0, 2**31, len(case.bench.runs))
    for index, (run, seed) in enumerate(zip(case.bench.runs, seeds.tolist(), strict=True)):
        scenario = scenario_of(case, run, seed, seconds)
        path = folder / f"run-{index + 1}.mcap"
        _write(simulation_of(case, scenario, run, seed), declared(scenario), path, _START_NS + index * _BETWEEN_NS)
        paths.append(path)
        if run.reverse:
            reverse.append(path)
    names = {"recordings": [path.name for path in paths], "reverse": [path.name for path in reverse]}
    (folder / "declared.json").write_text(json.dumps(names, indent=1), encoding="utf-8")
    return Recorded(tuple(paths), tuple(reverse))


def scenario_of(case: Case, run: Run, seed: int, seconds: float) -> Scenario:
    """Return the scenario of one run, what is wrong included."""
    bench = case.bench
    bs, cw, rs, ts = bench.numbers
    drift = run.speed_kmh * float(np.random.default_rng(seed).uniform(-_DRIFT, _DRIFT))
    document: dict[str, dict[str, Any]] = {
        "scenario": {"name": "rig", "duration_s": seconds},
        "motion": {
            "speed_kmh": [[0.0, run.speed_kmh - drift], [seconds, run.speed_kmh + drift]],
            "direction": "reverse" if run.reverse else "forward",
        },
        "tire": {
            **{"radius_mm": bench.radius_mm, "Bs": bs, "Cw": cw, "Rs": rs, "Ts": ts},
            "reference_pressure_kpa": bench.reference_kpa,
            "sidewall_pressure_share": bench.pressure_share,
            "mass_kgpm": bench.mass_kgpm,
            "extension_stiffness_mn": EXTENSION_STIFFNESS_MN,
            "tread_stiffness_mpa": bench.tread_mpa,
            "ring_nodes": RING_NODES,
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
        },
        "stated": {},
    }
    for table, values in case.tables.items():
        document.setdefault(table, {}).update(values)
    if run.reverse:
        for table, key in case.mirrored:
            document[table][key] = -document[table][key]
    wheel = {**document.pop("wheel"), "stated": document.pop("stated")}
    text = toml_text({**document, "hub": [document["hub"]], "wheel": [wheel]})
    return parse_scenario(text, "rig")


def simulation_of(case: Case, scenario: Scenario, run: Run, seed: int) -> Simulation:
    """Return the run being simulated, with what the simulator itself cannot do."""
    simulation = simulate(scenario, seed=seed)
    if case.disturbance is not None:
        for wheel in simulation.wheels:
            rotation = wheel.plan.rotation(wheel.phase_rad)
            chain: Any = DisturbedChain(wheel.chain, rotation, case.disturbance, run.reverse)
            wheel.chain = chain
    return simulation


def declared(scenario: Scenario) -> str:
    """Return the vehicle's configuration: load, radius, pressure and mounting as stated, but no numbers of the tire."""
    config: dict[str, Any] = tomllib.loads(vehicle_toml(scenario))
    for wheel in config["wheel"]:
        tire: Mapping[str, Any] = wheel["tire"]
        wheel["tire"] = {key: tire[key] for key in ("radius_mm", "pressure_kpa", "temperature_degc")}
    return toml_text(config)


def _write(simulation: Simulation, toml: str, path: Path, start_ns: int) -> None:
    writer = RecordingWriter(path, start_ns=start_ns, vehicle_toml=toml, sources=[LINK])
    try:
        writer.write(LinkEvent(LINK, start_ns, LinkEventKind.CONNECTED, "rig"))
        last_ns = start_ns
        for chunk in simulation.chunks(LINK, start_ns):
            writer.write(chunk)
            last_ns = chunk.host_ns
        writer.write(LinkEvent(LINK, last_ns, LinkEventKind.ENDED, "end of the run"))
    finally:
        writer.close()
