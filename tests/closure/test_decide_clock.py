"""What would decide between a clock and all that looks like one."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gateway.closure.decide import deciding_recording
from gateway.closure.effects.catalogue import catalogue
from gateway.closure.model import AngleEffect


@pytest.mark.parametrize(
    ("std", "words"),
    [(math.nan, "made live"), (9e-5, "longer recording made live would decide: the hub's clock is known to 90 ppm"),
     (2e-6, "better than a host's 50 ppm")],
)  # fmt: skip
@pytest.mark.parametrize("names", [("rolling radius", "sample clock error"), ("sample clock error", "gain")])
def test_how_well_the_clock_is_known_tells_what_would_decide(std: float, words: str, names: tuple[str, str]) -> None:
    final: Any = SimpleNamespace(model=SimpleNamespace(campaign=SimpleNamespace(clock_error=(0.0, std))))
    effect, rival = (cast(AngleEffect, catalogue()[name]) for name in names)
    data: Any = None
    assert words in deciding_recording(final, effect, rival, data)
