"""Figures of tables by matplotlib: quantities against time, angle or order, one axis for each unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.core.errors import OutputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ABSCISSAE: Final = ("angle_rad", "device_s", "device_start_s", "device_end_s", "first_s")
_WIDTH_IN: Final = 8.0
_HEIGHT_IN: Final = 2.6


def abscissa_of(columns: Sequence[str]) -> str:
    """Return the column that the others are drawn against: the angle, or the time of the hub's clock.

    Raises:
        KeyError: the table has neither.
    """
    for name in _ABSCISSAE:
        if name in columns:
            return name
    raise KeyError("the table has no angle and no time to draw against")


def drawn(
    x: NDArray[Any], x_label: str, series: Mapping[str, tuple[NDArray[Any], NDArray[Any] | None, str]], title: str
) -> Figure:
    """Return a figure.

    Args:
        x: (n,) abscissa, or for each series of its length.
        x_label: its name with its unit.
        series: by label, values (n,), standard errors (n,) or None, and unit.
        title: of the figure.

    Raises:
        OutputError: matplotlib is not installed.
    """
    return drawn_each({label: (x, *values) for label, values in series.items()}, x_label, title)


def drawn_each(
    series: Mapping[str, tuple[NDArray[Any], NDArray[Any], NDArray[Any] | None, str]], x_label: str, title: str
) -> Figure:
    """Return a figure of series with abscissae of their own: label to (x, values, errors or None, unit).

    Raises:
        OutputError: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise OutputError("plot() needs the package matplotlib", "Install it: pip install 'treadlink[plot]'") from error
    units = list(dict.fromkeys(unit for _, _, _, unit in series.values()))
    figure = Figure(figsize=(_WIDTH_IN, _HEIGHT_IN * max(len(units), 1)), layout="constrained")
    axes = figure.subplots(max(len(units), 1), sharex=True, squeeze=False)[:, 0]
    for axis, unit in zip(axes, units, strict=False):
        for label, (x, values, errors, own_unit) in series.items():
            if own_unit != unit:
                continue
            (line,) = axis.plot(x, values, label=label, linewidth=1.0)
            if errors is not None:
                band = np.asarray(errors, dtype=np.float64)
                axis.fill_between(x, values - band, values + band, color=line.get_color(), alpha=0.2, linewidth=0)
        axis.set_ylabel(unit or "1")
        axis.grid(alpha=0.3)
        axis.legend(loc="upper right", fontsize="small")
    axes[-1].set_xlabel(x_label)
    # A long title must not narrow the axes.
    axes[0].set_title(title, fontsize="medium", loc="left", wrap=True).set_in_layout(False)
    return figure
