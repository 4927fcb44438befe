"""Runs file of a slip calibration: recordings, or parts of them, at known slip angles."""

from typing import Literal

from pydantic import Field

from gateway.config.known_runs import KnownRun, KnownRunsFile


class RunTable(KnownRun):
    """`[[run]]`: one recording, or a part of it, at a constant and known slip angle."""

    slip_deg: float = Field(
        ge=-10, le=10, description="known slip angle in degrees; a positive one pulls the tire to the left"
    )
    slip_std_deg: float | None = Field(
        default=None, ge=0, le=5, description="standard error of slip_deg in degrees; default: that of the file"
    )
    direction: Literal["forward", "reverse"] = Field(default="forward", description="direction of rolling")


class SlipRunsFile(KnownRunsFile):
    """A runs file."""

    slip_std_deg: float = Field(
        default=0.05, ge=0, le=5, description="standard error of each slip_deg by itself in degrees"
    )
    slip_zero_std_deg: float = Field(
        default=0.05, ge=0, le=5, description="standard error of the zero that all slip_deg are counted from in degrees"
    )
    run: tuple[RunTable, ...] = Field(
        strict=False, min_length=2, max_length=200, description="at least two runs, a [[run]] table each"
    )
