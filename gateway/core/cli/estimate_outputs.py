"""Outputs of `treadlink estimate` that features add: options, what is collected, and what is written."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from gateway.core.feature import Registry, added, object_of
from gateway.core.plugins import Plugin, load_all, missing_factory
from gateway.core.reasons import CoreCode, Notice, Reason

if TYPE_CHECKING:
    from gateway.core.config.vehicle import VehicleConfig
    from gateway.core.estimates.results import AlarmRecord, RevolutionResult, WheelSnapshot
    from gateway.core.recording.recorded_file import RecordedFile


class RecordingCollector(Protocol):
    """What an output collects of one recording."""

    def add(self, result: RevolutionResult) -> None:
        """Take one revolution."""
        ...

    def finish(
        self, states: Sequence[WheelSnapshot], alarms: Sequence[AlarmRecord], notices: Sequence[Notice]
    ) -> Sequence[str]:
        """Take what is complete at the end of the recording; return lines for its summary."""
        ...


class EstimateOutput(Protocol):
    """An output of all recordings of a command."""

    def begin(self, file: RecordedFile, vehicle: VehicleConfig | None) -> RecordingCollector:
        """Return a collector for a recording that is read next."""
        ...

    def write(self) -> Mapping[str, str] | None:
        """Write what was collected, after the last recording; return what the metadata of a Parquet table repeats.

        Raises:
            OutputError: it cannot be written.
        """
        ...


@dataclass(frozen=True, slots=True)
class AddedOutput:
    """Declaration of an output; its module imports nothing heavy, as `--help` needs it.

    Attributes:
        factory: `module:callable`, called where there is no option, or the user gives it, with the file that the user
            names, None for none, and whether to overwrite it; returns an `EstimateOutput`, or None where nothing is
            to be written. It fails before the work if the file cannot be written.
        parameter: of the option; empty without one.
        option: adds it to a command; None without one.
    """

    factory: str
    parameter: str = ""
    option: Callable[[Any], Any] | None = None


@cache
def added_outputs() -> tuple[AddedOutput, ...]:
    """Return the outputs that features add, then those of plug-ins that fit."""
    targets = added(Registry.ESTIMATE_OUTPUTS)
    of_plugins = load_all(Registry.ESTIMATE_OUTPUTS, targets, plugin_fault).values()
    outputs = (*map(object_of, targets.values()), *of_plugins)
    return tuple(output for output in outputs if isinstance(output, AddedOutput))


def plugin_fault(_plugin: Plugin, output: object) -> Reason | None:
    """Return why the object of a plug-in is no output, None when it is one."""
    if not isinstance(output, AddedOutput):
        return Reason(
            CoreCode.PLUGIN_REFUSED, why="wrong_type", expected="a gateway.core.cli.estimate_outputs.AddedOutput"
        )
    return missing_factory(output.factory)


def with_added_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options of these outputs to a command."""
    for output in reversed(added_outputs()):
        if output.option is not None:
            command = output.option(command)
    return command


def open_outputs(values: dict[str, Path | None], *, force: bool) -> list[EstimateOutput]:
    """Return the outputs that are asked for.

    Args:
        values: of the options, by parameter.
        force: whether to overwrite files.

    Raises:
        OutputError: a file cannot be written.
    """
    opened = [
        object_of(output.factory)(values.get(output.parameter), force=force)
        for output in added_outputs()
        if not output.parameter or values.get(output.parameter) is not None
    ]
    return [output for output in opened if output is not None]
