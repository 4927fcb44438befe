"""The figure of the diagnosis tutorial: the first figure of the report that its commands write, as one SVG file.

python -m tools.docs_figure        # about a minute; needs treadlink[plot]
"""

import re
import tempfile
from pathlib import Path
from typing import Final

from tools.docs_outputs import ROOT, marks_of, run

PAGE: Final = ROOT / "docs" / "tutorials" / "why-does-the-model-not-fit.md"
FIGURE: Final = ROOT / "docs" / "figures" / "diagnose-circumferential.svg"


def first_figure(report: str) -> str:
    """Return the first figure of a report as a file of its own, in the report's light colours on white."""
    figure = report[report.index("<figure") :]
    width, height = re.findall(r"viewBox=\"0 0 ([\d.]+) ([\d.]+)\"", figure)[0]
    drawing = figure[figure.index("<defs>") : figure.index("</svg>")]
    colours = dict(re.findall(r"--(\w+): *(#\w+)", report)[::-1])
    drawing = re.sub(r"var\(--(\w+)\)", lambda match: colours[match[1]], drawing)
    drawing = re.sub(r'd="[^"]+"', lambda match: re.sub(r"(\.\d)\d+", r"\1", match[0]), drawing)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" width="{width}" '
        f'height="{height}" viewBox="0 0 {width} {height}">\n<rect width="100%" height="100%" fill="#ffffff"/>\n'
        f"{drawing}</svg>\n"
    )


def main() -> None:
    """Run the tutorial's commands and write the figure."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for mark in marks_of(PAGE):
            if mark.kind == "file":
                (folder / mark.text).write_text(mark.body, "utf-8")
            elif mark.kind == "output" and not (folder / "report.html").exists():
                run(mark.text, folder)
        FIGURE.write_text(first_figure((folder / "report.html").read_text("utf-8")), "utf-8")


if __name__ == "__main__":
    main()
