"""The accuracy bench measures what it says, and the weak form stays within its targets on the base case."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from accuracy.cases import BASE_RING, MEASURED_WAVES, RADIUS_M, Case, all_cases, grid_cases, quick_cases
from accuracy.measure import Effort, Outcome, Sample, measure
from accuracy.signals import samples_of, truth_of
from accuracy.tables import case_tables, grid_tables, percent, use_tables

from gateway.estimators.estimator import Estimate, Status

SMALL = Effort(clean=6, single=8, single_slow=0, runs=2)
NAMES = ("kinematic", "weak-form", "load", "wear")


@pytest.fixture(scope="module")
def base() -> Outcome:
    return measure(Case("noise", "base"), NAMES, SMALL)


def test_targets_of_the_weak_form_and_of_speed(base: Outcome) -> None:
    """The study's targets at 5000 N: bias without noise, spread of one revolution against the bound."""
    for name, bias in (("Bs", 0.006), ("Cw", 0.004), ("Rs", 0.004), ("Ts", 0.03)):
        assert abs(base.clean["weak-form", name].bias) < bias
        assert 0.4 < base.single["weak-form", name].std / base.bound[name] < 4.0
    assert abs(base.clean["kinematic", "speed_mps"].bias) < 1e-5
    assert base.single["kinematic", "speed_mps"].std < 5e-5
    assert abs(base.clean["kinematic", "half_angle_rad"].bias) < 0.025
    assert abs(base.clean["wear", "wear_mm"].bias) < 0.02
    assert abs(base.clean["load", "load_by_width_n"].bias) < 0.003


def test_averaging_helps_by_the_root_of_the_count(base: Outcome) -> None:
    many, single = base.long["weak-form", "Cw"], base.single["weak-form", "Cw"]
    assert many.rms < 0.4 * single.rms
    assert len(many.errors) == 2
    assert len(single.errors) == 8


def test_samples_are_repeatable_and_as_requested() -> None:
    case = Case("noise", "base", waves=(MEASURED_WAVES,), road_rms_mps2=2.0, hub_rms_mps2=1.0, jitter_m=0.002)
    first, again = (samples_of(case, 3, np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(first.counts, again.counts)
    radial = first.counts[:, 2] * first.range_mps2 / 32767
    revolution = 2.0 * math.pi / case.omega_radps * case.rate_hz
    assert len(radial) >= 5 * revolution
    assert radial.mean() == pytest.approx(RADIUS_M * case.omega_radps**2, rel=0.02)
    quiet = samples_of(Case("noise", "base"), 3, np.random.default_rng(5), noise=False)
    assert np.abs(quiet.counts).max() > 30000  # as fine as 16 bit go


def test_errors_are_relative_except_for_values_near_zero() -> None:
    sample = Sample()
    sample.add(Estimate("Bs", 2.2, 0.1, Status.VALID), 2.0)
    sample.add(Estimate("Bs", math.nan, math.nan, Status.INVALID, "no"), 2.0)
    assert (sample.bias, sample.valid, sample.asked) == (pytest.approx(0.1), 1, 2)
    assert sample.worth == pytest.approx(2.0)
    wear = Sample()
    wear.add(Estimate("wear_mm", 0.3, 0.1, Status.VALID), 0.0)
    assert wear.bias == pytest.approx(0.3)


def test_tables_show_every_estimator_with_results(base: Outcome) -> None:
    tables = [*case_tables([base], NAMES, "noise"), *use_tables([base])]
    text = "\n".join(table.text(markdown=False) for table in tables)
    assert "weak-form" in text
    assert percent(base.long["weak-form", "Bs"].bias, 2) in text
    assert percent(base.long["kinematic", "speed_mps"].bias) in text
    rows = [line for line in tables[0].text(markdown=True).splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in rows}) == 1
    assert not list(grid_tables([base], NAMES))


def test_grid_matches_paper_and_variants_differ() -> None:
    assert len(list(grid_cases())) == 27
    cases = all_cases()
    assert len({(case.group, case.name) for case in cases}) == len(cases)
    assert {case.rate_hz for case in cases} == {2000.0, 9600.0}
    assert {case.noise_mg_rthz for case in cases} == {0.125, 5.0, 15.0, 70.0}
    assert all(case in cases for case in quick_cases())
    worn = next(case for case in grid_cases() if case.wear_mm == 6.4)
    assert truth_of(worn).numbers.Bs < 0.3 * BASE_RING.numbers(worn.pressure_pa).Bs
