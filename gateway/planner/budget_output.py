"""Uncertainty budgets of recordings: lines of the summary, and a JSON file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gateway.core.config.vehicle import VehicleConfig
from gateway.core.estimates.results import AlarmRecord, WheelSnapshot
from gateway.core.quantity_catalogue import quantity_of, unit_of
from gateway.core.reasons import Notice
from gateway.core.recording.recorded_file import RecordedFile
from gateway.core.text.numbers import finite_or_none
from gateway.core.text.output_file import OutputFile, check_target
from gateway.planner.uncertainty_budget import Budget, LatestRevolutions


def open_budgets(path: Path | None, *, force: bool) -> BudgetFile | None:
    """Return the output where it is asked for.

    Raises:
        OutputError: the file exists or cannot be made.
    """
    if path is None:
        return None
    check_target(path, force=force)
    return BudgetFile(path, force=force)


class BudgetFile:
    """JSON file of the budgets of all recordings of a command."""

    def __init__(self, path: Path, *, force: bool) -> None:
        self._path, self._force = path, force
        self._entries: list[dict[str, Any]] = []

    def begin(self, file: RecordedFile, vehicle: VehicleConfig | None) -> _Collector:
        """Return what collects the latest revolutions of a recording."""
        return _Collector(vehicle, str(file.info.path), self._entries)

    def write(self) -> dict[str, str]:
        """Write the file; return its content.

        Raises:
            OutputError: it cannot be written.
        """
        with OutputFile(self._path, force=self._force) as output:
            output.file.write(json.dumps(self._entries, indent=1).encode() + b"\n")
        return {"uncertainty_budget": json.dumps(self._entries)}


class _Collector:
    """Latest revolutions of a recording on their way to budgets."""

    def __init__(self, vehicle: VehicleConfig | None, recording: str, entries: list[dict[str, Any]]) -> None:
        self._latest = LatestRevolutions(() if vehicle is None else vehicle.wheel_setups())
        self._recording, self._entries = recording, entries
        self.add = self._latest.add

    def finish(
        self, states: Sequence[WheelSnapshot], alarms: Sequence[AlarmRecord], notices: Sequence[Notice]
    ) -> Sequence[str]:
        """Make the budgets; return a line for each quantity that a better statement would help."""
        del states, alarms, notices
        lines = []
        for position, wheel_budgets in self._latest.budgets().items():
            for budget in wheel_budgets:
                self._entries.append({"recording": self._recording, "position": position, **_entry(budget)})
                # Those that people follow; the file has all.
                if budget.advice and quantity_of(budget.estimate.name).watch is not None:
                    lines.append(f"{position}: {budget.advice}")
        return ["", "uncertainty budget", *lines] if lines else []


def _entry(budget: Budget) -> dict[str, Any]:
    estimate, promise = budget.estimate, budget.promise
    return {
        "quantity": estimate.name,
        "unit": unit_of(estimate.name),
        "value": finite_or_none(estimate.value),
        "std": estimate.std,
        "status": str(estimate.status),
        "parts": budget.all_parts(),
        "better": None
        if promise is None
        else {
            "statement": promise.source.name,
            "stated": promise.stated,
            "to": promise.source.better,
            "how": promise.source.how,
            "std": promise.std,
        },
    }
