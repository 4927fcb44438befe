"""Checks of `treadlink doctor`; each yields its findings and remedies."""

from __future__ import annotations

import importlib.metadata
import math
import os
import re
import shutil
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gateway.core.errors import ConfigError, TreadlinkError
from gateway.core.links.source import open_source, parse_source_uri
from gateway.core.text.progress import can_move_cursor
from gateway.core.text.text import escaped
from gateway.core.text.wording import notice_text
from gateway.core.text.wording import text as wording

if TYPE_CHECKING:
    from gateway.core.trust.turn_verdict import Verdict

PYTHON_MIN: Final = (3, 11)
TERMINAL_MIN_COLUMNS: Final = 80
TERMINAL_MIN_LINES: Final = 24
DISK_FAULT_BYTES: Final = 100_000_000
# Four wheels with three axes at 9600 Hz, in frames of 36 samples and 242 bytes.
BYTES_PER_HOUR: Final = 4 * 9600 / 36 * 242 * 3600
DISK_WARNING_HOURS: Final = 1.0
_LISTEN_S: Final = 0.1
# What shows the sign of a lateral axis: to a car, and on a rig, which drives no curve.
_DRIVE: Final = (
    "Record one curve of 0.1 g for 3 s, straights before and behind it, with both wheels of an axle, or with a yaw "
    "rate of the bus or a GNSS receiver."
)
_STEER: Final = (
    "On a rig, record 50 revolutions at zero slip, then a slip angle of 1 deg that pulls the tire to the left: if "
    "slip_direction (--estimator slip-angle) becomes 1, state lateral_is_left; if -1, reverse the sign of the axis."
)
# Extras of developers, and the one that only names all others.
_UNCHECKED_EXTRAS: Final = ("all", "dev", "docs")

_REQUIREMENT: Final = re.compile(
    r"^([A-Za-z0-9._-]+)[^;]*?(?:>=([0-9.]+))?[^;]*(?:;\s*extra\s*==\s*['\"]([^'\"]+)['\"])?\s*$"
)


class Level(StrEnum):
    """Result of a check."""

    OK = "ok"
    WARNING = "warning"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class Check:
    """One finding.

    Attributes:
        name: subject of the check.
        level: result.
        text: finding.
        remedy: advice to the user, empty if none is needed.
    """

    name: str
    level: Level
    text: str
    remedy: str = ""


def check_python(version: tuple[int, int, int] = sys.version_info[:3]) -> Iterator[Check]:
    """Check the interpreter's version."""
    installed = ".".join(map(str, version))
    if version[:2] < PYTHON_MIN:
        required = ".".join(map(str, PYTHON_MIN))
        yield Check("python", Level.FAULT, f"{installed} is too old", f"Install Python {required} or newer.")
    else:
        yield Check("python", Level.OK, installed)


def check_packages() -> Iterator[Check]:
    """Check all required and optional packages except those for development."""
    try:
        requirements = importlib.metadata.requires("treadlink") or []
    except importlib.metadata.PackageNotFoundError:
        yield Check("packages", Level.FAULT, "treadlink is not installed", "Run: pip install -e .")
        return
    missing: dict[str, list[str]] = {}
    versions: list[str] = []
    for requirement in requirements:
        match = _REQUIREMENT.match(requirement)
        if match is None or match[3] in _UNCHECKED_EXTRAS:
            continue
        name, minimum, extra = match[1], match[2], match[3] or ""
        version = _version_of(name)
        if version is not None and (minimum is None or _release(version) >= _release(minimum)):
            versions.append(f"{name} {version}")
            continue
        detail = f"{name} is missing" if version is None else f"{name} {version} is older than {minimum}"
        if extra:
            missing.setdefault(extra, []).append(detail)
        else:
            missing[""] = []
            yield Check("package", Level.FAULT, detail, f"Run: pip install '{name}>={minimum or 0}'")
    if "" not in missing:
        yield Check("packages", Level.OK, ", ".join(dict.fromkeys(versions)))
    for extra, details in missing.items():
        if extra:
            remedy = f"Optional. Run: pip install 'treadlink[{extra}]'"
            yield Check(f"packages [{extra}]", Level.WARNING, ", ".join(details), remedy)


def check_core() -> Iterator[Check]:
    """Check whether the compiled core is in use."""
    from gateway.core.compiled import core, is_switched_off

    if core is not None:
        yield Check("compiled core", Level.OK, "in use")
    elif is_switched_off():
        yield Check("compiled core", Level.OK, "not in use: TREADLINK_COMPILED is 0")
    else:
        remedy = "Optional. Install a C compiler and Python's headers, and then treadlink again."
        yield Check("compiled core", Level.WARNING, "not in use: estimation is slower", remedy)


