"""What would decide between a clock and all that looks like one."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gateway.closure import findings
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


@pytest.mark.parametrize(
    ("rivals", "asked", "words"),
    [
        (("gain", "sample clock error", "run-out"), "sample clock error", "against sample clock error: a recording"),
        (("gain", "run-out"), "gain", "against gain: a recording"),
        (("run-out",), "run-out", "a recording"),
    ],
)
def test_the_clock_is_asked_for_first(
    monkeypatch: pytest.MonkeyPatch, rivals: tuple[str, ...], asked: str, words: str
) -> None:
    effects = {name: cast(AngleEffect, effect) for name, effect in catalogue().items()}
    step: Any = SimpleNamespace(effect=effects["rolling radius"])
    selection: Any = SimpleNamespace(final=None, steps=[step], refused={})
    data: Any = None
    seen: list[str] = []

    def deciding(_final: object, effect: AngleEffect, rival: AngleEffect, _data: object) -> str:
        seen.append(f"{effect.name} or {rival.name}")
        return "a recording"

    monkeypatch.setattr(findings, "rivals_of", lambda *_: dict.fromkeys(rivals))
    monkeypatch.setattr(findings, "deciding_recording", deciding)
    monkeypatch.setattr(findings, "_added", lambda *told: told[-1])
    found, _ = findings.findings_of(selection, data, effects)
    assert cast(list[object], found) == [words]
    assert seen == [f"rolling radius or {asked}"]
