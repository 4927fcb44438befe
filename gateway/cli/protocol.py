"""`treadlink protocol`: what the hub's firmware team needs, generated from the declaration."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click

from gateway.errors import TreadlinkError

_OUT = click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), help="Directory to write to; standard output without it."
)
_FORCE = click.option("--force", is_flag=True, help="Overwrite files that are there.")


@click.group()
def protocol() -> None:
    """Generate the firmware's C header, encoder and test vectors."""


@protocol.command()
@_OUT
@_FORCE
def header(out: Path | None, force: bool) -> None:
    """Write the C header with the constants, the message structs and the encoder's functions."""
    from firmware_protocol.cgen import HEADER_NAME, c_header

    _deliver({HEADER_NAME: c_header()}, out, force=force)


@protocol.command()
@_OUT
@_FORCE
def encoder(out: Path | None, force: bool) -> None:
    """Write the C11 reference encoder that belongs to the header."""
    from firmware_protocol.cgen import ENCODER_NAME, c_encoder

    _deliver({ENCODER_NAME: c_encoder()}, out, force=force)


@protocol.command()
@_OUT
@_FORCE
def vectors(out: Path | None, force: bool) -> None:
    """Write the JSON test vectors: frames with their fields, streams with what is in them."""
    from firmware_protocol.conformance import make_vectors

    _deliver(make_vectors(), out, force=force)


@protocol.command()
@click.argument("specification", type=click.Path(exists=True, dir_okay=False, path_type=Path))
def tables(specification: Path) -> None:
    """Bring the generated parts of the SPECIFICATION (docs/reference/protocol.md) up to date."""
    from firmware_protocol.spec import updated

    specification.write_text(updated(specification.read_text("utf-8")), "utf-8")


def _deliver(files: Mapping[str, str], out: Path | None, *, force: bool) -> None:
    """Write the files, all or none of them, or print them."""
    if out is None:
        for text in files.values():
            click.echo(text, nl=False)
        return
    targets = {out / name: text for name, text in files.items()}
    there = [str(path) for path in targets if path.exists()]
    if there and not force:
        raise TreadlinkError(f"already there: {', '.join(there)}", "Choose another --out, or overwrite with --force.")
    try:
        out.mkdir(parents=True, exist_ok=True)
        for path, text in targets.items():
            path.write_text(text, "utf-8")
            click.echo(path)
    except OSError as error:
        raise TreadlinkError(
            f"cannot write to {out}: {error.strerror}", "Choose a directory you may write to."
        ) from error
