"""`treadlink view`: look into recordings in a browser."""

from pathlib import Path
from urllib.parse import urlsplit

import click

from gateway.core.cli.options import config_option, keys_option

_HOST = "127.0.0.1"
_PORT = 8780
_MAX_RECORDINGS = 8


@click.command()
@click.argument("recordings", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--listen",
    metavar="HOST[:PORT]",
    help=f"Address of the page.  [default: {_HOST}:{_PORT}, or a free port]",
)
@config_option
@keys_option
def view(recordings: tuple[Path, ...], listen: str | None, config_path: Path | None, key_file: Path | None) -> None:
    """Look into recordings in a browser: drag to zoom from hours to single samples.

    The page shows the samples of every axis, the waveform of any revolution, orders over time and speed, every
    estimated quantity, losses, marks and alarms; of several recordings one over the other. It is there at once, and
    becomes complete while the recordings are read; what was read is stored in the user's cache for the next time. The
    recordings are not changed. Ctrl-C ends it.

    Only this computer can open the page. With `--listen 0.0.0.0` others on the network can, who have its address with
    its token.

    Example: `treadlink view before.mcap after.mcap`
    """
    from gateway.core.cli.stop_signals import stop_request
    from gateway.core.errors import TreadlinkError
    from gateway.core.recording.file_content import check_distinct
    from gateway.core.recording.recorded_file import check_exist
    from gateway.viewer.recording_view import RecordingView
    from gateway.viewer.view_server import ViewServer

    if len(recordings) > _MAX_RECORDINGS:
        raise TreadlinkError(f"{len(recordings)} recordings are too many", f"Give at most {_MAX_RECORDINGS}.")
    host, port = _address(listen)
    check_exist(recordings)
    check_distinct(recordings)
    views = [RecordingView(path, config_path, key_file) for path in recordings]
    server = ViewServer(host, port, views, may_move=listen is None)
    with stop_request() as stop:
        server.start()
        click.echo(f"{server.address}\nOpen it in a browser; Ctrl-C ends.")
        try:
            while not stop.is_set():
                stop.wait(0.2)
        finally:
            server.close()


def _address(listen: str | None) -> tuple[str, int]:
    """Return host and port; fails with a usage error."""
    parts = urlsplit(f"//{listen or _HOST}")
    try:
        if parts.hostname and not parts.path:
            return parts.hostname, parts.port if parts.port is not None else _PORT
    except ValueError:
        pass
    raise click.BadParameter(f"'{listen}' is no HOST[:PORT].", param_hint="--listen")
