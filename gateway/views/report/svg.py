"""Drawings as SVG that stand within an HTML page, take its colours, and need nothing from outside."""

from __future__ import annotations

import io
import re
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, Final

from gateway.errors import OutputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Colours that stand for roles: the page's style sheet says what they are, on screen, in the dark and in print.
INK: Final = "#010203"
QUIET: Final = "#040506"
GRID: Final = "#070809"
MEASURED: Final = "#0a0b0c"
BEFORE: Final = "#0d0e0f"
AFTER: Final = "#101112"
NOISE: Final = "#131415"
LEFT: Final = "#161718"
PAPER: Final = "#191a1b"
_VARIABLES: Final = {
    INK: "--ink", QUIET: "--quiet", GRID: "--grid", MEASURED: "--measured", BEFORE: "--before", AFTER: "--after",
    NOISE: "--noise", LEFT: "--left", PAPER: "--paper",
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
    missing = []
    try:
        import jinja2  # noqa: F401 - only whether it is there
    except ImportError:
        missing.append("jinja2")
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        missing.append("matplotlib")
    if missing:
        are = "which is not installed" if len(missing) == 1 else "which are not installed"
        raise OutputError(
            f"the HTML report needs {' and '.join(missing)}, {are}", "Install it with: pip install 'treadlink[plot]'."
        )


def report_style() -> AbstractContextManager[None]:
    """Return a context in which figures are drawn in the report's style."""
    import matplotlib

    style: Any = {
        "axes.axisbelow": True,
        "axes.edgecolor": QUIET,
        "axes.formatter.limits": (-4, 5),
        "axes.formatter.use_mathtext": True,
        "axes.grid": True,
        "axes.labelcolor": INK,
        "axes.labelsize": 10.0,
        "axes.linewidth": 0.8,
        "axes.spines.right": False,
        "axes.spines.top": False,
        "axes.titlelocation": "left",
        "axes.titlesize": 10.5,
        "axes.unicode_minus": True,
        "figure.facecolor": "none",
        "axes.facecolor": "none",
        "font.family": "DejaVu Sans",
        "font.size": 10.0,
        "grid.color": GRID,
        "grid.linewidth": 0.7,
        "legend.facecolor": "none",
        "legend.fontsize": 9.5,
        "legend.frameon": False,
        "lines.linewidth": 1.4,
        "path.simplify": True,
        "path.simplify_threshold": 0.15,
        "svg.fonttype": "path",  # looks the same wherever it is opened
        "svg.hashsalt": "treadlink",
        "text.color": INK,
        "xtick.color": QUIET,
        "xtick.labelcolor": INK,
        "ytick.color": QUIET,
        "ytick.labelcolor": INK,
    }
    return matplotlib.rc_context(style)


def new_figure(width_inch: float, height_inch: float) -> Figure:
    """Return an empty figure that needs no display."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_inch, height_inch), layout="constrained")


def drawable(text: str) -> str:
    """Return text as a figure's font can draw it, without what would be read as mathematics."""
    return "".join(c if c.isprintable() and c < "\u0250" and c != "$" else "·" for c in text)


def inline_svg(figure: Figure, prefix: str) -> str:
    """Return a figure as one SVG element with colours by role and identities that start with `prefix`."""
    buffer = io.StringIO()
    # No date, no creator: the same diagnosis gives the same bytes, and no address is named.
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = buffer.getvalue()
    text = _STYLE_SHEET.sub("", _COMMENT.sub("", text[text.index("<svg") :]))
    text = _OPENING.sub(r'<svg viewBox="\1" aria-hidden="true" focusable="false">', text, count=1)
    # A hundredth of a point is finer than any screen or printer, and halves the file.
    text = _PATH.sub(lambda match: _LONG_NUMBER.sub(r"\1", match[0]).replace(" \n", " "), text)
    text = _COLOUR.sub(lambda match: f"var({_VARIABLES[match[0]]})", text)
    return _IDENTITY.sub(rf"\g<1>{prefix}-", text)
