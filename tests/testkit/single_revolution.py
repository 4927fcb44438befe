"""Steps of the signal chain for one revolution, which the gateway takes for several at once."""

from typing import Any

import numpy as np

from gateway.core.revolutions.angle_resampling import GRID_SIZE, Phase, resample_revolutions
from gateway.core.revolutions.speed_normalisation import NormalisedRevolutions, normalise_revolutions


def resample_revolution(samples_mps2: np.ndarray, phase: Phase, n: int = GRID_SIZE) -> np.ndarray:
    return resample_revolutions([samples_mps2], [phase], n)[0]


def normalise_radial(
    radial_mps2: np.ndarray, phase: Phase, *, steady_mps2: float | None = None, **options: Any
) -> NormalisedRevolutions:
    steady = None if steady_mps2 is None else np.array([steady_mps2])
    rows = normalise_revolutions(radial_mps2[np.newaxis], [phase], steady_mps2=steady, **options)
    return NormalisedRevolutions(*(getattr(rows, name)[0] for name in NormalisedRevolutions.__slots__))
