"""Experiment design for a clock error and its confounders."""

import math
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gateway.core.reasons import Reason
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.model.closure_model import AngleEffect
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.report import findings
from gateway.diagnosis.report.experiment_design import deciding_recording

AGAIN = Reason(DiagnosisCode.RECORD_AGAIN, how="ratio", quantity="speed", ratio=1.5)


def against(confounder: str) -> Reason:
    return Reason(DiagnosisCode.DECIDES_AGAINST, effect=confounder, recording=AGAIN)


@pytest.mark.parametrize(
    ("std", "recording"),
    [
        (math.nan, Reason(DiagnosisCode.RECORD_AGAIN, how="live")),
        (9e-5, Reason(DiagnosisCode.RECORD_AGAIN, how="live_longer", clock_std=9e-5)),
        (2e-6, Reason(DiagnosisCode.RECORD_AGAIN, how="better_clock", host_clock=5e-5)),
    ],
)
@pytest.mark.parametrize("names", [("rolling radius", "sample clock error"), ("sample clock error", "gain")])
def test_clock_uncertainty_chooses_the_recording(std: float, recording: Reason, names: tuple[str, str]) -> None:
    final: Any = SimpleNamespace(model=SimpleNamespace(campaign=SimpleNamespace(clock_error=(0.0, std))))
    effect, rival = (cast(AngleEffect, catalogue()[name]) for name in names)
    assert deciding_recording(final, effect, rival) == recording


@pytest.mark.parametrize(
    ("rivals", "asked", "recording"),
    [
        (("gain", "sample clock error", "run-out"), "sample clock error", against("sample clock error")),
        (("gain", "run-out"), "gain", against("gain")),
        (("run-out",), "run-out", AGAIN),
    ],
)
def test_clock_comes_first(
    monkeypatch: pytest.MonkeyPatch, rivals: tuple[str, ...], asked: str, recording: Reason
) -> None:
    effects = {name: cast(AngleEffect, effect) for name, effect in catalogue().items()}
    rolling_radius = effects["rolling radius"]
    fit: Any = SimpleNamespace()
    seen: list[str] = []

    def deciding(_final: object, effect: AngleEffect, rival: AngleEffect) -> Reason:
        seen.append(f"{effect.name} or {rival.name}")
        return AGAIN

    monkeypatch.setattr(findings, "deciding_recording", deciding)
    assert findings._decide(fit, rolling_radius, rivals, effects) == recording
    assert seen == [f"rolling radius or {asked}"]
