"""Effects that explain nothing beside a large unexplained part."""

from collections.abc import Mapping
from typing import Any, cast

import pytest

from gateway.closure.inference import posterior
from gateway.closure.inference.posterior import doubted_sets
from gateway.closure.inference.residual import ByPart
from gateway.closure.inference.set_evidence import Evaluated
from gateway.reasons import Code


def judged(
    monkeypatch: pytest.MonkeyPatch, ratios: Mapping[str, tuple[float, ...]]
) -> tuple[dict[str, list[str]], ByPart]:
    """Return the effects objected to in each set, and the temperatures.

    Args:
        monkeypatch: of the test.
        ratios: of sets, effects as letters, their log evidence and the power that they leave over that of the noise in
            the wheel's plane and, where it is not that of noise, on the lateral axis.
    """
    sets = {frozenset(names): Evaluated(frozenset(names), cast(Any, names), ratios[names][0]) for names in ratios}

    monkeypatch.setattr(posterior, "ratios_by_part", lambda fit, data: ByPart(*ratios[fit][1:]))
    result, temperatures = doubted_sets(sets, cast(Any, None))
    assert all(
        reason.code is Code.LEAVES_MORE_THAN_WITHOUT for item in result.values() for _, reason in item.objections
    )
    return {names: [name for name, _ in result[frozenset(names)].objections] for names in ratios}, temperatures


def test_effect_that_moves_the_fit_away_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """The evidence is for a and b together; without a, less is left."""
    objected, temperatures = judged(monkeypatch, {"": (0.0, 400.0), "b": (50.0, 16.0), "ab": (90.0, 40.0)})
    assert objected == {"": [], "b": [], "ab": ["a"]}
    assert temperatures == pytest.approx((4.0, 1.0))


def test_set_that_leaves_half_replaces_as_many_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    objected, _ = judged(monkeypatch, {"": (0.0, 400.0), "ac": (90.0, 40.0), "bc": (50.0, 18.0)})
    assert objected["ac"] == ["a"]
    # Of two that leave about as much, neither replaces the other.
    objected, _ = judged(monkeypatch, {"": (0.0, 400.0), "ac": (90.0, 40.0), "bc": (50.0, 30.0)})
    assert objected["ac"] == []


def test_effects_at_the_noise_are_not_doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    objected, temperatures = judged(monkeypatch, {"": (0.0, 1.2), "a": (9.0, 1.3)})
    assert objected["a"] == []
    assert temperatures == pytest.approx((1.3**0.5, 1.0))


def test_effect_on_one_part_is_not_doubted_for_what_is_left_of_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """`l` explains the lateral axis; its set leaves a little more of the plane, which it does not move."""
    sets = {"": (0.0, 400.0, 49.0), "l": (90.0, 401.0, 1.1), "p": (60.0, 200.0, 49.0), "pl": (95.0, 201.0, 1.1)}
    objected, temperatures = judged(monkeypatch, sets)
    assert objected == {"": [], "l": [], "p": [], "pl": []}
    assert temperatures == pytest.approx((201.0**0.5, 1.1**0.5))


def test_effect_whose_rival_leaves_half_of_its_part_is_doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    """What both leave of the lateral axis is the same but for noise."""
    objected, _ = judged(monkeypatch, {"": (0.0, 400.0, 1.1), "a": (90.0, 40.0, 1.05), "b": (50.0, 16.0, 1.1)})
    assert objected["a"] == ["a"]
    objected, _ = judged(monkeypatch, {"": (0.0, 400.0, 9.0), "a": (90.0, 40.0, 1.05), "b": (50.0, 16.0, 9.0)})
    assert objected["a"] == []
