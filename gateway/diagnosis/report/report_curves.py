"""Curves and trends of a diagnosis for the figures of its report."""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from gateway.core.constants import AXIS_NAMES
from gateway.core.types import BoolArray, ComplexArray, FloatArray
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.angle.likelihood import Whitened, as_complex
from gateway.diagnosis.angle.residual import group_residuals
from gateway.diagnosis.data.campaign_data import Group
from gateway.diagnosis.effects.angle_orders import THETA, orders_field
from gateway.diagnosis.report.effect_contribution import added_by
from gateway.diagnosis.result import Curves, EffectCurves, Finding, Trend

# A quantity that varies by less than this share over the groups shows no trend.
_VARIES: Final = 0.03
_ABSCISSAE: Final[dict[str, tuple[Callable[[Group], float], float]]] = {
    # name -> (value, least span that is worth a trend where a share says nothing)
    "speed_kmh": (lambda group: 3.6 * group.conditions.omega_radps * group.conditions.radius_m, 2.0),
    "load_n": (lambda group: group.conditions.load_n, 50.0),
    "pressure_kpa": (lambda group: 1e-3 * group.conditions.pressure_pa, 5.0),
    "temperature_degc": (lambda group: group.conditions.temperature_degc, 3.0),
    "time_s": (lambda group: group.conditions.time_s, 1.0),
}


def curves_of(before: Fit, after: Fit, data: Whitened) -> tuple[Curves, ...]:
    """Return the waveforms of every group."""
    result = []
    for index, group in enumerate(after.model.campaign.groups):
        weight = np.square(data.weights[index])
        total = weight.sum(axis=0)
        present = total > 0.0
        scale = np.where(present, 1.0 / np.where(present, total, 1.0), 0.0)

        def field(orders: ComplexArray, present: BoolArray = present) -> FloatArray:
            return orders_field(np.where(present, orders, 0.0))

        absent = ~present.any(axis=1)
        measured = field(data.mean(index, data.orders[index]))
        measured[absent] = np.nan
        order_noise = np.sqrt(scale)
        order_noise[~present] = np.nan
        result.append(
            Curves(
                label=group.label,
                theta_rad=THETA,
                measured_mps2=measured,
                before_mps2=field(before.predicted[index]),
                after_mps2=field(after.predicted[index]),
                noise_mps2=np.sqrt(scale.sum(axis=1)),
                order_noise_mps2=order_noise,
            )
        )
    return tuple(result)


def effect_curves_of(fit: Fit, findings: Sequence[Finding]) -> tuple[EffectCurves, ...]:
    """Return what each identified effect of a fit adds, in the group where that is most.

    Args:
        fit: of the best set.
        findings: identified effects, with their parameters' errors.
    """
    effects = {effect.name: effect for effect in fit.model.effects}
    groups = fit.model.campaign.groups
    result = []
    for finding in findings:
        if finding.name not in effects:
            continue
        added = [orders_field(orders) for orders in added_by(fit, effects[finding.name])]
        index = max(range(len(groups)), key=lambda number: float(np.nan_to_num(np.square(added[number])).sum()))
        indices = fit.model.layout.effect(finding.name)
        rows = orders_field(as_complex(fit.rows[index][indices]))
        # Errors over all sets, and of the equation, are larger than the fit's own; correlations are the fit's.
        covariance = fit.covariance[indices, indices]
        fit_stds = np.sqrt(np.diagonal(covariance))
        wider = np.array([fitted.std for fitted in finding.parameters.values()]) / np.where(
            fit_stds > 0.0, fit_stds, 1.0
        )
        variance = np.einsum("pan,pq,qan->an", rows, covariance * np.outer(wider, wider), rows)
        std = np.sqrt(np.maximum(variance, 0.0))
        result.append(EffectCurves(finding.name, groups[index].label, THETA, added[index], std))
    return tuple(result)


def trends_of(before: Fit, after: Fit, data: Whitened) -> tuple[Trend, ...]:
    """Return how the residual goes with speed, load, pressure, temperature and time, where these vary."""
    groups = after.model.campaign.groups
    residuals = group_residuals(before, data), group_residuals(after, data)
    trends = []
    for name, (value, least_span) in _ABSCISSAE.items():
        abscissa = np.array([value(group) for group in groups])
        if len(abscissa) < 2 or np.ptp(abscissa) < max(
            least_span, _VARIES * float(np.abs(abscissa).mean()) if name != "time_s" else least_span
        ):
            continue
        for axis, words in enumerate(AXIS_NAMES):
            if not any((weight[:, axis] > 0.0).any() for weight in data.weights):
                continue
            rms_mps2 = [np.array([r.rms_mps2()[axis] for r in stage]) for stage in residuals]
            noise = np.array([r.noise_rms_mps2()[axis] for r in residuals[1]])
            trends.append(Trend(words, name, abscissa, rms_mps2[0], rms_mps2[1], noise))
    return tuple(trends)
