"""`treadlink figures`: the papers' figures, redrawn."""

from __future__ import annotations

from pathlib import Path

import click


def _print_list(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if not wanted or ctx.resilient_parsing:
        return
    from gateway.papers.figure_registry import all_figures, title

    for name, draw in all_figures().items():
        click.echo(f"{name:20s} {title(draw)}")
    ctx.exit()


@click.command()
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option("--out", type=click.Path(path_type=Path), default=Path("figures"), show_default=True, help="Folder.")
@click.option("--format", "suffix", type=click.Choice(["svg", "png"]), default="svg", show_default=True)
@click.option("--force", is_flag=True, help="Replace figures that are there.")
@click.option("--list", is_flag=True, is_eager=True, expose_value=False, callback=_print_list, help="What there is.")
def figures(names: tuple[str, ...], out: Path, suffix: str, force: bool) -> None:
    """Redraw the papers' figures from simulated tires through the estimators: all, or those named.

    Each comes with a caption that says what came out and what did not; index.html in the folder shows all.
    """
    from gateway.papers.figure_registry import chosen
    from gateway.papers.figure_sheet import draw_figures

    wanted = chosen(names)

    def told(name: str, caption: str) -> None:
        click.echo(f"{name}: {caption}")

    written = draw_figures(wanted, out, suffix=suffix, force=force, on_figure=told)
    click.echo(f"wrote {len(written) - 1} figures and {written[-1]}")
