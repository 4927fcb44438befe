"""Effects that explain nothing beside a large unexplained part."""

from __future__ import annotations

from typing import Any, cast

import pytest

from gateway.closure.inference import misspecification
from gateway.closure.inference.misspecification import doubted_sets
from gateway.closure.inference.set_evidence import Evaluated
from gateway.reasons import Code


def judged(
    monkeypatch: pytest.MonkeyPatch, ratios: dict[str, tuple[float, float]]
) -> tuple[dict[str, list[str]], float]:
    """Return the effects objected to in each set, and the temperature.

    Args:
        monkeypatch: of the test.
        ratios: of sets, effects as letters, their log evidence and the power that they leave over that of the noise.
    """
    sets = {frozenset(names): Evaluated(frozenset(names), cast(Any, names), ratios[names][0]) for names in ratios}
    monkeypatch.setattr(misspecification, "residual_ratio", lambda fit, data: ratios[fit][1])
    found, temperature = doubted_sets(sets, cast(Any, None))
    assert all(reason.code is Code.LEAVES_MORE_THAN_WITHOUT for one in found.values() for _, reason in one.objections)
    return {names: [name for name, _ in found[frozenset(names)].objections] for names in ratios}, temperature


def test_effect_that_moves_the_fit_away_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """The evidence is for a and b together; without a, less is left."""
    objected, temperature = judged(monkeypatch, {"": (0.0, 400.0), "b": (50.0, 16.0), "ab": (90.0, 40.0)})
    assert objected == {"": [], "b": [], "ab": ["a"]}
    assert temperature == pytest.approx(4.0)


def test_set_that_leaves_half_replaces_as_many_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    objected, _ = judged(monkeypatch, {"": (0.0, 400.0), "ac": (90.0, 40.0), "bc": (50.0, 18.0)})
    assert objected["ac"] == ["a"]
    # Of two that leave about as much, neither replaces the other.
    objected, _ = judged(monkeypatch, {"": (0.0, 400.0), "ac": (90.0, 40.0), "bc": (50.0, 30.0)})
    assert objected["ac"] == []


def test_effects_at_the_noise_are_not_doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    objected, temperature = judged(monkeypatch, {"": (0.0, 1.2), "a": (9.0, 1.3)})
    assert objected["a"] == []
    assert temperature == pytest.approx(1.3**0.5)
