"""`treadlink manifest`: write the hashes of the recordings of a folder."""

from pathlib import Path

import click


@click.command()
@click.argument(
    "folders", nargs=-1, required=True, type=click.Path(path_type=Path, file_okay=False), metavar="FOLDER..."
)
def manifest(folders: tuple[Path, ...]) -> None:
    """Write SHA256SUMS of the finished recordings in FOLDER... and of their notes.

    rsync, rclone and other copies carry the file; `treadlink inspect --verify` and `sha256sum -c` compare with it. A
    recording that is in it keeps its hash.
    """
    from gateway.recording.manifest import MANIFEST_NAME, write_manifest
    from gateway.views.progress import progress_bar
    from gateway.views.text import clean, counted

    for folder in folders:
        with progress_bar("hashing") as bar:
            hashes = write_manifest(folder, lambda path, bar=bar: bar.show(0.0, path.name))  # type: ignore[misc]
        click.echo(clean(f"written: {folder / MANIFEST_NAME} ({counted(len(hashes), 'file')})"))
        for path in sorted(folder.glob("*.mcap")):
            if path.name not in hashes:
                click.echo(clean(f"left out: {path}, which is being recorded"))
