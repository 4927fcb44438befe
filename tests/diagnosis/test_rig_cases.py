"""The blind rig: reproducible cases, readable recordings, sealed labels; its plan, and runs that can be continued."""

import json
import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from closure_rig.bench import draw_campaign
from closure_rig.causes import CAUSES, SIZES
from closure_rig.draw import Case, Kind, Order, Parts, blind, draw, pair
from closure_rig.limit import DETECTION_CHI2, Strength, noise_density
from closure_rig.outside import STRANGERS
from closure_rig.plan import Planned, make, plan, remake, sampled
from closure_rig.record import SECONDS, declared, record, scenario_of, simulation_of
from closure_rig.rivals import Rivals
from closure_rig.run import read, run
from closure_rig.seal import SealBrokenError, open_label, seal
from closure_rig.store import Store
from closure_rig.truth import State, numbers_of, parameters_of

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Hello, SampleBlock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.links.source import Chunk
from gateway.core.recording.reader import RecordingReader
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.effects.effect import BaselineModel
from gateway.ring.rolling_ring import RingParameters, solve_rolling_ring

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


BENCH = draw_campaign(np.random.default_rng(3))
NOTHING = Parts(BENCH, outside=False).case(Order(Kind.NOTHING, 1), {})
# A version of the gateway that names a gain of 1 % whatever it gets.
FAKE = {
    "__init__.py": "__version__ = 'fake'",
    "diagnosis/__init__.py": "",
    "diagnosis/effects/__init__.py": "",
    "diagnosis/effects/effect.py": "from enum import StrEnum\nclass BaselineModel(StrEnum):\n    EXACT = 'exact'",
    "diagnosis/campaign_diagnosis.py": """
from types import SimpleNamespace as S
def diagnose_recordings(paths, *, model, jobs, reverse):
    assert all(path.is_file() for path in paths) and 'labels' not in str(paths)
    fitted = S(quantity='Bs', state=None, value=1e-3, std=1e-4)
    gain = S(name='gain', verdict='named', probability=0.9, rivals=(), chi2=30.0,
             parameters={'error': S(value=0.01, std=0.001)})
    return S(findings=(gain,), unexplained=(), noise_floor_mps2=1.0, determined={'Bs': False},
             revolutions=7, rejected=0, held_out=S(rms_before_mps2=2.0, rms_after_mps2=float('nan')),
             estimates_before={'Bs': fitted}, estimates_after={'Bs': fitted})
""",
}


def single(name: str, size: float, *, outside: bool = False) -> Case:
    """A case of one effect on the bench."""
    parts = Parts(BENCH, outside=outside)
    parts.add(name, size, np.random.default_rng(1))
    sizes = {name: {"value": size, "seed": 1, "strength": 1.0}}
    return parts.case(Order(Kind.OUTSIDE if outside else Kind.EFFECT, 1, (name,)), sizes)


@pytest.fixture(scope="module")
def strength() -> Strength:
    return Strength(BENCH, NOTHING)


def test_strength_of_camber_is_that_of_its_constant(strength: Strength) -> None:
    # Order 0 of the lateral axis, which no number of the tire can take.
    change = STANDARD_GRAVITY_MPS2 * math.sin(math.radians(1.0))
    noise = noise_density(BENCH)[1] / math.sqrt(2.0 * SECONDS)
    expected = change / noise * math.sqrt(len(BENCH.runs) / DETECTION_CHI2)
    assert strength(single("camber", 1.0)) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("name", ["gain", "run-out", "structural damping", "sample clock error", "rolling radius"])
def test_strength_is_in_proportion_to_the_size(strength: Strength, name: str) -> None:
    size = next(entry.sizes[0] for entry in CAUSES if entry.name == name)
    assert strength(single(name, 3.0 * size)) == pytest.approx(3.0 * strength(single(name, size)), rel=0.02)


