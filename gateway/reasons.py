"""Why something is as it is, as a value: a code with its numbers. `gateway.views.wording` turns it into text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

Value: TypeAlias = "float | str | Reason | tuple[Value, ...]"


class Code(StrEnum):
    """What a reason says. The text of each code, with the values it needs, is in `gateway.views.wording`.

    Codes appear in JSON output and recordings: a code may be added, but not renamed without an entry in the changelog.
    """

    # Revolutions
    CONTACT_HAS_NO_SLOPE = "contact_has_no_slope"
    CONTACT_IN_NOISE = "contact_in_noise"
    CONTACT_INTERPOLATED = "contact_interpolated"
    NO_CONTACT = "no_contact"
    RADIAL_CLIPPED = "radial_clipped"
    RADIAL_SATURATED = "radial_saturated"
    SAMPLES_LOST = "samples_lost"
    EFFECTS_OUTSIDE_LOADS = "effects_outside_loads"
    EFFECTS_OUTSIDE_PRESSURES = "effects_outside_pressures"
    EFFECTS_OUTSIDE_SPEEDS = "effects_outside_speeds"
    EFFECTS_OF_OTHER_SENSOR = "effects_of_other_sensor"

    # Estimates
    # - of any estimator
    AC_COUPLED = "ac_coupled"
    AVERAGE_ERRORS_UNKNOWN = "average_errors_unknown"
    AXIS_MISSING = "axis_missing"
    AXIS_NOT_FINITE = "axis_not_finite"
    EDGE_ERRORS_UNKNOWN = "edge_errors_unknown"
    EFFECTS_NOT_SUBTRACTED = "effects_not_subtracted"
    NEEDS_LOAD = "needs_load"
    NEEDS_PRESSURE = "needs_pressure"
    NO_CONTACT_EDGES = "no_contact_edges"
    NO_STEADY_VALUE = "no_steady_value"
    NOT_SETTLED = "not_settled"
    REVOLUTION_NOT_USED = "revolution_not_used"
    SAMPLES_LOST_SHARE = "samples_lost_share"
    SPEED_OR_RADIUS_UNKNOWN = "speed_or_radius_unknown"
    TOO_FEW_ORDERS = "too_few_orders"
    # - of the tire's four numbers
    BENDING_LIKE_SHEAR = "bending_like_shear"
    CORRELATED = "correlated"
    FIT_AT_ZERO = "fit_at_zero"
    FIT_NOT_CONVERGED = "fit_not_converged"
    LINEAR_RING = "linear_ring"
    LINEAR_RING_TENSION = "linear_ring_tension"
    MODEL_ERROR_SHARE = "model_error_share"
    NO_BELT_SHAPE = "no_belt_shape"
    NO_FLAT_CONTACT = "no_flat_contact"
    NO_RING_EQUILIBRIUM = "no_ring_equilibrium"
    NOT_DETERMINED = "not_determined"
    ORDERS_UNUSABLE = "orders_unusable"
    RING_DOES_NOT_FIT = "ring_does_not_fit"
    # - of load and wear
    BENDING_NOT_POSITIVE = "bending_not_positive"
    FROM_BELT_WIDTH = "from_belt_width"
    FROM_CONTACT_ANGLE = "from_contact_angle"
    FROM_RATIO = "from_ratio"
    HALF_ANGLE_OUTSIDE_CALIBRATION = "half_angle_outside_calibration"
    NEEDS_ESTIMATOR = "needs_estimator"
    NEEDS_LOAD_CALIBRATION = "needs_load_calibration"
    NEEDS_REFERENCE_NUMBER = "needs_reference_number"
    NEEDS_RING_THICKNESS = "needs_ring_thickness"
    NEEDS_WEAR_VALUES = "needs_wear_values"
    NO_LOAD_FROM_BELT_WIDTH = "no_load_from_belt_width"
    NO_LOAD_FROM_CONTACT_ANGLE = "no_load_from_contact_angle"
    NUMBER_MISSING = "number_missing"
    OVER_REVOLUTIONS = "over_revolutions"
    PRESSURE_NOT_COMPENSATED = "pressure_not_compensated"
    PRESSURE_OUTSIDE_CALIBRATION = "pressure_outside_calibration"
    UNKNOWN_ESTIMATOR = "unknown_estimator"
    WORN_SINCE_CALIBRATION = "worn_since_calibration"
    # - of the lateral axis
    FROM_AXIS_MEANS = "from_axis_means"
    INCLUDES_CONICITY = "includes_conicity"
    NEEDS_BOTH_SLIPS = "needs_both_slips"
    ORDERS_USED = "orders_used"
    ROLL_NOT_CALIBRATED = "roll_not_calibrated"
    SCATTER_UNKNOWN = "scatter_unknown"
    SPEED_UNUSABLE = "speed_unusable"
    ZERO_SLIP_GIVEN = "zero_slip_given"
    ZERO_SLIP_IS_MEAN = "zero_slip_is_mean"
    ZERO_SLIP_NOT_SETTLED = "zero_slip_not_settled"
    # - of the sensor's calibration
    FLAT_CONTACT_ASSUMED = "flat_contact_assumed"
    NEEDS_TEMPERATURE_CHANGE = "needs_temperature_change"
    NEEDS_TWO_SPEEDS = "needs_two_speeds"
    NO_REVOLUTION_YET = "no_revolution_yet"
    NOT_FINITE = "not_finite"
    OTHER_OFFSET_STATED = "other_offset_stated"
    # - of what is not locked to the wheel
    AT_WHEEL_ORDER = "at_wheel_order"
    IN_BAND = "in_band"
    NEEDS_UNINTERRUPTED_ROLLING = "needs_uninterrupted_rolling"
    NO_LINE = "no_line"

    # Sensors
    AXIS_READS = "axis_reads"
    PRESSURE_FROZEN = "pressure_frozen"
    SENSOR_DEAD = "sensor_dead"
    SENSOR_FLIPPED = "sensor_flipped"
    SENSOR_LOOSE = "sensor_loose"
    SENSOR_STUCK = "sensor_stuck"
    SENSOR_TILTED = "sensor_tilted"

    # Wheels, links and alarms

    # Security

    # Files and configuration
    RECORDING_CHANNEL_UNDECLARED = "recording_channel_undeclared"
    RECORDING_CHUNK_DAMAGED = "recording_chunk_damaged"
    RECORDING_CUT_OFF = "recording_cut_off"
    RECORDING_DESCRIPTION_DAMAGED = "recording_description_damaged"
    RECORDING_RECORD_DAMAGED = "recording_record_damaged"
    RECORDING_RECORD_MISSING = "recording_record_missing"


@dataclass(frozen=True, slots=True, init=False)
class Reason:
    """A code and the values that belong to it, in SI units with the unit in the name.

    Attributes:
        code: what is said.
        values: name and value of each number, name or nested reason, in the order given.
    """

    code: Code
    values: tuple[tuple[str, Value], ...]

    def __init__(self, code: Code, **values: Value) -> None:
        object.__setattr__(self, "code", code)
        object.__setattr__(self, "values", tuple(values.items()))

    def __getitem__(self, name: str) -> Value:
        """Return one value; raises KeyError when the code has none of that name."""
        return dict(self.values)[name]

    def __iter__(self) -> Iterator[Reason]:
        """Iterate over this reason and those nested in it, outermost first."""
        yield self
        for _, value in self.values:
            for inner in value if isinstance(value, tuple) else (value,):
                if isinstance(inner, Reason):
                    yield from inner


def codes_of(reasons: Iterable[Reason]) -> tuple[Code, ...]:
    """Return the codes of reasons and of those nested in them, in order."""
    return tuple(inner.code for reason in reasons for inner in reason)
