"""Runs file of a side force calibration: recordings, or parts of them, at known side forces."""

from pydantic import Field

from gateway.config.known_runs import KnownRun, KnownRunsFile
from gateway.config.vehicle import POSITION_PATTERN


class ForceRunTable(KnownRun):
    """`[[run]]`: one recording, or a part of it, at a constant and known side force."""

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


class ForceRunsFile(KnownRunsFile):
    """A runs file."""

    side_force_std_n: float = Field(default=20.0, ge=0, le=10_000, description="standard error of each force in N")
    aligning_moment_std_nm: float = Field(
        default=1.0, ge=0, le=10_000, description="standard error of each moment in N m"
    )
    run: tuple[ForceRunTable, ...] = Field(
        strict=False, min_length=2, max_length=200, description="at least two runs, a [[run]] table each"
    )
