"""Runs file of a slip calibration: recordings, or parts of them, at known slip angles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from gateway.config.validation import Fault, Section, parse_document, read_text, show
from gateway.config.vehicle import POSITION_PATTERN


class RunTable(Section):
    """`[[run]]`: one recording, or a part of it, at a constant and known slip angle."""

    recording: str = Field(min_length=1, description="path of the recording, relative to the runs file")
    slip_deg: float = Field(
        ge=-10, le=10, description="known slip angle in degrees; a positive one pulls the tire to the left"
    )
    slip_std_deg: float | None = Field(
        default=None, ge=0, le=5, description="standard error of slip_deg in degrees; default: that of the file"
    )
    direction: Literal["forward", "reverse"] = Field(default="forward", description="direction of rolling")
    from_s: float = Field(default=0.0, ge=0, le=1e6, description="begin of the run after the first revolution in s")
    to_s: float | None = Field(
        default=None, gt=0, le=1e6, description="end of the run after the first revolution in s; default: the last one"
    )


class SlipRunsFile(Section):
    """A runs file."""

    wheel: str | None = Field(
        default=None, pattern=POSITION_PATTERN, description="position of the wheel; default: the only one recorded"
    )
    slip_std_deg: float = Field(
        default=0.05, ge=0, le=5, description="standard error of each slip_deg by itself in degrees"
    )
    slip_zero_std_deg: float = Field(
        default=0.05, ge=0, le=5, description="standard error of the zero that all slip_deg are counted from in degrees"
    )
    run: tuple[RunTable, ...] = Field(
        strict=False, min_length=2, max_length=200, description="at least two runs, a [[run]] table each"
    )


def load_slip_runs(path: Path) -> SlipRunsFile:
    """Return a runs file.

    Raises:
        ConfigError: it cannot be read, or has faults; the message lists all of them.
    """
    return parse_document(SlipRunsFile, read_text(path, "the runs file"), str(path), _faults)


def _faults(data: Mapping[str, Any]) -> Iterator[Fault]:
    runs = data.get("run")
    for index, run in enumerate(runs if isinstance(runs, list) else ()):
        if not isinstance(run, Mapping):
            continue
        begin, end = run.get("from_s", 0.0), run.get("to_s")
        if isinstance(begin, int | float) and isinstance(end, int | float) and not begin < end:
            yield Fault(f"run[#{index + 1}].to_s", show(end), f"allowed: more than from_s = {show(begin)}")
