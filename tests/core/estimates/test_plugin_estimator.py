"""An estimator of a plug-in can spoil only its own numbers."""

import json
import math
import signal
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core import quantity_catalogue
from gateway.core.cli.stop_signals import stop_request
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.plugin_estimator import PluginEstimator
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.quantity import Basis, Quantity
from gateway.core.quantity_catalogue import declare, quantities_of
from gateway.core.reasons import CoreCode, Reason
from gateway.core.table_columns import estimate_columns
from gateway.core.text import wording
from gateway.core.text.numbers import split_name
from gateway.core.trust.qualification import qualified
from gateway.core.trust.reasons import TrustCode
from tests.core.wheels.test_qualification import NOTHING
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
    st.sampled_from(
        [*Status, "valid", Reason(CoreCode.NOT_SETTLED), Reason(EstimateCode.PLUGIN_FAILED, error="y" * 100_000)]
    ),
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


NAMES = ("a_number", "good", "bad", "a_m", "b.c-d")


def updated(does: Callable[[], Any]) -> tuple[Estimate, ...]:
    return PluginEstimator("scripted", lambda: Scripted(does), NAMES).update(REVOLUTION, AVERAGE, CONDITIONS)


def check(estimates: tuple[Estimate, ...]) -> None:
    names = [estimate.name for estimate in estimates]
    assert len(set(names)) == len(names)
    for name, value, std, status, reasons, scatter_std in estimates:
        assert scatter_std == 0.0 or scatter_std <= std
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
    assert [(estimate.name, estimate.reasons[0].code) for estimate in estimates] == [
        (name, EstimateCode.PLUGIN_FAILED) for name in NAMES
    ]


@given(ERRORS)
def test_estimator_that_cannot_be_made_or_reset_is_invalid(error: BaseException) -> None:
    unmade = PluginEstimator("scripted", lambda: raising(error), NAMES)
    check(unmade.update(REVOLUTION, AVERAGE, CONDITIONS))
    unready = PluginEstimator("scripted", lambda: Scripted(lambda: raising(error)), NAMES)
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
    assert refused.reasons[0].code is EstimateCode.PLUGIN_FIELD_REFUSED
    assert refused.reasons[0]["field"] == field


def test_good_estimates_pass_unchanged() -> None:
    made = (Estimate("a_m", 1.0, math.nan, Status.VALID), Estimate("b.c-d", -2.0, 0.0, Status.PROVISIONAL))
    passed = updated(lambda: list(made))
    assert repr(passed) == repr(made)


def test_endless_and_undeclared_estimates_are_refused() -> None:
    def endless() -> Iterator[Estimate]:
        while True:
            yield Estimate("good", 1.0, 1.0, Status.VALID)

    for returned in (endless, lambda: (Estimate("new", 1.0, 1.0, Status.VALID),)):
        estimates = updated(returned)
        check(estimates)
        assert [estimate.name for estimate in estimates] == list(NAMES)
        assert {estimate.status for estimate in estimates} == {Status.INVALID}


@pytest.fixture
def _catalogue(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(quantity_catalogue, "_OF_PLUGINS", {})
    monkeypatch.setattr(quantity_catalogue, "_BY_NAME", {item.name: item for item in quantity_catalogue.declared()})
    yield
    quantity_catalogue.quantity_of.cache_clear()


@pytest.mark.usefixtures("_catalogue")
def test_declared_quantities_of_a_plugin_have_units_limits_and_doubts() -> None:
    mine = Quantity("squat_m", "squat", "its own", powers={Basis.RATE: 2.0}, possible=(0.0, 0.1), label="rear squat")
    assert declare("scripted", (mine,)) is None
    assert declare("scripted", (mine,)) is None
    assert quantities_of("scripted") == (mine,)
    assert split_name("squat_m") == ("rear squat", split_name("contact_length_m")[1])
    value, *_ = estimate_columns("squat_m", quantity_catalogue.quantity_of("squat_m").description)
    assert (value.unit, value.description) == ("m", "squat")
    (passed,) = qualified((Estimate("squat_m", -0.2, 0.01, Status.VALID),), NOTHING, (), None)
    assert (passed.status, passed.reasons[0].code) == (Status.PROVISIONAL, TrustCode.NOT_POSSIBLE)
    assert declare("another", (Quantity("squat_m", "the same"),)) == ("squat_m", "scripted")
    assert declare("another", (Quantity("estimated_load_n", "a column of the load"),)) == ("estimated_load_n", "load")


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
