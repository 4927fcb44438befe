"""Figures of the papers for programs: from simulated tires, recordings, a dataset, or a table of conditions."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Literal

from gateway.core.errors import TreadlinkError
from gateway.core.session.program_arguments import PathLike, paths, several_names
from gateway.core.text.output_file import check_outputs, write_whole
from gateway.papers.figure_registry import chosen
from gateway.papers.figure_sheet import draw_figures, make_room
from gateway.papers.figure_sources import FigureSource, measured_tires, read_grid, table_csv, table_lines
from gateway.papers.measured_figures import measured_figures


def figures(
    out: PathLike,
    sources: PathLike | Sequence[PathLike] = (),
    *,
    grid: PathLike | None = None,
    names: str | Sequence[str] = (),
    suffix: Literal["svg", "png"] = "svg",
    config: PathLike | None = None,
    force: bool = False,
    on_line: Callable[[str], None] = lambda _: None,
    show_progress: bool = False,
) -> list[Path]:
    """Draw the figures of the papers into a folder, as `treadlink figures`, and return the files.

    Args:
        out: folder; created if it does not exist.
        sources: recordings and datasets; without them and without `grid`, tires are simulated.
        grid: CSV table of recordings and their conditions.
        names: figures; all that can be drawn when empty.
        suffix: format of the figures.
        config: vehicle configuration of the recordings, None for the recorded ones.
        force: overwrite existing files.
        on_line: called with each line that the command prints.
        show_progress: whether a terminal shows how much of a recording is read.

    Raises:
        TreadlinkError: a source cannot be read, the measurements allow no figure, a file exists, or matplotlib is
            missing.
    """
    folder, write, wanted_names = Path(out), partial(write_whole, force=force), several_names(names)
    grid_path, config_path = (None if path is None else Path(path) for path in (grid, config))
    measured = paths(sources)
    table = [folder / "conditions.csv"] if measured or grid_path is not None else []
    if table:
        make_room(folder, [], force=force)
        check_outputs(table, [*measured, grid_path, config_path], force=force)
    inputs = [*map(FigureSource, measured), *(read_grid(grid_path) if grid_path is not None else [])]
    if inputs:
        tires = measured_tires(
            inputs, config_path, lambda path: on_line(f"reading {path}"), show_progress=show_progress
        )
        selected, missing = measured_figures(tires, wanted_names)
        for line in table_lines(tires):
            on_line(line)
        write(table[0], table_csv(tires))
        left_out = [f"{name}: left out: {reason}" for name, reason in missing.items()]
        if not selected:
            raise TreadlinkError(
                "\n".join(("these measurements allow no figure", *left_out)), f"'{table[0]}' has what was measured."
            )
        for line in left_out:
            on_line(line)
    else:
        selected = chosen(wanted_names)
    drawn = draw_figures(
        selected,
        folder,
        suffix=suffix,
        write=write,
        force=force,
        is_measured=bool(inputs),
        on_figure=lambda name, caption: on_line(f"{name}: {caption}"),
    )
    return [*table, *drawn]
