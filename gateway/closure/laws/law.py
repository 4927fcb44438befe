"""Base class of the laws of the library."""

from __future__ import annotations

from gateway.closure.effects.effect import Confounder, SignalEffect


class Law(SignalEffect):
    """A law that runs through the model as an effect does.

    Attributes:
        scaling: growth with speed, load and pressure, in words.
        sizes: number of its first parameters that make its size; the others shape it.
        equation_share: error of its sizes by its equation, as a share of them.
    """

    rank = 0
    scaling: str
    sizes = 1
    equation_share = 0.0
    observed_in = "what no effect of the catalogue explains"
    confounders: tuple[Confounder, ...] = ()

    def renew(self) -> None:
        """Work out anew what is kept of the belt; nothing by default."""
