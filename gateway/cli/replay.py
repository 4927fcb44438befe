"""`treadlink replay`: a recording through the console again."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import quote

import click

from gateway.cli.live import show_session
from gateway.cli.session_setup import (
    config_option,
    duration_option,
    effects_option,
    estimator_option,
    keys_option,
    start_session,
)


@click.command()
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--speed", default="1", show_default=True, metavar="1|10|max", help="How many times as fast as recorded.")
@config_option
@click.option("--plain", is_flag=True, help="One line a revolution; the default where the output is no terminal.")
@duration_option
@keys_option
@estimator_option
@effects_option
def replay(
    recording: Path,
    speed: str,
    config_path: Path | None,
    plain: bool,
    duration_s: float | None,
    key_file: Path | None,
    estimators: tuple[str, ...],
    effects_paths: tuple[Path, ...],
) -> None:
    """Play RECORDING again: the same bytes, the same estimates.

    The configuration is the one recorded with it, unless --config gives another.
    """
    uri = f"replay:{quote(str(recording))}?speed={speed}"
    session = start_session(
        (uri,),
        config_path=config_path,
        record=None,
        estimators=estimators,
        key_file=key_file,
        effects_paths=effects_paths,
    )
    show_session(session, plain=plain, duration_s=duration_s)
