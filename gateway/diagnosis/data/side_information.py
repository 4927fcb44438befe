"""Side information about effects beside the waveforms: the hub's clock against the host's."""

import math
from typing import Final, NamedTuple

from gateway.diagnosis.data.campaign_data import Campaign

CLOCK: Final = "sample clock error"
HOST_CLOCK: Final = 5e-5
"""Accuracy of a host's crystal."""


class Witness(NamedTuple):
    """One parameter measured independently of the waveforms.

    Attributes:
        effect: name of the effect whose only parameter it is; 0 where the effect is absent.
        value: measured value.
        std: one standard error.
    """

    effect: str
    value: float
    std: float

    def misfit(self, parameter: float) -> float:
        """Return the chi-square of a parameter."""
        return ((parameter - self.value) / self.std) ** 2


def witnesses(campaign: Campaign) -> tuple[Witness, ...]:
    """Return the side information of a campaign."""
    share, std = campaign.clock_error
    if not (math.isfinite(share) and math.isfinite(std)):
        return ()
    return (Witness(CLOCK, share, math.hypot(std, HOST_CLOCK)),)
