"""`treadlink merge`: recordings of one drive as one."""

from pathlib import Path

import click

from gateway.core.cli.options import config_option
from gateway.core.cli.path_option import path_option


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RECORDING...")
@path_option("--out", required=True, help="New recording.")
@config_option
def merge(recordings: tuple[Path, ...], out: Path, config_path: Path | None) -> None:
    """Merge RECORDING... of one drive, such as one for each hub or the parts of --split, into a new one.

    The computers' clocks make the time line: set them alike before the drive (NTP). What two recordings have of one
    link is taken once. The same wheel from two hubs, and different vehicle configurations without --config, are
    refused. The decoded topics are left out; `treadlink estimate` and replays compute them again.

    \b
    Example:
      treadlink merge front.mcap rear.mcap --out drive.mcap
    """
    if len(recordings) < 2:
        raise click.UsageError("Give two recordings or more.")
    from gateway.core.cli.summary_output import SummaryOutput
    from gateway.core.config.validation import read_text
    from gateway.core.config.vehicle import parse_vehicle
    from gateway.core.recording.container import refuse_existing
    from gateway.core.text.output_file import check_outputs
    from gateway.upkeep.merge import merge_recordings

    say = SummaryOutput()
    check_outputs([out], [*recordings, config_path], force=True)
    refuse_existing(out)
    vehicle_toml = None
    if config_path is not None:
        vehicle_toml = read_text(config_path, "the vehicle configuration")
        parse_vehicle(vehicle_toml, str(config_path))
    report = merge_recordings(
        recordings, out, vehicle_toml=vehicle_toml, on_recording=lambda path: say(f"reading {path}")
    )
    say(
        f"{report.target}: {report.items} chunks and events of {len(recordings)} recordings; left out: "
        f"{report.repeated_frames} repeated frames, {report.noise_bytes} bytes outside frames"
    )
    say.finish()
