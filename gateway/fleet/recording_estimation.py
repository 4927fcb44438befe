"""Estimation of one recording of a campaign by a worker process: from the file to the rows of the dataset."""

import sys
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple, Self

import numpy as np

from gateway import __version__
from gateway.core.config.vehicle import VehicleConfig, shown_units_of
from gateway.core.errors import ConfigError, OutputError, RecordingError, TreadlinkError
from gateway.core.estimates.registry import make_estimator
from gateway.core.estimates.result_block import ResultBlock, blocks_of
from gateway.core.estimates.results import RevolutionResult, WheelSnapshot
from gateway.core.estimates.wheel_setup import CorrectionTable
from gateway.core.feature import Registry
from gateway.core.plugins import installed
from gateway.core.quantity_catalogue import given_by
from gateway.core.reasons import Code, Reason
from gateway.core.recording.file_content import FileContent
from gateway.core.recording.reader import REPAIR_REMEDY, RecordingReader
from gateway.core.recording.run_description import RunDescription, TireIdentity
from gateway.core.revolutions.order_spectrum import order_coefficients
from gateway.core.session.corrections import check_effects
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass, open_recording
from gateway.core.session.wheel_identity import configured, configured_tire
from gateway.core.storable_text import storable
from gateway.core.table_columns import (
    RECORDING_HEAD,
    RECORDING_TAIL,
    RESULT_HEAD,
    RESULT_TAIL,
    Column,
    recording_columns,
    revolution_columns,
)
from gateway.core.text.numbers import distinct_name
from gateway.core.text.result_columns import as_objects, estimate_cells, result_columns, texts
from gateway.core.text.result_table import alarm_fields
from gateway.core.text.table_sinks import Cell
from gateway.core.text.wheel_rows import WheelRow, json_cell
from gateway.core.text.wording import as_json
from gateway.core.wheels.reasons import WheelCode
from gateway.diagnosis.effects_file import effects_text
from gateway.diagnosis.provenance import Quantity, is_assumed
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.fleet.content_keys import settings_key
from gateway.fleet.parquet_parts import PartFile
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.structure_trend import FIRST_ORDER, LAST_ORDER

AVERAGE_ORDERS: Final = Column(
    "average_orders", "cosines and sines of the radial average over R Omega^2, from the contact centre, as JSON", str
)
REVOLUTIONS: Final = "revolutions"
RECORDINGS: Final = "recordings"

_NS: Final = 1_000_000_000
_FALSE_STATEMENT: Final = "false statement"
_OTHER_EFFECTS: Final = "effects of another tire"


class RowsKept(StrEnum):
    """Revolutions that the dataset keeps."""

    SECOND = "second"
    """The last one of each second and wheel."""
    ALL = "all"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class EstimationSettings:
    """Settings that all recordings of a campaign share.

    Attributes:
        estimators: names.
        columns: names of the estimates that have columns.
        rows: revolutions that are kept.
        vehicle: configuration for all recordings; None to use the one in each recording.
        effects: known effects to subtract.
        key_file: keys of signed frames; None for the user's.
        code: version of the estimators that the campaign expects of its workers.
    """

    estimators: tuple[str, ...]
    columns: tuple[str, ...]
    rows: RowsKept = RowsKept.SECOND
    vehicle: VehicleConfig | None = None
    effects: tuple[CorrectionTable, ...] = ()
    key_file: Path | None = None
    code: str = ""

    @property
    def key(self) -> str:
        """Identity of all that decides about the rows of a given content."""
        return settings_key(
            {
                "estimators": self.estimators,
                "rows": self.rows,
                "vehicle": None if self.vehicle is None else self.vehicle.to_toml(),
                "effects": [effects_text(table) for table in self.effects],
                "code": self.code,
                "plugins": [
                    [plugin.name, plugin.package, plugin.version]
                    for plugin in installed(Registry.ESTIMATORS)
                    if plugin.name in self.estimators
                ],
            }
        )


def estimate_names(estimators: Sequence[str]) -> tuple[str, ...]:
    """Return the names of all estimates that estimators can give, as in tables; they do not depend on the data.

    Some estimates come only with a lateral axis, others only where the configuration states plies or a calibration.

    Raises:
        ConfigError: no estimator of a name.
        PluginError: it is a plug-in that cannot be used.
    """
    conditions = {*RECORDING_HEAD, *RECORDING_TAIL, *RESULT_HEAD, *RESULT_TAIL}
    for estimator in estimators:
        make_estimator(estimator)  # a plug-in declares its quantities when it is loaded
    return tuple(distinct_name(name, conditions) for name in given_by(estimators))


