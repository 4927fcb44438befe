"""The ring paper's series as a baseline model: Eq. 27 as printed, or corrected by options.

It is linear about the undeformed circle, under a contact pressure that is given, not found: uniform but for the
Legendre amounts of the options. What the belt's finite turning in the contact changes is added as a share of the
difference between the exact ring and the linear ring under the exact ring's own contact pressure.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from scipy.special import spherical_jn

from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.types import FloatArray
from gateway.diagnosis.effects.effect import FIELD_SIZE, BaselineModel, GroupConditions
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.diagnosis.model.baseline import Shape, differences, moved
from gateway.diagnosis.model.exact_baseline import ExactCore
from gateway.diagnosis.model.shape_derivatives import Tangents
from gateway.ring.reference_tire import (
    TABLE_3_LOAD_N,
    TABLE_3_LOAD_NUMBER,
    TABLE_3_NUMBERS,
    TABLE_3_PRESSURE_PA,
    TABLE_3_RADIUS_M,
)
from gateway.ring.ring_series import stiffness_terms
from gateway.ring.rolling_ring.sensor_waveform import SensorWaveform, waveform_orders

# Table 3's tire; its stiffnesses over its load are the start of a fit at any load.
_NOMINAL: Final = GroupConditions(
    omega_radps=56.0,
    omega_dot_radps2=0.0,
    radius_m=TABLE_3_RADIUS_M,
    load_n=TABLE_3_LOAD_N,
    pressure_pa=TABLE_3_PRESSURE_PA,
    temperature_degc=25.0,
    reference_degc=25.0,
    rate_hz=math.inf,
    time_s=0.0,
)
_NOMINAL_TREAD: Final[FloatArray] = np.zeros(1)

# Far above what is compared, and below what the exact ring's coarse grid carries.
_MAX_ORDER: Final = 200
_ORDER: Final[FloatArray] = np.arange(1.0, _MAX_ORDER + 1.0)
_TERMS: Final[FloatArray] = stiffness_terms(_ORDER)
_PRINTED: Final[FloatArray] = -np.square(np.square(_ORDER)) / math.pi
_CORRECTED: Final[FloatArray] = -np.square(_ORDER) * (np.square(_ORDER) - 1.0) / math.pi
# Weights of the waves n - 1 and n + 1 of a vertical push: cos theta cos n theta + sin theta sin(n theta) / n.
_WEIGHT_BELOW: Final[FloatArray] = 0.5 * (1.0 + 1.0 / _ORDER)
_WEIGHT_ABOVE: Final[FloatArray] = 0.5 * (1.0 - 1.0 / _ORDER)
_PUSH_ORDERS: Final[FloatArray] = np.arange(_MAX_ORDER + 2.0)

# From a cosine coefficient to the half-spectrum of a field that begins at -pi.
_TO_SPECTRUM: Final[FloatArray] = 0.5 * FIELD_SIZE * np.where(_ORDER % 2.0, -1.0, 1.0)


class SeriesCore:
    """The linear ring: Bs, Cw, Rs and Ts are a state's parameters."""

    model = BaselineModel.PAPER
    gravity = drift = mean = False
    # With all corrections, what is left of the exact ring at 3000 to 6000 N: 1e-4 of order 0, up to 8e-3 of orders 1 to
    # 5, 3e-4 to 2e-3 of those up to 25, 6e-5 of R omega^2 of higher ones.
    equation_share = 1e-3
    names: tuple[str, ...] = RING_NUMBERS

    def __init__(self) -> None:
        """Begin without any solution of the exact ring."""
        self.prior_mean: FloatArray = np.zeros(len(self.names))
        self.prior_std: FloatArray = np.array([2.0, 1.5, 1.5, 1.5])
        self.steps: FloatArray = np.full(len(self.names), 1e-3)
        self._exact = ExactCore()
        self._tangents = Tangents()

    def shape(
        self, parameters: FloatArray, conditions: GroupConditions, options: RingOptions, half_angle_rad: float
    ) -> Shape:
        """Return the shape; the exact ring is solved only where `options.tension_loss` asks for it."""
        orders = _orders(parameters, half_angle_rad, options)
        if options.tension_loss:
            orders += options.tension_loss * self._rotation_orders(parameters)
        return Shape(_waveform(orders, conditions.radius_m, options.sensor_offset_m), -half_angle_rad, half_angle_rad)

    def tangent(
        self, parameters: FloatArray, conditions: GroupConditions, options: RingOptions, half_angle_rad: float
    ) -> tuple[Shape, ...]:
        """Return the derivatives of the shape by the state's parameters."""
        # The shape depends only on these conditions and the half angle.
        key = conditions.radius_m, half_angle_rad
        return self._tangents.at(
            key, parameters, options, lambda: differences(self, parameters, conditions, options, half_angle_rad)
        )

    def changes(
        self,
        parameters: FloatArray,
        conditions: GroupConditions,
        before: RingOptions,
        after: RingOptions,
        beside: Sequence[RingOptions],
        half_angle_rad: float,
    ) -> list[Shape]:
        """Return the change of the shape by another option, and by each of those beside it."""
        base, *shapes = (
            self.shape(parameters, conditions, options, half_angle_rad) for options in (before, after, *beside)
        )
        return [moved(shape, base, -1.0) for shape in shapes]

    def refine(self, parameters: FloatArray, conditions: GroupConditions, options: RingOptions) -> None:
        """Do nothing: a series has no grid."""

    def numbers(self, parameters: FloatArray, conditions: GroupConditions) -> Mapping[str, float]:
        """Return Bs, Cw, Rs, Ts at the load and pressure of `conditions`."""
        load_number = conditions.load_n / (conditions.pressure_pa * conditions.radius_m**2)
        values = _nominal_numbers(parameters) * (load_number / TABLE_3_LOAD_NUMBER)
        return dict(zip(self.names, (float(value) for value in values), strict=True))

    def _rotation_orders(self, parameters: FloatArray) -> FloatArray:
        """Return the part of the cosine orders of s / (R omega^2), from order 1, due to the belt's finite rotation."""
        # One size and load represent all: in these parameters the shape is the same.
        nominal = np.concatenate([parameters, _NOMINAL_TREAD])
        ring = self._exact.solution(nominal, _NOMINAL, RingOptions())
        pressure = ring.contact_pressure_npm * (2.0 * math.pi * _NOMINAL.radius_m / _NOMINAL.load_n)
        normal = 0.5 * waveform_orders(pressure * np.cos(ring.theta_rad), _MAX_ORDER).real[1:]
        tangential = -0.5 * waveform_orders(pressure * np.sin(ring.theta_rad), _MAX_ORDER).imag[1:]
        linear = _CORRECTED * (normal + tangential / _ORDER) / _compliance_inverse(parameters)
        exact = waveform_orders(ring.sensor.radial_m / _NOMINAL.radius_m, _MAX_ORDER).real[1:]
        result: FloatArray = exact - linear
        return result


