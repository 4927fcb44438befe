"""Displacement of the belt against the wheel, from the lateral shape of its free part: side shift and yaw.

Outside the contact nothing pushes the belt sideways but the sidewall, so its lateral displacement y obeys

    y - t y'' + b y'''' = 0,  t = T / (ky R^2), b = EIz / (ky R^4),

in which the mean of y, which no accelerometer measures, and order 1, which contains gravity, are unknowns: a shift and
a yaw of the belt. With virtual displacements that vanish in the contact they follow linearly from the orders from 2 on.
t and b are those of a usual belt. Another belt, which also twists, and in which the sensor rolls with it, only changes
the factor between force and shift, and between moment and yaw (docs/explanation/forces.md). A calibration gives them.
"""

import math
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.estimators.lateral_shape import ORDERS
from gateway.types import FloatArray

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
    return _rows(math.ceil((half_angle_rad + _CLEARANCE_RAD) / _STEP_RAD))


@lru_cache(maxsize=64)
def _rows(begin: int) -> FloatArray:
    span = (_STEPS - 2 * begin) * _STEP_RAD
    along = np.clip((_ANGLES_RAD - begin * _STEP_RAD) / span, 0.0, 1.0) * math.pi
    window = np.sin(along) ** 4
    waves = np.multiply.outer(np.arange(1, _WAVES + 1), along)
    virtual = window * np.concatenate([np.cos(waves), np.sin(waves)])
    # The operator is symmetric, so it may act on the virtual displacement.
    order = np.fft.fftfreq(_STEPS, 1.0 / _STEPS)
    factor = 1.0 + _TENSION * order**2 + _BENDING * order**4
    pulled = np.fft.ifft(np.fft.fft(virtual, axis=1) * factor, axis=1).real
    work = pulled @ _SHAPES.T
    unknowns = pulled @ np.stack([np.ones(_STEPS), np.cos(_ANGLES_RAD), np.sin(_ANGLES_RAD)], axis=1)
    first = (_NUMBERS == 1.0).nonzero()[0]
    ignored = np.concatenate([first, len(_NUMBERS) + first])
    work[:, ignored] = 0.0
    covariance = work @ work.T
    covariance += _RIDGE * np.trace(covariance) / len(covariance) * np.eye(len(covariance))
    weighted = np.linalg.solve(covariance, unknowns).T
    weights: FloatArray = -np.linalg.solve(weighted @ unknowns, weighted @ work)
    rows = weights[[0, 2]]
    rows.setflags(write=False)
    return rows
