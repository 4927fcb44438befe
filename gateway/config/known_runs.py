"""Runs file of a calibration: recordings, or parts of them, during which a quantity is known."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import Field

from gateway.config.validation import Fault, Section, parse_document, read_text, show
from gateway.config.vehicle import POSITION_PATTERN


class KnownRun(Section):
    """`[[run]]`: one recording, or a part of it."""

    recording: str = Field(min_length=1, description="path of the recording, relative to the runs file")
    from_s: float = Field(default=0.0, ge=0, le=1e6, description="begin of the run after the first revolution in s")
    to_s: float | None = Field(
        default=None, gt=0, le=1e6, description="end of the run after the first revolution in s; default: the last one"
    )


class KnownRunsFile(Section):
    """A runs file."""

    wheel: str | None = Field(
        default=None, pattern=POSITION_PATTERN, description="position of the wheel; default: the only one recorded"
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


def _faults(data: Mapping[str, Any]) -> Iterator[Fault]:
    runs = data.get("run")
    for index, run in enumerate(runs if isinstance(runs, list) else ()):
        if not isinstance(run, Mapping):
            continue
        begin, end = run.get("from_s", 0.0), run.get("to_s")
        if isinstance(begin, int | float) and isinstance(end, int | float) and not begin < end:
            yield Fault(f"run[#{index + 1}].to_s", show(end), f"allowed: more than from_s = {show(begin)}")
        for earlier, other in enumerate(runs[:index] if isinstance(runs, list) else ()):
            if isinstance(other, Mapping) and _overlap(other, run):
                yield Fault(
                    f"run[#{index + 1}].from_s",
                    show(begin),
                    f"allowed: a part of {show(run.get('recording'))} that run[#{earlier + 1}] does not have",
                )


def _overlap(run: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return whether two runs have revolutions in common, which would count twice."""
    if any(run.get(key) != other.get(key) for key in ("recording", "wheel")):
        return False
    begin, begin_other = run.get("from_s", 0.0), other.get("from_s", 0.0)
    end, end_other = run.get("to_s", math.inf), other.get("to_s", math.inf)
    if not all(isinstance(time, int | float) for time in (begin, begin_other, end, end_other)):
        return False
    return bool(max(begin, begin_other) < min(end, end_other))