def check_plugins() -> Iterator[Check]:
    """Check every plug-in of the installed packages: it is imported, and its interface compared with the registry's."""
    from gateway.core import cli
    from gateway.core.cli import estimate_outputs
    from gateway.core.estimates import registry
    from gateway.core.feature import Registry, added, object_of
    from gateway.core.links import source
    from gateway.core.plugins import installed, statuses

    # The modules of a registry are imported only where a package adds to it.
    checks = {Registry(group): target for group, target in added(Registry.PLUGIN_CHECKS).items()}
    checked = [
        *statuses(Registry.SOURCES, source.schemes_of_package(), source.plugin_fault),
        *statuses(Registry.ESTIMATORS, tuple(registry.ESTIMATORS), registry.plugin_fault),
        *(status for group in checks if installed(group) for status in object_of(checks[group])()),
        *statuses(Registry.COMMANDS, tuple(cli.COMMANDS), cli.plugin_fault),
        *statuses(Registry.ESTIMATE_OUTPUTS, tuple(added(Registry.ESTIMATE_OUTPUTS)), estimate_outputs.plugin_fault),
    ]
    for plugin, refusal in ((status.plugin, status.refusal) for status in checked):
        name = f"plug-in {plugin.name}"
        origin = f"{plugin.group.removeprefix('treadlink.')} of {plugin.package} {plugin.version}"
        if refusal is None:
            yield Check(name, Level.OK, origin)
        else:
            remedy = f"Update or remove the package: pip uninstall {plugin.package}"
            yield Check(name, Level.FAULT, f"{origin} refused: {wording(refusal)}", remedy)


def check_ports() -> Iterator[Check]:
    """Check the permissions of all serial ports."""
    from serial.tools import list_ports

    any_port = False
    for port in sorted(list_ports.comports()):
        any_port = True
        check = check_device(Path(port.device), port.description or "")
        # Many computers have unused ports. A port that the user needs is given as a SOURCE.
        yield check if check.level is Level.OK else replace(check, level=Level.WARNING)
    if not any_port:
        yield Check(
            "serial port", Level.WARNING, "none found", "Plug in the hub. Without a hub, try: treadlink live sim:demo"
        )


def check_bluetooth() -> Iterator[Check]:
    """Check adapter, service and permissions of Bluetooth LE."""
    from gateway.core.links.ble_source import scan_devices

    fault = scan_devices(_LISTEN_S).fault
    if fault is None:
        yield Check("bluetooth", Level.OK, "available; `treadlink scan` lists the hubs in range")
    else:
        # A hub on a cable needs no Bluetooth.
        yield Check("bluetooth", Level.WARNING, str(fault), f"Needed only for hubs on Bluetooth. {fault.remedy}")


def check_device(device: Path, description: str = "") -> Check:
    """Check that a serial device can be read and written; the remedy names the group that may."""
    label = f"{device} ({description})" if description and description != "n/a" else str(device)
    name = "serial port"
    if os.name != "posix":
        return Check(name, Level.OK, label)
    if not device.exists():
        return Check(name, Level.FAULT, f"there is no {device}", "Plug in the hub. `treadlink doctor` lists the ports.")
    if not device.is_char_device():
        return Check(name, Level.FAULT, f"{device} is not a serial port", "Check the name.")
    if os.access(device, os.R_OK | os.W_OK):
        return Check(name, Level.OK, f"{label} can be read and written")
    group = device.group() if _has_group_name(device) else str(device.stat().st_gid)
    if group == "root" or not device.stat().st_mode & 0o060:
        remedy = f"Allow access with: sudo chmod a+rw {device}, or add a udev rule."
    else:
        remedy = f"Run: sudo usermod -aG {group} $USER, then log out and in again."
    return Check(name, Level.FAULT, f"{label}: permission denied", remedy)


def check_disk(folder: Path) -> Iterator[Check]:
    """Check that a folder is writable, and its free space."""
    name = "recordings"
    existing = folder.absolute()
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    if folder.exists() and not folder.is_dir():
        yield Check(name, Level.FAULT, f"{folder} is a file", "Choose a folder with --recordings.")
        return
    if not os.access(existing, os.W_OK | os.X_OK):
        yield Check(name, Level.FAULT, f"{existing} is not writable", "Choose another folder with --recordings.")
        return
    free_bytes = shutil.disk_usage(existing).free
    hours = free_bytes / BYTES_PER_HOUR
    text = f"{folder}: {free_bytes / 1e9:.1f} GB free, enough for about {hours:.3g} h of four wheels at 9600 Hz"
    if free_bytes < DISK_FAULT_BYTES:
        yield Check(name, Level.FAULT, text, "Free some space, or choose another disk with --recordings.")
    elif hours < DISK_WARNING_HOURS:
        yield Check(name, Level.WARNING, text, "Free some space for longer sessions.")
    else:
        yield Check(name, Level.OK, text)


