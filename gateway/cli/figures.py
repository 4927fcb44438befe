"""`treadlink figures`: draw the figures of the papers from simulated tires."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click

from gateway.cli.options import force_option
from gateway.cli.summary_output import SummaryOutput
from gateway.views.output_file import write_whole


def _print_list(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if not wanted or ctx.resilient_parsing:
        return
    from gateway.papers.figure_registry import all_figures, title

    for name, draw in all_figures().items():
        click.echo(f"{name:20s} {title(draw)}")
    ctx.exit()


@click.command()
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("figures"),
    show_default=True,
    metavar="DIR",
    help="Output folder.",
)
@click.option(
    "--format", "suffix", type=click.Choice(["svg", "png"]), default="svg", show_default=True, help="File format."
)
@force_option
@click.option("--list", is_flag=True, is_eager=True, expose_value=False, callback=_print_list, help="List the figures.")
def figures(names: tuple[str, ...], out: Path, suffix: str, force: bool) -> None:
    """Draw the figures of the papers from simulated tires and the estimators, all of them or those named.

    The caption of each figure compares the result with the paper. The page index.html in the output folder shows all
    figures.
    """
    from gateway.papers.figure_registry import chosen
    from gateway.papers.figure_sheet import draw_figures

    wanted = chosen(names)

    say = SummaryOutput()

    def on_figure(name: str, caption: str) -> None:
        say(f"{name}: {caption}")

    write = partial(write_whole, force=force)
    written = draw_figures(wanted, out, suffix=suffix, write=write, force=force, on_figure=on_figure)
    say(f"written: {len(written) - 1} figures and {written[-1]}")
    say.finish()