@dataclass(frozen=True, slots=True)
class EstimationOrder:
    """Order to estimate one recording.

    Attributes:
        content: the file.
        settings: of the campaign.
        folder: for the finished parts, in the dataset.
        token: beginning of their names.
    """

    content: FileContent
    settings: EstimationSettings
    folder: Path
    token: str


@dataclass(frozen=True, slots=True)
class Failure:
    """A recording without rows.

    Attributes:
        reason: why.
        remedy: what to do about it.
        is_final: whether the file or the settings must change before another try can succeed.
        attempts: times that it was tried.
    """

    reason: Reason
    remedy: str = ""
    is_final: bool = True
    attempts: int = 1


@dataclass(frozen=True, slots=True)
class Estimated:
    """What a worker made of a recording.

    Attributes:
        vehicle: name, empty when unknown.
        start_ns: start of the recording, by the time that its clock was set to later.
        parts: file of each table.
        rows: rows of each table.
        wheels: (position, sensor id) of each wheel with revolutions.
        revolutions: of all wheels.
        damage: what of the file could not be read.
        failure: why there are no rows; None when there are.
        peak_bytes: largest memory of the worker process so far, 0 when not known.
    """

    vehicle: str = ""
    start_ns: int = 0
    parts: dict[str, Path] = field(default_factory=dict)
    rows: dict[str, int] = field(default_factory=dict)
    wheels: tuple[tuple[str, str], ...] = ()
    revolutions: int = 0
    damage: Reason | None = None
    failure: Failure | None = None
    peak_bytes: int = 0


def estimate_recording(order: EstimationOrder, on_bytes: Callable[[int], None] | None = None) -> Estimated:
    """Estimate one recording and write its parts into the order's folder.

    Args:
        order: recording, settings and place.
        on_bytes: called with the bytes of the file read so far.

    Returns:
        the parts, or the failure of the recording.

    Raises:
        OutputError: the dataset cannot be written, which concerns all recordings.
        MemoryError: the worker has no memory left.
    """
    try:
        return _estimate(order, on_bytes or (lambda _: None))
    except (OutputError, MemoryError):
        raise
    except RecordingError as error:
        return _failed(DiagnosisCode.RECORDING_NOT_READ, str(error), error.remedy, final=order.content.is_unchanged())
    except TreadlinkError as error:
        return _failed(DiagnosisCode.RECORDING_NOT_USED, str(error), error.remedy, final=isinstance(error, ConfigError))
    except OSError as error:
        return _failed(DiagnosisCode.RECORDING_NOT_READ, error.strerror or str(error), final=False)
    except Exception as error:  # a fault of treadlink in one recording must not stop the others
        reason = Reason(FleetCode.ESTIMATION_FAILED, kind=type(error).__name__, message=str(error)[:500])
        return Estimated(failure=Failure(reason), peak_bytes=_peak_bytes())


def _failed(code: Code, message: str, remedy: str = "", *, final: bool) -> Estimated:
    return Estimated(failure=Failure(Reason(code, message=message), remedy, is_final=final), peak_bytes=_peak_bytes())


