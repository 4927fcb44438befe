"""Effects beside the strongest single unknown: a waveform of any shape that is fixed in time or to the contact's edges.

The discrepancy holds any waveform that is fixed in angle. What is fixed in time passes with the angle as the wheel
turns faster, what is fixed to an edge as the contact grows. Each is a sum of narrow normal curves whose sizes have one
prior, at the width of which the evidence is highest. An effect whose evidence such a waveform takes is not identified.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.core.constants import AXIS_NAMES
from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.angle.likelihood import as_real
from gateway.diagnosis.bayes.posterior import ByPart
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.effect import LATERAL
from gateway.diagnosis.model.baseline import NoShapeError
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Finding, Verdict
from gateway.diagnosis.search.profile_scan import under_factors

# Numbers of curves of an unknown, few for a smooth one, and the reach of those fixed in time, in angle of the slowest
# group.
_CURVES: Final = (16, 48)
_REACH_RAD: Final = 1.0
# Reach before and after an edge, and the change of the contact's half angle from which edges are no angles.
_BESIDE_EDGE_RAD: Final = 0.5
_EDGES_APART_RAD: Final = 0.02
# Exponents of the speed with which an unknown grows, and standard deviations of its sizes over the largest signal.
_GROWTHS: Final = (0.0, 2.0)
_STDS: Final = tuple(np.geomspace(1e-5, 1e-1, 9).tolist())
_ORDER: Final[FloatArray] = np.arange(ORDERS, dtype=np.float64)


def beside_unknown(findings: Sequence[Finding], fit: Fit, without: Mapping[str, Fit], parts: ByPart) -> list[Finding]:
    """Reject identified effects whose evidence the strongest single unknown takes.

    Args:
        findings: of effects.
        fit: of the best set, with its discrepancy.
        without: fit of the best set without each of its effects.
        parts: by which the evidence of plane and lateral axis is divided.
    """
    named = [finding.name for finding in findings if finding.verdict is Verdict.NAMED and finding.name in without]
    try:
        unknowns = _unknowns(fit) if named else []
        scans = under_factors(fit) if unknowns else None
        scans_without = {name: under_factors(without[name]) for name in named if unknowns}
    except (NoShapeError, np.linalg.LinAlgError):
        # Without a smaller discrepancy no unknown can be compared with it.
        return list(findings)
    judged = []
    for finding in findings:
        if finding.name in named and scans is not None:
            scan_without = scans_without[finding.name]
            axes = next(effect.axes for effect in fit.model.effects if effect.name == finding.name)
            tried = [(evidence_of(*scan_without, rows, axis), rows, axis) for rows in unknowns for axis in axes]
            gain, rows, axis = max(tried, key=lambda trial: trial[0])
            loss = (gain - evidence_of(*scans, rows, axis)) / (parts.lateral if axis == LATERAL else parts.plane)
            if finding.log_odds - loss < math.log(criteria.NAMED / (1.0 - criteria.NAMED)):
                reason = Reason(DiagnosisCode.TAKEN_BY_UNKNOWN, axis=AXIS_NAMES[axis], taken=loss)
                finding = replace(finding, verdict=Verdict.REFUSED, reason=reason)
        judged.append(finding)
    return judged


def evidence_of(fits: Sequence[Fit], levels: FloatArray, curves: Sequence[FloatArray], axis: int) -> float:
    """Return the log evidence that an unknown on one axis adds to a fit, to first order; 0 where none is better.

    Args:
        fits: one under several factors of its discrepancy, which stands for the unknown where that is left out.
        levels: log evidence of each, the first that of the fit itself.
        curves: real coefficients of the unknown's curves, (k, REAL) of each group.
        axis: on which it is.
    """
    rows = []
    for group_curves in curves:
        placed = np.zeros((len(group_curves), 3, group_curves.shape[1]))
        placed[:, axis] = group_curves
        rows.append(placed)
    largest = max(float(np.abs(predicted[axis]).max()) for predicted in fits[0].predicted)
    variances = np.square(np.array(_STDS) * largest)[:, None]
    peak = levels[0]
    for fit, level in zip(fits, levels.tolist(), strict=True):
        cross = fit.cross(rows)
        information = fit.cross_information(rows, 1)[0] - cross[:-1].T @ np.linalg.solve(fit.precision, cross[:-1])
        powers, directions = np.linalg.eigh(information)
        scores = directions.T @ (cross[-1] - fit.step @ cross[:-1])
        widened = 1.0 + variances * np.maximum(powers, 0.0)
        peak = max(peak, level + 0.5 * float((variances * scores**2 / widened - np.log(widened)).sum(axis=1).max()))
    return float(peak - levels[0])


def _unknowns(fit: Fit) -> list[list[FloatArray]]:
    """Return the curves (k, REAL) of each group of every unknown that is no waveform in angle."""
    model = fit.model
    groups, indices = model.campaign.groups, range(len(model.campaign.groups))
    omegas = np.array([group.conditions.omega_radps for group in groups])
    centres = [float(fit.vector[model.layout.centre(index)]) for index in indices]
    shapes = [model.shape(fit.vector, index) for index in indices]
    placed: list[list[tuple[FloatArray, float]]] = []
    if omegas.max() > criteria.SPEEDS_APART * omegas.min():
        for count in _CURVES:
            times_s = np.linspace(-_REACH_RAD, _REACH_RAD, count) / omegas.min()
            placed.append([(omega * times_s, omega * (times_s[1] - times_s[0])) for omega in omegas.tolist()])
    edges = np.array([(shape.leading_edge_rad, shape.trailing_edge_rad) for shape in shapes])
    for edge in edges.T:
        if np.ptp(edge) > _EDGES_APART_RAD:
            for count in _CURVES:
                away_rad = np.linspace(-_BESIDE_EDGE_RAD, _BESIDE_EDGE_RAD, count)
                placed.append([(angle_rad + away_rad, away_rad[1] - away_rad[0]) for angle_rad in edge.tolist()])
    return [
        [
            (omega / omegas.max()) ** growth * _curves(angles_rad + centre, width_rad)
            for (angles_rad, width_rad), centre, omega in zip(places, centres, omegas.tolist(), strict=True)
        ]
        for places in placed
        for growth in _GROWTHS
    ]


def _curves(angles_rad: FloatArray, width_rad: float) -> FloatArray:
    """Return the real coefficients of normal curves of unit height at angles (k,), (k, REAL)."""
    spectrum = math.sqrt(2.0 / math.pi) * width_rad * np.exp(-0.5 * np.square(width_rad * _ORDER))
    spectrum[0] *= 0.5
    return as_real(spectrum * np.exp(-1j * np.outer(angles_rad, _ORDER)))
