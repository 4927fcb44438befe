"""Diagnoses of the tires of a campaign: one for each tire, from recordings at its different speeds."""

import json
import threading
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple
from urllib.parse import unquote

from gateway import __version__
from gateway.core.config.vehicle import VehicleConfig
from gateway.core.errors import OutputError, TreadlinkError
from gateway.core.reasons import Reason
from gateway.core.recording.file_content import FileContent
from gateway.core.storable_text import storable
from gateway.core.table_columns import DIAGNOSIS_COLUMNS
from gateway.core.text.plain_values import plain
from gateway.core.text.wording import as_json, joined, text
from gateway.diagnosis.campaign_diagnosis import diagnose_agreeing
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.views.diagnosis_json import diagnosis_json
from gateway.fleet.content_keys import diagnosis_version, settings_key
from gateway.fleet.dataset import DIAGNOSES, Dataset, Key, is_identified
from gateway.fleet.parquet_parts import PartFile, read_rows
from gateway.fleet.reasons import FleetCode
from gateway.fleet.recording_estimation import RECORDINGS
from gateway.fleet.worker_tasks import WorkerTasks

MOST_RECORDINGS: Final = 12
"""Recordings of a diagnosis: the time that it takes grows with their number."""

_POLL_S: Final = 0.1
_COLUMNS: Final = ("recording_id", "position", "sensor_id", "start_utc", "speed_mean_mps", "revolutions_valid")


@dataclass(frozen=True, slots=True)
class DiagnosisOrder:
    """Order to diagnose one tire.

    Attributes:
        vehicle: name.
        position: of the wheel.
        sensor_id: of its sensor.
        paths: of the recordings.
        start_ns: of the earliest.
        config: configuration for all recordings, None for the one in each.
        key_file: keys of signed frames.
        part: file to write.
    """

    vehicle: str
    position: str
    sensor_id: str
    paths: tuple[Path, ...]
    start_ns: int
    config: VehicleConfig | None
    key_file: Path | None
    part: Path


class TireOutcome(NamedTuple):
    """What became of a tire, as its file states it.

    Attributes:
        failure: why there is no diagnosis; empty where there is one.
        left_out: recordings that the diagnosis leaves out, each with its reason.
    """

    failure: str = ""
    left_out: tuple[str, ...] = ()


@dataclass(slots=True)
class DiagnosisCounts:
    """Counts of a run: tires diagnosed now, known before, and without a diagnosis, now or before.

    Attributes:
        made: diagnosed now.
        made_before: diagnosed before.
        reasons: tires without a diagnosis, as (vehicle, position, sensor), and why.
        left_out: tires with a diagnosis, now or before, and the recordings that it leaves out with their reasons.
    """

    made: int = 0
    made_before: int = 0
    reasons: list[tuple[tuple[str, str, str], str]] = field(default_factory=list)
    left_out: list[tuple[tuple[str, str, str], tuple[str, ...]]] = field(default_factory=list)

    @property
    def failed(self) -> int:
        """Number of tires without a diagnosis."""
        return len(self.reasons)

    def add(self, tire: tuple[str, str, str], outcome: TireOutcome) -> None:
        """Take what the views list of a tire."""
        if outcome.failure:
            self.reasons.append((tire, outcome.failure))
        elif outcome.left_out:
            self.left_out.append((tire, outcome.left_out))


def diagnose_tires(
    dataset: Dataset,
    tasks: Callable[[], WorkerTasks],
    contents: Mapping[str, FileContent],
    *,
    config: VehicleConfig | None,
    key_file: Path | None,
    stop: threading.Event,
    on_tire: Callable[[int, int], None] = lambda _, __: None,
) -> DiagnosisCounts:
    """Diagnose the tires of the recordings of a campaign, as far as that is not done.

    Args:
        dataset: with the rows of the recordings.
        tasks: returns the tasks of the workers.
        contents: of its files, by recording; files of other recordings may not exist any more.
        config: configuration for all recordings, None for the one in each.
        key_file: keys of signed frames.
        stop: event that asks to stop.
        on_tire: called with the number of finished and of all tires.

    Raises:
        OutputError: the dataset cannot be written.
    """
    counts = DiagnosisCounts()
    orders: dict[str, tuple[DiagnosisOrder, list[Path]]] = {}
    for tire, rows in _tires(dataset.root, contents).items():
        vehicle, _, sensor_id = tire
        if len(rows) > 1 and not is_identified(vehicle, sensor_id):
            counts.add(tire, TireOutcome(text(Reason(FleetCode.TIRE_UNIDENTIFIED, recordings=len(rows)))))
            continue
        chosen = _chosen(rows)
        tire_key = settings_key(list(tire))
        key = settings_key(
            [
                sorted(str(row["recording_id"]) for row in chosen),
                None if config is None else config.to_toml(),
                diagnosis_version(),
            ]
        )
        name = f"{tire_key}-{key}"
        old = list((dataset.root / DIAGNOSES).glob(f"*/*/{tire_key}-*.parquet"))
        if outcome := next((outcome_in(path) for path in old if path.name == f"{name}.parquet"), None):
            counts.made_before += not outcome.failure
            counts.add(tire, outcome)
            continue
        paths = tuple(contents[row["recording_id"]].path for row in chosen)
        start_ns = min(int(row["start_utc"]) for row in chosen)
        part = dataset.incoming / f"{name}.parquet"
        orders[name] = DiagnosisOrder(*tire, paths, start_ns, config, key_file, part), old
    waiting, running = list(orders), set[str]()
    on_tire(0, len(orders))
    while (waiting or running) and not stop.is_set():
        pool = tasks()
        while waiting and len(running) < max(pool.places(), 1):
            name = waiting.pop(0)
            running.add(name)
            pool.submit(name, diagnose_tire, orders[name][0], TireOutcome)
        event = pool.wait(_POLL_S)
        if event is None:
            continue
        running.discard(event.token)
        order, old = orders[event.token]
        outcome, name = event.outcome, event.token
        if outcome is None:  # a fault of the workers, not of the tire: the next run tries it again
            outcome, name = _write_failure(order, event.ended or Reason(FleetCode.WORKER_ENDED)), f"{name}.again"
        dataset.replace_files(DIAGNOSES, [(order.part, order.vehicle, order.start_ns, f"{name}.parquet")], old)
        counts.made += not outcome.failure
        counts.add((order.vehicle, order.position, order.sensor_id), outcome)
        on_tire(len(orders) - len(waiting) - len(running), len(orders))
    if running:
        tasks().cancel()
    return counts