class _Collector:
    """Takes the results of a recording and keeps the rows of its revolutions."""

    def __init__(self, order: EstimationOrder) -> None:
        self.wheels: dict[str, WheelRow] = {}
        self.revolutions: PartFile | None = None
        self._order = order
        self._last_results: dict[str, RevolutionResult] = {}

    def block(self, block: ResultBlock) -> None:
        row = self.wheels.get(block.position)
        if row is None:
            row = self.wheels[block.position] = WheelRow()
        for result in block.results:
            row.add(result)
        kept_rows = self._order.settings.rows
        if kept_rows is RowsKept.ALL:
            self._write(block)
        elif kept_rows is RowsKept.SECOND:
            previous = self._last_results.get(block.position)
            results = [previous, *block.results] if previous is not None else block.results
            thinned = [before for before, after in pairwise(results) if before.host_ns // _NS != after.host_ns // _NS]
            for last_block in blocks_of(thinned):
                self._write(last_block)
            self._last_results[block.position] = results[-1]

    def finish(self) -> None:
        for block in blocks_of(self._last_results.values()):
            self._write(block)
        self._last_results.clear()
        if self.revolutions is not None:
            self.revolutions.close()

    def discard(self) -> None:
        if self.revolutions is not None:
            self.revolutions.discard()

    def _write(self, block: ResultBlock) -> None:
        order = self._order
        names = order.settings.columns
        if self.revolutions is None:
            path = order.folder / f"{order.token}.{REVOLUTIONS}.parquet"
            self.revolutions = PartFile(path, revolution_columns(names), REVOLUTIONS, many_rows=True)
        fixed, named = result_columns(block, order.content.path.name)
        late = {name: parts for name, parts in named.items() if name not in names}
        self.revolutions.block(
            {
                **fixed,
                **estimate_cells({name: parts for name, parts in named.items() if name in names}),
                "recording_id": texts([order.content.recording_id] * len(block)),
                "other_estimates": as_objects(late, len(block)),
            },
            len(block),
        )


def _estimate(order: EstimationOrder, on_bytes: Callable[[int], None]) -> Estimated:
    settings = order.settings
    reader = RecordingReader(order.content.path)
    recording = open_recording(reader, settings.vehicle, key_file=settings.key_file, on_position=on_bytes)
    vehicle = recording.vehicle
    # Vehicles of a fleet differ in their wheels. Without a configuration there is none to compare with: refused.
    effects = tuple(table for table in settings.effects if vehicle is None or configured(vehicle, table.position))
    check_effects(effects, vehicle)
    recording = replace(recording, effects=effects)
    collected = _Collector(order)
    estimation = RecordingPass(recording, settings.estimators)
    try:
        for block in estimation.blocks():
            collected.block(block)
        collected.finish()
    except BaseException:
        collected.discard()
        raise
    if not order.content.is_unchanged():
        return Estimated(failure=Failure(Reason(FleetCode.RECORDING_CHANGED), is_final=False), peak_bytes=_peak_bytes())
    if not any(counted.frames for counted in estimation.links.values()):
        notice = estimation.missing()[0]
        if reader.damage is not None:
            return _nothing_readable(reader.damage, notice.reason)
        final = notice.reason.code is SessionCode.NO_FRAME_RECEIVED
        return Estimated(failure=Failure(notice.reason, is_final=final), peak_bytes=_peak_bytes())
    if reader.damage is not None and not _senders(collected, estimation):
        return _nothing_readable(reader.damage, Reason(WheelCode.NO_SAMPLES))
    return _recording_rows(order, recording, collected, estimation)


def _nothing_readable(damage: Reason, cause: Reason) -> Estimated:
    """Return the failure of a damaged recording whose readable part gives no row."""
    reason = Reason(FleetCode.RECORDING_NOTHING_READABLE, damage=damage, why=cause)
    return Estimated(failure=Failure(reason, REPAIR_REMEDY), damage=damage, peak_bytes=_peak_bytes())


def _senders(collected: _Collector, estimation: RecordingPass) -> list[str]:
    """Return the wheels that sent samples; one that is configured and sent none has no row, but an alarm."""
    senders = [state.position for state in estimation.wheels if state.counters.samples]
    return list(dict.fromkeys([*collected.wheels, *senders]))


def _recording_rows(
    order: EstimationOrder, recording: OpenedRecording, collected: _Collector, estimation: RecordingPass
) -> Estimated:
    """Write the rows of the recording's wheels and return what was made."""
    names, content = order.settings.columns, order.content
    info, vehicle, damage = recording.file.info, recording.vehicle, recording.file.damage
    times = _Times.of(estimation, info.start_ns)
    states = {state.position: state for state in estimation.wheels}
    positions, alarms, counters = _senders(collected, estimation), estimation.alarms(), estimation.links.values()
    of_links = [alarm for alarm in alarms if alarm.position not in positions]
    sensors = {position: _sensor_ids(estimation, position) for position in positions}
    path = order.folder / f"{order.token}.{RECORDINGS}.parquet"
    run = info.described_run()
    columns = {**recording_columns(names), AVERAGE_ORDERS.name: AVERAGE_ORDERS}
    with PartFile(path, columns, RECORDINGS) as part:
        for position in positions:
            tire = configured_tire(vehicle, position)
            wheel_alarms = [*(alarm for alarm in alarms if alarm.position == position), *of_links]
            contradictions = _false_statements(recording, estimation, position, positions)
            cells = collected.wheels.get(position, WheelRow()).cells(states.get(position), names)
            if isinstance(zero_ns := cells.get("hub_zero_utc"), int):
                cells["hub_zero_utc"] = zero_ns + times.ahead_ns
            cells |= {
                "recording_id": content.recording_id,
                "recording": storable(content.path.name),
                "path": storable(str(content.path)),
                "position": position,
                "sensor_id": sensors[position],
                "start_utc": times.start_ns,
                "begin_utc": times.first_ns,
                "end_utc": times.last_ns,
                "duration_s": (times.last_ns - times.first_ns) * 1e-9,
                "pressure_measured": estimation.sensors.measures_pressure(position),
                "frames": sum(counted.frames for counted in counters),
                "frames_lost": sum(counted.lost for counted in counters),
                "alarms": json_cell(
                    [
                        *({"position": alarm.position, **alarm_fields(alarm)} for alarm in wheel_alarms),
                        *({"position": position, "name": name, **as_json(reason)} for name, reason in contradictions),
                    ]
                ),
                "alarm_count": sum(alarm.count for alarm in wheel_alarms) + len(contradictions),
                "damage": json_cell(as_json(damage)) if damage is not None else None,
                # A belt radius that the configuration lists as assumed is not stated.
                "stated_radius_m": tire.radius_m if tire and not is_assumed(vehicle, Quantity.RADIUS) else None,
                "tire_size": tire.size if tire else None,
                "shown_units": str(shown_units_of(vehicle)),
                AVERAGE_ORDERS.name: _average_orders(states.get(position)),
                **_run_cells(run, position),
                "size_bytes": content.size_bytes,
                "version": __version__,
            }
            part.row(cells)
    parts = {RECORDINGS: path}
    rows = {RECORDINGS: part.rows}
    if collected.revolutions is not None:
        parts[REVOLUTIONS] = order.folder / f"{order.token}.{REVOLUTIONS}.parquet"
        rows[REVOLUTIONS] = collected.revolutions.rows
    return Estimated(
        vehicle=vehicle.name.strip() if vehicle is not None else "",
        start_ns=times.start_ns,
        parts=parts,
        rows=rows,
        wheels=tuple((position, sensors[position]) for position in collected.wheels),
        revolutions=sum(state.counters.revolutions for state in estimation.wheels),
        damage=damage,
        peak_bytes=_peak_bytes(),
    )


class _Times(NamedTuple):
    """Times of a recording in ns since the epoch, by the time that its clock was set to later.

    A wrong clock that was set, or that a receiver contradicts, would put the recording at a wrong place of a trend.

    Attributes:
        ahead_ns: what was added to the recorded times.
        start_ns: start of the recording.
        first_ns: first sample, 0 without any.
        last_ns: last sample, 0 without any.
    """

    ahead_ns: int
    start_ns: int
    first_ns: int
    last_ns: int

    @classmethod
    def of(cls, estimation: RecordingPass, start_ns: int | None) -> Self:
        ahead_ns = round((estimation.clock.ahead_s or 0.0) * 1e9)
        first_ns, last_ns = (0, 0)
        if estimation.span_ns is not None:
            first_ns, last_ns = (time_ns + ahead_ns for time_ns in estimation.span_ns)
        return cls(ahead_ns, start_ns + ahead_ns if start_ns else first_ns, first_ns, last_ns)


def _false_statements(
    recording: OpenedRecording, estimation: RecordingPass, position: str, positions: Collection[str]
) -> list[tuple[str, Reason]]:
    """Return the statements about a wheel that its signal contradicts, and effects that are not of its tire."""
    contradicted = (
        (_FALSE_STATEMENT, notice.reason)
        for notice in estimation.statements.contradictions()
        if _concerns(notice.subject, position, positions)
    )
    misplaced = ((_OTHER_EFFECTS, notice.reason) for notice in recording.effects_doubts() if notice.subject == position)
    return [*contradicted, *misplaced]


def _sensor_ids(estimation: RecordingPass, position: str) -> str:
    return ",".join(f"{sensor:08x}" for sensor in sorted(estimation.sensors.at(position)))


def _average_orders(wheel: WheelSnapshot | None) -> str | None:
    """Return the orders of the averaged waveform of a wheel that trends follow, None without an average."""
    if wheel is None or wheel.last is None or wheel.average_mps2 is None:
        return None
    scale_mps2 = wheel.last.conditions.radius_m * wheel.last.revolution.omega_radps**2
    orders = order_coefficients(wheel.average_mps2)[FIRST_ORDER : LAST_ORDER + 1] / scale_mps2
    parts = np.stack([orders.real, -orders.imag], axis=1).ravel()
    return json_cell([float(f"{part:.3e}") for part in parts]) if np.isfinite(parts).all() else None


def _run_cells(run: RunDescription, position: str) -> dict[str, Cell]:
    """Return the cells of a run's description for the wheel at `position`."""
    tire = run.tires.get(position, TireIdentity())
    texts = {
        "test": run.test,
        "driver": run.driver,
        "comment": run.comment,
        "tags": json_cell(list(run.tags)),
        "tire_maker": tire.maker,
        "tire_dot": tire.dot,
    }
    return {
        **{name: storable(text) if text else None for name, text in texts.items()},
        "tire_wear_m": tire.wear_m,
        "tire_run_in_m": tire.run_in_m,
    }


def _concerns(subject: str, position: str, positions: Collection[str]) -> bool:
    """Return whether a notice, whose subject is `FL`, `hub 0` or `LINK, FL`, is about a wheel or all wheels."""
    name = subject.rpartition(", ")[2]
    return name == position or name not in positions


def _peak_bytes() -> int:
    if sys.platform == "win32":
        return 0
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
