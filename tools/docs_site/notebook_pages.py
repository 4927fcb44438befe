"""Pages of the notebooks: their text and code, and their outputs when they are run."""

import re
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

NOTEBOOKS: Final = Path(__file__).parents[2] / "examples" / "notebooks"
_FOLDER: Final = "tutorials"
_LINK: Final = re.compile(r"\]\(([\w-]+)\.ipynb\)")
_TIMEOUT_S: Final = 600


def notebook_markdown(*, run: bool = False) -> dict[str, Callable[[], str]]:
    """Return path in the site -> what writes the page of every notebook; `run` executes it, so that it has outputs."""
    return {page_of(path): partial(_page, path, run=run) for path in sorted(NOTEBOOKS.glob("*.ipynb"))}


def page_of(path: Path) -> str:
    """Return the path in the site of a notebook's page."""
    return f"{_FOLDER}/notebook-{path.stem}.md"


def _page(path: Path, *, run: bool) -> str:
    import nbformat

    notebook = nbformat.read(path, as_version=4)
    if run:
        from nbclient import NotebookClient

        with tempfile.TemporaryDirectory() as folder:
            resources = {"metadata": {"path": folder}}
            NotebookClient(notebook, timeout=_TIMEOUT_S, kernel_name="python3", resources=resources).execute()
    parts: list[str] = []
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            parts.append(_LINK.sub(r"](notebook-\1.md)", cell.source))
        else:
            parts += [f"```python\n{cell.source}\n```", *map(_output, cell.outputs)]
    parts.insert(1, f"This page is the notebook `examples/notebooks/{path.name}`.")
    return "\n\n".join(filter(None, parts)) + "\n"


def _output(output: Any) -> str:
    data = output.get("data", {})
    if "image/png" in data:
        encoded = "".join(data["image/png"].split())
        return f"![Figure drawn by the code above](data:image/png;base64,{encoded})"
    text = output.get("text") or data.get("text/plain", "")
    return f"```text\n{text.rstrip()}\n```" if text.strip() else ""
