"""The blind rig: reproducible cases, readable recordings, a null case without effects, and sealed labels."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from closure_rig.causes import CAUSES, SIZES
from closure_rig.draw import Case, Kind, Order, blind, draw, pair
from closure_rig.outside import STRANGERS
from closure_rig.record import declared, record, scenario_of, simulation_of
from closure_rig.seal import SealBrokenError, open_label, seal

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Hello, SampleBlock
from gateway.closure.effects.catalogue import catalogue
from gateway.config.vehicle import parse_vehicle
from gateway.io.source import Chunk
from gateway.physics.rolling_ring import RingParameters, solve_rolling_ring
from gateway.recording.reader import RecordingReader
from gateway.session.recording_pass import OpenedRecording, RecordingPass

NULL = Order(Kind.NOTHING, 3)


def samples(case: Case, run: int = 0, seconds: float = 1.0) -> np.ndarray:
    """The first samples of a run in m/s^2, (n, 3)."""
    scenario = scenario_of(case, case.bench.runs[run], 5, seconds)
    wheel = simulation_of(case, scenario, case.bench.runs[run], 5).wheels[0]
    return wheel.advance(seconds).counts * np.array(wheel.chain.scale_mps2)


def quiet(case: Case) -> Case:
    return replace(case, bench=replace(case.bench, noise_mg_rthz=(0.0, 0.0, 0.0)))


def test_seed_determines_case() -> None:
    order = Order(Kind.PAIR, 4, ("roll tilt", "torsional ripple"))
    assert draw(order).label == draw(order).label
    assert draw(order).label != draw(replace(order, seed=5)).label
    assert {draw(blind(seed)).label["kind"] for seed in range(40)} == {str(kind) for kind in Kind}
    assert blind(7) == blind(7)


def test_recordings_are_reproducible_and_readable(tmp_path: Path) -> None:
    results = []
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        made = record(draw(Order(Kind.EFFECT, 1, ("imbalance and hub motion",), 2)), tmp_path / name, seconds=1.5)
        assert [path.name for path in made.reverse] == ["run-7.mcap"]
        results.append([path.read_bytes() for path in made.paths])
    assert results[0] == results[1]
    recording = RecordingReader(tmp_path / "first" / "run-2.mcap")
    assert recording.vehicle_toml is not None
    vehicle = parse_vehicle(recording.vehicle_toml, "run")
    assert len(list(RecordingPass(OpenedRecording(recording, vehicle), ("kinematic",)))) > 10
    assert json.loads((tmp_path / "first" / "declared.json").read_text())["reverse"] == ["run-7.mcap"]


def test_null_case_is_exact_baseline_model() -> None:
    """No effect: an inextensible, undamped ring on a flat road, and nothing on the lateral axis but noise."""
    case = quiet(draw(NULL))
    bench, run = case.bench, case.bench.runs[2]
    scenario = scenario_of(case, run, 5, 1.0)
    wheel = simulation_of(case, scenario, run, 5).wheels[0]
    measured = wheel.advance(1.0).counts * np.array(wheel.chain.scale_mps2)
    assert np.abs(measured[:, 1]).max() < 0.2
    turning = wheel.plan.rotation(wheel.phase_rad).at(np.arange(len(measured)) / bench.rate_hz)
    growth = 1.0 + bench.pressure_share * (run.pressure_kpa / bench.reference_kpa - 1.0)
    plain = RingParameters.from_numbers(
        *bench.numbers, radius_m=bench.radius_mm * 1e-3, pressure_pa=bench.reference_kpa * 1e3,
        mass_kgpm=bench.mass_kgpm, tread_stiffness_npm2=bench.tread_mpa * 1e6, extension_stiffness_n=2e10,
    )  # fmt: skip
    ring = replace(
        plain,
        radial_stiffness_npm2=plain.radial_stiffness_npm2 * growth,
        tangential_stiffness_npm2=plain.tangential_stiffness_npm2 * growth,
    )
    solved = solve_rolling_ring(
        ring, run.load_n, run.pressure_kpa * 1e3, 0.0, nodes=1440, sensor_offset_m=bench.offset_mm * 1e-3
    )
    radial, along = solved.sensor.specific_force(turning.omega_radps[0], turning.omega_dot_radps2[0])
    theta = np.mod(turning.angle_rad + math.pi, 2 * math.pi) - math.pi
    scale = (turning.omega_radps / turning.omega_radps[0]) ** 2
    for axis, wave in ((2, radial), (0, along)):
        expected = np.interp(theta, solved.theta_rad, wave, period=2 * math.pi) * scale
        assert np.sqrt(np.mean((measured[:, axis] - expected) ** 2)) < 2e-3 * bench.highest_baseline_mps2


def test_every_cause_is_catalogued_and_changes_signal() -> None:
    missing = {entry.name for entry in CAUSES} - set(catalogue())
    assert not missing
    assert all(len(entry.sizes) == len(SIZES) for entry in (*CAUSES, *STRANGERS))


@pytest.mark.parametrize("name", [entry.name for entry in CAUSES if entry.name != "AC coupling"])
def test_signal_change_grows_with_cause_size(name: str) -> None:
    run = 5 if name == "gain-temperature drift" else 3
    changes = []
    for size in (0, 2):
        case = quiet(draw(Order(Kind.EFFECT, 2, (name,), size)))
        plain = replace(case, tables={}, mirrored=(), per_load=(), bend=None)
        if name == "rolling radius":
            stated = parse_vehicle(declared(scenario_of(case, case.bench.runs[run], 5, 1.0)), "rig").wheel[0].tire
            assert stated.radius_mm is not None
            changes.append(abs(stated.radius_mm - case.bench.radius_mm))
            continue
        with_it, without = samples(case, run, 0.5), samples(plain, run, 0.5)
        length = min(len(with_it), len(without))
        change = with_it[:length] - without[:length]
        changes.append(float(np.sqrt(np.mean(change**2))))
    assert changes[1] > 2.0 * changes[0] > 0.0


@pytest.mark.parametrize("name", [entry.name for entry in STRANGERS])
def test_effect_outside_catalogue_changes_signal_undeclared(name: str) -> None:
    case = draw(Order(Kind.OUTSIDE, 2, (name,), 2))
    assert case.label["truth"] == []
    assert case.label["outside"] == name
    plain = replace(quiet(case), tables={}, disturbance=None, bend=None, fault=None)
    assert np.abs(samples(quiet(case), 1) - samples(plain, 1)).max() > 0.5


def test_coupling_settles_before_recording(tmp_path: Path) -> None:
    case = quiet(draw(Order(Kind.EFFECT, 3, ("AC coupling",), 2)))
    record(replace(case, bench=replace(case.bench, runs=case.bench.runs[:1])), tmp_path, seconds=2.0)
    decoder = FrameDecoder()
    chunks = [item for item in RecordingReader(tmp_path / "run-1.mcap").items() if isinstance(item, Chunk)]
    messages = [frame.message for chunk in chunks for frame in decoder.feed(chunk.data)]
    assert any(isinstance(message, Hello) for message in messages[:4])
    blocks = [message for message in messages if isinstance(message, SampleBlock)]
    assert blocks[0].first_sample * 1e-4 > 0.9
    radial = np.concatenate([block.counts for block in blocks])[:, 2].astype(float)
    first, second = np.array_split(radial, 2)
    assert abs(first.mean()) < 0.05 * np.abs(radial).max()
    assert abs(second.mean() - first.mean()) < 0.05 * np.abs(radial).max()


def test_declaration_reveals_no_tire_parameters_or_truth() -> None:
    case = draw(Order(Kind.EFFECT, 9, ("mounting offset",), 2))
    text = declared(scenario_of(case, case.bench.runs[0], 5, 1.0))
    assert "Bs" not in text
    assert "offset_mm" in text
    stated = parse_vehicle(text, "rig").wheel[0]
    assert stated.mounting.offset_mm == pytest.approx(case.bench.offset_mm)
    assert case.tables["sensor"]["offset_mm"] != pytest.approx(case.bench.offset_mm)


def test_pairs_can_all_be_drawn() -> None:
    rng = np.random.default_rng(0)
    for seed in range(120):
        assert len(draw(Order(Kind.PAIR, seed, pair(rng))).label["truth"]) == 2


def test_label_stays_sealed_until_diagnosis(tmp_path: Path) -> None:
    label, path, diagnosis = draw(NULL).label, tmp_path / "label", tmp_path / "diagnosis.json"
    digest = seal(label, path)
    assert "nothing" not in path.read_text()
    with pytest.raises(FileNotFoundError, match="stays sealed"):
        open_label(path, digest, diagnosis)
    with pytest.raises(FileExistsError):
        seal(label, path)
    diagnosis.write_text("{}")
    assert open_label(path, digest, diagnosis) == json.loads(json.dumps(label))
    other = tmp_path / "other"
    seal({**label, "truth": ["gain"]}, other)
    path.write_text(other.read_text())
    with pytest.raises(SealBrokenError, match="not the label"):
        open_label(path, digest, diagnosis)