def _waveform(orders: FloatArray, radius_m: float, offset_m: float) -> SensorWaveform:
    """Return what a sensor on the belt feels whose curvature times radius has these cosine orders, 1 up.

    s = V^2 kappa (1 - e kappa) and, circumferential, -(e / R) ds/dtheta, both without mean.
    """
    spectrum = np.zeros((2, FIELD_SIZE // 2 + 1), dtype=np.complex128)
    field = orders * _TO_SPECTRUM
    spectrum[0, 1 : _MAX_ORDER + 1] = field
    spectrum[1, 1 : _MAX_ORDER + 1] = 1j * field * _ORDER
    change, slope = np.fft.irfft(spectrum, n=FIELD_SIZE, axis=1)
    curvature = 1.0 + change
    radial = radius_m * curvature - offset_m * np.square(curvature)
    zero = np.zeros(FIELD_SIZE)
    return SensorWaveform(radial - radial.mean(), -offset_m * slope, zero, zero, zero, zero)


def _nominal_numbers(parameters: FloatArray) -> FloatArray:
    """Return the numbers at the nominal load number."""
    with np.errstate(over="ignore"):
        numbers = np.array(TABLE_3_NUMBERS) * np.exp(parameters)
    if not np.isfinite(numbers).all():
        raise ValueError(f"the ring's numbers must be finite, not {numbers}")
    return numbers


def _compliance_inverse(parameters: FloatArray) -> FloatArray:
    """Return D_n p0 R^2 / Q, (_MAX_ORDER,) (Eq. 19)."""
    result: FloatArray = _TERMS @ _nominal_numbers(parameters) / TABLE_3_LOAD_NUMBER
    return result


def _orders(parameters: FloatArray, half_angle_rad: float, options: RingOptions) -> FloatArray:
    """Return the cosine orders of s / (R omega^2), orders 1 up (Eq. 27), under uniform pressure and its options.

    Args:
        parameters: of the state.
        half_angle_rad: of the contact.
        options: `pressure_p2`, `pressure_p4`, `pressure_p6`; and `kinematics`, which at 0 reads n^2 under a radial push
            as printed, at 1 n^2 - 1 under a vertical one.
    """
    # The transform of a Legendre polynomial is a spherical Bessel function; even ones alternate in sign.
    push = spherical_jn(0, half_angle_rad * _PUSH_ORDERS)
    if options.pressure_p2:
        push = push - options.pressure_p2 * spherical_jn(2, half_angle_rad * _PUSH_ORDERS)
    if options.pressure_p4:
        push = push + options.pressure_p4 * spherical_jn(4, half_angle_rad * _PUSH_ORDERS)
    if options.pressure_p6:
        push = push - options.pressure_p6 * spherical_jn(6, half_angle_rad * _PUSH_ORDERS)
    load, corrected_share = np.zeros(_MAX_ORDER), options.kinematics
    if corrected_share != 0.0:
        load += corrected_share * _CORRECTED * (_WEIGHT_BELOW * push[:-2] + _WEIGHT_ABOVE * push[2:])
    if corrected_share != 1.0:
        load += (1.0 - corrected_share) * _PRINTED * push[1:-1]
    result: FloatArray = load / _compliance_inverse(parameters)
    return result
