"""Worker processes and small recordings, once for all tests of campaigns."""

import shutil
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gateway.core.clock import SystemClock
from gateway.core.estimates.wheel_setup import CorrectionTable
from gateway.fleet.campaign_run import CampaignProgress, CampaignRun, find_recordings
from gateway.fleet.content_keys import estimators_version
from gateway.fleet.dataset import Description, opened
from gateway.fleet.local_tasks import LocalTasks
from gateway.fleet.recording_estimation import EstimationSettings, RowsKept, estimate_names, estimate_recording
from tests.testkit.campaign_recordings import START_NS, write_recording

ESTIMATORS = ("kinematic", "weak-form", "wear")
DAY_NS = 86_400 * 10**9
MEMORY_BYTES = 500_000_000


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with three recordings of 1.6 s, of two vehicles on two days."""
    folder = tmp_path_factory.mktemp("made")
    for number, vehicle in enumerate(("van 7", "van 7", "a/b=c ü")):
        write_recording(
            folder / f"drive{number}.mcap",
            "[sensor]\nrate_hz = 2000\n[motion]\nspeed_kmh = 80\n",
            wheels=("load_n = 4000\n",),
            duration_s=1.6,
            seed=number + 1,
            start_ns=START_NS + number * DAY_NS,
            change=lambda toml, name=vehicle: toml.replace('name = ""', f'name = "{name}"'),
        )
    return folder


@pytest.fixture
def recordings(made: Path, tmp_path: Path) -> Path:
    """Return a folder with copies, which a test may change."""
    folder = tmp_path / "recordings"
    shutil.copytree(made, folder)
    return folder


@pytest.fixture(scope="session")
def workers() -> Iterator[LocalTasks]:
    """Yield a worker process."""
    with LocalTasks(1, MEMORY_BYTES) as tasks:
        yield tasks


Campaign = Callable[..., CampaignProgress]


@pytest.fixture
def campaign(workers: LocalTasks, tmp_path: Path) -> Campaign:
    """Return what runs a campaign over paths into `tmp_path / "dataset"`."""

    def run(
        *paths: Path,
        work: Callable[..., object] = estimate_recording,
        rows: RowsKept = RowsKept.SECOND,
        stop: threading.Event | None = None,
        estimators: tuple[str, ...] = ESTIMATORS,
        code: str = "",
        effects: tuple[CorrectionTable, ...] = (),
        **options: object,
    ) -> CampaignProgress:
        version = code or estimators_version()
        settings = EstimationSettings(estimators, estimate_names(estimators), rows, effects=effects, code=version)
        description = Description(estimators, settings.columns, str(rows))
        with opened(tmp_path / "dataset", description, lambda _: False) as dataset:
            return CampaignRun(
                dataset=dataset,
                settings=settings,
                connect=lambda: workers,
                clock=SystemClock(),
                stop=stop or threading.Event(),
                work=work,  # type: ignore[arg-type]
                **options,  # type: ignore[arg-type]
            ).run(find_recordings(paths))

    return run
