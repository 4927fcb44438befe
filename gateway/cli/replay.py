"""`treadlink replay`: replay a recording with live estimates."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import quote

import click

from gateway.cli.live import show_session
from gateway.cli.options import (
    PAGE_URI,
    config_option,
    duration_option,
    effects_option,
    estimator_option,
    keys_option,
    plain_option,
    publish_option,
    web_option,
)
from gateway.cli.stop_signals import stop_request


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
@duration_option
@keys_option
@estimator_option
@effects_option
def replay(
    recording: Path,
    speed: str,
    config_path: Path | None,
    plain: bool,
    web: bool,
    publish: tuple[str, ...],
    duration_s: float | None,
    key_file: Path | None,
    estimators: tuple[str, ...],
    effects_paths: tuple[Path, ...],
) -> None:
    """Replay RECORDING with live estimates, from the same bytes and with the same results.

    The vehicle configuration is the one in the recording, unless --config gives another.
    """
    from gateway.cli.session_setup import start_session

    uri = f"replay:{quote(str(recording))}?speed={speed}"
    with stop_request() as stop:
        session = start_session(
            (uri,),
            config_path=config_path,
            record=None,
            estimators=estimators,
            key_file=key_file,
            effects_paths=effects_paths,
            duration_s=duration_s,
            publish=(*publish, PAGE_URI) if web else publish,
        )
        show_session(session, stop, plain=plain)
