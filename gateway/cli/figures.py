"""`treadlink figures`: draw the figures of the papers from simulated tires or measurements."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click

from gateway.cli.options import config_option, force_option
from gateway.cli.path_option import path_option
from gateway.cli.summary_output import SummaryOutput
from gateway.views.output_file import check_outputs, write_whole


def _print_list(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if not wanted or ctx.resilient_parsing:
        return
    from gateway.papers.figure_registry import all_figures, title

    for name, draw in all_figures().items():
        click.echo(f"{name:20s} {title(draw)}")
    ctx.exit()


@click.command()
@click.argument("names", nargs=-1, metavar="[NAME]...")
@path_option("--out", default=Path("figures"), show_default=True, metavar="DIR", help="Output folder.")
@click.option(
    "--format", "suffix", type=click.Choice(["svg", "png"]), default="svg", show_default=True, help="File format."
)
@path_option(
    "--from",
    "sources",
    multiple=True,
    metavar="PATH",
    help="Draw from this recording or dataset instead of simulated tires; repeat for several.",
)
@path_option(
    "--grid", "grid_path", metavar="TABLE", help="Draw from the recordings of this CSV table, under its conditions."
)
@config_option
@force_option
@click.option("--list", is_flag=True, is_eager=True, expose_value=False, callback=_print_list, help="List the figures.")
def figures(
    names: tuple[str, ...],
    out: Path,
    suffix: str,
    sources: tuple[Path, ...],
    grid_path: Path | None,
    config_path: Path | None,
    force: bool,
) -> None:
    """Draw the figures of the papers, all of them or those named: from simulated tires, or from measurements.

    The caption of each figure compares the result of simulated tires with the paper. The page index.html in the output
    folder shows all figures.

    With --from, those figures are drawn that the measurements allow: 7 and 11 to 16 of the ring paper, 13 to 15 of the
    ply steer paper; a dataset has no waveforms. A --grid has a line for each recording with the columns recording,
    wheel, load_n, pressure_kpa, wear_mm and speed_kmh, of which all but the first may be left out; what it states
    replaces what the recording states. Conditions and numbers are printed, and written to conditions.csv.

    \b
    Examples:
      treadlink figures --from drum-2000N.mcap --from drum-5000N.mcap --out mine
      treadlink figures --grid table-1.csv --out table-1
    """
    from gateway.papers.figure_registry import chosen
    from gateway.papers.figure_sheet import draw_figures

    say = SummaryOutput()
    write = partial(write_whole, force=force)
    table: list[Path] = []
    if sources or grid_path is not None:
        from gateway.cli.figure_sources import FigureSource, measured_tires, read_grid, table_csv, table_lines
        from gateway.errors import TreadlinkError
        from gateway.papers.figure_sheet import make_room
        from gateway.papers.measured_figures import measured_figures

        table = [out / "conditions.csv"]
        make_room(out, [], force=force)
        check_outputs(table, [*sources, grid_path, config_path], force=force)
        inputs = [*map(FigureSource, sources), *(read_grid(grid_path) if grid_path is not None else [])]
        tires = measured_tires(inputs, config_path, lambda path: say(f"reading {path}"))
        wanted, missing = measured_figures(tires, names)
        for line in table_lines(tires):
            say(line)
        for name, reason in missing.items():
            say(f"{name}: left out: {reason}")
        write(table[0], table_csv(tires))
        if not wanted:
            raise TreadlinkError(
                "these measurements allow no figure", f"The reasons are above; '{table[0]}' has what was measured."
            )
    elif config_path is not None:
        raise click.UsageError("--config needs --from or --grid: simulated tires have no configuration.")
    else:
        wanted = chosen(names)

    def on_figure(name: str, caption: str) -> None:
        say(f"{name}: {caption}")

    written = draw_figures(
        wanted, out, suffix=suffix, write=write, force=force, is_measured=bool(table), on_figure=on_figure
    )
    say(f"written: {', '.join(map(str, [*table, f'{len(written) - 1} figures']))} and {written[-1]}")
    say.finish()
