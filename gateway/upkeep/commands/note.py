"""`treadlink note`: add a comment or tags to recordings, beside their data."""

from pathlib import Path

import click

from gateway.core.cli.run_options import checked_text, checked_texts


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RECORDING...")
@click.option("--comment", default="", callback=checked_text, metavar="TEXT", help="Comment to add.")
@click.option(
    "--tag",
    "tags",
    multiple=True,
    callback=checked_texts,
    metavar="WORD",
    help="Tag, also several: a,b.",
)
def note(recordings: tuple[Path, ...], comment: str, tags: tuple[str, ...]) -> None:
    """Add a comment or tags to RECORDING... without changing the files.

    The note is a line of RECORDING.notes.jsonl, which belongs to the recording: copy both. `treadlink inspect`, exports
    and `--where` of `campaign` and `trends` take it into account.

    Example: `treadlink note drive.mcap --comment "wet from km 12 on" --tag wet`
    """
    from gateway.core.clock import SystemClock
    from gateway.core.recording.reader import RecordingReader
    from gateway.core.recording.run_description import Note, add_note, notes_path, read_notes
    from gateway.core.recording.writer import utc_text

    if not comment and not tags:
        raise click.UsageError("Give --comment or --tag.")
    for path in recordings:
        RecordingReader(path)  # what is no recording has no notes
        read_notes(path)
    new = Note(utc_text(SystemClock().now_ns()), comment, tags)
    for path in recordings:
        add_note(path, new)
        click.echo(f"written: {notes_path(path)}")
