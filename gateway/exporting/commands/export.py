"""`treadlink export`: write the measurements of a recording to a file of another program."""

from pathlib import Path

import click

from gateway.core.cli.options import (
    KnownName,
    config_option,
    effects_option,
    estimator_option,
    force_option,
    keys_option,
)
from gateway.exporting.export_registry import CONTENTS, FORMATS

_CONTENTS = "\n".join(f"    {name:<10} {content.description}" for name, content in CONTENTS.items())
_FORMATS = "\n".join(
    f"    {name:<8} {' '.join(entry.suffixes):<15} {entry.description}" for name, entry in FORMATS.items()
)


@click.command(
    help=f"""Write the measurements of RECORDING to the file OUT, with their units and conditions.

    The format is that of the suffix of OUT, unless --format gives another. An OUT of - is standard output. OUT appears
    when it is complete, or not at all. Memory use does not depend on the length of the recording.

    \b
    Contents:
{_CONTENTS}

    \b
    Formats:
{_FORMATS}

    Estimates and average belong to the tire with the configuration and the effects given. An mcap file holds samples
    and estimates unless --what chooses; every other format holds one content.

    \b
    Examples:
      treadlink export drive.mcap drive.parquet
      treadlink export drive.mcap orders.csv --what orders --wheel FL
    """
)
@click.argument("recording", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path, allow_dash=True))
@click.option(
    "--what",
    "contents",
    multiple=True,
    type=KnownName(list(CONTENTS)),
    help="What to write, of the contents above; repeat for several in an mcap file.  [default: samples]",
)
@click.option(
    "--format", "format_name", type=KnownName(list(FORMATS)), help="File format.  [default: from the suffix of OUT]"
)
@click.option(
    "--wheel", "wheels", multiple=True, metavar="POSITION", help="Only this wheel; repeat for several.  [default: all]"
)
@config_option
@effects_option
@estimator_option
@keys_option
@force_option
def export(
    recording: Path,
    out: Path,
    contents: tuple[str, ...],
    format_name: str | None,
    wheels: tuple[str, ...],
    config_path: Path | None,
    effects_paths: tuple[Path, ...],
    estimators: tuple[str, ...],
    key_file: Path | None,
    force: bool,
) -> None:
    """Write the measurements of a recording to a file."""
    from gateway.core.errors import TreadlinkError
    from gateway.core.estimates.registry import DEFAULT_ESTIMATORS
    from gateway.core.text.output_file import check_outputs, is_stdout
    from gateway.core.text.progress import progress_bar
    from gateway.core.text.text import clean, file_size
    from gateway.core.text.wording import notice_text, text
    from gateway.exporting.export_registry import check_format, format_of
    from gateway.exporting.recording_export import ExportRequest, export_recording
    from gateway.security.key_file import default_key_file

    name = format_of(out, format_name)
    chosen = tuple(dict.fromkeys(contents)) or (
        ("samples", "estimates") if FORMATS[name].many_contents else ("samples",)
    )
    check_outputs([out], (recording, config_path, *effects_paths, key_file or default_key_file()), force=force)
    check_format(out, name, chosen)
    with progress_bar(f"exporting {recording.name}") as bar:
        report = export_recording(
            recording,
            out,
            ExportRequest(chosen, name, estimators or DEFAULT_ESTIMATORS, tuple(dict.fromkeys(wheels))),
            config_path=config_path,
            effects_paths=effects_paths,
            key_file=key_file,
            force=force,
            on_progress=bar.show,
        )
    for doubt in report.doubts:
        click.echo(clean(notice_text(doubt)), err=is_stdout(out))
    if not is_stdout(out):
        size = f", {file_size(out.stat().st_size)}" if out.is_file() else ""
        columns = ", ".join(f"{count} columns of {content}" for content, count in report.columns.items())
        click.echo(clean(f"written: {out} ({report.rows} rows, {columns}, {', '.join(report.wheels)}{size})"))
    if report.damage is not None:
        raise TreadlinkError(text(report.damage), "The readable part was exported.")
