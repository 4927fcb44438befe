"""Runs files of calibrations: recordings, or parts of them, during which a slip angle or a side force is known."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal, TypeVar

from pydantic import Field

from gateway.core.config.validation import Fault, Section, above, parse_document, read_text, show, within
from gateway.core.config.vehicle import POSITION_PATTERN
from gateway.core.errors import CalibrationError

PRESSURE_KPA: Final = (10.0, 1500.0)
"""Gauge pressures that the table of a calibration can state."""


class KnownRun(Section):
    """`[[run]]`: one recording, or a part of it."""

    recording: str = Field(min_length=1, description="path of the recording, relative to the runs file")
    from_s: float = within(0.0, 0, 1e6, "begin of the run after the first revolution in s")
    to_s: float | None = above(None, 0, 1e6, "end of the run after the first revolution in s; default: the last one")


class KnownRunsFile(Section):
    """A runs file."""

    wheel: str | None = Field(
        default=None, pattern=POSITION_PATTERN, description="position of the wheel; default: the only one recorded"
    )


class RunTable(KnownRun):
    """`[[run]]`: one recording, or a part of it, at a known slip angle."""

    slip_deg: float | None = within(
        None,
        -10,
        10,
        "known slip angle in degrees; a positive one pulls the tire to the left; default: the mean of "
        "the recording's reference slip_angle at the revolutions used",
    )
    slip_std_deg: float | None = within(None, 0, 5, "standard error of slip_deg in degrees; default: that of the file")
    direction: Literal["forward", "reverse"] = Field(default="forward", description="direction of rolling")


class SlipRunsFile(KnownRunsFile):
    """A runs file of a slip calibration."""

    slip_std_deg: float = within(0.05, 0, 5, "standard error of each slip_deg by itself in degrees")
    slip_zero_std_deg: float = within(
        0.05, 0, 5, "standard error of the zero that all slip_deg are counted from in degrees"
    )
    run: tuple[RunTable, ...] = Field(
        strict=False, min_length=2, max_length=200, description="at least two runs, a [[run]] table each"
    )


class ForceRunTable(KnownRun):
    """`[[run]]`: one recording, or a part of it, at a constant and known side force."""

    side_force_n: float | None = within(
        None,
        -100_000,
        100_000,
        "force of the road on the tire in N, positive to the left; default: the mean of the recording's reference "
        "side_force at the revolutions used",
    )
    aligning_moment_nm: float | None = within(
        None, -100_000, 100_000, "moment about the vertical axis in N m, positive turns the tire to the left"
    )
    wheel: str | None = Field(
        default=None, pattern=POSITION_PATTERN, description="position of the wheel; default: the one of the others"
    )


class ForceRunsFile(KnownRunsFile):
    """A runs file of a side force calibration."""

    side_force_std_n: float = within(20.0, 0, 10_000, "standard error of each force in N")
    aligning_moment_std_nm: float = within(1.0, 0, 10_000, "standard error of each moment in N m")
    run: tuple[ForceRunTable, ...] = Field(
        strict=False, min_length=2, max_length=200, description="at least two runs, a [[run]] table each"
    )


RunsT = TypeVar("RunsT", bound=KnownRunsFile)


def load_runs(kind: type[RunsT], path: Path) -> RunsT:
    """Return a runs file of a kind.

    Raises:
        ConfigError: it cannot be read, or has faults; the message lists all of them.
    """
    return parse_document(kind, read_text(path, "the runs file"), str(path), _faults)


def run_recordings(path: Path, runs: Sequence[KnownRun]) -> tuple[Path, ...]:
    """Return the recordings of a runs file, each once, although several runs may be parts of it."""
    return tuple(dict.fromkeys(path.parent / run.recording for run in runs))


def pressure_fault(pressure_pa: float | None) -> str | None:
    """Return why no calibration can be made at a mean pressure, None where one can or the pressure is not known."""
    low, high = PRESSURE_KPA
    if pressure_pa is None or low <= 1e-3 * pressure_pa <= high:
        return None
    return f"its pressure is {1e-3 * pressure_pa:.1f} kPa, {low:.0f} to {high:.0f} kPa are required"


def check_pressure(name: str, pressure_pa: float | None) -> None:
    """Check the mean pressure of a run.

    Raises:
        CalibrationError: no calibration can be made at it.
    """
    if (fault := pressure_fault(pressure_pa)) is not None:
        raise CalibrationError(f"{name}: {fault}", "Check tire and pressure sensor, or leave out the run.")


def _faults(data: Mapping[str, Any]) -> Iterator[Fault]:
    runs = data.get("run")
    runs = runs if isinstance(runs, list) else []
    for index, run in enumerate(runs):
        if not isinstance(run, Mapping):
            continue
        begin, end = run.get("from_s", 0.0), run.get("to_s")
        if isinstance(begin, int | float) and isinstance(end, int | float) and not begin < end:
            yield Fault(f"run[#{index + 1}].to_s", show(end), f"allowed: more than from_s = {show(begin)}")
        for other_index, other in enumerate(runs[:index]):
            if isinstance(other, Mapping) and _overlap(other, run, data.get("wheel")):
                yield Fault(
                    f"run[#{index + 1}].from_s",
                    show(begin),
                    f"allowed: a part of {show(run.get('recording'))} that run[#{other_index + 1}] does not have",
                )


def _overlap(run: Mapping[str, Any], other: Mapping[str, Any], wheel: object) -> bool:
    """Return whether two runs have revolutions in common, which would count twice; `wheel` is the default of both."""
    recordings = [Path(str(each.get("recording"))) for each in (run, other)]
    # A wheel that is not named is the only one recorded.
    named = {str(each.get("wheel", wheel)) for each in (run, other)} - {"None"}
    if recordings[0] != recordings[1] or len(named) > 1:
        return False
    begin, begin_other = run.get("from_s", 0.0), other.get("from_s", 0.0)
    end, end_other = run.get("to_s", math.inf), other.get("to_s", math.inf)
    if not all(isinstance(time, int | float) for time in (begin, begin_other, end, end_other)):
        return False
    return bool(max(begin, begin_other) < min(end, end_other))
