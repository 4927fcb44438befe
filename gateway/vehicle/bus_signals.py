"""`[vehicle_signals]` of a vehicle file: signals of the vehicle's bus by their names in a DBC file."""

from typing import Final

from pydantic import Field

from gateway.core.config.validation import AddedKey, Section, above, within
from gateway.vehicle.vehicle_signals import Quantity, SignalSetup


class BusSignal(Section):
    """`[[vehicle_signals.signal]]`: one signal of the bus."""

    quantity: Quantity = Field(
        strict=False,
        description=f"what it measures: {', '.join(Quantity)}; yaw_rate is positive to the left, course to the right",
    )
    message: str = Field(min_length=1, max_length=200, description="name of its message in the DBC file")
    signal: str = Field(min_length=1, max_length=200, description="name of the signal in the message")
    wheel: str | None = Field(
        default=None, description="position of the wheel that it belongs to; required for wheel_speed"
    )
    unit: str | None = Field(
        default=None,
        description="unit of its physical value; default: that of the DBC file. km/h, m/s, rpm, rad/s, Hz, deg, rad, "
        "deg/s, bar, kPa, Pa, g, m/s^2, N, Nm, degC, %, s or 1",
    )
    factor: float = Field(
        default=1.0, description="multiplies the value, such as -1 for another sign or a scale that the DBC file lacks"
    )
    std_percent: float | None = within(
        None,
        0.01,
        50,
        "standard error of a speed or yaw rate in percent; default: 0.5 for speeds of rotation, 2 for yaw rates, 1 for "
        "others",
    )


class VehicleSignals(Section):
    """`[vehicle_signals]`: signals of the vehicle's bus, recorded and joined to the wheels' revolutions."""

    dbc: str | None = Field(
        default=None, description="DBC file, relative to this file; default: that of the source or the recording"
    )
    j1939: bool = Field(
        default=False, description="compare identifiers of 29 bits without priority and source address, as in J1939"
    )
    max_age_s: float = above(1.0, 0, 60, "a signal that was not received for longer is unknown, in s")
    signal: tuple[BusSignal, ...] = Field(
        default=(), strict=False, description="the signals, a [[vehicle_signals.signal]] table each"
    )

    def setups(self) -> tuple[SignalSetup, ...]:
        """Return the signals for the pipeline."""
        return tuple(
            SignalSetup(
                signal.quantity,
                signal.message,
                signal.signal,
                signal.wheel,
                signal.unit,
                signal.factor,
                None if signal.std_percent is None else signal.std_percent * 1e-2,
            )
            for signal in self.signal
        )


VEHICLE_SIGNALS: Final = AddedKey(
    VehicleSignals, "signals of the vehicle's bus, beside the wheels", default=VehicleSignals()
)