def check_terminal(
    is_terminal: bool, size: os.terminal_size, encoding: str, environment: Mapping[str, str]
) -> Iterator[Check]:
    """Check the terminal's type, size and encoding."""
    name = "terminal"
    if not is_terminal:
        yield Check(name, Level.WARNING, "the output is not a terminal", "`treadlink live` prints plain lines here.")
        return
    term = environment.get("TERM", "")
    text = f"{term or 'TERM not set'}, {size.columns} x {size.lines}, {encoding}"
    problems = []
    if not can_move_cursor(environment):
        problems.append("set TERM, for example to xterm-256color; until then `treadlink live` prints plain lines")
    if size.columns < TERMINAL_MIN_COLUMNS or size.lines < TERMINAL_MIN_LINES:
        problems.append(f"enlarge it to at least {TERMINAL_MIN_COLUMNS} x {TERMINAL_MIN_LINES}")
    if "utf" not in encoding.lower():
        problems.append("use a UTF-8 locale such as LANG=C.UTF-8 for curves and units")
    if problems:
        remedy = "; ".join(problems)
        yield Check(name, Level.WARNING, text, f"{remedy[0].upper()}{remedy[1:]}.")
    else:
        yield Check(name, Level.OK, text)


def check_config(path: Path) -> Iterator[Check]:
    """Check a vehicle configuration, with one finding for each fault."""
    from gateway.core.config.vehicle import load_vehicle
    from gateway.core.estimates.registry import estimator_names

    name = "configuration"
    try:
        config = load_vehicle(path)
    except ConfigError as error:
        yield from (Check(name, Level.FAULT, line, error.remedy) for line in str(error).splitlines())
        return
    setups = config.wheel_setups()
    wheels = ", ".join(f"{setup.position} (hub {setup.hub}, wheel {setup.wheel})" for setup in setups)
    yield Check(name, Level.OK, f"{path}: {config.name or 'unnamed'}, wheels {wheels}")
    if assumed := [f"{share} of the {field} ({', '.join(wheels)})" for field, share, wheels in config.assumed_errors()]:
        yield Check(name, Level.OK, f"standard errors that are not stated and assumed: {'; '.join(assumed)}")
    if unstated := ", ".join(setup.position for setup in setups if setup.sensor.bandwidth_hz is None):
        yield Check(name, Level.OK, f"not stated: bandwidth_hz, so no band is doubted ({unstated})")
    for quantity, key, unknown in (
        ("load", "load_n or an [[axle]]", [setup.position for setup in setups if setup.load_n is None]),
        ("pressure", "pressure_kpa", [setup.position for setup in setups if setup.pressure_pa is None]),
    ):
        if unknown:
            condition = ", unless the sensor reports it" if quantity == "pressure" else ""
            text = f"{quantity} of {', '.join(unknown)} is unknown: only ratios of the numbers can be estimated"
            yield Check(name, Level.WARNING, text, f"State {key} if possible{condition}.")
    for unknown_name in sorted({setup.tire.reference.estimator for setup in setups} - set(estimator_names())):
        text = (
            f"tire.reference.estimator: '{unknown_name}' is not an estimator: neither wear nor load is measured with it"
        )
        yield Check(name, Level.FAULT, escaped(text), f"Allowed: {', '.join(estimator_names())}.")
    yield from (
        Check(name, Level.WARNING, notice_text(notice), "Measure it and state it in the configuration.")
        for notice in config.notices()
    )


def check_errors(path: Path) -> Iterator[Check]:
    """Name the largest part of the errors that the statements about the first wheel of a vehicle lead to."""
    from gateway.core.config.vehicle import load_vehicle
    from gateway.core.feature import Registry, added, object_of

    try:
        setup = load_vehicle(path).wheel_setups()[0]
    except ConfigError:
        # The faults of the file are named by `check_config`.
        return
    name = f"errors of {setup.position}"
    try:
        for target in added(Registry.VEHICLE_CHECKS).values():
            yield from (Check(name, Level.OK, sentence) for sentence in object_of(target)(setup))
    except TreadlinkError as error:
        yield Check(name, Level.WARNING, str(error), error.remedy)


