"""`treadlink orders`: order spectra, amplitudes against speed and the average of the wheels of a recording."""

from pathlib import Path

import click

from gateway.core.cli.options import FiniteRange, config_option, effects_option, force_option, keys_option
from gateway.core.cli.path_option import path_option
from gateway.core.errors import TreadlinkError
from gateway.core.shown_units import shown_in
from gateway.core.text.wording import text

_DEFAULT_ORDERS = 12
_SPEED_STEP_KMH = 5.0


@click.command()
@click.argument("recording", type=click.Path(path_type=Path))
@click.option(
    "--wheel", "wheels", multiple=True, metavar="POSITION", help="Only this wheel; repeat for several.  [default: all]"
)
@click.option(
    "--orders",
    "shown",
    type=click.IntRange(min=0, max=60),
    default=_DEFAULT_ORDERS,
    show_default=True,
    metavar="N",
    help="Highest order that is printed.",
)
@click.option(
    "--speed-step",
    "speed_step_kmh",
    type=FiniteRange(min=0.5, max=100.0),
    default=_SPEED_STEP_KMH,
    show_default=True,
    metavar="KMH",
    help="Width in km/h of the ranges of speed that are told apart.",
)
@path_option("--figure", help="Draw a figure: .html, .svg or .png; needs treadlink[plot].")
@path_option(
    "--csv",
    "csv_path",
    allow_dash=True,
    help="Write the amplitudes to a CSV table, one row per order and range of speed.",
)
@path_option("--json", "json_path", allow_dash=True, help="Write everything to a JSON file.")
@config_option
@effects_option
@keys_option
@force_option
def orders(
    recording: Path,
    wheels: tuple[str, ...],
    shown: int,
    speed_step_kmh: float,
    figure: Path | None,
    csv_path: Path | None,
    json_path: Path | None,
    config_path: Path | None,
    effects_paths: tuple[Path, ...],
    key_file: Path | None,
    force: bool,
) -> None:
    """Show what repeats with each turn of the wheels of RECORDING, and what does not: orders and mean revolution.

    Order n repeats n times per revolution. What the tire does in every revolution lies on integer orders; road, cavity
    resonance and other shafts lie between them. The share of the power on integer orders says how far the signal is
    the tire's own; white noise alone has 12.5 %. Revolutions with faults are left out.

    A FILE of - is standard output, and the summary is then printed to standard error. The exit status is 1 if no wheel
    has a usable revolution, or the recording is damaged.

    Example: `treadlink orders drive.mcap --figure orders.html`
    """
    from gateway.compare.recorded_orders import recorded_orders
    from gateway.compare.views.order_figure import SUFFIXES, write_figure
    from gateway.compare.views.order_tables import order_lines, write_csv, write_json
    from gateway.core.cli.summary_output import SummaryOutput
    from gateway.core.text.aligned_table import terminal_columns
    from gateway.core.text.figure_file import check_figure
    from gateway.core.text.output_file import check_outputs
    from gateway.core.text.progress import progress_bar
    from gateway.security.key_file import default_key_file

    outputs = (figure, csv_path, json_path)
    check_outputs(outputs, (recording, config_path, *effects_paths, key_file or default_key_file()), force=force)
    if figure is not None:
        check_figure(figure, SUFFIXES)
    summary = SummaryOutput(outputs)
    with progress_bar(f"reading {recording.name}") as bar:
        spectra, damage, start_ns, units = recorded_orders(
            recording,
            wheels=wheels,
            speed_step_mps=speed_step_kmh / 3.6,
            config_path=config_path,
            effects_paths=effects_paths,
            key_file=key_file,
            on_progress=bar.show,
        )
    with shown_in(units):
        for index, wheel in enumerate(spectra):
            if index:
                summary()
            for line in order_lines(wheel, shown, terminal_columns(on_err=summary.err)):
                summary(line)
        if figure is not None:
            write_figure(figure, spectra, recording.name, start_ns, force=force)
    if csv_path is not None:
        write_csv(csv_path, spectra, recording.name, force=force)
    if json_path is not None:
        write_json(json_path, spectra, recording.name, force=force)
    for path in outputs:
        summary.written(path)
    summary.finish()
    if damage is not None:
        raise TreadlinkError(text(damage), "The readable part was used.")
