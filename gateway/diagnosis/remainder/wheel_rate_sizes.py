"""Turning wheel and camber rate: their sizes by recording, from rates of single revolutions."""

import math

from gateway.core.reasons import Reason
from gateway.diagnosis import criteria
from gateway.diagnosis.bayes.parameter_estimates import fitted_parameter, outside_range
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.data.wheel_rates import WheelRate
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Finding, SingleSize, Verdict


def rate_findings(campaign: Campaign) -> tuple[Finding, ...]:
    """Return the findings of rates of the wheel; none without evidence in any recording."""
    by_recording = {campaign.recordings[group.recording]: group.rates for group in campaign.groups}
    rates_by_effect: dict[str, dict[str, WheelRate]] = {}
    for name, recording_rates in by_recording.items():
        for rate in recording_rates:
            rates_by_effect.setdefault(rate.effect.name, {})[name] = rate
    return tuple(finding for rates in rates_by_effect.values() if (finding := _finding(rates)) is not None)


def _finding(rates: dict[str, WheelRate]) -> Finding | None:
    """Return the finding of one effect by its rate in each recording."""
    turning = [rate for rate in rates.values() if rate.shown]
    # A recording in which the wheel turns says nothing of others.
    strongest = max(turning or rates.values(), key=lambda rate: rate.log_evidence)
    reported = turning or [strongest]
    log_odds = strongest.log_evidence + math.log(criteria.PRIOR_ODDS)
    probability = 1.0 / (1.0 + math.exp(-min(max(log_odds, -500.0), 500.0)))
    if not turning and probability < criteria.LISTED:
        return None
    parameter = strongest.effect.parameters[0]

    def rms(attribute: str) -> float:
        return math.sqrt(sum(getattr(rate, attribute) ** 2 for rate in reported) / len(reported))

    size, std = rms("rms_radps"), rms("std_radps")
    reason: Reason | None = None
    if not turning:
        reason = strongest.objection or Reason(
            DiagnosisCode.PROBABILITY_TOO_LOW, probability=probability, needed=criteria.NAMED
        )
    elif size > parameter.high:
        reason = outside_range(parameter, size)
    return Finding(
        name=strongest.effect.name,
        verdict=Verdict.NAMED if reason is None else Verdict.REFUSED,
        parameters={parameter.name: fitted_parameter(parameter, size, std)},
        chi2=2.0 * sum(rate.log_evidence for rate in reported),
        rms_mps2=rms("rms_mps2"),
        rms_before_mps2=rms("before_mps2"),
        rms_after_mps2=rms("after_mps2"),
        reason=reason,
        summary=strongest.effect.summary,
        equation=strongest.effect.equation,
        lock="revolution",
        probability=probability,
        log_odds=log_odds,
        single_sizes=tuple(
            SingleSize(name, parameter.name, rate.rms_radps, rate.std_radps) for name, rate in rates.items()
        ),
    )
