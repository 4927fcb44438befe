"""An estimator of a plug-in can spoil only its own numbers."""

from __future__ import annotations

import json
import math
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.cli.stop_signals import stop_request
from gateway.estimators.estimator import Estimate, Status
from gateway.estimators.plugin_estimator import PluginEstimator
from gateway.reasons import Code, Reason
from gateway.views import wording
from tests.testkit.exact_ring import solution
from tests.testkit.revolution_data import CONDITIONS, exact_wave, make_revolution, settled

REVOLUTION = make_revolution(exact_wave(solution()))
AVERAGE = settled(REVOLUTION)

THINGS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.just(10**400),
    st.floats(),
    st.complex_numbers(),
    st.text(max_size=5),
    st.just("x" * 100_000),
    st.sampled_from([b"1", [1.0], {}, object(), np.ones(3), np.float32(2.0), np.array(1.0), Fraction(1, 3), ("a",)]),
    st.sampled_from([*Status, "valid", Reason(Code.NOT_SETTLED), Reason(Code.PLUGIN_FAILED, error="y" * 100_000)]),
)
ESTIMATES = st.builds(
    Estimate,
    st.one_of(st.just("a_number"), THINGS),
    st.one_of(st.floats(), THINGS),
    st.one_of(st.floats(), THINGS),
    st.one_of(st.sampled_from(Status), THINGS),
    st.one_of(st.just(()), THINGS, st.lists(THINGS, max_size=3).map(tuple)),
)
ERRORS = st.one_of(
    st.sampled_from([SystemExit, KeyboardInterrupt, GeneratorExit, MemoryError, RecursionError, StopIteration]),
    st.just(BaseException),
    st.just(ValueError),
).flatmap(lambda kind: st.builds(kind, st.one_of(st.just("z" * 100_000), st.integers(), st.text())))


class Scripted:
    """Estimator that does what it is told."""

    name = "scripted"

    def __init__(self, does: Callable[[], Any]) -> None:
        self.does = does

    def update(self, *_: object) -> Any:
        return self.does()

    def reset(self) -> None:
        self.does()


def raising(error: BaseException) -> Any:
    raise error


def updated(does: Callable[[], Any]) -> tuple[Estimate, ...]:
    return PluginEstimator("scripted", lambda: Scripted(does)).update(REVOLUTION, AVERAGE, CONDITIONS)


def check(estimates: tuple[Estimate, ...]) -> None:
    names = [estimate.name for estimate in estimates]
    assert len(set(names)) == len(names)
    for name, value, std, status, reasons in estimates:
        assert name.isascii()
        assert 0 < len(name) <= 60
        assert type(value) is float
        assert type(std) is float
        assert isinstance(status, Status)
        assert math.isnan(std) or 0.0 <= std < math.inf
        assert math.isfinite(value) == (status is not Status.INVALID)
        assert reasons or status is not Status.INVALID
        for reason in reasons:
            assert len(json.dumps(wording.as_json(reason), allow_nan=False)) < 3000


@given(st.one_of(THINGS, ESTIMATES, st.lists(st.one_of(ESTIMATES, ESTIMATES, THINGS), max_size=4)))
def test_estimates_are_usable_whatever_a_plugin_returns(returned: Any) -> None:
    check(updated(lambda: returned))


@given(ERRORS)
def test_what_an_estimator_raises_makes_its_estimates_invalid(error: BaseException) -> None:
    estimates = updated(lambda: raising(error))
    check(estimates)
    assert [estimate.reasons[0].code for estimate in estimates] == [Code.PLUGIN_FAILED]


@given(ERRORS)
def test_estimator_that_cannot_be_made_or_reset_is_invalid(error: BaseException) -> None:
    unmade = PluginEstimator("scripted", lambda: raising(error))
    check(unmade.update(REVOLUTION, AVERAGE, CONDITIONS))
    unready = PluginEstimator("scripted", lambda: Scripted(lambda: raising(error)))
    unready.reset()
    check(unready.update(REVOLUTION, AVERAGE, CONDITIONS))


@pytest.mark.parametrize(
    ("changed", "field"),
    [
        ({"value": "3"}, "value"),
        ({"value": math.nan}, "value"),
        ({"value": math.inf}, "value"),
        ({"value": True}, "value"),
        ({"std": -1.0}, "std"),
        ({"std": math.inf}, "std"),
        ({"status": "valid"}, "status"),
        ({"reasons": ["why"]}, "reasons"),
    ],
)
def test_refused_estimate_names_the_field_and_leaves_the_others(changed: dict[str, Any], field: str) -> None:
    good = Estimate("good", 1.0, 0.5, Status.VALID)
    refused, passed = updated(lambda: (good._replace(name="bad", **changed), good))
    assert passed == good
    assert refused.status is Status.INVALID
    assert refused.reasons[0].code is Code.PLUGIN_FIELD_REFUSED
    assert refused.reasons[0]["field"] == field


def test_good_estimates_pass_unchanged() -> None:
    made = (Estimate("a_m", 1.0, math.nan, Status.VALID), Estimate("b.c-d", -2.0, 0.0, Status.PROVISIONAL))
    passed = updated(lambda: list(made))
    assert repr(passed) == repr(made)


def test_endless_estimates_and_ever_new_names_are_refused() -> None:
    def endless() -> Iterator[Estimate]:
        index = 0
        while True:
            index += 1
            yield Estimate(f"n{index}", 1.0, 1.0, Status.VALID)

    check(updated(endless))
    numbers = iter(range(1000))
    estimator = PluginEstimator(
        "scripted", lambda: Scripted(lambda: (Estimate(f"n{next(numbers)}", 1.0, 1.0, Status.VALID),))
    )
    names = {
        estimate.name
        for index in range(500)
        for estimate in estimator.update(replace(REVOLUTION, index=index), AVERAGE, CONDITIONS)
    }
    assert len(names) <= 101


def test_signal_during_an_estimator_ends_the_session() -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            updated(lambda: signal.raise_signal(signal.SIGINT))
        with stop_request() as request:
            updated(lambda: signal.raise_signal(signal.SIGINT))
            assert request.is_set()
            with pytest.raises(KeyboardInterrupt):
                updated(lambda: signal.raise_signal(signal.SIGINT))
    finally:
        signal.signal(signal.SIGINT, before)
