"""Contract of every registered estimator."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.errors import ConfigError
from gateway.core.estimates.estimator import AngleAverage, Estimate, Revolution, Status, TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.registry import DEFAULT_ESTIMATORS, ESTIMATORS, make_estimator
from gateway.core.reasons import Reason
from tests.testkit.exact_ring import RADIUS_M, solution
from tests.testkit.revolution_data import CONDITIONS, exact_wave, make_revolution, settled

GOOD = make_revolution(exact_wave(solution()))
NAN = math.nan


def empty_average(average: AngleAverage) -> AngleAverage:
    return replace(
        average,
        count=0,
        effective_count=0.0,
        radial_mps2=np.full(1024, NAN),
        scatter_mps2=np.full(1024, NAN),
        orders_mps2=np.full(61, complex(NAN, NAN)),
        orders_std_mps2=np.full(61, NAN),
        leading_edge_rad=NAN,
        trailing_edge_rad=NAN,
        leading_edge_std_rad=NAN,
        trailing_edge_std_rad=NAN,
    )


CASES: dict[str, tuple[Revolution, AngleAverage, TireConditions]] = {
    "good": (GOOD, settled(GOOD), CONDITIONS),
    "first": (GOOD, settled(GOOD, 1), CONDITIONS),
    "no load": (GOOD, settled(GOOD), TireConditions(radius_m=RADIUS_M)),
    "nan radius": (GOOD, settled(GOOD), TireConditions(radius_m=NAN)),
    "faults": (replace(GOOD, faults=(Reason(EstimateCode.SAMPLES_LOST),), saturated=True), settled(GOOD), CONDITIONS),
    "empty average": (GOOD, empty_average(settled(GOOD)), CONDITIONS),
    "nan revolution": (
        replace(
            GOOD,
            radial_mps2=np.full(1024, NAN),
            orders_mps2=np.full(61, complex(NAN, NAN)),
            order_max=0,
            leading_edge_rad=NAN,
            trailing_edge_rad=NAN,
            leading_edge_std_rad=NAN,
            trailing_edge_std_rad=NAN,
            noise_mps2=NAN,
        ),
        settled(GOOD),
        CONDITIONS,
    ),
    "nan stds": (GOOD, replace(settled(GOOD), orders_std_mps2=np.full(61, NAN), trailing_edge_std_rad=NAN), CONDITIONS),
}


def check(estimates: tuple[Estimate, ...]) -> None:
    for estimate in estimates:
        if estimate.status is Status.INVALID:
            assert math.isnan(estimate.value)
            assert estimate.reasons
        else:
            assert math.isfinite(estimate.value)
            assert not estimate.std < 0.0
        if estimate.status is Status.PROVISIONAL:
            assert estimate.reasons


@pytest.mark.parametrize("name", list(ESTIMATORS))
def test_never_raises_and_keeps_its_names(name: str) -> None:
    estimator = make_estimator(name)
    assert estimator.name == name
    columns = [e.name for e in estimator.update(*CASES["good"])]
    assert len(set(columns)) == len(columns)
    for case in CASES:
        for which in (case, "good"):
            estimates = estimator.update(*CASES[which])
            check(estimates)
            assert [e.name for e in estimates] == columns, case


@pytest.mark.parametrize("name", list(ESTIMATORS))
def test_reset_restores_the_initial_state(name: str) -> None:
    estimator = make_estimator(name)
    first = [repr(estimator.update(*case)) for case in CASES.values()]
    estimator.reset()
    assert [repr(estimator.update(*case)) for case in CASES.values()] == first


def test_default_estimators_have_distinct_names() -> None:
    assert DEFAULT_ESTIMATORS[0] == "kinematic"
    names = [e.name for default in DEFAULT_ESTIMATORS for e in make_estimator(default).update(*CASES["good"])]
    assert len(set(names)) == len(names)


def test_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="nonsense") as caught:
        make_estimator("nonsense")
    assert "ring-paper" in caught.value.remedy
