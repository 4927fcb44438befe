"""Figures of result pages as inline SVG, with colours by role that the style sheet of the page sets."""

from __future__ import annotations

import io
import re
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from gateway.core.optional_packages import require_packages

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.figure import Figure

# Placeholder colours, replaced by the CSS variables of their roles.
INK: Final = "#010203"
QUIET: Final = "#040506"
GRID: Final = "#070809"
MEASURED: Final = "#0a0b0c"
BEFORE: Final = "#0d0e0f"
AFTER: Final = "#101112"
NOISE: Final = "#131415"
RESIDUAL: Final = "#161718"
PAPER: Final = "#191a1b"
GOOD: Final = "#1c1d1e"
_VARIABLES: Final = {
    INK: "--ink", QUIET: "--quiet", GRID: "--grid", MEASURED: "--measured", BEFORE: "--before", AFTER: "--after",
    NOISE: "--noise", RESIDUAL: "--left", PAPER: "--paper", GOOD: "--good",
}  # fmt: skip

_COLOUR: Final = re.compile("|".join(_VARIABLES))
_IDENTITY: Final = re.compile(r'(\bid="|href="#|url\(#)')
_STYLE_SHEET: Final = re.compile(r"<style.*?</style>", re.DOTALL)
_COMMENT: Final = re.compile(r"<!--.*?-->\s*", re.DOTALL)
_PATH: Final = re.compile(r' d="[^"]*"')
_LONG_NUMBER: Final = re.compile(r"(\d+\.\d\d)\d+")
_OPENING: Final = re.compile(r"<svg [^>]*?viewBox=\"([^\"]*)\"[^>]*>")


def require_report_packages() -> None:
    """Raise OutputError, naming the extra to install, when a package of the report is missing."""
    require_packages("the HTML report", "plot", "jinja2", "matplotlib")


def report_style() -> AbstractContextManager[None]:
    """Return a context in which figures are drawn in the report's style."""
    import matplotlib

    # Letters are drawn as paths, independent of installed fonts.
    style: Any = {
        "axes.axisbelow": True, "axes.edgecolor": QUIET, "axes.formatter.limits": (-4, 5), "axes.grid": True,
        "axes.labelcolor": INK, "axes.labelsize": 10.0, "axes.linewidth": 0.8, "axes.spines.right": False,
        "axes.spines.top": False, "axes.titlelocation": "left", "axes.titlesize": 10.5, "axes.unicode_minus": True,
        "figure.facecolor": "none", "axes.facecolor": "none", "font.family": "DejaVu Sans", "font.size": 10.0,
        "grid.color": GRID, "grid.linewidth": 0.7, "legend.facecolor": "none", "legend.fontsize": 9.5,
        "legend.frameon": False, "lines.linewidth": 1.4, "path.simplify": True, "path.simplify_threshold": 0.15,
        "svg.fonttype": "path", "svg.hashsalt": "treadlink", "text.color": INK, "xtick.color": QUIET,
        "xtick.labelcolor": INK, "ytick.color": QUIET, "ytick.labelcolor": INK,
    }  # fmt: skip
    return matplotlib.rc_context(style)


def new_figure(width_inch: float, height_inch: float) -> Figure:
    """Return an empty figure that needs no display."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_inch, height_inch), layout="constrained")


def drawable(text: str) -> str:
    """Return text in characters of the figure's font and without mathematical markup."""
    return "".join(c if c.isprintable() and c < "\u0250" and c != "$" else "·" for c in text)


class Drawing(NamedTuple):
    """One figure of a page: SVG that needs no escaping, and its text."""

    svg: Markup
    alt: str
    title: str
    caption: str


def inline_svg(figure: Figure, prefix: str) -> Markup:
    """Return a figure as one SVG element with colours by role and identities that start with `prefix`.

    Matplotlib escapes what it draws, so that templates need not.
    """
    from markupsafe import Markup
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer = io.StringIO()
    # `savefig` would draw the figure twice, first to lay it out. Without date and creator the same diagnosis gives the
    # same bytes, and no URL appears.
    metadata = {"Date": None, "Creator": None, "Format": None, "Type": None}
    FigureCanvasSVG(figure).print_svg(buffer, metadata=metadata)  # type: ignore[no-untyped-call]
    text = buffer.getvalue()
    text = _STYLE_SHEET.sub("", _COMMENT.sub("", text[text.index("<svg") :]))
    text = _OPENING.sub(r'<svg viewBox="\1" aria-hidden="true" focusable="false">', text, count=1)
    # A hundredth of a point is finer than any screen or printer; rounding halves the file.
    text = _PATH.sub(lambda match: _LONG_NUMBER.sub(r"\1", match[0]).replace(" \n", " "), text)
    text = _COLOUR.sub(lambda match: f"var({_VARIABLES[match[0]]})", text)
    return Markup(_IDENTITY.sub(rf"\g<1>{prefix}-", text))
