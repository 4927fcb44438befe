"""What the equations of effects are good to."""

from __future__ import annotations

from typing import Final

from gateway.closure.effects.base import Approximate
from gateway.closure.model import AngleEffect

# As a share of what an effect adds: against the simulator they leave 0.2 to 3 %, most of it taken up by the other
# parameters. What is smaller than this beside an effect must not be called by a name.
_SHARE: Final = 0.01


def equation_share(effect: AngleEffect) -> float:
    """Return the share of what an effect adds that its equation leaves."""
    return effect.equation_share if isinstance(effect, Approximate) else _SHARE
