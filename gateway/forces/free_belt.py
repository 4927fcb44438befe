"""Free part of the belt under side force: its displacement, without the first order of the lateral axis.

Outside the contact y - t D2 y + b D4 y = 0, D = d/dtheta. So the orders above the first give the belt's mean shift and
its first order, which turning, camber rate and a tilt of the sensor change.
"""

import math
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.core.types import FloatArray
from gateway.forces.lateral_deformation import ORDERS

FIRST_ORDER_STD_M: Final = (4e-4, 1.2e-4)
"""Error of the predicted first order where no side force acts, cosine and sine."""
FIRST_ORDER_SHARE: Final = 0.3
"""Part of the first order by side force over its prediction, less 1, and its spread over tires."""
FIRST_ORDER_SHARE_STD: Final = 0.5
# T / (ky R^2) and EIz / (ky R^4) of the lateral belt's defaults at Table 3's tension and radius.
_TENSION: Final = 0.17
_BENDING: Final = 0.4
_STEPS: Final = 512
_STEP_RAD: Final = 2.0 * math.pi / _STEPS
_ANGLES_RAD: Final[FloatArray] = _STEP_RAD * np.arange(_STEPS, dtype=np.float64)
# Virtual displacements: sin^4 over the free belt times cosines and sines of 1 to _WAVES of its half periods, so that
# they and three derivatives vanish at its ends. They see orders up to about _WAVES / 2 + 2; above there is no force.
_WAVES: Final = 12
# Distance from the contact edges, which are known to some milliradians only.
_CLEARANCE_RAD: Final = 0.02
# Keeps the covariance of nearly equal rows regular.
_RIDGE: Final = 1e-9

_NUMBERS: Final[FloatArray] = np.asarray(ORDERS, dtype=np.float64)
_COSINES: Final[FloatArray] = np.cos(np.multiply.outer(_NUMBERS, _ANGLES_RAD))
_SINES: Final[FloatArray] = np.sin(np.multiply.outer(_NUMBERS, _ANGLES_RAD))
# y of a unit of each coefficient of y''.
_SHAPES: Final[FloatArray] = -np.concatenate([_COSINES, _SINES]) / np.tile(_NUMBERS, 2)[:, np.newaxis] ** 2


def displacement_rows(half_angle_rad: float) -> FloatArray:
    """Return the rows that give shift and yaw, times R, from a lateral record about its contact centre, (2, 2 k).

    Yaw is positive where the rear of the belt, at positive theta, is displaced to the left. The variance of either by
    white noise is the row's square sum.
    """
    return all_rows(half_angle_rad)[[0, 2]]


def first_order_rows(half_angle_rad: float) -> FloatArray:
    """Return the rows that give the first order of a lateral record about its contact centre, (2, 2 k).

    Cosine, then sine, from the orders above, with the usual belt of this module. On random car tires, 40 of the lateral
    belt and 24 of finite elements, the first order beyond the prediction is a constant plus a factor of the prediction,
    to 5e-4 of it up to slip angles of 3 deg. Constants are 0 within `FIRST_ORDER_STD_M`, a quarter less of the lateral
    belt, factors `FIRST_ORDER_SHARE` within `FIRST_ORDER_SHARE_STD`.
    """
    return -all_rows(half_angle_rad)[1:]


def all_rows(half_angle_rad: float) -> FloatArray:
    """Return the rows that give shift, cosine and sine of the first order of y, (3, 2 k)."""
    return _rows(math.ceil((half_angle_rad + _CLEARANCE_RAD) / _STEP_RAD))


@lru_cache(maxsize=64)
def _rows(begin: int) -> FloatArray:
    span = (_STEPS - 2 * begin) * _STEP_RAD
    phase = np.clip((_ANGLES_RAD - begin * _STEP_RAD) / span, 0.0, 1.0) * math.pi
    window = np.sin(phase) ** 4
    waves = np.multiply.outer(np.arange(1, _WAVES + 1), phase)
    virtual = window * np.concatenate([np.cos(waves), np.sin(waves)])
    # The operator is symmetric, so it may act on the virtual displacement.
    order = np.fft.fftfreq(_STEPS, 1.0 / _STEPS)
    factor = 1.0 + _TENSION * order**2 + _BENDING * order**4
    loads = np.fft.ifft(np.fft.fft(virtual, axis=1) * factor, axis=1).real
    work = loads @ _SHAPES.T
    unknowns = loads @ np.stack([np.ones(_STEPS), np.cos(_ANGLES_RAD), np.sin(_ANGLES_RAD)], axis=1)
    first = (_NUMBERS == 1.0).nonzero()[0]
    ignored = np.concatenate([first, len(_NUMBERS) + first])
    work[:, ignored] = 0.0
    covariance = work @ work.T
    covariance += _RIDGE * np.trace(covariance) / len(covariance) * np.eye(len(covariance))
    weighted = np.linalg.solve(covariance, unknowns).T
    weights: FloatArray = -np.linalg.solve(weighted @ unknowns, weighted @ work)
    weights.setflags(write=False)
    return weights