def diagnose_tire(order: DiagnosisOrder, _: Callable[[int], None] = lambda _: None) -> TireOutcome:
    """Diagnose one tire in a worker and write its part; return what became of it.

    Raises:
        OutputError: the dataset cannot be written.
        MemoryError: the worker has no memory left.
    """
    try:
        diagnosis = diagnose_agreeing(order.paths, order.position, vehicle=order.config, key_file=order.key_file)
    except (OutputError, MemoryError):
        raise
    except TreadlinkError as error:
        return _write_failure(order, Reason(DiagnosisCode.RECORDING_NOT_USED, message=str(error)))
    except Exception as error:  # a fault of treadlink at one tire must not stop the others
        failed = Reason(FleetCode.ESTIMATION_FAILED, kind=type(error).__name__, message=str(error)[:500])
        return _write_failure(order, failed)
    document = json.dumps(diagnosis_json(diagnosis), ensure_ascii=False, allow_nan=False)
    common = {
        **_head(order, diagnosis.recordings),
        "left_out": storable(json.dumps([as_json(reason) for reason in diagnosis.left_out], ensure_ascii=False)),
        "held_out_before_mps2": diagnosis.held_out.rms_before_mps2,
        "held_out_after_mps2": diagnosis.held_out.rms_after_mps2,
        "noise_floor_mps2": diagnosis.noise_floor_mps2,
        "unexplained": len(diagnosis.unexplained),
    }
    with PartFile(order.part, DIAGNOSIS_COLUMNS, DIAGNOSES) as part:
        for number, finding in enumerate(diagnosis.findings):
            parameters = {
                name: {"value": fitted.value, "std": fitted.std, "unit": fitted.unit}
                for name, fitted in finding.parameters.items()
            }
            part.row(
                {
                    **common,
                    "effect": finding.name,
                    "verdict": str(finding.verdict),
                    "parameters": json.dumps(plain(parameters), ensure_ascii=False),
                    "reason": joined([finding.reason]) if finding.reason is not None else None,
                    "rms_mps2": finding.rms_mps2,
                    "diagnosis": document if number == 0 else None,
                }
            )
        if not diagnosis.findings:
            part.row({**common, "diagnosis": document})
    return TireOutcome(left_out=tuple(map(text, diagnosis.left_out)))


def _head(order: DiagnosisOrder, used: Sequence[str]) -> dict[str, Any]:
    recordings = [storable(path) for path in used]
    return {
        "position": order.position,
        "sensor_id": order.sensor_id,
        "recordings": json.dumps(recordings, ensure_ascii=False),
        "first_utc": order.start_ns,
        "version": __version__,
    }


def outcome_in(path: Path) -> TireOutcome | None:
    """Return what the file of a tire states, None where it cannot be read."""
    rows = read_rows(path, ("code", "text", "left_out"))
    if not rows:
        return None
    row = rows[0]
    if row["code"]:
        return TireOutcome(str(row["text"]))
    return TireOutcome(left_out=tuple(str(reason["text"]) for reason in json.loads(row["left_out"] or "[]")))


def _write_failure(order: DiagnosisOrder, reason: Reason) -> TireOutcome:
    with PartFile(order.part, DIAGNOSIS_COLUMNS, DIAGNOSES) as part:
        recordings = [str(path) for path in order.paths]
        part.row({**_head(order, recordings), "code": str(reason.code), "text": text(reason)})
    return TireOutcome(text(reason))


def _tires(root: Path, recording_ids: Collection[str]) -> dict[tuple[str, str, str], list[dict[str, Any]]]:
    """Return the rows of the given recordings by (vehicle, position, sensor)."""
    tires: dict[tuple[str, str, str], list[dict[str, Any]]] = defaultdict(list)
    for vehicle, row in _recording_rows(root):
        if row["recording_id"] in recording_ids and row["revolutions_valid"]:
            tires[vehicle, str(row["position"]), str(row["sensor_id"] or "")].append(row)
    return tires


def _recording_rows(root: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the rows of all recordings; the campaign has read those of the given ones, and made them readable."""
    for path in sorted((root / RECORDINGS).glob("*/*/*.parquet")):
        vehicle = unquote(path.parent.parent.name.removeprefix("vehicle="))
        rows = read_rows(path, _COLUMNS) if Key.of_name(path.name) is not None else None
        for row in rows or ():
            yield vehicle, row


def _chosen(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return recordings spread evenly over the speeds of all, in the order of time."""
    by_speed = sorted(rows, key=lambda row: (row["speed_mean_mps"] or 0.0, row["recording_id"]))
    if len(by_speed) > MOST_RECORDINGS:
        last = len(by_speed) - 1
        by_speed = [by_speed[round(index * last / (MOST_RECORDINGS - 1))] for index in range(MOST_RECORDINGS)]
    return sorted(by_speed, key=lambda row: (row["start_utc"], row["recording_id"]))
