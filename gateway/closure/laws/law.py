"""Base class of the laws of the library."""

from __future__ import annotations

from gateway.closure.effects.effect import Confounder, SignalEffect


class Law(SignalEffect):
    """A law that runs through the model as an effect does; its first parameter is its size.

    Attributes:
        scaling: growth with speed, load and pressure, in words.
    """

    rank = 0
    scaling: str
    observed_in = "what no effect of the catalogue explains"
    confounders: tuple[Confounder, ...] = ()
