"""Reasons and notices as values: a code with its numbers. `gateway.core.text.wording` turns them into text.

A template is a format string over the values of its reason. Values are in SI units; a unit after the format converts
and is printed: `{depth_m:.1f mm}` shows 0.008 as `8.0 mm`. A
format of `probability` rounds down near 1. A nested reason is replaced by its own text. `{unit: }` is
the symbol of a unit that the reason carries itself, behind a blank unless it is empty. `{name:series}` is the label of
a series of trends.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import TypeAlias

Value: TypeAlias = "float | str | Reason | tuple[Value, ...]"


class Code(Enum):
    """Meaning of a reason, declared with the template of its text. The code itself is the name in lower case.

    Codes appear in JSON output and recordings: a code may be added, but not renamed without an entry in the changelog.

    Attributes:
        text_template: text with the values it needs. Only `gateway.core.text.wording` fills it.
    """

    text_template: str

    def __new__(cls, text_template: str) -> Code:  # noqa: D102
        code = object.__new__(cls)
        # Members are equal where their values are, but two codes may have the same template.
        code._value_ = len(cls.__members__)
        code.text_template = text_template
        return code

    def __str__(self) -> str:
        return self.name.lower()

    def __lt__(self, other: Code) -> bool:
        return str(self) < str(other)

    # Revolutions
    CONTACT_HAS_NO_SLOPE = "the contact edges have no clear slope"
    CONTACT_IN_NOISE = "the contact does not stand out of the noise"
    CONTACT_INTERPOLATED = (
        "a contact was lost on the link or disturbed by an impact; it was placed between its neighbours"
    )
    CONTACT_NOT_SEEN = "samples were lost in a contact: its edges are those of an earlier one"
    NO_CONTACT = "no contact around angle 0"
    RADIAL_CLIPPED = "the radial axis is clipped below the range that the hub states"
    RADIAL_SATURATED = "the radial axis reached the end of its range"
    SAMPLES_LOST = "samples were lost on the link"
    SAMPLES_LOST_UNMARKED = "about {count:.0f} samples short: samples were lost without being marked"
    SAMPLES_REPEATED_UNMARKED = "about {count:.0f} samples too many: samples were repeated or inserted"
    SEVERAL_TURNS = (
        "it spans {turns:.0f} turns: the contacts between its two were not seen, as of a wheel without its load"
    )
    EFFECTS_OUTSIDE_LOADS = (
        "{load_n:.0f N} is outside the {low_n:.0f N} to {high_n:.0f N} at which the effects were found"
    )
    EFFECTS_OUTSIDE_PRESSURES = (
        "{pressure_pa:.0f kPa} is outside the {low_pa:.0f kPa} to {high_pa:.0f kPa} at which the effects were found"
    )
    EFFECTS_OUTSIDE_SPEEDS = (
        "{speed_mps:.0f km/h} is outside the {low_mps:.0f km/h} to {high_mps:.0f km/h} at which the effects were found"
    )
    EFFECTS_ENLARGE_ERROR = (
        "the effects make the error larger ({before_mps2:.3g} -> {after_mps2:.3g m/s²}): they are not those of this "
        "tire and sensor"
    )
    EFFECTS_OF_OTHER_OFFSET = (
        "the effects were found with the sensor {found_m:z.2f mm} below the neutral layer, but here {offset_m:z.2f mm} "
        "is in use: the effects may count the difference twice"
    )
    EFFECTS_OF_OTHER_RADIUS = (
        "the effects were found with a belt radius of {found_m:.1f mm}, but here {radius_m:.1f mm} is in use"
    )
    EFFECTS_OF_OTHER_SENSOR = "the effects were found on sensor {found_on}, but this is sensor {sensor}"
    EFFECTS_OF_OTHER_TIRE = "the effects were found on a tire {found_on}, but this is {tire}"
    EFFECTS_OF_OTHER_VEHICLE = "the effects were found on vehicle {found_on}, but this is {vehicle}"
    # - Revolutions that do not come
    ALL_FRAMES_REFUSED = "all {count} frames were rejected, because their signatures could not be verified"
    CONTACTS_NOT_ALIKE = (
        "no three contacts in a row are those of one rolling wheel (radial axis: mean {mean_mps2:.0f m/s²}, standard "
        "deviation {std_mps2:.0f m/s²})"
    )
    NO_CONTACT_IN_AC_SIGNAL = (
        "no contact with the road is seen: the AC-coupled radial axis falls by {depth_mps2:.0f m/s²}, but its rotation "
        "has a centripetal acceleration of {expected_mps2:.0f m/s²}. A sensor on the rim, or a wheel without load?"
    )
    NO_CONTACT_SEEN = (
        "no contact with the road is seen: the radial axis has a mean of {mean_mps2:.0f m/s²} and never falls below "
        "{lowest_mps2:.0f m/s²}. A sensor on the rim, or a wheel without load?"
    )
    NO_FRAME_RECEIVED = "no frame was received that can be used, so there is nothing to estimate"
    NO_REVOLUTION = "no revolution in {duration_s:.1f s} of samples: {why}"
    NO_SAMPLES = "no samples were received"
    RADIAL_AT_RANGE_END = (
        "{share:.0%} of the samples are at the end of the sensor's range, {level_mps2:.0f m/s²}: a larger range is "
        "needed"
    )
    RADIAL_IS_IN_G = (
        "the radial axis is {ratio:.3f} of the centripetal acceleration of its rotation ({level_mps2:.0f m/s²} of "
        "{expected_mps2:.0f m/s²}): its unit is g, not m/s² (a rate of {fitting_hz:.0f Hz} would fit as well)"
    )
    RADIAL_IS_IN_MPS2 = (
        "the radial axis is {ratio:.2f} times the centripetal acceleration of its rotation ({level_mps2:.0f m/s²} for "
        "{expected_mps2:.0f m/s²}): its unit is m/s², not g (a rate of {fitting_hz:.0f Hz} would fit as well)"
    )
    RADIAL_OUTWARD = "the mean of the radial axis is {mean_mps2:.0f m/s²}: it points outward, so reverse its sign"
    RADIAL_SCALE_DOES_NOT_FIT = (
        "the radial axis is {ratio:.3g} times the centripetal acceleration of its rotation ({level_mps2:.3g m/s²} for "
        "{expected_mps2:.0f m/s²}), too far for a wrong rate: the scale or the unit of the axis is wrong"
    )
    RATE_DOES_NOT_FIT = (
        "the radial axis is {ratio:.3g} times the centripetal acceleration of its rotation ({level_mps2:.0f m/s²} for "
        "{expected_mps2:.0f m/s²}): the rate is not {rate_hz:.0f Hz}; {fitting_hz:.0f Hz} would fit"
    )
    SAMPLES_INTERRUPTED = (
        "samples were lost again and again: at most {duration_s:.1f s} without a gap, {needed_s:.1f s} are needed"
    )
    SAMPLES_TOO_SHORT = "three revolutions take {needed_s:.1f s}, but the samples last {duration_s:.1f s}"
    SAMPLES_WITHOUT_HELLO = (
        "{count} blocks of samples, but no valid HELLO: without rate and scale nothing can be estimated. A hub sends a "
        "HELLO every 2 s. Restart the hub; `treadlink protocol check` says what is wrong with a HELLO"
    )
    WHEEL_STANDS = (
        "the wheel stands still: the radial axis is {mean_mps2:.1f m/s²} with a standard deviation of "
        "{std_mps2:.1f m/s²}"
    )
    WHEEL_TOO_SLOW = (
        "the wheel rolls at about {speed_mps:.0f km/h}; contacts differ from gravity at {limit_mps:.0f km/h} and more"
    )

    # Planned sensors
    PLAN_FEW_REVOLUTIONS = "{share:.0f} % of the simulated wheels gave no estimates"
    PLAN_NOISE_UNKNOWN = "the noise is not known, so that no errors are planned: state it with --sensors"
    PLAN_RANGE = "the peak of {peak_g:.0f} g exceeds the range of {range_g:.0f} g"
    PLAN_RATE = "{rate_hz:.0f} samples per second are fewer than the {least_hz:.0f} that the protocol carries"
    PLAN_RATE_UNKNOWN = "neither rate nor band is known"
    PLAN_SURVIVAL = "the peak of {peak_g:.0f} g exceeds the {survival_g:.0f} g that the part survives"

    # Plug-ins
    PLUGIN_EFFECT_TAKEN = "its name or its rank is that of {effect} of {by}, rank {rank}"
    PLUGIN_FAILED = "the plug-in failed: {error}"
    PLUGIN_FIELD_REFUSED = "the plug-in gave an estimate whose {field} cannot be used: {given}"
    PLUGIN_GAVE_NO_REASON = "the plug-in gives no reason"
    PLUGIN_LACKS_MEMBERS = "it lacks {members}"
    PLUGIN_NAME_TAKEN = "its name is taken by {by}"
    PLUGIN_NAME_DIFFERS = "it calls itself {name}"
    PLUGIN_NOT_IMPORTED = "it cannot be imported: {error}"
    PLUGIN_QUANTITY_TAKEN = "its quantity {name} is that of {by}"
    PLUGIN_WRONG_TYPE = "it is not {expected}"

    # Estimates
    # Of any estimator
    AC_COUPLED = "AC-coupled: the steady value is lost"
    AC_CORNER_NOT_STATED = "AC-coupled with a corner that is not stated, by which the lowest orders are turned"
    AVERAGE_ERRORS_UNKNOWN = "the standard errors of the average are not known"
    AXIS_MISSING = "the sensor has no {axis} axis"
    AXIS_NOT_FINITE = "the {axis} axis is not finite"
    AXIS_AGAINST_ROLLING = (
        "the {axis} axis points against the rolling direction: the tire rolls in reverse, or the sign of the axis is "
        "wrong; it is turned round here"
    )
    EDGE_ERRORS_UNKNOWN = "the standard errors of the contact edges are not known"
    EFFECTS_NOT_SUBTRACTED = "known effects were not subtracted: {why}"
    NEEDS_LOAD = "needs the load (set load_n of the wheel, or weight_kg of its axle, in the vehicle file)"
    NEEDS_PRESSURE = (
        "needs the pressure (set pressure_kpa of the tire in the vehicle file, or use a sensor that reports it)"
    )
    NO_CONTACT_EDGES = "no contact edges were found"
    NO_STEADY_VALUE = "the radial signal has no positive mean: its steady value is missing"
    NOT_SETTLED = "settling: {revolutions:.0f} of {needed:.0f} revolutions"
    REVOLUTION_NOT_USED = "this revolution was not used: {faults}"
    SIGNAL_MISSING = "it was not received lately"
    SIGNAL_OUTSIDE_RECORDING = (
        "its values are {away_s:.2f days} {side} the recording's first revolution, as in a log of another date: "
        "{shift_s:+.0f s}, added to `offset_s` of its source, makes both begin together"
    )
    SPEED_OR_RADIUS_UNKNOWN = "the angular speed or the belt radius is not known"
    TOO_FEW_ORDERS = "only {orders:.0f} orders, {needed:.0f} are needed: the sampling is too slow for this speed"
    # Of what the signal says against what is stated
    CONTACTS_MISSED = "a contact found in one of {every:.0f} revolutions only would fit"
    AXES_SWAPPED = (
        "the lateral axis reads what the circumferential one should, and the other way round: the two are swapped"
    )
    AXIS_LATE = "the {axis} axis is {late_s:.2f ms} later than the radial one"
    AXIS_LATER_THAN_OTHERS = (
        "the {axis} axis is {late_s:.2f ms} ± {std_s:.2f ms} later behind the radial one than those of the other wheels"
    )
    COUPLING_CONTRADICTED = (
        "the steady radial value is {share:.2f} ± {std:.2f} times what the contact shows: the sensor is AC-coupled and "
        "stated as DC-coupled; state its coupling as AC"
    )
    ERROR_COVERS = "{why}; the standard error covers the difference"
    GAIN_WOULD_FIT = "a gain of {gain:.3f} would fit"
    GRAVITY_ABSENT = (
        "the {axis} axis shows {share:.2f} ± {std:.1g} of gravity as it turns: it is not connected, or not the axis "
        "along the belt"
    )
    GRAVITY_CONTRADICTED = "gravity in the radial axis gives a gain of {gain:.2f} ± {std:.2f} of the stated one"
    MAY_CHANGE_BY = "may be wrong by {effect:.1%}: {why}"
    NOT_POSSIBLE = "{quantity} is {errors:.1f} standard errors beyond what is possible"
    NOT_POSSIBLE_AT_ALL = "{quantity} is beyond what is possible"
    NO_SINGLE_CAUSE = "no single cause fits"
    NOTHING_FOLLOWS = "not determined: {why}"
    HUB_MOVES = (
        "the hub moves by {amplitude_mps2:.2g m/s²} at the wheel's frequency, or the wheel turns unevenly: the error "
        "includes it"
    )
    OFFSET_CONTRADICTED = (
        "the sensor is stated {stated_m:.1f mm} ± {stated_std_m:.1f mm} below the neutral layer, the circumferential "
        "axis gives {offset_m:.2f mm} ± {std_m:.2f mm}"
    )
    OFFSET_UNKNOWN = "offset of the sensor not known (set offset_mm of its mounting): the error includes {std_m:.0f mm}"
    RADIUS_WOULD_FIT = "a belt radius of {radius_m:.0f mm} would fit ({stated_m:.0f mm} stated)"
    RATE_WOULD_FIT = "a sampling rate of {rate_hz:.0f Hz} would fit ({stated_hz:.0f Hz} stated)"
    SCALE_BY_WIDTH = (
        "Cw is {ratio:.3f} ± {std:.3f} times that of the new tire, which knows load, pressure and belt radius together "
        "within {error:.1%}, better than they are stated"
    )
    STEADY_VALUE_CONTRADICTED = (
        "the steady radial value is {ratio:.3f} ± {std:.3f} times that of speed and belt radius: {causes}"
    )
    STEADY_VALUE_DISAGREES = (
        "the steady radial value is {ratio:.3f} ± {std:.3f} times that of speed and belt radius: the error includes "
        "{error:.1%} because the radius may not be as stated"
    )
    UNIT_IS_G = "values in g taken for m/s² would fit"
    UNIT_IS_MPS2 = "values in m/s² taken for g would fit"
    VEHICLE_SPEED_CONTRADICTED = (
        "the speed of the car is {ratio:.3f} ± {std:.3f} times that of belt radius and rotation: {causes}"
    )
    WHEEL_SPEED_CONTRADICTED = (
        "the car's wheel turns {ratio:.3f} ± {std:.3f} times as fast as the contacts in the signal say: {causes}"
    )
    WIDTH_CONTRADICTED = (
        "Cw is {ratio:.3f} ± {std:.3f} times that of the new tire, and wear does not change it: load, pressure or belt "
        "radius are not as stated"
    )
    WIDTH_DISAGREES = (
        "Cw is {ratio:.3f} ± {std:.3f} times that of the new tire: the error includes {error:.1%} because load, "
        "pressure or belt radius may not be as stated"
    )
    ZERO_CONTRADICTED = (
        "several speeds give a zero-g offset of {zero_mps2:.1f m/s²} ± {std_mps2:.1f m/s²}, "
        "{stated_std_mps2:.1f m/s²} is its stated error"
    )
    ZERO_WOULD_FIT = "a zero-g offset of {zero_mps2:.0f m/s²} would fit"
    # Of the tire's four numbers
    BENDING_LIKE_SHEAR = "bending and shear of the belt cannot be separated here (correlation {correlation:+.2f})"
    CORRELATED = "correlated {correlation:+.2f} with {number}"
    FIT_AT_ZERO = "not determined: the fit puts {number} at zero"
    FIT_NOT_CONVERGED = "the fit has not converged"
    LINEAR_RING = "linear ring: its model error is in the standard error"
    LINEAR_RING_TENSION = "linear ring: the belt's loss of tension in the contact is in the standard error"
    MODEL_ERROR_SHARE = "{share:.0%} of the variance is model error"
    NO_BELT_SHAPE = "the radial signal does not describe a belt"
    NO_FLAT_CONTACT = "no flat contact at angle 0: its curvature is {curvature:.2f} of the mean, the limit {limit:.2f}"
    NO_RING_EQUILIBRIUM = "no ring in equilibrium reproduces this waveform"
    NOT_DETERMINED = "not determined: the standard error is {relative_error:times} the value"
    ORDERS_UNUSABLE = "the orders of the average are flat or not finite"
    RING_DOES_NOT_FIT = (
        "the ring does not describe these orders: the residual is {residual:.0%} of the signal, the limit {limit:.0%}"
    )
    # Of distance
    DISTANCE_BRIDGED = (
        "{duration_s:.1f s} without revolutions bridged at the mean speed: {distance_m:.1f m} ± {std_m:.1f m}"
    )
    DISTANCE_INTERRUPTED = "the hub restarted {count:.0f} times; what was rolled meanwhile is missing"
    # Of forces
    ASYMMETRY_NOT_BALANCED = (
        "the balance of a belt leaves {share:.0%} of the signal's asymmetry, the limit {limit:.0%}: a stone, water or "
        "waves make it"
    )
    BEYOND_FRICTION = (
        "no friction carries {force:.1f} times the load as force and {torque:.1f} times load and radius as torque"
    )
    FORCE_NOT_DETERMINED = (
        "not determined: the standard error is {share:.1%} of the load, the limit {limit:.0%} or a third of the force"
    )
    FRICTION_OF_LONGITUDINAL_ONLY = "of the longitudinal force only: the side force is not known"
    NEEDS_SIDE_FORCE_CALIBRATION = (
        "needs the tire's side force calibration ([tire.side_force_calibration] in the vehicle file;"
        " run: treadlink calibrate side-force)"
    )
    SLIP_LIMIT_NOT_DETERMINED = (
        "not determined: the side force acts {trail_m:.1f mm} ± {std_m:.1f mm} behind the contact centre; the shape of"
        " the contact pressure, which is not known, leaves {low:.0%} to {high:.0%}"
    )
    SLIP_NOT_LATERAL = "the longitudinal force is {ratio:.1f} times the side force, so the slip is not lateral"
    TIRE_GIVES_ENERGY = (
        "the tire would not lose energy but give {share:.1%} ± {std:.1%} of the load: run-out, or something else that "
        "turns with it, looks like a force"
    )
    # Of load and wear
    BENDING_NOT_POSITIVE = "the bending stiffness is not positive"
    CORRECTED_FOR_BENDING = "corrected for a bending stiffness {change:+.0%} from that of the calibration"
    CORRECTED_FOR_WEAR = "corrected for {wear_m:.1f mm} of wear since the calibration"
    FROM_BELT_WIDTH = "from the belt width"
    FROM_CONTACT_ANGLE = "from contact angle and pressure"
    FROM_RATIO = "from {ratio}, because the load is not known"
    HALF_ANGLE_OUTSIDE_CALIBRATION = (
        "the contact half angle {half_angle_rad:.1f deg} is outside the calibrated {low_rad:.1f deg} to "
        "{high_rad:.1f deg}"
    )
    LOAD_CONTRADICTED = "contradicts the stated load, {stated_n:.0f N} ± {stated_std_n:.0f N}"
    LOADS_DISAGREE = (
        "loads by contact angle, {angle_n:.0f N}, and by belt width, {width_n:.0f N}, disagree: the error includes it"
    )
    NEEDS_ESTIMATOR = "needs the estimator {estimator}, which made the reference numbers"
    NEEDS_LOAD_CALIBRATION = "needs tire.load_calibration in the vehicle file (treadlink calibrate)"
    NEEDS_REFERENCE_NUMBER = "needs {number} of the new tire, tire.reference in the vehicle file (treadlink calibrate)"
    NEEDS_RING_THICKNESS = "needs ring_thickness_mm of the tire in the vehicle file"
    NEEDS_WEAR_VALUES = "needs {revolutions:.0f} revolutions with valid wear (one in {spacing:.0f} is used)"
    NO_LOAD_FROM_BELT_WIDTH = "not from the belt width: {why}"
    NO_LOAD_FROM_CONTACT_ANGLE = "not from the contact angle: {why}"
    NUMBER_MISSING = "the estimator {estimator} does not give {number}"
    OVER_REVOLUTIONS = "over {revolutions:.0f} revolutions"
    PRESSURE_OLD = "rests on a pressure that is {age_s:.0f s} old"
    PRESSURE_NOT_COMPENSATED = "pressure not compensated"
    PRESSURE_OUTSIDE_CALIBRATION = (
        "the pressure {pressure_pa:.0f kPa} is outside the calibrated {low_pa:.0f kPa} to {high_pa:.0f kPa}"
    )
    SIDE_FORCE_PRESSURE_UNKNOWN = (
        "the pressure of the side force calibration, or that of the tire, is not known: calibrate again, or state "
        "pressure_min_kpa and pressure_max_kpa of its runs"
    )
    TEMPERATURE_NOT_COMPENSATED = "temperature not compensated, its error assumes a difference of {difference_k:.0f K}"
    UNKNOWN_ESTIMATOR = "tire.reference names '{estimator}', which is not an estimator"
    WEAR_CONTRADICTED = "contradicts the stated wear of {stated_m:.1f mm} ± {stated_std_m:.1f mm}"
    WEAR_UNKNOWN = "wear since the calibration is not known: an error of {relative_error:.0%} is included"
    WEARS_DISAGREE = "wear by Bs, {number_m:.1f mm}, and by Bs/Cw, {ratio_m:.1f mm}, disagree: the error includes it"
    # Of the lateral axis
    CONICITY_NOT_SEPARATED = "conicity cannot be separated from ply steer and noise here"
    FROM_AXIS_MEANS = "from the means of the lateral and the radial axis"
    FROM_LAMINATE = "from tire.laminate: B16 / A66 = {length_m:.2f mm} ± {length_std_m:.2f mm}, belt kept from twisting"
    INCLUDES_CONICITY = "ply steer plus conicity"
    LAMINATE_DIFFERS = (
        "differs from the measured peak, {measured_rad:.3f deg} ± {measured_std_rad:.3f deg}, by {errors:.1f} standard "
        "errors: cord angles, order of the plies, conicity, slip, or a belt that twists"
    )
    LAMINATE_NOT_BALANCED = (
        "the plies are not at opposite angles (A16 / A66 = {share:.2f}): tension shears the belt as well (Eq. 11)"
    )
    LATERAL_SIGN_UNVERIFIED = "the sign is not verified (state lateral_is_left of the mounting)"
    LATERAL_ZERO_CONTRADICTED = (
        "contradicts the stated accuracy of the sensor's zero, {stated_std_mps2:.1f m/s²}; a degree of camber is "
        "0.17 m/s²"
    )
    LATERAL_ZERO_NOT_SEPARATED = "needs two speeds: roll tilt and zero-g offset are not separated yet"
    LATERAL_SLIP_APART = (
        "slips to the other side than {other} in {opposite:.0f} revolutions and to the same side in {same:.0f}: the "
        "lateral axis of one of them points the other way, or their positions are not as stated"
    )
    WHEELS_ROLL_APART = (
        "rolls {ratio:.3f} ± {std:.3f} times as fast as {other}, more than in a curve: the belt radius or the sampling "
        "rate of one of them is not as stated"
    )
    NEEDS_BOTH_SLIPS = "needs {needed:.0f} revolutions each at left and at right slip"
    ORDERS_USED = "orders {first:.0f} to {last:.0f}"
    ROLL_CONTRADICTED = (
        "contradicts the stated roll, {stated_rad:.1f deg} ± {stated_std_rad:.1f deg} (mounting.roll_deg); the "
        "measured one is used"
    )
    ROLL_NOT_CALIBRATED = (
        "AC-coupled: the roll tilt of the sensor cannot be calibrated; the error includes {assumed_rad:.0f deg}"
    )
    ROLL_UNLIKELY = (
        "the means of the axes give a roll of {roll_rad:.1f deg}, {expected_rad:.1f deg} ± {expected_std_rad:.1f deg} "
        "is expected: a rolled sensor (state mounting.roll_deg) or a wrong zero of the lateral axis (record two speeds)"
    )
    SCATTER_UNKNOWN = "the scatter is not known before {needed:.0f} revolutions"
    SIGN_NOT_DETERMINED = "the sign is not determined: {errors:.1f} standard errors from zero"
    SIGN_WITHOUT_ERROR = "the sign is not determined: the standard error is not known yet"
    SLIP_BEYOND_LAW = "beyond the slip angles that the slip calibration describes"
    SLIP_OUTSIDE_CALIBRATION = (
        "the slip angle {slip_rad:.2f deg} is outside the calibrated {low_rad:.2f deg} to {high_rad:.2f deg}"
    )
    SPEED_UNUSABLE = "the speed is not known or too high for the sampling"
    ZERO_SLIP_GIVEN = "zero slip from tire.slip_calibration"
    ZERO_SLIP_IS_MEAN = (
        "zero slip is the mean of the latest revolutions, so constant slip is not seen; it needs tire.slip_calibration "
        "(treadlink calibrate slip)"
    )
    ZERO_SLIP_NOT_SETTLED = "zero slip is settling: {revolutions:.0f} of {needed:.0f} revolutions"
    # Of the sensor's calibration
    FLAT_CONTACT_ASSUMED = "AC-coupled: from the contact, assumed to be flat (flat road)"
    NEEDS_TEMPERATURE_CHANGE = "needs a change of temperature"
    NEEDS_TWO_SPEEDS = "needs two speeds: {quantity} and zero-g offset are not separated yet"
    NO_REVOLUTION_YET = "no revolution yet"
    NOT_FINITE = "the result is not finite"
    OTHER_OFFSET_STATED = "the vehicle file states {stated_m:.1f mm}"
    # Of what is not locked to the wheel
    AT_WHEEL_ORDER = "at order {order:.0f} of the wheel: may be locked to it"
    IN_BAND = "{low_hz:.0f Hz} to {high_hz:.0f Hz}, sensor noise included"
    NEEDS_UNINTERRUPTED_ROLLING = "needs {duration_s:.0f s} of uninterrupted rolling"
    NO_LINE = "no line stands out"

    # Of the road
    CAVITY_CONTRADICTED = (
        "the inner liner reads {measured_degc:.0f} °C, but the cavity resonates as air of {found_degc:.0f} °C would: "
        "another gas ({ratio:.2f} times gamma / M of air), cavity_length_mm or the temperature is wrong, or "
        "it is another line"
    )
    NEEDS_CAVITY_LENGTH = "needs cavity_length_mm or a size with the rim of the tire in the vehicle file"
    NEEDS_REVOLUTIONS = "needs {needed:.0f} revolutions, {count:.0f} so far"
    NEEDS_TEMPERATURE = "needs the temperature"
    ROAD_BELOW_NOISE = "not determined beside the jitter of the contact edges: class {letter} or better"
    ROAD_CLASS = "class {letter} with a probability of {probability:.0%}, if G falls with n²"
    ROAD_WAVES = "from waves of {short_m:.1f m} to {long_m:.1f m}"
    TOO_SLOW_FOR_ROAD = "needs at least {limit_mps:.0f km/h}"

    # Sensors
    AXIS_READS = "{axis} at {counts:.0f}"
    PRESSURE_FROZEN = (
        "the pressure has not changed while the temperature changed by {temperature_change_k:.0f} K; it may be "
        "off by {error_pa:.0f kPa}"
    )
    SENSOR_AC_CORNER = (
        "AC coupling: the tolerance of its corner, {ratio:.2f} of the wheel's frequency, moves the numbers"
    )
    SENSOR_BAND = "the band ends at {ratio:.0f} times the wheel's frequency, which biases length and Bs"
    SENSOR_DEAD = "every axis reads 0: the sensor is dead or its element has no supply"
    SENSOR_FLIPPED = "the radial axis points outward; its sign is corrected here"
    SENSOR_LOOSE = (
        "rings at {frequency_hz:.0f Hz} after every contact with {share:.0%} of the steady value: the sensor "
        "may have come loose; do not trust contact lengths and tire numbers"
    )
    SENSOR_STEPS = "steps of {step_mps2:.2g m/s²} are more than twice the noise, which biases the numbers"
    SENSOR_STUCK = "does not move by one count for {duration_s:.0f s}: {axes} counts"
    SENSORS_SHARE_NUMBER = "the sensors {first} and {second} send under the number of one wheel: give each its own"
    SENSOR_TILTED = (
        "the {axis} axis carries the steady value of the radial axis: tilted by {tilt_rad:.0f deg}, or the axes "
        "are swapped"
    )

    # Wheels, links and alarms
    # - Alarms as events
    ALARM_CLEARED = "alarm over at {at_s:.1f s}, after {duration_s:.1f s}: {what}"
    ALARM_COMES_AND_GOES = (
        "ALARM at {at_s:.1f s}: {alarm}. It comes and goes: it is reported again after a minute without change"
    )
    ALARM_RAISED = "ALARM at {at_s:.1f s}: {alarm}"
    ALARM_STANDS = "ALARM still at {at_s:.1f s}: {alarm}"
    # - Thresholds
    BATTERY_BELOW_LIMIT = "battery at {level:.0f %}, below {limit:.0f %}"
    BATTERY_NOW = "battery at {level:.0f %}"
    FRAME_LOSS_ABOVE_LIMIT = "{share:.2f %} of the latest frames lost, above {limit:.2f %}"
    FRAME_LOSS_NOW = "{share:.2f %} of the latest frames lost"
    LINK_DOWN = "link is down: {state}"
    LOAD_ABOVE_LIMIT = "load {load_n:.0f N} is above {limit_n:.0f N}"
    LOAD_NOW = "load {load_n:.0f N}"
    PRESSURE_ABOVE_LIMIT = "pressure {pressure_pa:.0f kPa} is above {limit_pa:.0f kPa}"
    PRESSURE_BELOW_LIMIT = "pressure {pressure_pa:.0f kPa} is below {limit_pa:.0f kPa}"
    PRESSURE_NOW = "pressure {pressure_pa:.0f kPa}"
    SENSOR_RANGE_REACHED = "{count} samples at the end of the sensor's range"
    SPEED_ABOVE_LIMIT = "speed {speed_mps:.0f km/h} is above {limit_mps:.0f km/h}"
    SPEED_NOW = "speed {speed_mps:.0f km/h}"
    TEMPERATURE_ABOVE_LIMIT = "inner liner at {temperature_degc:.0f degC}, above {limit_degc:.0f degC}"
    TEMPERATURE_NOW = "inner liner at {temperature_degc:.0f degC}"
    WEAR_ABOVE_LIMIT = "wear {wear_m:.1f mm} is above {limit_m:.1f mm}"
    WEAR_NOW = "wear {wear_m:.1f mm}"
    # - Silence
    AXIS_SILENT = (
        "the {axis} axis is silent for {silence_s:.0f s}, though the hello declares it: samples without it are not used"
    )
    BUS_NOT_MAPPED = (
        "no signal of this bus is mapped: its frames are recorded, but nothing is shown or compared (list the signals "
        "in [vehicle_signals] of the vehicle file)"
    )
    BUS_SILENT = "no frame of the vehicle's bus for {silence_s:.0f s}. Ignition off, cable loose, or bus off?"
    ENVIRONMENT_SILENT = "no pressure or temperature for {silence_s:.0f s}: the last values are that old"
    HUB_OF_WHEEL_SILENT = "no frame of its hub for {silence_s:.0f s}"
    HUB_SILENT = "no frame for {silence_s:.0f s} (wheels: {wheels}). Battery empty, out of range, or stopped?"
    POSITION_MISSING = (
        "the receiver has had no position for {silence_s:.0f} s. In a tunnel or building, or its antenna unplugged?"
    )
    RECEIVER_SILENT = (
        "no sentence of the receiver for {silence_s:.0f} s. Unplugged, switched off, or another baud rate?"
    )
    SAMPLES_MISSING = "no samples for {silence_s:.0f s}"
    SAMPLES_SILENT = (
        "no samples for {silence_s:.0f s}, only other messages of its sensor. Stopped by a command, or a fault of its "
        "firmware?"
    )
    SENDS_AGAIN = "sends again after {away_s:.1f s}"
    SENSOR_NEVER_HEARD = (
        "nothing received from its sensor in {silence_s:.0f s}, or only what was rejected. Is it switched on, and are "
        "hub and wheel number as configured?"
    )
    SENSOR_SILENT = "its sensor is silent for {silence_s:.0f s}, its hub is not. Battery empty, out of range or broken?"
    # - Events of links and devices
    BATTERY_LEVEL = "battery {level:.0f %}"
    BLE_DEVICE = "{device}"
    COMPUTER_EVENT = "this computer"
    COMPUTER_PAUSED = (
        "it paused for {paused_s:.1f s}, and what was sent meanwhile may be lost. Overloaded, or a virtual machine "
        "that was stopped?"
    )
    COMPUTER_SUSPENDED = "it was suspended for {suspended_s:.1f s}; what was sent meanwhile is lost"
    LINK_AWAY = "back after {away_s:.1f s}"
    LINK_CONNECTED = "connected"
    LINK_DISCONNECTED = "disconnected on request"
    LINK_ENDED = "ended"
    LINK_EVENT = "{event}: {details}"
    LINK_IN_USE = "the session of process {process} has this hub too; many hubs serve one program alone"
    LINK_LOST = "connection lost"
    LINK_NOT_OPEN = "not open yet"
    LINK_RESTORED = "reconnected"
    LINK_RETRYING = "reconnecting fails"
    MARK = "mark: {text}"
    MARK_NOT_KEPT = "not kept: nothing is recorded"
    MTU = "MTU {mtu}"
    MTU_TOO_SMALL = "MTU {mtu} is less than the {needed} that frames need: expect losses"
    MTU_UNKNOWN = "MTU unknown (frames need {needed})"
    NOTIFICATIONS_DROPPED = "{count} notifications dropped because this computer is too slow"
    PORT_SHARED = "also open in {holders}, which takes a part of its bytes: quit it"
    QUOTED_TEXT = "{text}"
    SYSTEM_TIME_SLEWED = (
        "its system time was slewed by {step_s:+.1f s} within {span_s:.0f s}, as time services do. The times of this "
        "session stay those of the clock at its start: {ahead_s:+.1f s} makes them those of the new time, as "
        "`treadlink set-clock` does"
    )
    SYSTEM_TIME_SET = (
        "its system time jumped by {step_s:+.1f s}. The times of this session stay those of the clock at its start: "
        "{ahead_s:+.1f s} makes them those of the new time, as `treadlink set-clock` does"
    )
    RECEIVER_TIME = (
        "the time of the receiver is {ahead_s:+.1f} s from that of this computer, whose times the recording has: "
        "`treadlink set-clock FILE` makes a copy with those of the receiver"
    )
    LOG_STEPS_BACK = "times that step back in the log: {count:.0f}; its lines are out of order, or twice in it"
    BUS_MESSAGE_TWICE = (
        "message {message} comes from two buses: {first} and {second}. Only that of {first} is decoded; `channel` of "
        "the source chooses one, as in can:drive.blf?channel=1"
    )
    SENTENCES_UNREAD = (
        "its position, speed and time are not read: that needs the package 'pynmeagps' (pip install 'treadlink[nmea]')"
    )
    RETRY_INTERVAL = "trying again every {interval_s:g s} or sooner"
    # - Live outputs
    SINK_CLOSED = "finished"
    SINK_CONNECTED = "publishing"
    SINK_CONNECTING = "connecting"
    SINK_DOWN = "nothing is published, {waiting} items wait: {state}"
    SINK_DROPS = "items are dropped, {dropped} so far: {state}"
    SINK_ENDED = "the reader has closed its end"
    SINK_FAULT = "internal error: {error}"
    SINK_FULL = "the receiver is slower than the session"
    SINK_LOST = "{error}; trying again every {interval_s:g s} or sooner"
    SINK_REFUSED = "the receiver refuses items: {error}"
    SINK_STALLED = "the receiver takes nothing"
    # - Health of links
    FIRMWARE_TOO_NEW = (
        "the firmware uses protocol {major}.x and treadlink {own}.x, so no frame can be read. Update treadlink"
    )
    FIRMWARE_TOO_OLD = (
        "the firmware uses protocol {major}.x and treadlink {own}.x, so no frame can be read. Update the hub's firmware"
    )
    FRAMES_DAMAGED = (
        "{share:.0f %} of the frames arrive damaged and are left out. Check cable, ground, distance and baud rate"
    )
    FRAMES_RESUMED = "frames arrive now"
    FRAMES_WITH_BAD_PAYLOAD = (
        "frames with a valid checksum whose content violates the protocol are skipped: a fault of the firmware. "
        "`treadlink protocol check` names the fields"
    )
    FRAMES_WITH_UNKNOWN_FLAGS = "frames with unknown flags are skipped and counted"
    HUB_RESTARTED = "restarted (boot count {boot_count}); its counters and times start again"
    HUB_RESTARTS_REPEATEDLY = "restarts again and again. Check its supply. Further restarts are not reported"
    LINK_NO_DATA_YET = (
        "open, but no data yet. Is the hub powered, awake and set to send? Are TX and RX connected correctly?"
    )
    LINK_RESUMED = "data arrives again"
    LINK_SILENT = (
        "open, but no data for {silence_s:.0f s}. Is the hub powered, awake and set to send? Are TX and RX "
        "connected correctly?"
    )
    NEWER_FRAME_LAYOUT = (
        "frames of a layout newer than protocol {own} are skipped and counted: the firmware is newer. Update treadlink"
    )
    NEWER_PROTOCOL = (
        "its firmware uses protocol {version}, newer than treadlink's {own}. What both support is read, the rest "
        "is skipped and counted. Update treadlink"
    )
    NO_FRAMES = "data arrives, but it contains no frame: {content}"
    NO_FRAMES_ANY_MORE = "data arrives, but no frame any more, after {frames} frames: {content}"
    NO_HELLO = (
        "samples arrive, but no valid HELLO for {silence_s:.0f s}: without rate and scale nothing can be estimated. A "
        "hub sends a HELLO every 2 s. Restart the hub; `treadlink protocol check` says what is wrong with a HELLO"
    )
    OLDER_PROTOCOL = (
        "its firmware uses protocol {version}, older than treadlink's {own}: it takes only unsigned commands"
    )
    # - Content of a line without frames
    CHECK_SOURCE_ADDRESS = "Check the address of the source"
    CHOOSE_HUB_PORT = "Choose the hub's port; `treadlink doctor` lists the ports"
    LINE_ALL_FRAMES_DAMAGED = (
        "frames start, but all are damaged: a bad cable or ground, an overrun, or firmware with a wrong CRC "
        "(`treadlink protocol` prints test vectors)"
    )
    LINE_CONSTANT = (
        "every byte is {byte}: the line is held at one level. Is the hub powered, and are its data wire and "
        "ground connected?"
    )
    LINE_GPS_RECEIVER = "this is a GPS receiver (NMEA text), not a hub. {remedy}"
    LINE_NOT_A_HUB = "this is not a hub. {remedy}"
    LINE_SYNC_SWAPPED = (
        "this is not a hub as it is: the two sync bytes of its frames are swapped (5A A5 instead of A5 5A). A fault"
        " of the firmware"
    )
    LINE_TEXT = "this is another device, which sends text: '{line}'. {remedy}"
    LINE_UBLOX_RECEIVER = "this is a u-blox receiver, not a hub. {remedy}"
    LINE_WRONG_BAUD_RATE = (
        "wrong baud rate, or another device on the port. Set the hub's rate, for example ?baudrate=115200; the "
        "default is {default_baud}"
    )
    # - Wheels and their sensors
    SENSOR_REPLACED = "sensor {sensor} is here, but the configuration names {expected}: a new sensor or tire?"
    SENSOR_SWAPPED = "sensor {sensor} of {owner} is here: wheels swapped? Estimates use load and tire of {position}"
    WHEEL_ADDRESS = "{position} (hub {hub}, wheel {wheel})"
    WHEEL_NOT_CONFIGURED = (
        "not configured: belt radius {radius_m:g mm} assumed, load unknown; give --config VEHICLE.toml"
    )
    WHEEL_NOT_IN_CONFIGURATION = (
        "not configured (the configuration has {configured}): belt radius {radius_m:g mm} assumed, load unknown"
    )
    # - False statements of a hub
    HELLO_AC_WITH_STEADY_VALUE = (
        "HELLO states AC coupling, but the {axis} axis has a steady value of {steady_mps2:.0f m/s²} ({count} so "
        "far): the sensor passes it. State DC coupling: without it, swapped axes and wrong signs are not seen "
        "either"
    )
    HELLO_AXES_DIFFER = (
        "samples have the axes {sent}, but HELLO states {stated}: {count} blocks are not used. A fault of the firmware"
    )
    HELLO_HIGHPASS_WITH_DC = (
        "HELLO states DC coupling and a high-pass at {highpass_hz:g Hz} ({count} so far). The high-pass is ignored; if "
        "there is one, the firmware must state AC"
    )
    HELLO_KEEPS_CHANGING = (
        "HELLO keeps changing without a restart ({count} so far): each change of sensor, rate or axes starts the wheel "
        "anew. A faulty hub, two sensors under one number, or forged frames"
    )
    HELLO_RATE_DIFFERS = (
        "HELLO states {stated_hz:g Hz}, but samples come at {measured_hz:.0f Hz} by the hub's clock ({count} "
        "so far, each over {duration_s:g s}). One of the two is wrong: a fault of the firmware"
    )
    HELLO_SCALE_ABSURD = (
        "HELLO states a full scale of {full_scale_mps2:.3g m/s²} for the {axis} axis, which no tire sensor has "
        "({count} so far). Its accelerations are wrong"
    )
    HELLO_SCALE_AGAINST_RANGE = (
        "HELLO states a range of {range_mps2:.4g m/s²} for the {axis} axis, but scale and saturation give "
        "{full_scale_mps2:.4g m/s²} ({count} so far). Its accelerations may be wrong"
    )
    HELLO_SCALE_ZERO = (
        "HELLO states a scale of 0 for {axes} ({count} so far): such an axis cannot be used. A fault of the firmware"
    )
    HELLO_SENSORS_ALTERNATE = (
        "sensors {sensor} and {other} announce themselves in turn as this wheel ({count} so far): estimates of two "
        "sensors are mixed. Give each a wheel number of its own"
    )
    HELLO_ZERO_ABSURD = (
        "HELLO states {offset_counts:.6g} counts at zero acceleration for the {axis} axis, more than a sample can have "
        "({count} so far). Its accelerations are wrong"
    )
    HUB_BOOT_COUNTS_DIFFER = (
        "its wheels state different boot counts, {own:.0f} and {other:.0f} ({count} so far): each change is taken "
        "for a restart. A fault of the firmware"
    )
    HUB_CLOCK_STILL = (
        "the hub's clock does not advance while samples arrive ({count} so far, each over {duration_s:g s}): "
        "times and the sampling rate cannot be checked. A fault of the firmware"
    )
    HUB_NUMBER_RESERVED = (
        "the hub has the number 255, which commands use for every hub ({count} HELLOs): it cannot be commanded alone"
    )
    HUB_SENDS_AS_WHEEL = (
        "the hub sends messages of a wheel under its own number, 255: {count} frames are not used. A fault of the "
        "firmware"
    )
    HUB_SENDS_COMMANDS = (
        "commands arrive from the hub ({count} frames), which only a gateway sends: is the line looped back?"
    )
    HUB_TIME_AGAINST_TICK = (
        "TIME_SYNC states {hub_us:.0f} us in a frame of tick {tick_us:.0f} us ({count} so far). A fault of the firmware"
    )
    ONLY_UNKNOWN_TYPES = (
        "sends nothing but frames of unknown types ({count} so far). Update treadlink, or check the firmware"
    )
    PRESSURE_IMPOSSIBLE = (
        "the sensor states {pressure_pa:.0f kPa} ({count} so far), which no tire has: these readings are not used"
    )
    SAMPLES_BYTES_SWAPPED = (
        "the two bytes of its samples seem to be swapped ({count} so far): the other way round, the steps from "
        "sample to sample are {ratio:.0f} times smaller. int16 is sent little endian. A fault of the firmware"
    )
    SAMPLES_REPEATED = "sends the same samples again: {count} blocks are not used. A fault of the firmware"
    SAMPLE_NUMBERS_JUMP = (
        "sample numbers jump against the hub's clock, last by {last_s:+.3g s} ({count} so far): a restart of the "
        "sensor that HELLO does not show, or a fault of the firmware. The jumps are not counted as lost"
    )
    TEMPERATURE_IMPOSSIBLE = (
        "the sensor states {temperature_degc:.0f degC} ({count} so far), which no tire has: these readings are not used"
    )
    WHEELS_REFUSED = (
        "{count} wheel numbers beyond the {most} that a session takes are not used. A faulty hub, or forged frames: "
        "configure the wheels, and sign frames"
    )
    # - Sessions and commands
    ASSUMED_NOT_MEASURED = "assumed, not measured: {text}"
    COMMAND_FAILED = "the command failed"
    COMMAND_NOT_VERIFIED = "command not signed, or signed with another key"
    COMMAND_OUTCOME = "outcome {outcome}"
    COMMAND_REFUSED = "did not execute {command}: {outcome}"
    COMMAND_REPEATED = "command repeated: its counter is not above that of an earlier one"
    COMMAND_UNKNOWN = "unknown command"
    COMMAND_VALUE_REFUSED = "value refused"
    CORE_STUCK = (
        "has not returned for {stuck_s:.0f s}: there are no results until it does, the recording goes on. Leave it "
        "out, or mend it"
    )
    CORE_GOES_ON = "has returned after {stuck_s:.0f s}"
    DECODING_BEHIND = (
        "this computer is too slow to decode and estimate. Dropped data is counted; a recording has all of it"
    )
    EFFECTS_SUBTRACTED = "subtracted from its axes at {ranges}: {effects}"
    HUB_LOG = "log ({severity}): {text}"
    HUB_LOG_LEFT_OUT = "{count} more lines of its hubs left out: at most ten a second are shown"
    LOAD_RANGE = "{low_n:.0f} to {high_n:.0f N}"
    PRESSURE_RANGE = "{low_pa:.0f kPa} to {high_pa:.0f kPa}"
    DISK_FULL_SOON = "the disk has {free_bytes:.1f MB} left and is full in {left_s:.0f min}: free some space"
    DISK_SPACE = "the disk has {free_bytes:.1f GB} left"
    DISK_TIME = "the disk has {free_bytes:.1f GB} left, which lasts {left_s:.1f h} at the present pace"
    RESULTS_LATE = (
        "results come {late_s:.0f s} late: this computer is too slow to decode and estimate. Choose fewer estimators, "
        "or record and estimate later"
    )
    RECORDING_BEHIND = "the disk is too slow: bytes are MISSING FROM THE RECORDING. Dropped data is counted"
    RECORDING_BEGUN = "recording to {path}"
    RECORDING_FINISHED = "recording {path} finished"
    RECORDING_STOPPED = "RECORDING STOPPED: {error}. {remedy}"
    RECORDING_PART_REFUSED = "{error}. The recording goes on in the present file, and tries again"
    THREAD_STOPPED = "stopped by an internal error: {error}"
    TIMES_REFUSED = (
        "frames are refused and counted, because their time is not between 1970 and 2116: that of the first is "
        "{time_s:utc}"
    )
    SPEED_RANGE = "{low_mps:.0f km/h} to {high_mps:.0f km/h}"
    TOPICS_BEHIND = (
        "the disk is too slow: decoded values are left out of the recording, raw bytes are kept. Dropped data is "
        "counted"
    )
    VIEW_BEHIND = "the screen is too slow: lines are left out. Dropped data is counted"
    # - Recordings of a campaign
    AXES_LEFT_OUT = "left out: the {axes} axes, which may not be what they are taken for"
    AXIS_CONSTANT = "the {axis} axis reads one value throughout {count} revolutions, dead or stuck: left out"
    SAMPLES_STUCK = (
        "data fault: {samples} samples ({share:.2%}) repeat the one before on every axis, in {runs} stretches of three "
        "or more, far beyond chance; check sensor, hub and link"
    )
    SAMPLES_BRIDGED = (
        "data fault: {samples} samples ({share:.2%}) are on {lines} straight lines in every axis, far beyond chance: "
        "bridged gaps, which bias the numbers. A new import of the measurement leaves them out"
    )
    DIFFERENT_SENSORS = "the recordings are of different sensors: {sensors}"
    RECORDING_DAMAGED = "{damage}. The readable part is used"
    RECORDING_ORDER_UNKNOWN = (
        "the recordings' times do not give their order: taken one after another, in the order given"
    )
    RECORDING_REPEATS = "holds the same revolutions as {other}"
    RECORDING_WITHOUT_DATA = "contains nothing that can be used"
    RECORDING_WITHOUT_WHEEL = "contains no revolution of wheel {wheel}"
    LEFT_WHEN_ENDED = (
        "the search ended with {residual_ratio:.3g} times the rms of the noise of the means unexplained: no number is "
        "determined, and nothing identified"
    )
    NUMBERS_CONTRADICT = (
        "{number} is {low:.3g} in {recording} alone and {high:.3g} in {other}, beyond their errors: tire, load or "
        "pressure is not as stated; no number is determined"
    )
    NOT_A_RING = (
        "the signal is not that of a ring: {share:.0%} of its rms is left unexplained, so no number is determined: "
        "{recordings}"
    )
    REVOLUTIONS_CLIPPED = "the radial axis is clipped in {count} of {total} revolutions"
    SENSOR_ALARM = "alarm of the sensor: {reason}"
    SENSOR_IN_DOUBT = "no number is determined where the sensor itself is in doubt: {recordings}"
    ABOUT_RECORDING = "{recording}: {reason}"
    RECORDING_LEFT_OUT = "{recording} left out: {reason}"
    SEVERAL_SENSORS = "several"
    # - Recordings of a dataset
    ESTIMATION_FAILED = "a fault of treadlink, {kind}: {message}"
    RECORDING_CHANGED = "the file changed while it was read"
    TIRE_UNIDENTIFIED = (
        "{recordings} recordings have neither a vehicle's name nor a sensor's number, and may be of several tires: set "
        "name in [vehicle]"
    )
    RECORDING_NOTHING_READABLE = "{damage}. The readable part gives nothing: {why}"
    RECORDING_NOT_READ = "{message}"
    RECORDING_NOT_USED = "{message}"
    WORKER_ENDED = "its worker process ended each time that it was tried: killed or crashed"
    WORKER_MEMORY_ABOVE_LIMIT = (
        "its worker process was ended each time that it was tried: it used more than its limit of "
        "{limit_bytes:.0f MB} of memory"
    )
    WORKER_MEMORY_FULL = "its worker process had no memory left"
    # - Provenance of conditions
    ASSUMED_LOAD = "load {load_n:.0f N} (not stated)"
    ASSUMED_OFFSET = "mounting offset 0.0 mm below the neutral layer (neither stated nor measured)"
    ASSUMED_PRESSURE = "pressure {pressure_pa:.0f kPa} (neither stated nor measured)"
    ASSUMED_RADIUS = "belt radius {radius_m:g mm} (no configuration states it)"
    ASSUMED_TEMPERATURE = "temperature steady (neither stated nor measured)"
    FROM_CONFIGURATION = "--config"
    FROM_RECORDING = "configuration recorded with it"
    FROM_SENSOR = "measured by the sensor"
    OF_RECORDINGS = "{statement}: {recordings}"
    STATED_LOAD = "load {load_n:.0f N} ({source})"
    STATED_LOAD_RANGE = "load {low_n:.0f} to {high_n:.0f N} ({source})"
    STATED_OFFSET = "mounting offset {offset_m:z.1f mm} below the neutral layer ({source})"
    STATED_PITCH = "mounting pitch {pitch_rad:g deg} ({source})"
    STATED_PRESSURE = "pressure {pressure_pa:.0f kPa} ({source})"
    STATED_PRESSURE_RANGE = "pressure {low_pa:.0f} to {high_pa:.0f kPa} ({source})"
    STATED_RADIUS = "belt radius {radius_m:g mm} ({source})"
    STATED_ROLL = "mounting roll {roll_rad:g deg} ({source})"

    # Rows of a dataset
    ROW_FEW_VALID = "valid in {count} of {of} revolutions only"
    ROW_SCATTERS = (
        "varies within the recording by far more than its standard errors; that of the mean contains the scatter"
    )

    # Trends of a dataset
    TREND_ALARMS = "alarm '{name}' in {count} of {of} recordings; the last: {why}"
    TREND_CLOCK_WRONG = (
        "left out, because the clock of the recorder was wrong: {path} says it began on {date}. Set its clock and "
        "record again"
    )
    TREND_CONTACT_CHANGED = (
        "since {date}, {name:series} is {change:+.3g}{unit: } ± {std:.2g}{unit: } from its earlier trend, by the load, "
        "the stiffness, or a pressure that is not measured: {count} recordings, {first} to {last}"
    )
    TREND_DAMAGED = "damaged: {count} of {of} recordings, whose readable part was estimated"
    TREND_DISTANCE_CONSTANT = (
        "the distance is the same in all recordings; an odometer file needs readings before and after them"
    )
    TREND_DISTANCE_SHORT = "the recordings span {distance_m:.3g km}: a rate per 1,000 km needs {needed_m:.0f km}"
    TREND_FEW_VALID = "more than half of the revolutions are not used in {count} of {of} recordings: {why}"
    TREND_FOREIGN_FILE = "left out, because it is not a file of this dataset: {path}"
    TREND_LAST_DEVIATES = "the last recording, {date}, deviates from the trend by {deviation:+.1f} standard deviations"
    TREND_LEVEL_CHANGED = (
        "since {date}, {name:series} is {change:+.3g}{unit: } ± {std:.2g}{unit: } from its earlier trend: {count} "
        "recordings, {first} to {last}"
    )
    TREND_LOAD_STATED = "as stated, not measured"
    TREND_LOAD_STEPS = "steps of the load: {count}"
    TREND_LOSES_PRESSURE = "loses {loss_pa:.1f kPa} ± {std_pa:.1g kPa} a month"
    TREND_LOSS_CHANGED = (
        "since {date}, loses {after_pa:.1f kPa} ± {after_std_pa:.1g kPa} a month; before, {before_pa:.1f kPa} ± "
        "{before_std_pa:.1g kPa}: {count} recordings, {first} to {last}"
    )
    TREND_NEWEST_LEFT = "without the last {count} recordings, which have left the trend on {date}"
    TREND_NO_REVOLUTION = "no recording has a revolution: the wheel stood still, or the sensor sent no usable signal"
    TREND_NO_VALUES = "no recording has a value: {why}"
    TREND_NOW_SINCE = "by the {count} recordings since {date}, which have left the earlier trend"
    TREND_OUTLIERS_LEFT_OUT = "outliers left out: {count}"
    TREND_PASSED = (
        "from {date} to {until}, {name:series} deviates from its trend by {deviations:.1f} standard deviations and "
        "more in {count} recordings in a row: {first} to {last}"
    )
    TREND_PRESSURE_CONSTANT = (
        "the pressure is {pressure_pa:.1f kPa} in all {count} recordings: the sensor is stuck, or too coarse to show "
        "a loss"
    )
    TREND_PRESSURE_FELL = (
        "the pressure has fallen by {fall_pa:.0f kPa} ± {std_pa:.1g kPa} in {span_s:.1f h}: {first} to {last}"
    )
    TREND_PRESSURE_NOT_MEASURED = "no sensor has sent a pressure"
    TREND_PRESSURE_STUCK = (
        "sensor: the pressure is {pressure_pa:.1f kPa} in {count} recordings from {first} to {last}, while the "
        "temperature varies: it is stuck, and left out of the trends"
    )
    TREND_PROVISIONAL = "provisional in {count} of {of} recordings: {why}"
    TREND_RATE_SINCE = "of the {count} recordings since {date}; before, it was {before:.3g}{unit: } ± {std:.2g}{unit: }"
    TREND_RECORDED_DISTANCE = (
        "over the recorded {distance_m:.0f km} only, which is less than the tire has rolled (--odometer)"
    )
    TREND_REFILLS_HIDE = (
        "refills that the scatter hides are not excluded: the loss is {low_pa:.2g kPa} to {high_pa:.2g kPa} a month"
    )
    TREND_REFILLS_OFTEN = (
        "if it is refilled {often:.0f} times a month at most: the scatter hides a loss of {hidden_pa:.0f kPa} a month "
        "that is topped up every week"
    )
    TREND_REPEATED = "recordings that repeat another and count once: {count}. {pairs}"
    TREND_REPEATS = "{path} repeats {other}"
    TREND_SENSOR_CLIPS = "sensor: {share:.1%} more of the samples at the end of its range"
    TREND_SENSOR_GAIN = "sensor: its gain has changed by {share:.1%}"
    TREND_SENSOR_LOSSES = "sensor: {share:.1%} more of the samples are lost"
    TREND_SENSOR_MOVES = "sensor: its distance from the neutral layer has changed by {change_m:.1f mm}"
    TREND_SENSOR_NOISE = "sensor: its noise has become {factor:.1f} times as large"
    TREND_SENSOR_STEADY = (
        "sensor: its steady radial value has changed by {share:.1%}: its gain by as much, or its zero by "
        "{change_mps2:.1f m/s²}. Recordings at several speeds tell which"
    )
    TREND_SENSOR_ZERO = "sensor: its zero has changed by {change_mps2:.1f m/s²}"
    TREND_SLOPE_CHANGED = (
        "since {date}, {name:series} has another trend, and is {change:+.3g}{unit: } ± {std:.2g}{unit: } from its "
        "earlier one at the end: {count} recordings, {first} to {last}"
    )
    TREND_SPAN_SHORT = (
        "the recordings span {span_s:.2g days}: a rate per month needs {needed_s:.0f days}, as what changes from hour "
        "to hour is no trend"
    )
    TREND_SPEED_WITH_TIME = "the speed changes with the time, so that the influences of the two cannot be separated"
    TREND_STATED_CALIBRATION = "the stated [tire.load_calibration] changed on {date}: no change of the load"
    TREND_STATED_LEVELS = (
        "changes of what is stated of the tire, before and after which the levels are fitted apart: {count}"
    )
    TREND_STATED_LOAD = (
        "the stated load changed on {date}, from {before_n:.0f N} to {after_n:.0f N}: no change of the tire"
    )
    TREND_STATED_RADIUS = (
        "the stated belt radius changed on {date}, from {before_m:.1f mm} to {after_m:.1f mm}: no change of the tire"
    )
    TREND_STATED_REFERENCE = "the stated [tire.reference] changed on {date}: no change of the tire"
    TREND_STATED_THICKNESS = "the stated ring_thickness_mm changed on {date}: no change of the tire"
    TREND_STEPS = "steps that are fitted and left out of the trend: {count}"
    TREND_STIFFNESS_DRIFTS = "{name} changes by {share:.2%} ± {std:.2%} a month"
    TREND_TEMPERATURE_CONSTANT = "the temperature varies too little, or is not known"
    TREND_TEMPERATURE_IMPOSSIBLE = (
        "sensor: a temperature of up to {temperature_degc:.0f} °C in {count} recordings, which no tire has; left out "
        "of the trends"
    )
    TREND_TEMPERATURE_STUCK = (
        "the temperature is {temperature_degc:.1f} °C in all {count} recordings: if the sensor is stuck, the pressure "
        "of a colder season looks like a loss"
    )
    TREND_TEMPERATURE_UNKNOWN = "no sensor has sent a temperature, which the comparison of pressures needs"
    TREND_TOO_FEW = "{count} recordings with a value, {needed} are needed"
    TREND_TIRE_MOVED = (
        "came from {origin} to {target}, first recorded there on {date}; each wheel has a trend of its own"
    )
    TREND_TIRE_UNIDENTIFIED = (
        "no vehicle's name and no sensor says that all recordings are of one tire: differences between tires would be "
        "in it"
    )
    TREND_TIRES_EXCHANGED = (
        "wheels or sensors were exchanged: sensor {sensor} came from {origin} to {target}, sensor {other} went the "
        "other way, first recorded on {date}; each wheel has a trend of its own"
    )
    TREND_TIRES_UNIDENTIFIED = (
        "NOT IDENTIFIED: {recordings} recordings have neither a vehicle's name nor a sensor's number, and may be of "
        "several vehicles. Their numbers are marked ~ and make no finding. Set name in [vehicle], and estimate again"
    )
    TREND_UNDETERMINED = "the recordings do not determine it"
    TREND_UNREADABLE_FILE = "left out, because it cannot be read: {path}"
    TREND_VEHICLE_WITHOUT_ODOMETER = (
        "the odometer file does not cover vehicle {vehicle}: its distance is the recorded one"
    )
    TREND_WEAR_CHANGED = (
        "since {date}, wears by {after_m:.3f mm} ± {after_std_m:.3f mm} in 1,000 km; before, {before_m:.3f mm} ± "
        "{before_std_m:.3f mm}: {count} recordings, {first} to {last}"
    )
    TREND_WEAR_SOFTENS = "of this, {share:.2%} ± {std:.2%} a month is the measured wear's"
    TREND_WEARS_FAST = (
        "wears by {rate_m:.3f mm} ± {std_m:.3f mm} in 1,000 km; the median of the fleet is {median_m:.3f mm}"
    )

    # Security
    COUNTERS_NOT_SAVED = "frames of this session could be replayed to the next one: {error}. {remedy}"
    COUNTERS_SAVED_LATE = (
        "frames of this session could be replayed to the next one: the counters of the sensors could not be "
        "written in time"
    )
    FRAMES_IGNORED = "ignored, but recorded"
    FRAMES_NOT_TRUSTED = "frames not to be trusted: {counts}"
    FRAMES_USED = "not refused for that (policy warn)"
    FRAMES_VERDICT = "{count} {verdict}"
    FRAME_BEFORE_HELLO = "signed frames arrive, but no verified hello ({count} so far); {consequence}"
    FRAME_EARLIER_START = (
        "{signer} sends under boot count {start}, but {latest} was accepted before ({count} frames so far): an old "
        "recording is replayed, or the hub was replaced or has lost its boot count. If the hub is yours, set its boot "
        "count above {latest}, or give a new key: treadlink keys new {identity} --replace; {consequence}"
    )
    FRAME_LATE = (
        "a frame arrived long after later ones ({count} so far): a recording of the sensor may be replayed; "
        "{consequence}"
    )
    FRAME_NO_KEY = (
        "frames are signed by {signer}, whose key is missing ({count} so far); `treadlink keys import` admits "
        "it; {consequence}"
    )
    FRAME_REPLAYED = "a frame arrived twice ({count} so far): a recording of the sensor may be replayed; {consequence}"
    FRAME_UNSIGNED = "a frame is not signed ({count} so far): anyone could have sent it; {consequence}"
    FRAME_WRONG_TAG = (
        "a signed frame has a wrong tag ({count} so far): forged, from an earlier start, or signed with another "
        "key; {consequence}"
    )
    KEY_MISSING_FRAMES_IGNORED = (
        "no key for sensor {sensor}: its frames will be ignored; add its key with `treadlink keys import`"
    )
    KEY_MISSING_FRAMES_NOT_VERIFIED = (
        "no key for sensor {sensor}: its frames cannot be verified; add its key with `treadlink keys import`"
    )
    NO_KEYS = "the policy is to verify frames, but '{file}' has no key: import keys with `treadlink keys import`"
    SENSOR_NOT_ADMITTED = (
        "sensor {sensor} is here, but the configuration names {expected} ({count} frames so far); configure it "
        "to admit it; {consequence}"
    )
    SENSOR_NOT_ADMITTED_SWAPPED = (
        "sensor {sensor} of {owner} is here: wheels swapped? ({count} frames so far); {consequence}"
    )
    SENSOR_NOT_ADMITTED_UNCONFIGURED = (
        "sensor {sensor} is at a wheel that is not configured ({count} frames so far); configure it to admit it; "
        "{consequence}"
    )
    SIGNER_AT_HUB = "{signer} at hub {hub}"
    SIGNER_HUB = "hub {identity}"
    SIGNER_SENSOR = "sensor {identity}"
    SIGNER_UNKNOWN = "an unknown sensor"

    # Bring-up of a firmware
    AXES_OUT_OF_ORDER = (
        "the {axis} axis has the steady value of a wheel that rolls, {level_mps2:.0f m/s²}, the radial one "
        "{radial_mps2:.0f m/s²}: the order is circumferential, lateral, radial"
    )
    AXIS_STANDS = "the {axis} axis sends the same count for {duration_s:.1f s} while the wheel rolls"
    BLOCKS_NOT_FULL = (
        "a block holds {samples:.0f} samples on average, {full} fit: the link carries {more:.0%} more bytes than it"
        " must"
    )
    BLOCK_COPIED = (
        "the {samples} samples from number {first} are those from number {earlier} again, noise included: a buffer was "
        "sent before it was filled"
    )
    BOOT_COUNT_GOES_BACK = (
        "the hub has restarted, and boot_count went from {before:.0f} back to {after:.0f}: it must be higher after "
        "every start"
    )
    BOOT_COUNT_STANDS = (
        "the hub has restarted, but boot_count is {after:.0f} as before: count every start, where it survives a "
        "loss of power"
    )
    BYTES_BETWEEN_FRAMES = (
        "{bytes} bytes between {frames} frames: frames are sent back to back, with nothing between them"
    )
    CHECK_AC_HAS_NO_SCALE = "the sensor is AC-coupled, so that its steady value, and the scale with it, cannot be seen"
    CHECK_AT_REST = (
        "the wheel does not roll; at rest its axes read {share:.2f} g together, where 1 g and the zero errors are "
        "expected"
    )
    CHECK_DOES_NOT_ROLL = "the wheel does not roll: roll it, or move the sensor on a turntable, at 10 m/s or more"
    CHECK_FRAMES_LOST = (
        "{lost} frames are missing by their counters ({damaged} of them beside damaged bytes), {frames} arrived"
    )
    CHECK_HUB_TAKES_NO_COMMANDS = "the hub answered no command, as one that takes none"
    CHECK_NO_COMMANDS = "no command can be sent: a file, or a source that is only read"
    CHECK_NO_COMMANDS_WANTED = "commands were left out, as asked for"
    CHECK_NO_KEY = "there is no key of {identity}: give --keys FILE"
    CHECK_NO_RADIAL_AXIS = "the sensor has no radial axis"
    CHECK_STOPPED_EARLY = "the check ended before it came to this: give it more time with --for"
    CHECK_TOO_SHORT = "{duration_s:.1f s} are too short: {needed_s:g s} are needed"
    COMMAND_ANSWERED_DAMAGED = "a command with a wrong CRC was answered: it must be dropped without an answer"
    COMMAND_ANSWER_LATE = "no answer to {command} within {waited_s:g s}, although the hub answers commands"
    COMMAND_ANSWER_NOT_OF_HUB = "COMMAND_RESULT comes from wheel {wheel}: it is sent by the hub itself (wheel 255)"
    COMMAND_OUTCOME_WRONG = "{command} was answered with outcome {outcome}; {expected} is right here"
    COMMAND_REPLY_MISMATCH = (
        "COMMAND_RESULT states command {command} and seq {seq}; the command sent was {sent}, seq {sent_seq}"
    )
    COUNTS_OFFSET_BINARY = (
        "counts jump by the whole range, and are smooth with the highest bit inverted: they are offset binary; "
        "int16 is two's complement"
    )
    CRC_ALWAYS_ZERO = "always 0"
    CRC_BIG_ENDIAN = "big endian"
    CRC_BZIP2 = "not reflected (CRC-32/BZIP2)"
    CRC_CASTAGNOLI = "CRC-32C (Castagnoli)"
    CRC_FROM_ZERO = "with the initial value 0"
    CRC_FROM_ZERO_NOT_INVERTED = "with the initial value 0 and without the final inversion"
    CRC_MPEG2 = "not reflected (CRC-32/MPEG-2)"
    CRC_NOT_INVERTED = "without the final inversion"
    CRC_OF_HEADER = "over the header only"
    CRC_OF_PAYLOAD = "over the payload only"
    CRC_OF_WORDS = "not reflected, over words (the default of an STM32's CRC unit)"
    CRC_WITHOUT_SYNC = "without the sync"
    DROPS_NOT_NUMBERED = (
        "frames_dropped rose by {dropped:.0f}, but only {missing:.0f} numbers are missing: a frame that cannot be "
        "sent must use its number"
    )
    FRAME_CRC_VARIANT = "the CRC of the frames is {how}: CRC-32 of zlib over all bytes before it, little endian"
    FRAME_CRC_WRONG = (
        "frames start, but the CRC of none is right: CRC-32 of zlib over all bytes before it, little endian "
        "(`treadlink protocol vectors`)"
    )
    FRAME_FLAGS_UNKNOWN = "flags are {flags}: only bit 0 is defined, all others are 0"
    FRAME_LENGTH_COUNTS = "length counts {how}: it is that of the payload alone"
    FRAME_TYPE_UNKNOWN = "type {type} is not defined"
    FRAME_VERSION_WRONG = "the version byte is {version}: 0x10, the version in which the layout of the frame appeared"
    FRAME_WITHOUT_TAG = "bit 0 of flags is set, but the payload has no room for a tag"
    HELLO_ABSENT_AXES_FILLED = "range, scale and zero of axes that the mask lacks should be 0: {axes}"
    HELLO_OTHER_MAJOR = "HELLO states protocol {major}.{minor}, its frame 1.0"
    LENGTH_OF_FRAME = "header, payload and CRC"
    LENGTH_WITH_CRC = "payload and CRC"
    LENGTH_WITH_HEADER = "header and payload"
    LINK_NEARLY_FULL = (
        "the samples take {needed:.0f} bytes/s, {share:.0%} of the {capacity:.0f} bytes/s that the link carries"
    )
    LOG_HAS_CONTROLS = "a log text has control characters; it should be one line"
    LOG_LEVEL_RESERVED = "log level {level} is reserved"
    LOG_NOT_UTF8 = "a log text is not UTF-8"
    LOG_TOO_OFTEN = "{lines} log texts within a second, at most 10 are allowed"
    MESSAGE_TOO_OFTEN = "{type} came {count} times in {span_s:.1f s}, {due:.0f} are due"
    MESSAGE_TOO_RARE = "{type} came {count} times in {span_s:.1f s}, {due:.0f} are due"
    PAYLOAD_LENGTH_WRONG = "the payload of {type} has {length} bytes, its layout {layout}: a C struct must be packed"
    PAYLOAD_VALUE_WRONG = "{field} of {type} is outside its range"
    RATE_NOT_EXACT = (
        "samples come at {measured_hz:.2f Hz} by the hub's clock, {share:+.2%} from the {stated_hz:g Hz} of HELLO; "
        "0.1 % is recommended"
    )
    SAMPLES_BEFORE_HELLO = "SAMPLES come before the first HELLO of the wheel"
    SAMPLES_DROPPED_BY_HUB = "the hub has dropped {holes:.0f} samples, as first_sample and HUB_STATUS say"
    SAMPLES_NOT_STARTED = "no SAMPLES within {waited_s:g s} after SET_STREAM 1 was done"
    SAMPLES_NOT_STOPPED = "SAMPLES still come {waited_s:g s} after SET_STREAM 0 was done"
    SAMPLE_NUMBERS_HOLES = (
        "first_sample leaves out {holes:.0f} samples, but no frame is missing and samples_dropped of HUB_STATUS "
        "does not rise"
    )
    SAMPLE_NUMBERS_OVERLAP = "first_sample rose by {step:.0f} after a block of {samples:.0f} samples: it counts samples"
    PRESSURE_LIKE_KPA = "pressure_pa is {pressure_pa:.0f} Pa: is it in kPa?"
    ROWS_TRANSPOSED = (
        "counts are smooth when a block is read axis by axis, {ratio:.0f} times smoother than row by row: each row has "
        "the counts of all axes at one instant"
    )
    SCALE_OFF_BY_POWER_OF_TWO = (
        "the steady radial value is {level_mps2:.0f m/s²}, {ratio:.2f} times R Omega² = {expected_mps2:.0f m/s²} (R"
        " = {radius_m:.0f mm}, --radius): is the scale wrong by a factor of 2 to the power of {power}? Check how "
        "many bits a word of the sensor has, and how they are aligned"
    )
    SEQ_BIG_ENDIAN = "seq counts in the wrong order of bytes: it is sent little endian"
    SEQ_GOES_BACK = "seq {seq:.0f} is lower than before, without a restart: it has 32 bits and does not go back"
    SEQ_JUMPS = "seq jumped over {gap:.0f} numbers to {seq:.0f}"
    SEQ_NOT_FROM_ZERO = "the first seq after the start is {seq:.0f}: it counts from 0 at every start"
    SEQ_REPEATED = "seq {seq:.0f} came again: it counts the frames of every type, and a reader drops repeated ones"
    SEQ_SHARED = "all sources share one seq: every wheel, and the hub itself, has a counter of its own"
    SEQ_STANDS = "seq is {seq:.0f} in every frame"
    SET_RATE_NOT_STATED = (
        "HELLO states {stated_hz:g Hz} still, {waited_s:g s} after SET_RATE was done: it follows at once when the "
        "rate changes"
    )
    SOME_FRAMES_DAMAGED = (
        "{damaged} times a frame was damaged, {frames} are intact: a bad cable or ground, an overrun, or a buffer "
        "that is overwritten while it is sent"
    )
    SOURCE_SIGNS_SOME_FRAMES = "some frames are signed and some are not: a source signs all of its frames or none"
    STATUS_FRAMES_SENT_WRONG = "frames_sent rose by {stated:.0f} while {arrived:.0f} frames arrived or are missing"
    STATUS_UPTIME_WRONG = "uptime_s is {uptime_s:.0f} when the clock is at {clock_s:.1f s}"
    TAG_WRONG = "the tag is not that of the key of {identity} and boot_count {boot_count}"
    TICK_GOES_BACK = (
        "tick_us went back by {back_us:.0f} to {tick_us:.0f}: it has 32 bits, is never set, and wraps every 71.6 "
        "minutes"
    )
    TICK_IN_OTHER_UNIT = (
        "tick_us counts {unit}, not us: it advanced {pace:.4g} times as far as {duration_s:.1f s} of this "
        "computer's clock"
    )
    TICK_JITTERS = (
        "tick_us of the blocks scatters over {spread_s:.1f ms} about an even rate ({std_s:.2f ms} standard "
        "deviation): take it in the sensor's interrupt"
    )
    TICK_NOT_OF_FIRST_SAMPLE = (
        "frames sent after a block have tick_us {tick_us:.0f}, before the block's last sample: tick_us of SAMPLES "
        "is that of the first sample"
    )
    TICK_PACE_WRONG = "tick_us advanced {pace:.4f} times as far as {duration_s:.1f s} of this computer's clock"
    TICK_STANDS = "tick_us is {tick_us:.0f} in two messages in a row"
    TIME_NOT_ECHOED = "host_ns of TIME_SYNC is {host_ns}, not the {sent_ns} of SET_TIME"
    # Files and configuration
    RECORDING_CHANNEL_UNDECLARED = (
        "'{recording}' has messages of the undeclared channel {channel:d}, which are skipped. `treadlink repair` may "
        "recover them"
    )
    RECORDING_CHUNK_DAMAGED = (
        "'{recording}' has a damaged chunk near byte {at_byte:d}; {skipped_bytes:d} bytes are skipped. `treadlink "
        "repair` recovers what is left of them"
    )
    RECORDING_CUT_OFF = "'{recording}' is cut off at byte {at_byte:d}, inside a record. `treadlink repair` completes it"
    RECORDING_DESCRIPTION_DAMAGED = (
        "'{recording}' has a damaged description, which contains the vehicle configuration. `treadlink repair` "
        "recovers the rest"
    )
    RECORDING_PARTS_DAMAGED = (
        "'{recording}' is damaged in {parts:d} parts, the first near byte {at_byte:d}: {unread_bytes:d} of its "
        "{size_bytes:d} bytes are not read. `treadlink repair` recovers what is left of them"
    )
    RECORDING_RECORD_DAMAGED = (
        "'{recording}' has a damaged record near byte {at_byte:d}. `treadlink repair` recovers what is left of it"
    )
    RECORDING_RECORD_MISSING = (
        "'{recording}' has no valid record at byte {at_byte:d}; the rest is not read. `treadlink repair` recovers it"
    )
    RECORDING_RECORD_TOO_LARGE = (
        "'{recording}' has {size_bytes:.1f MB} in one chunk or record at byte {at_byte:d}, which is skipped; at most "
        "{largest_bytes:.1f MB} are read at once. Check where the file comes from"
    )
    SCALE_UNLIKELY = (
        "the steady acceleration of the radial column is {found_mps2:.4g m/s²}, {ratio:.3g} times the V²/R of "
        "{expected_mps2:.4g m/s²} of its revolutions: is it in counts or volts? State `scale`, their size, in each axis"
    )
    UNIT_UNLIKELY = (
        "the radial column is stated in {stated}, but {fitting} fits: with {stated}, the steady acceleration is "
        "{found_mps2:.4g m/s²}, {ratio:.3g} times the V²/R of {expected_mps2:.4g m/s²} of a revolution of "
        "{period_s:.4g s} and a belt radius of {radius_m:.0f mm}"
    )
    SIGNAL_INTERPOLATED = (
        "{share:.0%} of the samples lie on straight lines in every axis: the signal was interpolated. Import it at the "
        "rate at which it was measured"
    )

    # Diagnosis: effects that are not identified
    IMPLAUSIBLE_PARAMETER = (
        "{parameter} would be {value:.4g}{unit: }, outside its plausible range of {low:.4g} to {high:.4g}{unit: }"
    )
    FADES_WITHIN_ONE_WAVE = "the packet at the {edge} edge fades within {waves:.2f} of a wavelength: a bump, not a wave"
    HOLLOW_ROAD = "the road would be hollow with a radius of {radius_m:.3g m}, larger than any inner drum (5 m)"
    PROBABILITY_TOO_LOW = "its probability is {probability:probability}, and {needed:.2g} is needed"
    TIME_LIMIT_SPENT = (
        "limit {limit_s:.3g s}: reading took {reading_s:.2g s}, fit and search {search_s:.2g s}; hold-out and figures "
        "came after it, {after_s:.2g s}"
    )
    RIVALS_UNTRIED = "the search ended before it had tried {effects} in its place"
    SEARCH_ENDED_EARLY = (
        "the search for effects ended at its time limit before it was complete (sets tried: {sets}; effects never "
        "tried: {untried}): others may be more probable"
    )
    EVIDENCE_TEMPERED = (
        "what is left unexplained ({axes}) has {residual_ratio:.3g} times the rms of the noise of the means; evidence "
        "from there counts less by that factor"
    )
    ERROR_BY_POSSIBLE_EFFECT = (
        "most of the error of {numbers} comes from {effect}, which the data neither show nor exclude (probability "
        "{probability:probability}); without it the error would be {ratio:.2g} times smaller"
    )
    ERROR_BY_MISSING_EFFECT = (
        "most of the error of {numbers} comes from the possible absence of {effect} (probability "
        "{probability:probability}, not identified); if it were certain the error would be {ratio:.2g} times smaller"
    )
    OTHER_OPTIMUM = (
        "{effect}: nearly as good with {parameter} {value:.4g}{unit: } in place of {best:.4g}{unit: } (probability "
        "{probability:probability}), which makes up most of its error"
    )
    PLUGIN_EFFECTS_LEFT_OUT = "effects of plug-ins ({effects}) are left out: with them the diagnosis failed: {error}"
    NOT_ON_EXACT_RING = (
        "it absorbs errors of this model's equations: on the exact ring {effect} is {errors:.1f} errors from zero"
    )
    LEAVES_MORE_THAN_WITHOUT = (
        "with it the fit leaves {with_it:.3g} times the noise of the means, without it {without:.3g} times"
    )
    SMALLER_THAN_LEFT = (
        "its {size_mps2:.2g m/s²} are less than the {left_mps2:.2g m/s²} that stay unexplained there: an equation "
        "that is off by as much makes any small effect certain"
    )
    SIZE_DIFFERS_BETWEEN_RECORDINGS = "its size would have to differ between recordings (most in {recording})"
    LEAVES_RESIDUAL_AT_EDGES = (
        "it leaves {residual_share:.0f %} of the scatter at the contact edges, so it stands in for another cause"
    )
    NOTHING_REMAINS = "nothing of it remains beside the other effects"
    ORDER_OR_FREQUENCY = (
        "the residual is {noise_floors:.1f} times the noise floor, and one speed does not distinguish an "
        "order from a fixed frequency"
    )
    BESIDE_SOMETHING_LARGER = (
        "its {own_mps2:.2f m/s²} may be part of something unknown beside it, {larger_mps2:.2f m/s²}"
    )
    FAILS_UNSEEN = (
        "with the size of the other recordings, the {axis} error of {recording} goes from {before_mps2:.3g} to "
        "{after_mps2:.3g m/s²}"
    )
    SIZES_DIFFER = (
        "it has no one size: fitted to each recording alone, its sizes differ (chi-square {chi2:.3g} of {freedom})"
    )
    UNTESTED_ELSEWHERE = "no recording of another speed, load or pressure can test it"

    # Diagnosis: deciding recordings
    RECORD_AT_SPEED = "record again at {speed_ratio:g} times the speed"
    RECORD_REVERSED = "record again rolling in the opposite direction"
    RECORD_WARMER = "record again with the tire {difference_k:g K} warmer"
    RECORD_AT_LOAD = "record again at {load_ratio:g} times the load"
    RECORD_AT_PRESSURE = "record again at {pressure_ratio:g} times the pressure"
    RECORD_AT_REST = (
        "record at rest with the axle level and the tire lifted: the lateral axis then reads the zero-g offset alone"
    )
    RECORD_ROAD_AT_ANOTHER_SPEED = "record again at another speed: road vibration grows with it, sensor noise does not"
    RECORD_ON_ANOTHER_ROAD = (
        "record again on another road or drum: a resonance of the tire keeps its frequency, vibration from a track "
        "does not"
    )
    RECORD_LIVE = "record live, with host time stamps"
    RECORD_LIVE_FOR_LONGER = "record live for longer: the hub's clock is known to {clock_std:.0f ppm} so far"
    COMPARE_CLOCK = "compare the hub's clock with one better than {host_clock:.0f ppm}"
    NO_RECORDING_DECIDES = "no other speed, load, pressure, temperature or direction tried here would decide"
    DECIDES_AGAINST = "against {effect}: {recording}"

    # Diagnosis: notes
    MEANS_NOT_COMPARED = (
        "the paper's model has no mean, so the means of the axes are not compared, and a zero-g offset or a "
        "constant gain error in them is not detected; start from --model exact to detect it"
    )
    REVOLUTIONS_LEFT_OUT = "{revolutions} revolutions left out: {reason}"
    REVOLUTION_NOT_MEASURED = "the radial axis or the sampling rate is not known"
    BEYOND_RECORDING_LIMIT = "beyond the first {limit} of a recording"
    BEYOND_GROUP_LIMIT = "beyond the first {limit} at the same speed, load, pressure and temperature"
    BETWEEN_GROUP_SPEEDS = "at speeds between those of the {groups} most informative groups"
    TOO_FEW_ALIKE = "too few at the same speed, load, pressure and temperature"
    OUTLIER_OF_GROUP = "an outlier at the same conditions, as after an impact"
    CLIPPED_UNLIKE_GROUP = "the radial axis is clipped, unlike in others at the same conditions"
    CIRCUMFERENTIAL_REVERSED = (
        "the sign of its circumferential axis is opposite to that of a rolling tire: the tire rolled backwards or was "
        "reversed on its rim, or the axis is reversed"
    )
    BASELINE_UNFITTED = "the baseline model cannot be fitted to it: its belt radius, load or pressure is not as stated"
    CONTACT_UNLIKE_OTHERS = (
        "its contact half angle is {angle_rad:.1f deg}, that of {count} others with the same stated load and pressure "
        "{other_rad:.1f deg}: its load, pressure or tire is not as stated"
    )
    CONTACTS_CONTRADICT = (
        "contact half angle {short_rad:.1f deg} in {short}, {long_rad:.1f deg} in {long}: load, pressure or tire is "
        "not as stated"
    )
    LATERAL_OPPOSITE = (
        "the lateral waveforms of {recording} and {other} are opposite: the lateral axis of one is reversed, or its "
        "sensor or tire is turned round"
    )
    LATERAL_OPPOSITE_TO_OTHERS = (
        "its lateral waveform is the opposite of that of {count} others: its lateral axis is reversed, or its sensor "
        "or tire is turned round"
    )
    LOADS_CONTRADICT = (
        "Cw, which no load changes, is {low:.4g} to {high:.4g}: a stated load or pressure is {share:.1%} off; all "
        "errors contain that"
    )
    RADIUS_UNLIKE_OTHERS = "its belt radius is stated as {radius_m:.1f mm}, that of {count} others as {other_m:.1f mm}"
    WIDTH_UNLIKE_OTHERS = (
        "Cw, which no load changes, is {value:.4g} in it and {other:.4g} in {count} others: its load or pressure is "
        "not as stated"
    )
    FEW_REVOLUTIONS = "only {revolutions} revolutions: a pattern common to all of them may still be chance"
    EDGES_ALIGNED = (
        "the contact edges of {revolutions} revolutions, held-out ones too, are aligned by up to {parameters} "
        "parameters of their own, whatever moves them; as recorded, the held-out rms is {before_mps2:.4g m/s²} before "
        "and {after_mps2:.4g m/s²} after"
    )
    ONE_SPEED = "one speed only: effects that depend on speed cannot be separated from those that do not"
    GROUPS_TOO_SHORT = (
        "no spectrum of the signal that does not repeat with the wheel: {groups} of {of} groups are too short"
    )
    NOISE_ROLLS_OFF = "the noise rolls off at about {corner_hz:.0f Hz}, as behind a low-pass filter"


@dataclass(frozen=True, slots=True, init=False)
class Reason:
    """A code and the values that belong to it, in SI units with the unit in the name.

    Attributes:
        code: its meaning.
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


class Level(StrEnum):
    """Severity of a notice."""

    INFO = "info"
    WARNING = "warning"
    SECURITY = "security"
    """A warning that an attack could explain."""
    ERROR = "error"
    """Data is being lost."""


@dataclass(frozen=True, slots=True)
class Notice:
    """Something that the user should know.

    Attributes:
        subject: name of the link, hub, wheel or file that it is about, empty for the whole session.
        reason: what happened.
        level: how much it matters.
    """

    subject: str
    reason: Reason
    level: Level = Level.INFO
