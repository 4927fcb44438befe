"""Load calibration and reference numbers of a tire, from recordings of known load.

The load calibration is a power law of contact half angle and pressure with a slight curvature. On the exact ring the
exponents are about 1.4 and 0.5 and the curvature about 0.1, over tires, wear and treads. These values are the prior:
one recording gives the scale, two loads the exponent of the angle, two pressures that of the pressure. Recordings at
several temperatures give the loss of bending stiffness with temperature.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.tire_data import (
    DIFFERENCE_STD_K,
    LOAD_LAW_STD,
    SOFTENING_PER_K,
    SOFTENING_STD_PER_K,
    LoadCalibration,
    ReferenceNumbers,
)
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.types import FloatArray

# Exponent of the half angle, curvature and exponent of the pressure on the exact ring, and their variation.
_EXPONENTS: Final = (1.4, 0.1, 0.5)
_EXPONENT_STDS: Final = (0.15, 0.1, 0.15)
# Share of the usual variation below which the points determine an exponent.
_DETERMINED_SHARE: Final = 0.8
# Weights depend on the exponent and on the scatter of the points, which these passes settle.
_PASSES: Final = 8
# Points of equal weight from which leaving one out gives the error; a little less, as weights are hardly ever equal.
_MIN_POINTS: Final = 2.5
# Standard errors from the range of tires at which a slope with temperature is none of one tire.
_CONTRADICTION: Final = 4.0
# Sidewall numbers change with pressure: they are averaged over points within this share of the reference pressure.
_SAME_PRESSURE: Final = 0.05


@dataclass(frozen=True, slots=True)
class TirePoint:
    """Data of one wheel in one recording.

    Attributes:
        name: shown to the user.
        load_n: known load.
        load_std_n: its standard error.
        pressure_pa: mean pressure.
        half_angle_rad: median contact half angle.
        numbers: estimates of the four numbers at the end of the recording, by name.
        temperature_degc: mean inner-liner temperature; None when not known.
        half_angle_std_rad: standard error of the half angle, without that of the definition of an edge, which all
            points share and the calibration absorbs.
    """

    name: str
    load_n: float
    load_std_n: float
    pressure_pa: float
    half_angle_rad: float
    numbers: dict[str, Estimate]
    temperature_degc: float | None = None
    half_angle_std_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class LoadFit:
    """A calibration and its errors at the points that it was fitted to.

    Attributes:
        calibration: the power law.
        residuals: (k,) relative error of the calibrated load at each point.
        left_out: (k,) relative error at each point of a calibration without it; NaN for a single point.
        angle_exponent_std: standard error; that of the usual variation where the points do not determine it.
        angle_curvature_std: likewise.
        pressure_exponent_std: likewise.
        scatter: of the points over what their errors say, at least 1; the errors contain it.
        is_error_measured: False where the standard error of the calibration is assumed.
    """

    calibration: LoadCalibration
    residuals: FloatArray
    left_out: FloatArray
    angle_exponent_std: float
    angle_curvature_std: float
    pressure_exponent_std: float
    scatter: float
    is_error_measured: bool

    @property
    def is_angle_exponent_determined(self) -> bool:
        """Whether the points say more about the exponent of the half angle than the usual variation."""
        return _is_determined(self.angle_exponent_std, 0)

    @property
    def is_pressure_exponent_determined(self) -> bool:
        """Likewise for the exponent of the pressure."""
        return _is_determined(self.pressure_exponent_std, 2)


def _is_determined(std: float, exponent: int) -> bool:
    return std < _DETERMINED_SHARE * _EXPONENT_STDS[exponent]


def fit_load_calibration(points: Sequence[TirePoint]) -> LoadFit:
    """Fit load = f(half angle, pressure) to at least one point.

    Load and half angle of each point have errors; a point weighs by both. The calibration's standard error is the root
    mean square error of leaving each point out in turn, by the same weights, and at least that of the law on the exact
    ring, since a few points may agree by chance. With fewer than three points, or where they do not determine the
    exponent of the half angle, it is the error that the fit leaves over a factor of two in load, and at least 5 %.
    """
    calibration, weight, stds, scatter = _fit(points)
    load = np.array([point.load_n for point in points])
    fitted = np.array([calibration.load_at(point.half_angle_rad, point.pressure_pa) for point in points])
    left_out = np.full(len(points), math.nan)
    for index, point in enumerate(points if len(points) > 1 else ()):
        others, *_ = _fit([*points[:index], *points[index + 1 :]])
        left_out[index] = others.load_at(point.half_angle_rad, point.pressure_pa) / point.load_n - 1.0
    effective = float(np.square(weight).sum()) ** 2 / float((weight**4).sum())
    is_measured = effective >= _MIN_POINTS and _is_determined(stds[1], 0)
    if is_measured:
        error = math.hypot(math.sqrt(float(np.average(np.square(left_out), weights=np.square(weight)))), LOAD_LAW_STD)
    else:
        error = math.hypot(0.05, stds[0], stds[1] * 0.5 * math.log(2.0))
    return LoadFit(
        replace(calibration, relative_std=error), fitted / load - 1.0, left_out, *stds[1:], scatter, is_measured
    )


def _fit(points: Sequence[TirePoint]) -> tuple[LoadCalibration, FloatArray, tuple[float, float, float, float], float]:
    """Fit by least squares with prior exponents.

    Returns:
        the calibration without its standard error; the weights of the points (k,); the standard errors of the logarithm
        of the load in the middle, the exponent of the half angle, its curvature and the exponent of the pressure; and
        the scatter of the points over what their errors say, at least 1, by which their errors are enlarged.
    """
    half = np.array([point.half_angle_rad for point in points])
    pressure = np.array([point.pressure_pa for point in points])
    load = np.array([point.load_n for point in points])
    load_error = np.hypot(LOAD_LAW_STD, [point.load_std_n / point.load_n for point in points])
    angle_error = np.array([point.half_angle_std_rad / point.half_angle_rad for point in points])
    middle = float(np.exp(np.log(half).mean())), float(np.exp(np.log(pressure).mean()))
    angle = np.log(half / middle[0])
    rows = np.stack([np.ones(len(half)), angle, np.square(angle), np.log(pressure / middle[1])], axis=1)
    prior = np.diag([0.0, *(1.0 / std for std in _EXPONENT_STDS)])
    solution = np.array([0.0, *_EXPONENTS])
    expected = prior[1:] @ solution
    scatter = 1.0
    for _ in range(_PASSES):
        weight = 1.0 / scatter / np.hypot(load_error, (solution[1] + 2.0 * solution[2] * angle) * angle_error)
        weighted_rows = np.concatenate([rows * weight[:, np.newaxis], prior[1:]])
        targets = np.concatenate([np.log(load) * weight, expected])
        solution = np.linalg.lstsq(weighted_rows, targets, rcond=None)[0]
        residuals = weighted_rows @ solution - targets
        # The usual exponents count as three measurements of the four unknowns.
        scatter *= math.sqrt(max(1.0, float(residuals @ residuals) / max(len(points) - 1, 1)))
    errors = np.sqrt(np.diag(np.linalg.inv(weighted_rows.T @ weighted_rows)))
    scale, angle_exponent, curvature, pressure_exponent = solution.tolist()
    calibration = LoadCalibration(
        load_n=math.exp(scale),
        half_angle_rad=middle[0],
        pressure_pa=middle[1],
        angle_exponent=angle_exponent,
        angle_curvature=curvature,
        pressure_exponent=pressure_exponent,
        relative_std=math.nan,
        half_angle_range_rad=(float(half.min()), float(half.max())),
        pressure_range_pa=(float(pressure.min()), float(pressure.max())),
        temperature_degc=_median_degc(points),
    )
    return calibration, weight, tuple(errors.tolist()), scatter


def _median_degc(points: Sequence[TirePoint]) -> float | None:
    """Return the median temperature of the points, None unless all are known."""
    stated_degc = sorted(point.temperature_degc for point in points if point.temperature_degc is not None)
    return stated_degc[len(points) // 2] if stated_degc and len(stated_degc) == len(points) else None


def fit_softening(points: Sequence[TirePoint]) -> tuple[float, float]:
    """Return the relative loss of bending stiffness per kelvin and its standard error, from points of one wear.

    ln(Bs p) = constant - softening T by weighted least squares, with the usual range of tires as the prior: points at
    one temperature return the prior. The errors include that of the temperatures, and the scatter of the points. Points
    whose own slope contradicts that range differ in more than their temperature, and return the prior too.
    """
    rows = [
        (point.temperature_degc, bending.value * point.pressure_pa, bending.std / bending.value)
        for point in points
        if point.temperature_degc is not None
        and (bending := point.numbers.get("Bs")) is not None
        and bending.status is Status.VALID
    ]
    if not rows:
        return SOFTENING_PER_K, SOFTENING_STD_PER_K
    degc, stiffness, relative = np.array(rows).T
    weights = 1.0 / (np.square(relative) + (SOFTENING_PER_K * DIFFERENCE_STD_K) ** 2 / 2.0)
    warmer = degc - weights @ degc / weights.sum()
    logarithm = np.log(stiffness) - weights @ np.log(stiffness) / weights.sum()
    prior = SOFTENING_STD_PER_K**-2
    information = float(weights @ np.square(warmer))
    product = -float(weights @ (warmer * logarithm))
    # Of the slope from the prior, in units of 1 / information.
    departure = product - information * SOFTENING_PER_K
    if abs(departure) > _CONTRADICTION * math.hypot(math.sqrt(information), information * SOFTENING_STD_PER_K):
        return SOFTENING_PER_K, SOFTENING_STD_PER_K
    slope = (prior * SOFTENING_PER_K + product) / (prior + information)
    scatter = 1.0
    if len(rows) > 2:
        scatter = max(1.0, float(weights @ np.square(logarithm + slope * warmer)) / (len(rows) - 2))
    return slope, 1.0 / math.sqrt(prior + information / scatter)


def reference_numbers(points: Sequence[TirePoint], estimator: str) -> ReferenceNumbers:
    """Return the tire's numbers at the median pressure, each the weighted mean over the points that determine it.

    Bs is proportional to 1 / p, because EI belongs to the tire, and falls with the temperature; it is given at the
    median temperature of the points, unless some are not known. Cw does not depend on pressure. The standard error is
    the larger of the formal one of the mean and that from the scatter of the points.
    """
    pressure = sorted(point.pressure_pa for point in points)[len(points) // 2]
    temperature = _median_degc(points)
    softening, softening_std = fit_softening(points)
    values: dict[str, float | None] = {}
    stds: dict[str, float] = {}
    for name in RING_NUMBERS:
        scaled = []
        for point in points:
            estimate = point.numbers.get(name)
            is_close = abs(point.pressure_pa / pressure - 1.0) < _SAME_PRESSURE
            if estimate is None or estimate.status is not Status.VALID or not (is_close or name in ("Bs", "Cw")):
                continue
            factor = 1.0
            if name == "Bs":
                warmer_k = 0.0
                if temperature is not None and point.temperature_degc is not None:
                    warmer_k = point.temperature_degc - temperature
                factor = point.pressure_pa / pressure * math.exp(softening * warmer_k)
            scaled.append((estimate.value * factor, estimate.std * factor))
        values[name], stds[name] = _mean(np.array(scaled)) if scaled else (None, 0.0)
    return ReferenceNumbers(
        values["Bs"], values["Cw"], values["Rs"], values["Ts"],
        stds["Bs"], stds["Cw"], stds["Rs"], stds["Ts"],
        pressure_pa=pressure,
        temperature_degc=temperature,
        estimator=estimator,
        softening_per_k=softening,
        softening_std_per_k=softening_std,
    )  # fmt: skip


def _mean(values_and_stds: FloatArray) -> tuple[float, float]:
    """Return the weighted mean of (k, 2) values with standard errors, and its standard error."""
    values, stds = values_and_stds.T
    weights = 1.0 / np.square(np.maximum(stds, 1e-4 * np.abs(values)))
    weights /= weights.sum()
    mean = float(weights @ values)
    formal = math.sqrt(float(np.square(weights) @ np.square(stds)))
    if len(values) < 2:
        return mean, formal
    scatter = math.sqrt(float(weights @ np.square(values - mean)) / (len(values) - 1))
    return mean, max(formal, scatter)
