"""Roll tilt of a sensor from the means of its lateral and radial axes."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

# What may stand in the mean of the lateral axis beside the tilt, as a constant: zero-g offset left after the hello's
# calibration (0.1 g) and gravity times camber (1 m/s^2 is 6 deg).
OFFSET_STD_MPS2: Final = 1.0
# How far the mean of one revolution strays from that: cornering, crossfall, noise.
REVOLUTION_STD_MPS2: Final = 0.5
# How well a sensor is put in by hand. Used as it stands when the means are lost (AC coupling).
MOUNTING_STD_RAD: Final = math.radians(1.0)
# Nobody mounts a sensor worse than this; keeps the first revolutions finite.
_ROLL_PRIOR_STD_RAD: Final = math.radians(10.0)


class RollCalibration:
    """Straight line mean(lateral) = tan(roll) mean(radial) + offset over revolutions, with a prior on the offset.

    Over a closed belt the lateral displacement adds nothing to the mean and the radial mean is R Omega^2. At one speed
    the tilt is as good as the offset is known (1 m/s^2 at 65 km/h is 0.06 deg); revolutions at other speeds separate
    the two by themselves. Old revolutions fade out, so the line follows temperature.
    """

    def __init__(self, offset_std_mps2: float = OFFSET_STD_MPS2, horizon_revolutions: float = 500.0) -> None:
        """Start at no tilt and no offset.

        Args:
            offset_std_mps2: one standard error of the constant in the lateral mean.
            horizon_revolutions: revolution count of the memory.
        """
        self._prior = np.diag([math.tan(_ROLL_PRIOR_STD_RAD) ** -2, offset_std_mps2**-2])
        self._keep = 1.0 - 1.0 / horizon_revolutions
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._information = np.zeros((2, 2))
        self._weighted = np.zeros(2)
        self.count = 0
        self._roll_rad, self._roll_std_rad, self._offset_mps2 = 0.0, MOUNTING_STD_RAD, 0.0

    def update(self, mean_lateral_mps2: float, mean_radial_mps2: float) -> None:
        """Take in the means of one revolution as measured; a radial mean that is not positive (AC) is left out."""
        if not (math.isfinite(mean_lateral_mps2) and mean_radial_mps2 > 0.0):
            return
        row = np.array([mean_radial_mps2, 1.0]) / REVOLUTION_STD_MPS2
        self._information = self._keep * self._information + np.outer(row, row)
        self._weighted = self._keep * self._weighted + row * (mean_lateral_mps2 / REVOLUTION_STD_MPS2)
        self.count += 1
        (aa, ab), (_, bb) = self._information + self._prior
        determinant = aa * bb - ab * ab
        a, b = self._weighted
        self._roll_rad = math.atan((bb * a - ab * b) / determinant)
        self._roll_std_rad = math.sqrt(bb / determinant)
        self._offset_mps2 = float((aa * b - ab * a) / determinant)

    @property
    def roll_rad(self) -> float:
        """Best estimate of the tilt; 0 before the first revolution."""
        return self._roll_rad

    @property
    def roll_std_rad(self) -> float:
        """One standard error of the tilt."""
        return self._roll_std_rad

    @property
    def offset_mps2(self) -> float:
        """Best estimate of the constant in the lateral mean."""
        return self._offset_mps2
