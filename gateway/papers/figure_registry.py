"""Registry of the papers' figures."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from gateway.core.errors import ConfigError
from gateway.core.nearest_name import did_you_mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Modules with a function `figures()` that returns name -> function; the function draws and returns its caption.
MODULES: Final = (
    "gateway.papers.mode_figures",
    "gateway.papers.damping_figure",
    "gateway.papers.ring_figures",
    "gateway.papers.ply_steer_figures",
)


def all_figures() -> dict[str, Callable[[Figure], str]]:
    """Return every figure by name, without importing matplotlib."""
    return {name: draw for module in MODULES for name, draw in importlib.import_module(module).figures().items()}


def title(draw: Callable[[Figure], str]) -> str:
    """Return the title of a figure, in one line."""
    return (draw.__doc__ or "").strip().splitlines()[0].rstrip(".")


def chosen(names: tuple[str, ...]) -> dict[str, Callable[[Figure], str]]:
    """Return the figures with these names; all figures if `names` is empty.

    Raises:
        ConfigError: unknown name.
    """
    figures = all_figures()
    unknown = [name for name in names if name not in figures]
    if unknown:
        raise ConfigError(
            f"no figure '{unknown[0]}'", f"{did_you_mean(unknown[0], figures)}Known figures: {', '.join(figures)}."
        )
    return {name: figures[name] for name in names} if names else figures
