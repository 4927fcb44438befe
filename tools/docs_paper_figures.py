"""The ring paper's figures in the documentation, as `treadlink figures` draws them, without its index page.

python -m tools.docs_paper_figures        # about half a minute; needs treadlink[plot]
"""

import tempfile
from pathlib import Path
from typing import Final

from gateway.papers.figure_registry import all_figures, chosen
from gateway.papers.figure_sheet import draw_figures
from tools.docs_outputs import ROOT

FOLDER: Final = ROOT / "docs" / "figures"


def names() -> tuple[str, ...]:
    """Return the figures that the documentation shows."""
    return tuple(name for name in all_figures() if name.startswith("ring-"))


def main() -> None:
    """Draw the figures and copy them."""
    with tempfile.TemporaryDirectory() as folder:
        draw_figures(chosen(names()), Path(folder), suffix="svg", write=Path.write_bytes)
        for name in names():
            (FOLDER / f"{name}.svg").write_bytes((Path(folder) / f"{name}.svg").read_bytes())


if __name__ == "__main__":
    main()
