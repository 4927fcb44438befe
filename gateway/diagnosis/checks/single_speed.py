"""Ambiguity at a single speed: a fixed order or a fixed frequency."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from gateway.core.reasons import Reason
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.effect import Effect
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Finding, Verdict

# Speeds that differ by less count as equal.
_ONE_SPEED: Final = 1.1
# Ratio of held-out error to noise floor above which the data hold something that the model lacks.
_MUCH_LEFT: Final = 1.5
_ORDER_UNIT: Final = "per revolution"
FIXED_FREQUENCY: Final = "a resonance at a fixed frequency"
"""The confounder of effects with an order."""


def is_one_speed(campaign: Campaign) -> bool:
    """Return whether all of a campaign was driven at one speed."""
    omegas = [group.conditions.omega_radps for group in campaign.groups]
    return max(omegas) < _ONE_SPEED * min(omegas)


def doubted(
    findings: Sequence[Finding], effects: Sequence[Effect], campaign: Campaign, over_noise: float
) -> list[Finding]:
    """Make effects with an order undecided at one speed with a large residual: a loose sensor resonates as well.

    Args:
        findings: of one diagnosis.
        effects: of its model.
        campaign: the data.
        over_noise: held-out error over the noise floor.
    """
    if not over_noise > _MUCH_LEFT or not is_one_speed(campaign):
        return list(findings)
    ringing = {e.name for e in effects if any(parameter.unit == _ORDER_UNIT for parameter in e.parameters)}
    return [
        replace(
            finding,
            verdict=Verdict.INDISTINGUISHABLE,
            rivals=(*finding.rivals, FIXED_FREQUENCY),
            decide_with=finding.decide_with
            or Reason(DiagnosisCode.RECORD_AGAIN, how="ratio", quantity="speed", ratio=1.5),
            reason=Reason(DiagnosisCode.ORDER_OR_FREQUENCY, noise_floors=over_noise),
        )
        if finding.verdict is Verdict.NAMED and finding.name in ringing
        else finding
        for finding in findings
    ]
