"""`treadlink protocol`: check of a firmware, and files generated from the declarations of protocol and live outputs."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Final

import click

from gateway.core.cli.command_group import CommandGroup
from gateway.core.cli.options import FiniteRange, force_option, keys_option
from gateway.core.cli.path_option import path_option
from gateway.core.errors import RecordingError, TreadlinkError
from gateway.core.text.output_file import check_outputs, write_whole

_OUT = click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Output folder.  [default: standard output]",
)


_CHECK_S: Final = 30.0


@click.group(cls=CommandGroup)
def protocol() -> None:
    """Check a firmware; write C code, test vectors and descriptions of the protocol for makers."""


@protocol.command(short_help="Check a firmware against the specification, clause by clause.")
@click.argument("source", metavar="URI|FILE")
@click.option(
    "--for",
    "shown_duration",
    metavar="TIME",
    help="Check for this long, such as 60s or 2min.  [default: 30s of a hub, all of a file]",
)
@click.option(
    "--radius",
    "radius_mm",
    type=FiniteRange(min=10.0, max=5000.0),
    default=320.0,
    show_default=True,
    metavar="MM",
    help="Belt radius in mm of the wheel, or radius of the turntable, that the sensor rolls on.",
)
@click.option("--no-commands", is_flag=True, help="Send the hub nothing; its answers are not exercised.")
@click.option(
    "--junit",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write the result of each clause as JUnit XML to this file.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON, one line per link.")
@keys_option
@force_option
def check(
    source: str,
    shown_duration: str | None,
    radius_mm: float,
    no_commands: bool,
    junit: Path | None,
    as_json: bool,
    key_file: Path | None,
    force: bool,
) -> None:
    """Check a firmware against the specification of the protocol, clause by clause.

    URI is a hub (serial:PORT, tcp://HOST:PORT, ble://NAME), FILE a recording or a raw dump (.bin). Each clause has
    passed, failed (with bytes and reason), or was not exercised. Commands are sent to a hub: its samples stop for two
    seconds, and its rate changes twice.

    The exit status is 1 if a clause failed, or no frame arrived.

    \b
    Examples:
      treadlink protocol check /dev/ttyUSB0:921600 --for 60s
      treadlink protocol check dump.bin --json
    """
    import json

    from gateway.core.cli import exit_status
    from gateway.core.clock import SystemClock
    from gateway.makers.check.clauses import Verdict
    from gateway.makers.commands.clause_report import junit_xml, report_json, report_lines
    from gateway.makers.commands.protocol_check import check_link, duration_s, is_file
    from gateway.security.key_file import command_keys

    check_outputs((junit,), (Path(source) if is_file(source) else None, key_file), force=force)
    for_s = None if shown_duration is None else duration_s(shown_duration)
    reports = check_link(
        source,
        for_s=_CHECK_S if for_s is None and not is_file(source) else for_s,
        keys=command_keys(key_file),
        radius_m=radius_mm * 1e-3,
        sends_commands=not no_commands,
        clock=SystemClock(),
        say=partial(click.echo, err=True),
    )
    for report in reports:
        if as_json:
            click.echo(json.dumps(report_json(report)))
        else:
            for line in report_lines(report):
                click.echo(line)
    if junit is not None:
        write_whole(junit, junit_xml(reports), force=force)
    if not any(report.size_bytes for report in reports):
        if is_file(source):
            raise RecordingError(f"no byte of a hub is in '{source}'", "Record the hub again, or give another file.")
        raise TreadlinkError(
            f"no byte arrived from '{source}'", "Is the hub powered? Check its port, the baud rate and the wire."
        )
    if any(report.count(Verdict.FAILED) or not report.frames for report in reports):
        raise SystemExit(exit_status.NO_RESULT)


@protocol.command(short_help="Print the frames of a hub or a file as lines.")
@click.argument("source", metavar="URI|FILE")
@click.option("--for", "shown_duration", metavar="TIME", help="Stop after this time, such as 60s or 2min.")
def dump(source: str, shown_duration: str | None) -> None:
    """Print the frames of a hub, or of a recording or raw dump, as lines while they arrive.

    A line has the time since the first byte, the source, the type, the counter, the hub's clock and the content. A line
    with `!` counts what was no readable frame. The hub is sent nothing.

    Example: `treadlink protocol dump /dev/ttyUSB0:921600 --for 10s`
    """
    from gateway.core.clock import SystemClock
    from gateway.makers.commands.protocol_check import dump_frames, duration_s

    for_s = None if shown_duration is None else duration_s(shown_duration)
    dump_frames(source, for_s=for_s, clock=SystemClock(), write=click.echo)


@protocol.command()
@_OUT
@force_option
def header(out: Path | None, force: bool) -> None:
    """Write the C header of the protocol.

    It contains the constants, message structs and encoder functions.
    """
    from firmware_protocol.cgen import HEADER_NAME, c_header

    _write({HEADER_NAME: c_header()}, out, force=force)


@protocol.command()
@_OUT
@force_option
def encoder(out: Path | None, force: bool) -> None:
    """Write the C11 reference encoder for the header."""
    from firmware_protocol.cgen import ENCODER_NAME, c_encoder

    _write({ENCODER_NAME: c_encoder()}, out, force=force)


@protocol.command(short_help="Write the reference collector: firmware of a hub in C11.")
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), metavar="DIR", required=True, help="Output folder."
)
@force_option
def collector(out: Path, force: bool) -> None:
    """Write the reference collector: firmware of a hub in C11, with the header and the encoder.

    Its README describes what to write for a board.

    Example: `treadlink protocol collector --out collector/`
    """
    import firmware_protocol
    from firmware_protocol.cgen import ENCODER_NAME, HEADER_NAME, c_encoder, c_header

    root = Path(firmware_protocol.__file__).parent / "collector"
    files = {
        str(path.relative_to(root)): path.read_text("utf-8")
        for path in sorted(root.rglob("*"))
        if path.suffix in (".c", ".csv", ".h", ".ld", ".md")
    }
    _write({HEADER_NAME: c_header(), ENCODER_NAME: c_encoder(), **files}, out, force=force)


@protocol.command()
@_OUT
@force_option
def vectors(out: Path | None, force: bool) -> None:
    """Write the test vectors as JSON.

    They are frames with their fields, and streams with their content.
    """
    from firmware_protocol.conformance import make_vectors

    _write(make_vectors(), out, force=force)


@protocol.command()
@_OUT
@force_option
@path_option(
    "--config",
    "config_path",
    help="Vehicle configuration (TOML) with the wheels.  [default: FL, FR, RL, RR and four more]",
)
@click.option(
    "--base-id",
    default="0x500",
    show_default=True,
    metavar="ID",
    help="Identifier of the first frame, as in --publish can:INTERFACE:CHANNEL?base_id=ID.",
)
def dbc(out: Path | None, force: bool, config_path: Path | None, base_id: str) -> None:
    """Write the DBC file of the frames that `--publish can:` sends."""
    from gateway.core.config.vehicle import load_vehicle
    from gateway.publishing.can_frames import dbc_text

    positions = [wheel.position for wheel in load_vehicle(config_path).wheel] if config_path is not None else []
    try:
        first = int(base_id, 0)
    except ValueError as error:
        raise click.BadParameter(f"'{base_id}' is not a number such as 0x500", param_hint="--base-id") from error
    try:
        text = dbc_text(first, positions)
    except ModuleNotFoundError as error:
        raise TreadlinkError(
            f"a DBC file needs the package '{error.name}', which is not installed",
            "Install it with: pip install 'treadlink[can]'",
        ) from error
    _write({"treadlink.dbc": text}, out, force=force)


@protocol.command(short_help="Write the JSON schema of the objects that are published.")
@_OUT
@force_option
def schema(out: Path | None, force: bool) -> None:
    """Write the JSON schema of the objects that `--publish` sends as JSON lines and to MQTT."""
    import json

    from gateway.publishing.line_schema import line_schema

    _write({"treadlink-live.schema.json": json.dumps(line_schema(), indent=2) + "\n"}, out, force=force)


@protocol.command()
@_OUT
@force_option
def wireshark(out: Path | None, force: bool) -> None:
    """Write a dissector for Wireshark and tshark, in Lua.

    It shows the fields of each frame with their units, checks the CRC and
    marks bytes between frames.
    """
    from firmware_protocol.wireshark import DISSECTOR_NAME, wireshark_dissector

    _write({DISSECTOR_NAME: wireshark_dissector()}, out, force=force)


@protocol.command()
@click.argument("specification", type=click.Path(exists=True, dir_okay=False, path_type=Path))
def tables(specification: Path) -> None:
    """Update the generated tables of the specification.

    Example: `treadlink protocol tables docs/reference/protocol.md`
    """
    from firmware_protocol.spec import updated
    from gateway.core.config.validation import read_text

    write_whole(specification, updated(read_text(specification, "the specification")), force=True)


def _write(files: Mapping[str, str], out: Path | None, *, force: bool) -> None:
    """Write the files, or none if one of them exists; without a folder print them."""
    if out is None:
        for text in files.values():
            click.echo(text, nl=False)
        return
    targets = {out / name: text for name, text in files.items()}
    existing = [str(path) for path in targets if path.exists()]
    if existing and not force:
        raise TreadlinkError(
            f"already exists: {', '.join(existing)}", "Choose another folder with --out, or overwrite with --force."
        )
    try:
        for path in targets:
            path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TreadlinkError(
            f"cannot write to '{out}': {error.strerror}", "Choose another folder with --out."
        ) from error
    for path, text in targets.items():
        write_whole(path, text, force=force)
        click.echo(path)
