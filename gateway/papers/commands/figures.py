"""`treadlink figures`: draw the figures of the papers from simulated tires or measurements."""

from pathlib import Path
from typing import Literal

import click

from gateway.core.cli.options import config_option, force_option
from gateway.core.cli.path_option import path_option
from gateway.core.cli.summary_output import SummaryOutput


def _print_list(ctx: click.Context, _: click.Parameter, is_requested: bool) -> None:
    if not is_requested or ctx.resilient_parsing:
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
    suffix: Literal["svg", "png"],
    sources: tuple[Path, ...],
    grid_path: Path | None,
    config_path: Path | None,
    force: bool,
) -> None:
    """Draw the figures of the papers, all of them or those named: from simulated tires, or from measurements.

    The caption of each figure compares the result of simulated tires with the paper. The page index.html in the output
    folder shows all figures.

    With --from, those figures are drawn that the measurements allow: 7 and 11 to 16 of the ring paper, 2, 11 and 13 to
    15 of the ply steer paper; a dataset has no waveforms. A --grid has a line for each recording with the columns
    recording, wheel, load_n, pressure_kpa, wear_mm and speed_kmh, of which all but the first may be left out; what it
    states replaces what the recording states. Conditions and numbers are printed, and written to conditions.csv.

    \b
    Examples:
      treadlink figures --from drum-2000N.mcap --from drum-5000N.mcap --out mine
      treadlink figures --grid table-1.csv --out table-1
    """
    if config_path is not None and not sources and grid_path is None:
        raise click.UsageError("--config needs --from or --grid: simulated tires have no configuration.")
    from gateway.core.text.text import counted
    from gateway.papers.paper_figures import figures as draw

    summary = SummaryOutput()
    written = draw(
        out,
        sources,
        grid=grid_path,
        names=names,
        suffix=suffix,
        config=config_path,
        force=force,
        on_line=summary,
        show_progress=True,
    )
    tables = [path for path in written if path.suffix == ".csv"]
    count = len(written) - len(tables) - 1
    summary(f"written: {', '.join(map(str, [*tables, counted(count, 'figure')]))} and {written[-1]}")
    summary.finish()
