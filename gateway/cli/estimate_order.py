"""Order to estimate a recording, and its answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gateway.reasons import Reason
    from gateway.views.drive_page.drive import Drive
    from gateway.views.tables.result_table import TableFormat


@dataclass(frozen=True, slots=True)
class EstimateOrder:
    """Order to estimate one recording.

    Attributes:
        path: the recording.
        config_path: vehicle configuration, None to use the recorded one.
        effects_paths: files of known effects.
        key_file: keys of signed frames, None for the user's.
        estimators: names from the registry.
        spools: file for the rows of each table, when another process writes the tables.
        coverage_factor: of expanded uncertainties in the tables, None for none.
        is_drawn: whether the answer has what a page shows.
    """

    path: Path
    config_path: Path | None
    effects_paths: tuple[Path, ...]
    key_file: Path | None
    estimators: tuple[str, ...]
    spools: Mapping[TableFormat, Path]
    coverage_factor: float | None = None
    is_drawn: bool = False


@dataclass(frozen=True, slots=True)
class RecordingEstimated:
    """End of the work on one recording; its rows are written.

    Attributes:
        lines: summary.
        missing: number of links and wheels without a result.
        damage: unreadable parts, None without any.
        drive: what a page shows of it, None where none is made.
    """

    lines: tuple[str, ...]
    missing: int
    damage: Reason | None
    drive: Drive | None = None