def test_tire_takes_its_own_parameters(strength: Strength) -> None:
    stiffer = replace(BENCH, numbers=(BENCH.numbers[0] * 1.003, *BENCH.numbers[1:]), tread_mpa=BENCH.tread_mpa * 1.01)
    changed = replace(NOTHING, bench=stiffer)
    remainder = strength.contribution(changed)
    assert float(remainder @ remainder) < 1.0


def test_random_effects_grow_with_the_square_when_weak(strength: Strength) -> None:
    weak, strong = (strength(single("road vibration", size)) for size in (0.02, 0.04))
    # Chi-square of a power is that of its square: four times the strength for twice the size.
    assert strong == pytest.approx(4.0 * weak, rel=0.05)


def test_made_case_has_the_wanted_strength() -> None:
    planned = Planned(7, Kind.EFFECT, ("mounting offset",), (2.0,), BaselineModel.EXACT, 5)
    case = make(planned)
    entry = case.label["sizes"]["mounting offset"]
    assert entry["strength"] == pytest.approx(2.0, rel=0.05)
    assert remake(planned, case.label["sizes"]).label == case.label
    assert case.label["truth"] == ["mounting offset"]
    assert 2 <= len(case.bench.runs) <= 3


def test_plan_has_every_kind_and_effect_at_every_strength() -> None:
    cases = plan(1)
    assert plan(1) == cases
    assert plan(2) != cases
    kinds = Counter(case.stratum for case in cases)
    assert kinds["effect"] >= 300
    assert kinds["pair"] == 100
    assert kinds["nothing"] == 300
    assert kinds["outside"] >= 150
    assert {name for case in cases for name in case.names} == {e.name for e in (*CAUSES, *STRANGERS)}
    gains = [case.strengths[0] for case in cases if case.names == ("gain",) and case.stratum == "effect"]
    assert min(gains) < 0.6 < 5.0 < max(gains)
    models = Counter(case.model for case in cases)
    assert models[BaselineModel.EXACT] > 600
    assert min(models.values()) > 40


def test_beginning_of_a_sample_is_fair() -> None:
    cases = plan(1)
    some = sampled(cases, 1)[:93]
    counts, everything = Counter(case.stratum for case in some), Counter(case.stratum for case in cases)
    assert all(abs(counts[name] - 0.1 * everything[name]) < 2.0 for name in everything)
    assert sampled(cases, 1)[:40] == some[:40]


def test_rival_that_cannot_be_told_apart() -> None:
    both = Rivals(single("rolling radius", 0.01))
    assert both.alike("rolling radius", "sample clock error")
    assert not both.alike("rolling radius", "camber")
    assert not both.alike("rolling radius", "road vibration")
    assert not Rivals(single("roll tilt", 1.0)).alike("roll tilt", "gain")


def test_truth_of_numbers_and_parameters() -> None:
    truth = numbers_of(NOTHING)
    run = BENCH.runs[0]
    values = truth[State(run.load_n, run.pressure_kpa * 1e3)]
    assert values["Cw"] == pytest.approx(BENCH.numbers[1], rel=1e-3)
    assert values["Bs/Cw"] == pytest.approx(values["Bs"] / values["Cw"])
    assert 0.1 < values["contact_half_angle_rad"] < 0.5
    gain = single("gain", 2.0)
    assert abs(parameters_of(gain)["gain"]["error"]) == pytest.approx(0.02)
    offset = parameters_of(single("mounting offset", 0.5))["mounting offset"]["offset_m"]
    assert abs(offset) == pytest.approx(5e-4)
    for entry in CAUSES:
        true = parameters_of(single(entry.name, entry.sizes[2])).get(entry.name, {})
        assert all(math.isfinite(value) for value in true.values())


