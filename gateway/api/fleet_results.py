"""Campaigns over many recordings, and trends of their tires, for programs."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from gateway.core.clock import SystemClock
from gateway.core.estimates.registry import CAMPAIGN_ESTIMATORS, in_order
from gateway.core.session.program_arguments import Config, PathLike, chosen_vehicle, paths, several_names
from gateway.core.text.aligned_table import WIDEST
from gateway.core.text.output_file import write_whole
from gateway.core.text.text import json_text
from gateway.core.text.wording import text
from gateway.fleet.campaign_run import CampaignRun, find_recordings
from gateway.fleet.content_keys import estimators_version
from gateway.fleet.dataset import Description, opened
from gateway.fleet.history_reading import read_histories, read_odometer
from gateway.fleet.local_tasks import LocalTasks
from gateway.fleet.parquet_parts import require_campaign_packages
from gateway.fleet.recording_estimation import EstimationSettings, RowsKept, estimate_names
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.trend_result import FleetTrends
from gateway.fleet.views.trend_page import write_trends_page
from gateway.fleet.views.trend_tables import trends_csv, trends_json
from gateway.fleet.views.trend_terminal import trend_lines


@dataclass(frozen=True, slots=True)
class CampaignResult:
    """Result of a campaign.

    Attributes:
        dataset: its folder; `pandas.read_parquet(dataset / "recordings")` reads a table.
        estimated: recordings added now.
        done_before: recordings whose results were there.
        failures: recordings that could not be estimated, with the reason.
    """

    dataset: Path
    estimated: int
    done_before: int
    failures: tuple[tuple[Path, str], ...]

    def trends(self, *, odometer: PathLike | None = None) -> TireTrends:
        """Return how the tires and sensors of the dataset change; see `gateway.tire_trends`."""
        return tire_trends(self.dataset, odometer=odometer)


def campaign(
    recordings: PathLike | Sequence[PathLike],
    dataset: PathLike,
    *,
    config: Config | None = None,
    estimators: str | Sequence[str] = (),
    rows: str = "second",
    jobs: int = 1,
    keys: PathLike | None = None,
) -> CampaignResult:
    """Estimate recordings, or the .mcap files of folders, into a dataset of Parquet files, as `treadlink campaign`.

    Args:
        recordings: files and folders.
        dataset: folder; made when it does not exist, continued when it does.
        config: vehicle configuration for all; None for the one in each recording.
        estimators: names; none for those of a campaign.
        rows: revolutions to keep: `second` (the last of each second), `all` or `none`.
        jobs: worker processes.
        keys: sensor signing keys.

    Raises:
        TreadlinkError: the dataset cannot be used, or a package of the extra `campaign` is missing.
        ValueError: no such kind of rows, or no process.
    """
    if jobs < 1:
        raise ValueError(f"jobs must be at least 1, not {jobs}")
    require_campaign_packages()
    chosen = tuple(in_order(several_names(estimators) or CAMPAIGN_ESTIMATORS))
    settings = EstimationSettings(
        estimators=chosen,
        columns=estimate_names(chosen),
        rows=RowsKept(rows),
        vehicle=chosen_vehicle(config, (), "campaign") if config is not None else None,
        effects=(),
        key_file=None if keys is None else Path(keys).resolve(),
        code=estimators_version(),
    )
    failures: list[tuple[Path, str]] = []
    with (
        opened(Path(dataset), Description(chosen, settings.columns, str(settings.rows)), lambda _: False) as content,
        LocalTasks(jobs) as tasks,
    ):
        progress = CampaignRun(
            dataset=content,
            settings=settings,
            connect=lambda: tasks,
            clock=SystemClock(),
            stop=threading.Event(),
            on_progress=lambda _: None,
            on_failure=lambda path, failure: failures.append((path, text(failure.reason))),
            retries_failed=False,
        ).run(find_recordings(paths(recordings)))
    return CampaignResult(Path(dataset), progress.estimated, progress.done_before, tuple(failures))


class TireTrends:
    """Changes of the tires and sensors of a dataset; `str()` is the report of `treadlink trends`.

    Attributes:
        result: every number with its standard error.
    """

    def __init__(self, result: FleetTrends) -> None:
        """Keep the result."""
        self.result = result

    def to_dict(self) -> dict[str, Any]:
        """Return all results as the JSON of `treadlink trends --json`."""
        return trends_json(self.result)

    def save(self, path: PathLike, *, force: bool = False) -> None:
        """Write a report (.html), all results (.json) or a table of all numbers (.csv).

        Raises:
            OutputError: another suffix, a package is missing, or the file exists or cannot be written.
            ValueError: no such suffix.
        """
        out = Path(path)
        if out.suffix == ".html":
            write_trends_page(self.result, out, force=force)
        elif out.suffix == ".json":
            content = json_text(self.to_dict(), indent=2)
            write_whole(out, content + "\n", force=force)
        elif out.suffix == ".csv":
            write_whole(out, trends_csv(self.result), force=force)
        else:
            raise ValueError(f"'{out}': trends are saved as .html, .json or .csv")

    def __str__(self) -> str:
        return "\n".join(trend_lines(self.result, WIDEST))

    def __repr__(self) -> str:
        return f"<TireTrends: {len(self.result.tires)} tires>"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"


def tire_trends(dataset: PathLike, *, odometer: PathLike | None = None) -> TireTrends:
    """Return how the tires and sensors of a dataset change, as `treadlink trends`.

    Args:
        dataset: folder that `campaign` has made.
        odometer: CSV file with the columns vehicle, utc and km, for wear per 1,000 km.

    Raises:
        TreadlinkError: the dataset or the odometer cannot be read, or a package of the extra `campaign` is missing.
    """
    require_campaign_packages()
    histories = read_histories(Path(dataset), None if odometer is None else read_odometer(Path(odometer)))
    return TireTrends(
        analyse(histories.tires, recordings=histories.recordings, failures=histories.failures, notes=histories.notes)
    )
