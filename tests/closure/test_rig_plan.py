"""The rig's plan: detection limits, cases of wanted strength, fair samples, and runs that can be continued."""

import json
import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from closure_rig.bench import draw_campaign
from closure_rig.causes import CAUSES
from closure_rig.draw import Case, Kind, Order, Parts
from closure_rig.limit import DETECTION_CHI2, Strength, noise_density
from closure_rig.outside import STRANGERS
from closure_rig.plan import Planned, make, plan, remake, sampled
from closure_rig.record import SECONDS
from closure_rig.rivals import Rivals
from closure_rig.run import read, run
from closure_rig.store import Store
from closure_rig.truth import State, numbers_of, parameters_of

from gateway.closure.effects.effect import BaselineModel
from gateway.constants import STANDARD_GRAVITY_MPS2

BENCH = draw_campaign(np.random.default_rng(3))
NOTHING = Parts(BENCH, outside=False).case(Order(Kind.NOTHING, 1), {})
# A version of the gateway that names a gain of 1 % whatever it gets.
FAKE = {
    "__init__.py": "__version__ = 'fake'",
    "closure/__init__.py": "",
    "closure/effects/__init__.py": "",
    "closure/effects/effect.py": "from enum import StrEnum\nclass BaselineModel(StrEnum):\n    EXACT = 'exact'",
    "session/__init__.py": "",
    "session/campaign_diagnosis.py": """
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
