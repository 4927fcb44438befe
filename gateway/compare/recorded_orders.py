"""Orders and average of the wheels of a recording."""

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from gateway.compare.order_statistics import OrderAccumulator
from gateway.compare.views.wheel_orders import WheelOrders
from gateway.core.config.vehicle import shown_units_of
from gateway.core.errors import RecordingError
from gateway.core.estimates.results import RevolutionResult
from gateway.core.reasons import Reason
from gateway.core.recording.recorded_file import open_recorded_file
from gateway.core.session.recording_pass import open_recording
from gateway.core.shown_units import ShownUnits
from gateway.exporting.mean_revolution import MeanOfRevolutions
from gateway.exporting.recorded_signals import revolutions


@dataclass(slots=True)
class _Wheel:
    radius_m: float
    orders: OrderAccumulator
    mean: MeanOfRevolutions = field(default_factory=MeanOfRevolutions)
    rejected: int = 0

    def add(self, result: RevolutionResult) -> None:
        revolution = result.revolution
        if revolution.faults:
            self.rejected += 1
            return
        self.orders.add(
            revolution.index,
            revolution.axes_mps2,
            revolution.omega_radps,
            revolution.order_max,
            follows=revolution.follows,
        )
        self.mean.add(revolution)


class RecordedOrders(NamedTuple):
    """Orders of a recording.

    Attributes:
        wheels: each with a usable revolution.
        damage: what of the recording was unreadable, None without any.
        start_ns: start of the recording by the computer's clock; None where it is not known.
        units: that screens show.
    """

    wheels: tuple[WheelOrders, ...]
    damage: Reason | None
    start_ns: int | None = None
    units: ShownUnits = ShownUnits.SI


def recorded_orders(
    path: Path,
    *,
    wheels: Sequence[str] = (),
    speed_step_mps: float,
    config_path: Path | None = None,
    effects_paths: Sequence[Path] = (),
    key_file: Path | None = None,
    on_progress: Callable[[float], None] = lambda _: None,
) -> RecordedOrders:
    """Return the orders of every wheel that has a usable revolution; memory use does not depend on the length.

    Args:
        path: recording or dump of a link.
        wheels: positions; all when empty.
        speed_step_mps: width of the ranges of speed.
        config_path: vehicle configuration; None for the one in the recording.
        effects_paths: known effects to subtract.
        key_file: sensor signing keys; None for the default file.
        on_progress: called with the share of the file that is read.

    Raises:
        RecordingError: the file cannot be read, or no wheel has a usable revolution.
        ConfigError: the configuration or the effects cannot be read.
    """
    file = open_recorded_file(path)
    recording = open_recording(
        file,
        config_path,
        effects_paths=effects_paths,
        key_file=key_file,
        on_position=lambda position: on_progress(position / max(file.info.size_bytes, 1)),
    )
    vehicle = recording.vehicle
    by_position: dict[str, _Wheel] = {}
    for result in revolutions(recording, wheels=tuple(wheels) or None):
        wheel = by_position.get(result.position)
        if wheel is None:
            radius_m = result.conditions.radius_m
            wheel = by_position[result.position] = _Wheel(radius_m, OrderAccumulator(speed_step_mps / radius_m))
        wheel.add(result)
    orders = []
    doubts = recording.effects_doubts()
    for position, wheel in by_position.items():
        statistics, mean = wheel.orders.statistics(), wheel.mean.mean()
        if statistics is not None and mean is not None:
            of_wheel = tuple(notice.reason for notice in doubts if notice.subject == position)
            orders.append(WheelOrders(position, wheel.radius_m, statistics, mean, wheel.rejected, of_wheel))
    missing = [position for position in wheels if position not in by_position]
    if missing or not orders:
        wheels_text = f" of wheel {', '.join(missing)}" if missing else ""
        raise RecordingError(
            f"'{path}' has no usable revolution{wheels_text}",
            f"`treadlink estimate {shlex.quote(str(path))}` lists the reasons.",
        )
    order = {wheel.position: index for index, wheel in enumerate(vehicle.wheel if vehicle is not None else ())}
    return RecordedOrders(
        tuple(sorted(orders, key=lambda wheel_orders: order.get(wheel_orders.wheel, len(order)))),
        file.damage,
        file.info.start_ns,
        shown_units_of(vehicle),
    )
