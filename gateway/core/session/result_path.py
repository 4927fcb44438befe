"""The path from decoded frames to results: of a session, whose frames come one read at a time, and of a recording."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.frame_blocks import FrameBlock
from gateway.core.config.vehicle import UNKNOWN_WHEEL, VehicleConfig
from gateway.core.estimates.results import RevolutionResult
from gateway.core.estimates.wheel_setup import CorrectionTable
from gateway.core.links.source import VehicleData
from gateway.core.reasons import Notice
from gateway.core.session.alarm_watch import AlarmWatch
from gateway.core.session.corrections import with_effects
from gateway.core.session.session_parts import VehicleSignals, open_shared_turn, open_tire_sensors
from gateway.core.session.statement_watch import StatementWatch
from gateway.core.session.wheel_identity import positions
from gateway.core.trust.wheel_pairs import WheelPairs
from gateway.core.wheels.outside_readings import OutsideReading
from gateway.core.wheels.wheels import Pipeline


class ResultPath(Pipeline):
    """The wheels of one vehicle, with what compares them and what watches them.

    Attributes:
        statements: of the hubs, to be compared with what they send.
        pairs: of wheels.
    """

    def __init__(
        self,
        vehicle: VehicleConfig | None,
        effects: Sequence[CorrectionTable],
        estimators: Sequence[str],
        hold_s: float,
        signals: VehicleSignals | None,
    ) -> None:
        """Make the wheels of a vehicle; signals are None where they are of no interest, the rest as for `Pipeline`."""
        setups = with_effects(vehicle.wheel_setups() if vehicle is not None else (), effects)
        super().__init__(setups, UNKNOWN_WHEEL, estimators, hold_s)
        self.statements = StatementWatch(positions(vehicle), self.limit)
        self.pairs = WheelPairs(signals.witness() if signals is not None else None, open_shared_turn(vehicle))
        self._alarms: AlarmWatch | None = None
        self._signals, self._tire_sensors = signals, open_tire_sensors(vehicle)

    def raise_alarms(self, alarms: AlarmWatch) -> None:
        """Let alarms take the frames and results that come."""
        self._alarms = alarms

    def watched(
        self, link: str, block: FrameBlock, arrivals_ns: NDArray[np.int64], report: Callable[[list[Notice]], None]
    ) -> list[RevolutionResult]:
        """Take frames of a link with their arrivals, (frames,), 0 where unknown; `report` takes notices of alarms."""
        if self._alarms is not None:
            report(self._alarms.frames(link, block, arrivals_ns))
        # A dump has no arrival times.
        return self.compared(self.take(link, block, arrivals_ns if arrivals_ns.any() else None))

    def compared(self, results: list[RevolutionResult]) -> list[RevolutionResult]:
        """Return results of wheels with what the vehicle's signals, other wheels and alarms say of them."""
        compared = self.pairs.compared(results)
        return [result for result, _ in compared] if self._alarms is None else self._alarms.results(compared)

    def vehicle(self, item: VehicleData) -> tuple[dict[str, float], list[tuple[str, OutsideReading]]]:
        """Take data of the vehicle; return the values of its signals, and the readings of wheels."""
        readings = list(self._tire_sensors.take(item))
        for position, reading in readings:
            self.outside(position, reading)
        return self._signals.take(item) if self._signals is not None else {}, readings

    def notices_of_receivers(self) -> list[Notice]:
        """Return what is to be said of receivers since the last call."""
        parts = (self._signals, self._tire_sensors) if self._signals is not None else (self._tire_sensors,)
        return [Notice(link, reason) for part in parts for link, reason in part.take_notices()]
