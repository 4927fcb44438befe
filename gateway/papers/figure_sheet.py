"""Output of figures to files in one style, with an index page of their captions."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gateway.core.errors import OutputError
from gateway.core.optional_packages import require_packages
from gateway.core.text.figure_file import figure_bytes
from gateway.papers.figure_registry import title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INDEX: Final = "index.html"

_SIZE_INCH: Final = (7.0, 4.4)
# The palette of Okabe and Ito, which is safe for colour-blind readers.
_COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")


def draw_figures(
    figures: Mapping[str, Callable[[Figure], str]],
    out: Path,
    *,
    suffix: str,
    write: Callable[[Path, bytes], None],
    force: bool = False,
    is_measured: bool = False,
    on_figure: Callable[[str, str], None] = lambda _name, _caption: None,
) -> list[Path]:
    """Draw figures into the folder `out`, with an index page of captions; return the files written.

    Args:
        figures: drawing function by name.
        out: folder; created if it does not exist.
        suffix: one of FORMATS.
        write: writes a whole file.
        force: whether existing files may be replaced.
        is_measured: whether they are of measurements, not of simulated tires.
        on_figure: called with name and caption after each figure.

    Raises:
        OutputError: matplotlib is missing, a file exists, or the folder cannot be written.
    """
    require_packages("figures", "plot", "matplotlib")
    import matplotlib
    from matplotlib.figure import Figure

    files = [out / f"{name}.{suffix}" for name in figures]
    make_room(out, [*files, out / INDEX], force=force)
    captions: dict[str, str] = {}
    with matplotlib.rc_context(_style()):
        for (name, draw), file in zip(figures.items(), files, strict=True):
            figure = Figure(figsize=_SIZE_INCH, dpi=150, layout="constrained")
            captions[name] = draw(figure)
            for axes in figure.axes:
                axes.spines[["top", "right"]].set_visible(False)
                # A recording's name may contain dollar signs.
                for text in legend.get_texts() if (legend := axes.get_legend()) is not None else ():
                    text.set_parse_math(False)
            write(file, figure_bytes(figure, suffix))
            on_figure(name, captions[name])
    write(out / INDEX, _index(figures, captions, suffix, is_measured=is_measured).encode())
    return [*files, out / INDEX]


def _style() -> Any:
    from cycler import cycler

    return {
        "axes.prop_cycle": cycler(color=_COLOURS), "axes.grid": True, "grid.color": "0.9", "grid.linewidth": 0.8,
        "axes.axisbelow": True, "font.size": 10.0, "axes.labelsize": 10.5, "legend.frameon": True,
        "legend.framealpha": 0.9, "legend.edgecolor": "0.85", "lines.linewidth": 1.6, "svg.hashsalt": "treadlink",
    }  # fmt: skip


def make_room(out: Path, files: list[Path], *, force: bool) -> None:
    """Create the folder of files that are to be written.

    Raises:
        OutputError: it cannot be created, or a file exists and `force` is not set.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot create the folder '{out}': {error.strerror}", "Choose another folder.") from error
    existing = [file for file in files if file.exists()]
    if existing and not force:
        raise OutputError(f"'{existing[0]}' already exists", "Choose another folder, or replace it with --force.")


def _index(
    figures: Mapping[str, Callable[[Figure], str]], captions: Mapping[str, str], suffix: str, *, is_measured: bool
) -> str:
    """Return the HTML page that shows the figures with their captions."""
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8"><title>Figures of the papers, redrawn</title>',
        "<style>body{font:16px/1.5 sans-serif;max-width:46rem;margin:2rem auto;padding:0 1rem}"
        "img{width:100%}figure{margin:2.5rem 0}</style></head><body>",
        "<h1>Figures of the papers, redrawn</h1>",
        "<p>Drawn from measurements by the estimators of treadlink.</p>"
        if is_measured
        else "<p>Drawn from simulated tires and the estimators of treadlink. Each caption reports what is reproduced "
        "and what is not.</p>",
    ]
    for name, draw in figures.items():
        parts.append(
            f'<figure id="{name}"><h2>{html.escape(name)}: {html.escape(title(draw))}</h2>'
            f'<img src="{name}.{suffix}" alt="{html.escape(title(draw))}">'
            f"<figcaption>{html.escape(captions[name])}</figcaption></figure>"
        )
    return "\n".join([*parts, "</body></html>", ""])