def check_lateral_axes(path: Path, config: Path | None) -> Iterator[Check]:
    """Check what the curves of a recording say of sign and gain of each wheel's lateral axis."""
    from gateway.core.recording.recorded_file import open_recorded_file
    from gateway.core.session.recording_pass import RecordingPass, open_recording
    from gateway.core.session.session_parts import open_rig_channels
    from gateway.core.trust.turn_verdict import TURN_RATE

    turning: dict[str, bool] = {}
    revolutions: dict[str, list[tuple[float, float]]] = {}
    try:
        file = open_recorded_file(path)
        recording = open_recording(file, config, verifies=False)
        rig = open_rig_channels(file)
        results = RecordingPass(recording, ("turning",), signals=recording.signals(), is_watched=False)
        for result in results:
            turning[result.position] = any(estimate.name == TURN_RATE for estimate in result.estimates)
            revolutions.setdefault(result.position, []).append((result.revolution.start_s, result.revolution.period_s))
    except TreadlinkError as error:
        yield Check(f"recording {path}", Level.FAULT, str(error), error.remedy)
        return
    setups = recording.vehicle.wheel_setups() if recording.vehicle is not None else ()
    declared = {setup.position for setup in setups if setup.sensor.lateral_is_left}
    for position in (position for position, has_axis in turning.items() if has_axis):
        is_of_rig = bool(rig.means(position, revolutions[position]))
        # One wheel alone may be a car's or a rig's.
        remedy = _STEER if is_of_rig else _DRIVE if len(turning) > 1 else f"{_DRIVE} {_STEER}"
        yield from axis_checks(position, results.lateral_axis(position), is_stated=position in declared, remedy=remedy)


def axis_checks(position: str, verdict: Verdict, *, is_stated: bool, remedy: str) -> Iterator[Check]:
    """Check sign and gain of a wheel's lateral axis by what curves say.

    Args:
        position: of the wheel.
        verdict: of the curves.
        is_stated: whether the sign is stated.
        remedy: what shows the sign.
    """
    yield _axis_check(position, verdict, is_stated=is_stated, remedy=remedy)
    for contradiction in verdict.contradictions:
        remedy = "Correct position, axis or scale of the sensor; compare it with one whose gain is known."
        yield Check(f"lateral gain of {position}", Level.FAULT, wording(contradiction.reason), remedy)


def _axis_check(position: str, verdict: Verdict, *, is_stated: bool, remedy: str) -> Check:
    """Return whether curves show the sign of a lateral axis, and what they say of its gain."""
    from gateway.core.trust.reasons import WITNESSES

    name, gain, track = f"lateral axis of {position}", verdict.gain, verdict.track_m
    if verdict.reversed_by is not None:
        remedy = "Reverse the sign of the axis in the sensor, or correct the positions."
        return Check(name, Level.FAULT, wording(verdict.reversed_by), remedy)
    if not verdict.sign:
        text = "its sign is stated, and no curve has shown it" if is_stated else "no curve has shown its sign"
        return Check(name, Level.OK if is_stated else Level.WARNING, text, remedy)
    text = "points to the left, as curves show"
    if verdict.gain_by is not None:
        witness = WITNESSES[str(verdict.gain_by)]
        text += f"; by {gain.curves} curves its gain is {abs(gain.value):.2f} ± {gain.std:.2f} times the stated one"
        return Check(name, Level.OK, f"{text}, as {witness}")
    if math.isfinite(track.value):
        text += f"; if its gain is as stated, the track is {abs(track.value):.2f} m ± {track.std:.2f} m wide"
        return Check(name, Level.OK, text, "State track_width_mm of its [[axle]] to verify the gain, by 8 curves.")
    return Check(name, Level.OK, f"{text}; 8 curves verify its gain")


def check_source(uri: str, clock: Any) -> Iterator[Check]:
    """Check that a source can be opened, without reading from it."""
    name = f"source {uri}"
    try:
        address = parse_source_uri(uri)
        source = open_source(uri, clock)
        source.close()
        if address.scheme == "tcp":
            from gateway.core.links.tcp_link import connect, parse_host_port

            connect(parse_host_port(address)).close()
        elif address.scheme == "ble":
            yield Check(name, Level.OK, f"in range: {source.look()}")  # type: ignore[attr-defined]
            return
    except TreadlinkError as error:
        yield Check(name, Level.FAULT, str(error), error.remedy)
        return
    except ImportError as error:
        yield Check(name, Level.FAULT, f"package {error.name} is missing", "See the packages above.")
        return
    if address.scheme == "serial" and "://" not in address.target:
        device = check_device(Path(address.target))
        yield Check(name, device.level, device.text, device.remedy)
        return
    yield Check(name, Level.OK, "can be opened")


def _has_group_name(device: Path) -> bool:
    try:
        device.group()
    except KeyError:
        return False
    return True


def _version_of(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _release(version: str) -> tuple[int, ...]:
    """Return the leading numbers of a version, for comparing releases."""
    match = re.match(r"\d+(?:\.\d+)*", version)
    return tuple(map(int, match[0].split("."))) if match else ()