def test_bending_that_rolls_lacks_rotary_inertia() -> None:
    case, inertia_kgm = single("rotary inertia", 6e-4), 6e-4
    still, rolling = numbers_of(case), numbers_of(case, rolling=True)
    for state in still:
        squares = [
            (run.speed_kmh / 3.6) ** 2
            for run in BENCH.runs
            if (run.load_n, run.pressure_kpa * 1e3) == (state.load_n, state.pressure_pa)
        ]
        bending_nm2 = still[state]["Bs"] * (1e-3 * BENCH.radius_mm) ** 4 * state.pressure_pa
        share = inertia_kgm * sum(squares) / len(squares) / bending_nm2
        assert rolling[state]["Bs"] == pytest.approx(still[state]["Bs"] * (1.0 - share))
        assert 0.002 < share < 0.3
    assert numbers_of(NOTHING, rolling=True) == numbers_of(NOTHING)


def test_true_half_angle_is_that_at_the_sensor() -> None:
    """A high spot at the sensor meets the road under more load, with a longer contact; one opposite, a shorter one."""
    case = single("run-out", 1.0)
    height = math.cos(math.radians(case.tables["tire"]["runout_deg"]))
    plain, with_runout = numbers_of(NOTHING), numbers_of(case)
    for state, values in with_runout.items():
        longer = values["contact_half_angle_rad"] / plain[state]["contact_half_angle_rad"] - 1.0
        # The half angle grows with about half of the load's share, which a millimetre changes by some percent.
        assert 0.004 < longer / height < 0.06
        assert values["Cw"] == plain[state]["Cw"]


def test_run_continues_and_judges_the_version_given(tmp_path: Path) -> None:
    for name, text in FAKE.items():
        path = tmp_path / "version" / "gateway" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    store = Store(tmp_path / "cases", 1)
    small = [case for case in store.cases if case.kind is Kind.NOTHING and case.model is BaselineModel.EXACT][:2]
    results = tmp_path / "fake.jsonl"
    first = list(run(store, small[:1], tmp_path / "version", results, jobs=1, timeout_s=60.0))
    assert first[0]["outcome"] == "false alarm"
    assert first[0]["gateway"] == "fake"
    assert first[0]["probability"] == {"gain": 0.9}
    assert first[0]["held_out"]["after_mps2"] is None
    assert [entry["determined"] for entry in first[0]["numbers"]] in ([False, False], [])
    with results.open("a") as file:
        file.write('{"number": 3, "half')
    again = list(run(store, small, tmp_path / "version", results, jobs=1, timeout_s=60.0))
    assert [line["number"] for line in again] == [small[1].number]
    assert len(read(results)) == 2


def test_fault_of_a_diagnosis_is_a_result(tmp_path: Path) -> None:
    (tmp_path / "gateway").mkdir()
    (tmp_path / "gateway" / "__init__.py").write_text("raise RuntimeError('no such gateway')")
    store = Store(tmp_path / "cases", 1)
    case = next(case for case in store.cases if case.kind is Kind.NOTHING)
    (line,) = run(store, [case], tmp_path, tmp_path / "none.jsonl", jobs=1, timeout_s=60.0)
    assert line["outcome"] == "failed"
    assert "RuntimeError: no such gateway" in line["fault"]


def test_store_keeps_to_its_seed_and_seals_labels(tmp_path: Path) -> None:
    store = Store(tmp_path, 1)
    case = next(case for case in store.cases if case.kind is Kind.NOTHING)
    stored = store.get(case)
    assert sorted(path.name for path in stored.folder.iterdir())[0] == "declared.json"
    assert not any("label" in path.name for path in stored.folder.iterdir())
    with pytest.raises(FileNotFoundError, match="stays sealed"):
        store.open_label(case, tmp_path / "none.json")
    before = [path.stat().st_mtime_ns for path in sorted(stored.folder.iterdir())]
    again = Store(tmp_path, 1).get(case)
    assert [path.stat().st_mtime_ns for path in sorted(again.folder.iterdir())] == before
    (tmp_path / "diagnosis.json").write_text("{}")
    assert store.open_label(case, tmp_path / "diagnosis.json")["model"] == json.loads(json.dumps(str(case.model)))
    with pytest.raises(ValueError, match="another folder"):
        Store(tmp_path, 2)
