"""Runs file of a side force calibration: recordings, or parts of them, at known side forces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import Field

from gateway.config.validation import Fault, Section, parse_document, read_text, show
from gateway.config.vehicle import POSITION_PATTERN


class ForceRunTable(Section):
    """`[[run]]`: one recording, or a part of it, at a constant and known side force."""

    recording: str = Field(min_length=1, description="path of the recording, relative to the runs file")
    side_force_n: float = Field(
        ge=-100_000, le=100_000, description="force of the road on the tire in N, positive to the left"
    )
    aligning_moment_nm: float | None = Field(
        default=None,
        ge=-100_000,
        le=100_000,
        description="moment about the vertical axis in N m, positive turns the tire to the left",
    )
    wheel: str | None = Field(
        default=None, pattern=POSITION_PATTERN, description="position of the wheel; default: the one of the others"
    )
    from_s: float = Field(default=0.0, ge=0, le=1e6, description="begin of the run after the first revolution in s")
    to_s: float | None = Field(
        default=None, gt=0, le=1e6, description="end of the run after the first revolution in s; default: the last one"
    )


class ForceRunsFile(Section):
    """A runs file."""

    wheel: str | None = Field(
        default=None, pattern=POSITION_PATTERN, description="position of the wheel; default: the only one recorded"
    )
    side_force_std_n: float = Field(default=20.0, ge=0, le=10_000, description="standard error of each force in N")
    aligning_moment_std_nm: float = Field(
        default=1.0, ge=0, le=10_000, description="standard error of each moment in N m"
    )
    run: tuple[ForceRunTable, ...] = Field(
        strict=False, min_length=2, max_length=200, description="at least two runs, a [[run]] table each"
    )


def load_force_runs(path: Path) -> ForceRunsFile:
    """Return a runs file.

    Raises:
        ConfigError: it cannot be read, or has faults; the message lists all of them.
    """
    return parse_document(ForceRunsFile, read_text(path, "the runs file"), str(path), _faults)


def _faults(data: Mapping[str, Any]) -> Iterator[Fault]:
    runs = data.get("run")
    for index, run in enumerate(runs if isinstance(runs, list) else ()):
        if not isinstance(run, Mapping):
            continue
        begin, end = run.get("from_s", 0.0), run.get("to_s")
        if isinstance(begin, int | float) and isinstance(end, int | float) and not begin < end:
            yield Fault(f"run[#{index + 1}].to_s", show(end), f"allowed: more than from_s = {show(begin)}")
