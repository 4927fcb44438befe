"""`treadlink replay`: replay a recording with live estimates."""

from pathlib import Path
from typing import Unpack
from urllib.parse import quote

import click

from gateway.core.cli.live import show_session
from gateway.core.cli.options import (
    PAGE_URI,
    SessionOptions,
    config_option,
    plain_option,
    publish_option,
    session_options,
    web_option,
)
from gateway.core.cli.stop_signals import stop_request


@click.command()
@click.argument("recording", type=click.Path(path_type=Path))
@click.option(
    "--speed",
    default="1",
    show_default=True,
    metavar="FACTOR",
    help="Replay this many times as fast as recorded, or `max`.",
)
@config_option
@plain_option
@web_option
@publish_option
@session_options
def replay(
    recording: Path,
    speed: str,
    plain: bool,
    web: bool,
    publish: tuple[str, ...],
    **options: Unpack[SessionOptions],
) -> None:
    """Replay RECORDING with live estimates, from the same bytes and with the same results.

    The vehicle configuration is the one in the recording, unless --config gives another.

    Example: `treadlink replay drive.mcap --speed 10`
    """
    from gateway.core.cli.session_setup import start_session

    uri = f"replay:{quote(str(recording), errors='surrogateescape')}?speed={speed}"
    with stop_request() as stop:
        session = start_session(
            (uri,),
            record=None,
            **options,
            publish=(*publish, PAGE_URI) if web else publish,
        )
        show_session(session, stop, plain=plain)
