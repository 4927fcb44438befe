"""The text of every reason, in one table.

A template is a format string over the values of its reason. Values are in SI units; a unit after the format converts
and is printed: `{depth_m:.1f mm}` shows 0.008 as `8.0 mm`. A
format of `probability` rounds down near 1. A nested reason is replaced by its own text. `{unit: }` is
the symbol of a unit that the reason carries itself, behind a blank unless it is empty. `{name:series}` is the label of
a series of trends.
"""

from __future__ import annotations

import math
import string
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any, Final

from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.reasons import Code, Level, Notice, Reason, Value
from gateway.trends.watched_series import label_of
from gateway.views.probabilities import probability_text
from gateway.views.text import escaped

TEMPLATES: Final[Mapping[Code, str]] = {
    # Revolutions
    Code.CONTACT_HAS_NO_SLOPE: "the contact edges have no clear slope",
    Code.CONTACT_IN_NOISE: "the contact does not stand out of the noise",
    Code.CONTACT_INTERPOLATED: (
        "a contact was lost on the link or disturbed by an impact; it was placed between its neighbours"
    ),
    Code.NO_CONTACT: "no contact around angle 0",
    Code.RADIAL_CLIPPED: "the radial axis is clipped below the range that the hub states",
    Code.RADIAL_SATURATED: "the radial axis reached the end of its range",
    Code.SAMPLES_LOST: "samples were lost on the link",
    Code.SAMPLES_LOST_UNMARKED: "about {count:.0f} samples short: samples were lost without being marked",
    Code.SAMPLES_REPEATED_UNMARKED: "about {count:.0f} samples too many: samples were repeated or inserted",
    Code.SEVERAL_TURNS: (
        "it spans {turns:.0f} turns: the contacts between its two were not seen, as of a wheel without its load"
    ),
    Code.EFFECTS_OUTSIDE_LOADS: (
        "{load_n:.0f N} is outside the {low_n:.0f N} to {high_n:.0f N} at which the effects were found"
    ),
    Code.EFFECTS_OUTSIDE_PRESSURES: (
        "{pressure_pa:.0f kPa} is outside the {low_pa:.0f kPa} to {high_pa:.0f kPa} at which the effects were found"
    ),
    Code.EFFECTS_OUTSIDE_SPEEDS: (
        "{speed_mps:.0f km/h} is outside the {low_mps:.0f km/h} to {high_mps:.0f km/h} at which the effects were found"
    ),
    Code.EFFECTS_ENLARGE_ERROR: (
        "the effects make the error larger ({before_mps2:.3g} -> {after_mps2:.3g m/s²}): they are not those of this "
        "tire and sensor"
    ),
    Code.EFFECTS_OF_OTHER_OFFSET: (
        "the effects were found with the sensor {found_m:z.2f mm} below the neutral layer, but here {offset_m:z.2f mm} "
        "is in use: the effects may count the difference twice"
    ),
    Code.EFFECTS_OF_OTHER_RADIUS: (
        "the effects were found with a belt radius of {found_m:.1f mm}, but here {radius_m:.1f mm} is in use"
    ),
    Code.EFFECTS_OF_OTHER_TIRE: "the effects were found on a tire {found_on}, but this is {tire}",
    Code.EFFECTS_OF_OTHER_VEHICLE: "the effects were found on vehicle {found_on}, but this is {vehicle}",
    Code.EFFECTS_OF_OTHER_SENSOR: "the effects were found on sensor {found_on}, but this is sensor {sensor}",
    # - Revolutions that do not come
    Code.CONTACTS_NOT_ALIKE: (
        "no three contacts in a row are those of one rolling wheel (radial axis: mean {mean_mps2:.0f m/s²}, standard "
        "deviation {std_mps2:.0f m/s²})"
    ),
    Code.NO_CONTACT_SEEN: (
        "no contact with the road is seen: the radial axis has a mean of {mean_mps2:.0f m/s²} and never falls below "
        "{lowest_mps2:.0f m/s²}. A sensor on the rim, or a wheel without load?"
    ),
    Code.NO_CONTACT_IN_AC_SIGNAL: (
        "no contact with the road is seen: the AC-coupled radial axis falls by {depth_mps2:.0f m/s²}, but its rotation "
        "has a centripetal acceleration of {expected_mps2:.0f m/s²}. A sensor on the rim, or a wheel without load?"
    ),
    Code.ALL_FRAMES_REFUSED: "all {count} frames were rejected, because their signatures could not be verified",
    Code.NO_FRAME_RECEIVED: "no frame was received, so there is nothing to estimate",
    Code.NO_REVOLUTION: "no revolution in {duration_s:.1f s} of samples: {why}",
    Code.NO_SAMPLES: "no samples were received",
    Code.RADIAL_AT_RANGE_END: (
        "{share:.0%} of the samples are at the end of the sensor's range, {level_mps2:.0f m/s²}: a larger range is "
        "needed"
    ),
    Code.RADIAL_IS_IN_G: (
        "the radial axis is {ratio:.3f} of the centripetal acceleration of its rotation ({level_mps2:.0f m/s²} of "
        "{expected_mps2:.0f m/s²}): its unit is g, not m/s² (a rate of {fitting_hz:.0f Hz} would fit as well)"
    ),
    Code.RADIAL_IS_IN_MPS2: (
        "the radial axis is {ratio:.2f} times the centripetal acceleration of its rotation ({level_mps2:.0f m/s²} for "
        "{expected_mps2:.0f m/s²}): its unit is m/s², not g (a rate of {fitting_hz:.0f Hz} would fit as well)"
    ),
    Code.RADIAL_OUTWARD: "the mean of the radial axis is {mean_mps2:.0f m/s²}: it points outward, so reverse its sign",
    Code.RADIAL_SCALE_DOES_NOT_FIT: (
        "the radial axis is {ratio:.3g} times the centripetal acceleration of its rotation ({level_mps2:.3g m/s²} for "
        "{expected_mps2:.0f m/s²}), too far for a wrong rate: the scale or the unit of the axis is wrong"
    ),
    Code.RATE_DOES_NOT_FIT: (
        "the radial axis is {ratio:.3g} times the centripetal acceleration of its rotation ({level_mps2:.0f m/s²} for "
        "{expected_mps2:.0f m/s²}): the rate is not {rate_hz:.0f Hz}; {fitting_hz:.0f Hz} would fit"
    ),
    Code.SAMPLES_INTERRUPTED: (
        "samples were lost again and again: at most {duration_s:.1f s} without a gap, {needed_s:.1f s} are needed"
    ),
    Code.SAMPLES_TOO_SHORT: "three revolutions take {needed_s:.1f s}, but the samples last {duration_s:.1f s}",
    Code.SAMPLES_WITHOUT_HELLO: (
        "{count} blocks of samples, but no HELLO: without rate and scale nothing can be estimated. A hub sends a HELLO "
        "every 2 s. Restart the hub or update its firmware"
    ),
    Code.WHEEL_STANDS: (
        "the wheel stands still: the radial axis is {mean_mps2:.1f m/s²} with a standard deviation of "
        "{std_mps2:.1f m/s²}"
    ),
    Code.WHEEL_TOO_SLOW: (
        "the wheel rolls at about {speed_mps:.0f km/h}; contacts differ from gravity at {limit_mps:.0f km/h} and more"
    ),
    # Plug-ins
    Code.PLAN_AC_CORNER: "AC coupling: the corner is {ratio:.2f} of the wheel's frequency, which biases the numbers",
    Code.PLAN_BAND: "the band ends at {ratio:.0f} times the wheel's frequency, which biases length and Bs",
    Code.PLAN_FEW_REVOLUTIONS: "{share:.0f} % of the simulated wheels gave no estimates",
    Code.PLAN_NOISE_UNKNOWN: "the noise is not known, so that no errors are planned: state it with --sensors",
    Code.PLAN_RANGE: "the peak of {peak_g:.0f} g exceeds the range of {range_g:.0f} g",
    Code.PLAN_RATE: "{rate_hz:.0f} samples per second are fewer than the {least_hz:.0f} that the protocol carries",
    Code.PLAN_RATE_UNKNOWN: "neither rate nor band is known",
    Code.PLAN_STEPS: "steps of {step_mg:.0f} mg are more than twice the noise, which biases the numbers",
    Code.PLAN_SURVIVAL: "the peak of {peak_g:.0f} g exceeds the {survival_g:.0f} g that the part survives",
    Code.PLUGIN_EFFECT_TAKEN: "its name or its rank is that of {effect} of {by}, rank {rank}",
    Code.PLUGIN_FAILED: "the plug-in failed: {error}",
    Code.PLUGIN_FIELD_REFUSED: "the plug-in gave an estimate whose {field} cannot be used: {given}",
    Code.PLUGIN_GAVE_NO_REASON: "the plug-in gives no reason",
    Code.PLUGIN_LACKS_MEMBERS: "it lacks {members}",
    Code.PLUGIN_NAME_TAKEN: "its name is taken by {by}",
    Code.PLUGIN_NAME_DIFFERS: "it calls itself {name}",
    Code.PLUGIN_NOT_IMPORTED: "it cannot be imported: {error}",
    Code.PLUGIN_QUANTITY_TAKEN: "its quantity {name} is that of {by}",
    Code.PLUGIN_WRONG_TYPE: "it is not {expected}",
    # Estimates
    # Of any estimator
    Code.AC_COUPLED: "AC-coupled: the steady value is lost",
    Code.AVERAGE_ERRORS_UNKNOWN: "the standard errors of the average are not known",
    Code.AXIS_MISSING: "the sensor has no {axis} axis",
    Code.AXIS_NOT_FINITE: "the {axis} axis is not finite",
    Code.AXIS_AGAINST_ROLLING: (
        "the {axis} axis points against the rolling direction: the tire rolls in reverse, or the sign of the axis is "
        "wrong; it is turned round here"
    ),
    Code.EDGE_ERRORS_UNKNOWN: "the standard errors of the contact edges are not known",
    Code.EFFECTS_NOT_SUBTRACTED: "known effects were not subtracted: {why}",
    Code.NEEDS_LOAD: "needs the load (set load_n of the wheel, or weight_kg of its axle, in the vehicle file)",
    Code.NEEDS_PRESSURE: (
        "needs the pressure (set pressure_kpa of the tire in the vehicle file, or use a sensor that reports it)"
    ),
    Code.NO_CONTACT_EDGES: "no contact edges were found",
    Code.NO_STEADY_VALUE: "the radial signal has no positive mean: its steady value is missing",
    Code.NOT_SETTLED: "settling: {revolutions:.0f} of {needed:.0f} revolutions",
    Code.REVOLUTION_NOT_USED: "this revolution was not used: {faults}",
    Code.SIGNAL_MISSING: "the bus has not sent it lately",
    Code.SAMPLES_LOST_SHARE: "{share:.1%} of the samples were lost",
    Code.SPEED_OR_RADIUS_UNKNOWN: "the angular speed or the belt radius is not known",
    Code.TOO_FEW_ORDERS: "only {orders:.0f} orders, {needed:.0f} are needed: the sampling is too slow for this speed",
    # Of what the signal says against what is stated
    Code.AXES_SWAPPED: (
        "the lateral axis reads what the circumferential one should, and the other way round: the two are swapped"
    ),
    Code.AXIS_LATE: "the {axis} axis is {late_s:.2f ms} later than the radial one",
    Code.COUPLING_CONTRADICTED: (
        "the steady radial value is {share:.2f} ± {std:.2f} times what the contact shows: the sensor is AC-coupled and "
        "stated as DC-coupled; state its coupling as AC"
    ),
    Code.CONTACTS_MISSED: "a contact found in one of {every:.0f} revolutions only would fit",
    Code.ERROR_COVERS: "{why}; the standard error covers the difference",
    Code.GAIN_WOULD_FIT: "a gain of {gain:.3f} would fit",
    Code.GRAVITY_ABSENT: (
        "the {axis} axis shows {share:.2f} ± {std:.1g} of gravity as it turns: it is not connected, or not the axis "
        "along the belt"
    ),
    Code.GRAVITY_CONTRADICTED: "gravity in the radial axis gives a gain of {gain:.2f} ± {std:.2f} of the stated one",
    Code.MAY_CHANGE_BY: "may be wrong by {effect:.1%}: {why}",
    Code.NOT_POSSIBLE: "{errors:.1f} standard errors beyond what is possible",
    Code.NO_SINGLE_CAUSE: "no single cause fits",
    Code.NOTHING_FOLLOWS: "not determined: {why}",
    Code.HUB_MOVES: (
        "the hub moves by {amplitude_mps2:.2g m/s²} at the wheel's frequency, or the wheel turns unevenly: the error "
        "includes it"
    ),
    Code.OFFSET_CONTRADICTED: (
        "the sensor is stated {stated_m:.1f mm} ± {stated_std_m:.1f mm} below the neutral layer, the circumferential "
        "axis gives {offset_m:.2f mm} ± {std_m:.2f mm}"
    ),
    Code.OFFSET_UNKNOWN: (
        "offset of the sensor not known (set offset_mm of its mounting): the error includes {std_m:.0f mm}"
    ),
    Code.RADIUS_WOULD_FIT: "a belt radius of {radius_m:.0f mm} would fit ({stated_m:.0f mm} stated)",
    Code.RATE_WOULD_FIT: "a sampling rate of {rate_hz:.0f Hz} would fit ({stated_hz:.0f Hz} stated)",
    Code.SCALE_BY_WIDTH: (
        "Cw is {ratio:.3f} ± {std:.3f} times that of the new tire, which knows load, pressure and belt radius together "
        "within {error:.1%}, better than they are stated"
    ),
    Code.STEADY_VALUE_CONTRADICTED: (
        "the steady radial value is {ratio:.3f} ± {std:.3f} times that of speed and belt radius: {causes}"
    ),
    Code.STEADY_VALUE_DISAGREES: (
        "the steady radial value is {ratio:.3f} ± {std:.3f} times that of speed and belt radius: the error includes "
        "{error:.1%} because the radius may not be as stated"
    ),
    Code.UNIT_IS_G: "values in g taken for m/s² would fit",
    Code.UNIT_IS_MPS2: "values in m/s² taken for g would fit",
    Code.VEHICLE_SPEED_CONTRADICTED: (
        "the speed of the car is {ratio:.3f} ± {std:.3f} times that of belt radius and rotation: {causes}"
    ),
    Code.WHEEL_SPEED_CONTRADICTED: (
        "the car's wheel turns {ratio:.3f} ± {std:.3f} times as fast as the contacts in the signal say: {causes}"
    ),
    Code.WIDTH_CONTRADICTED: (
        "Cw is {ratio:.3g} ± {std:.1g} times that of the new tire, and wear does not change it: load, pressure or belt "
        "radius are not as stated"
    ),
    Code.WIDTH_DISAGREES: (
        "Cw is {ratio:.3f} ± {std:.3f} times that of the new tire: the error includes {error:.1%} because load, "
        "pressure or belt radius may not be as stated"
    ),
    Code.ZERO_CONTRADICTED: (
        "several speeds give a zero-g offset of {zero_mps2:.1f m/s²} ± {std_mps2:.1f m/s²}, "
        "{stated_std_mps2:.1f m/s²} is its stated error"
    ),
    Code.ZERO_WOULD_FIT: "a zero-g offset of {zero_mps2:.0f m/s²} would fit",
    # Of the tire's four numbers
    Code.BENDING_LIKE_SHEAR: "bending and shear of the belt cannot be separated here (correlation {correlation:+.2f})",
    Code.CORRELATED: "correlated {correlation:+.2f} with {number}",
    Code.FIT_AT_ZERO: "not determined: the fit puts {number} at zero",
    Code.FIT_NOT_CONVERGED: "the fit has not converged",
    Code.LINEAR_RING: "linear ring: its model error is in the standard error",
    Code.LINEAR_RING_TENSION: "linear ring: the belt's loss of tension in the contact is in the standard error",
    Code.MODEL_ERROR_SHARE: "{share:.0%} of the variance is model error",
    Code.NO_BELT_SHAPE: "the radial signal does not describe a belt",
    Code.NO_FLAT_CONTACT: (
        "no flat contact at angle 0: its curvature is {curvature:.2f} of the mean, the limit {limit:.2f}"
    ),
    Code.NO_RING_EQUILIBRIUM: "no ring in equilibrium reproduces this waveform",
    Code.NOT_DETERMINED: "not determined: the standard error is {relative_error:times} the value",
    Code.ORDERS_UNUSABLE: "the orders of the average are flat or not finite",
    Code.RING_DOES_NOT_FIT: (
        "the ring does not describe these orders: the residual is {residual:.0%} of the signal, the limit {limit:.0%}"
    ),
    # Of distance
    Code.DISTANCE_BRIDGED: (
        "{duration_s:.1f s} without revolutions bridged at the mean speed: {distance_m:.1f m} ± {std_m:.1f m}"
    ),
    Code.DISTANCE_INTERRUPTED: "the hub restarted {count:.0f} times; what was rolled meanwhile is missing",
    # Of forces
    Code.FORCE_NOT_DETERMINED: (
        "not determined: the standard error is {share:.1%} of the load, the limit {limit:.0%} or a third of the force"
    ),
    Code.FRICTION_OF_LONGITUDINAL_ONLY: "of the longitudinal force only: the side force is not known",
    Code.NEEDS_SIDE_FORCE_CALIBRATION: (
        "needs the tire's side force calibration ([tire.side_force_calibration] in the vehicle file;"
        " run: treadlink calibrate side-force)"
    ),
    Code.SLIP_LIMIT_NOT_DETERMINED: (
        "not determined: the side force acts {trail_m:.1f mm} ± {std_m:.1f mm} behind the contact centre; the shape of"
        " the contact pressure, which is not known, leaves {low:.0%} to {high:.0%}"
    ),
    Code.SLIP_NOT_LATERAL: "the longitudinal force is {ratio:.1f} times the side force, so the slip is not lateral",
    # Of load and wear
    Code.BENDING_NOT_POSITIVE: "the bending stiffness is not positive",
    Code.CORRECTED_FOR_BENDING: "corrected for a bending stiffness {change:+.0%} from that of the calibration",
    Code.CORRECTED_FOR_WEAR: "corrected for {wear_m:.1f mm} of wear since the calibration",
    Code.FROM_BELT_WIDTH: "from the belt width",
    Code.FROM_CONTACT_ANGLE: "from contact angle and pressure",
    Code.FROM_RATIO: "from {ratio}, because the load is not known",
    Code.HALF_ANGLE_OUTSIDE_CALIBRATION: (
        "the contact half angle {half_angle_rad:.1f deg} is outside the calibrated {low_rad:.1f deg} to "
        "{high_rad:.1f deg}"
    ),
    Code.LOAD_CONTRADICTED: "contradicts the stated load, {stated_n:.0f N} ± {stated_std_n:.0f N}",
    Code.LOADS_DISAGREE: (
        "loads by contact angle, {angle_n:.0f N}, and by belt width, {width_n:.0f N}, disagree: the error includes it"
    ),
    Code.NEEDS_ESTIMATOR: "needs the estimator {estimator}, which made the reference numbers",
    Code.NEEDS_LOAD_CALIBRATION: "needs tire.load_calibration in the vehicle file (treadlink calibrate)",
    Code.NEEDS_REFERENCE_NUMBER: (
        "needs {number} of the new tire, tire.reference in the vehicle file (treadlink calibrate)"
    ),
    Code.NEEDS_RING_THICKNESS: "needs ring_thickness_mm of the tire in the vehicle file",
    Code.NEEDS_WEAR_VALUES: ("needs {revolutions:.0f} revolutions with valid wear (one in {spacing:.0f} is used)"),
    Code.NO_LOAD_FROM_BELT_WIDTH: "not from the belt width: {why}",
    Code.NO_LOAD_FROM_CONTACT_ANGLE: "not from the contact angle: {why}",
    Code.NUMBER_MISSING: "the estimator {estimator} does not give {number}",
    Code.OVER_REVOLUTIONS: "over {revolutions:.0f} revolutions",
    Code.PRESSURE_OLD: "rests on a pressure that is {age_s:.0f s} old",
    Code.PRESSURE_NOT_COMPENSATED: "pressure not compensated",
    Code.PRESSURE_OUTSIDE_CALIBRATION: (
        "the pressure {pressure_pa:.0f kPa} is outside the calibrated {low_pa:.0f kPa} to {high_pa:.0f kPa}"
    ),
    Code.TEMPERATURE_NOT_COMPENSATED: (
        "temperature not compensated, its error assumes a difference of {difference_k:.0f K}"
    ),
    Code.UNKNOWN_ESTIMATOR: "tire.reference names '{estimator}', which is not an estimator",
    Code.WEAR_CONTRADICTED: "contradicts the stated wear of {stated_m:.1f mm} ± {stated_std_m:.1f mm}",
    Code.WEAR_UNKNOWN: "wear since the calibration is not known: an error of {relative_error:.0%} is included",
    Code.WEARS_DISAGREE: (
        "wear by Bs, {number_m:.1f mm}, and by Bs/Cw, {ratio_m:.1f mm}, disagree: the error includes it"
    ),
    # Of the lateral axis
    Code.CONICITY_NOT_SEPARATED: "conicity cannot be separated from ply steer and noise here",
    Code.FROM_AXIS_MEANS: "from the means of the lateral and the radial axis",
    Code.FROM_LAMINATE: (
        "from tire.laminate: B16 / A66 = {length_m:.2f mm} ± {length_std_m:.2f mm}, belt kept from twisting"
    ),
    Code.INCLUDES_CONICITY: "ply steer plus conicity",
    Code.LAMINATE_DIFFERS: (
        "differs from the measured peak, {measured_rad:.3f deg} ± {measured_std_rad:.3f deg}, by {errors:.1f} standard "
        "errors: cord angles, order of the plies, conicity, slip, or a belt that twists"
    ),
    Code.LAMINATE_NOT_BALANCED: (
        "the plies are not at opposite angles (A16 / A66 = {share:.2f}): tension shears the belt as well (Eq. 11)"
    ),
    Code.LATERAL_ZERO_CONTRADICTED: (
        "contradicts the stated accuracy of the sensor's zero, {stated_std_mps2:.1f m/s²}; a degree of camber is "
        "0.17 m/s²"
    ),
    Code.LATERAL_ZERO_NOT_SEPARATED: "needs two speeds: roll tilt and zero-g offset are not separated yet",
    Code.NEEDS_BOTH_SLIPS: "needs {needed:.0f} revolutions each at left and at right slip",
    Code.ORDERS_USED: "orders {first:.0f} to {last:.0f}",
    Code.ROLL_CONTRADICTED: (
        "contradicts the stated roll, {stated_rad:.1f deg} ± {stated_std_rad:.1f deg} (mounting.roll_deg); the "
        "measured one is used"
    ),
    Code.ROLL_NOT_CALIBRATED: (
        "AC-coupled: the roll tilt of the sensor cannot be calibrated; the error includes {assumed_rad:.0f deg}"
    ),
    Code.ROLL_UNLIKELY: (
        "the means of the axes give a roll of {roll_rad:.1f deg}, {expected_rad:.1f deg} ± {expected_std_rad:.1f deg} "
        "is expected: a rolled sensor (state mounting.roll_deg) or a wrong zero of the lateral axis (record two speeds)"
    ),
    Code.SCATTER_UNKNOWN: "the scatter is not known before {needed:.0f} revolutions",
    Code.SIGN_NOT_DETERMINED: "the sign is not determined: {errors:.1f} standard errors from zero",
    Code.SLIP_BEYOND_LAW: "beyond the slip angles that the slip calibration describes",
    Code.SLIP_OUTSIDE_CALIBRATION: (
        "the slip angle {slip_rad:.2f deg} is outside the calibrated {low_rad:.2f deg} to {high_rad:.2f deg}"
    ),
    Code.SPEED_UNUSABLE: "the speed is not known or too high for the sampling",
    Code.ZERO_SLIP_GIVEN: "zero slip from tire.slip_calibration",
    Code.ZERO_SLIP_IS_MEAN: (
        "zero slip is the mean of the latest revolutions, so constant slip is not seen; it needs tire.slip_calibration "
        "(treadlink calibrate slip)"
    ),
    Code.ZERO_SLIP_NOT_SETTLED: "zero slip is settling: {revolutions:.0f} of {needed:.0f} revolutions",
    # Of the sensor's calibration
    Code.FLAT_CONTACT_ASSUMED: "AC-coupled: from the contact, assumed to be flat (flat road)",
    Code.NEEDS_TEMPERATURE_CHANGE: "needs a change of temperature",
    Code.NEEDS_TWO_SPEEDS: "needs two speeds: {quantity} and zero-g offset are not separated yet",
    Code.NO_REVOLUTION_YET: "no revolution yet",
    Code.NOT_FINITE: "the result is not finite",
    Code.OTHER_OFFSET_STATED: "the vehicle file states {stated_m:.1f mm}",
    # Of what is not locked to the wheel
    Code.AT_WHEEL_ORDER: "at order {order:.0f} of the wheel: may be locked to it",
    Code.IN_BAND: "{low_hz:.0f Hz} to {high_hz:.0f Hz}, sensor noise included",
    Code.NEEDS_UNINTERRUPTED_ROLLING: "needs {duration_s:.0f s} of uninterrupted rolling",
    Code.NO_LINE: "no line stands out",
    # Of road and water
    Code.CAVITY_CONTRADICTED: (
        "the inner liner reads {measured_degc:.0f} °C, but the cavity resonates as air of {found_degc:.0f} °C would: "
        "another gas ({ratio:.2f} times gamma / M of air), cavity_length_mm or the temperature is wrong, or "
        "it is another line"
    ),
    Code.LIKE_A_WATER_WEDGE: "the leading edge has moved in by {shift_rad:.1f deg}, the trailing one has not",
    Code.NEEDS_CAVITY_LENGTH: "needs cavity_length_mm or a size with the rim of the tire in the vehicle file",
    Code.NEEDS_REVOLUTIONS: "needs {needed:.0f} revolutions, {count:.0f} so far",
    Code.NEEDS_TEMPERATURE: "needs the temperature",
    Code.NOT_VERIFIED_BY_MEASUREMENT: "not verified by any measurement",
    Code.ROAD_BELOW_NOISE: "not determined beside the jitter of the contact edges: class {letter} or better",
    Code.ROAD_CLASS: "class {letter} with a probability of {probability:.0%}, if G falls with n²",
    Code.ROAD_WAVES: "from waves of {short_m:.1f m} to {long_m:.1f m}",
    Code.TOO_SLOW_FOR_ROAD: "needs at least {limit_mps:.0f km/h}",
    # Sensors
    Code.AXIS_READS: "{axis} at {counts:.0f}",
    Code.PRESSURE_FROZEN: (
        "the pressure has not changed while the temperature changed by {temperature_change_k:.0f} K; it may be "
        "off by {error_pa:.0f kPa}"
    ),
    Code.SENSOR_DEAD: "every axis reads 0: the sensor is dead or its element has no supply",
    Code.SENSOR_FLIPPED: "the radial axis points outward; its sign is corrected here",
    Code.SENSOR_LOOSE: (
        "rings at {frequency_hz:.0f Hz} after every contact with {share:.0%} of the steady value: the sensor "
        "may have come loose; do not trust contact lengths and tire numbers"
    ),
    Code.SENSOR_STUCK: "does not move by one count for {duration_s:.0f s}: {axes} counts",
    Code.SENSOR_TILTED: (
        "the {axis} axis carries the steady value of the radial axis: tilted by {tilt_rad:.0f deg}, or the axes "
        "are swapped"
    ),
    # Wheels, links and alarms
    # - Alarms as events
    Code.ALARM_CLEARED: "alarm over at {at_s:.1f s}, after {duration_s:.1f s}: {what}",
    Code.ALARM_COMES_AND_GOES: (
        "ALARM at {at_s:.1f s}: {alarm}. It comes and goes: it is reported again after a minute without change"
    ),
    Code.ALARM_RAISED: "ALARM at {at_s:.1f s}: {alarm}",
    Code.ALARM_STANDS: "ALARM still at {at_s:.1f s}: {alarm}",
    # - Thresholds
    Code.BATTERY_BELOW_LIMIT: "battery at {level:.0f %}, below {limit:.0f %}",
    Code.BATTERY_NOW: "battery at {level:.0f %}",
    Code.FRAME_LOSS_ABOVE_LIMIT: "{share:.2f %} of the latest frames lost, above {limit:.2f %}",
    Code.FRAME_LOSS_NOW: "{share:.2f %} of the latest frames lost",
    Code.LINK_DOWN: "link is down: {state}",
    Code.LOAD_ABOVE_LIMIT: "load {load_n:.0f N} is above {limit_n:.0f N}",
    Code.LOAD_NOW: "load {load_n:.0f N}",
    Code.PRESSURE_ABOVE_LIMIT: "pressure {pressure_pa:.0f kPa} is above {limit_pa:.0f kPa}",
    Code.PRESSURE_BELOW_LIMIT: "pressure {pressure_pa:.0f kPa} is below {limit_pa:.0f kPa}",
    Code.PRESSURE_NOW: "pressure {pressure_pa:.0f kPa}",
    Code.SENSOR_RANGE_REACHED: "{count} samples at the end of the sensor's range",
    Code.SPEED_ABOVE_LIMIT: "speed {speed_mps:.0f km/h} is above {limit_mps:.0f km/h}",
    Code.SPEED_NOW: "speed {speed_mps:.0f km/h}",
    Code.TEMPERATURE_ABOVE_LIMIT: "inner liner at {temperature_degc:.0f degC}, above {limit_degc:.0f degC}",
    Code.TEMPERATURE_NOW: "inner liner at {temperature_degc:.0f degC}",
    Code.WEAR_ABOVE_LIMIT: "wear {wear_m:.1f mm} is above {limit_m:.1f mm}",
    Code.WEAR_NOW: "wear {wear_m:.1f mm}",
    # - Silence
    Code.AXIS_SILENT: (
        "the {axis} axis is silent for {silence_s:.0f s}, though the hello declares it: samples without it are not used"
    ),
    Code.BUS_NOT_MAPPED: (
        "no signal of this bus is mapped: its frames are recorded, but nothing is shown or compared (list the signals "
        "in [vehicle_signals] of the vehicle file)"
    ),
    Code.BUS_SILENT: "no frame of the vehicle's bus for {silence_s:.0f s}. Ignition off, cable loose, or bus off?",
    Code.ENVIRONMENT_SILENT: "no pressure or temperature for {silence_s:.0f s}: the last values are that old",
    Code.HUB_OF_WHEEL_SILENT: "no frame of its hub for {silence_s:.0f s}",
    Code.HUB_SILENT: "no frame for {silence_s:.0f s} (wheels: {wheels}). Battery empty, out of range, or stopped?",
    Code.SAMPLES_MISSING: "no samples for {silence_s:.0f s}",
    Code.SAMPLES_SILENT: (
        "no samples for {silence_s:.0f s}, only other messages of its sensor. Stopped by a command, or a fault of its "
        "firmware?"
    ),
    Code.SENDS_AGAIN: "sends again after {away_s:.1f s}",
    Code.SENSOR_NEVER_HEARD: (
        "nothing received from its sensor in {silence_s:.0f s}, or only what was rejected. Is it switched on, and are "
        "hub and wheel number as configured?"
    ),
    Code.SENSOR_SILENT: (
        "its sensor is silent for {silence_s:.0f s}, its hub is not. Battery empty, out of range or broken?"
    ),
    # - Events of links and devices
    Code.BATTERY_LEVEL: "battery {level:.0f %}",
    Code.BLE_DEVICE: "{device}",
    Code.COMPUTER_EVENT: "this computer",
    Code.COMPUTER_PAUSED: (
        "it paused for {paused_s:.1f s}, and what was sent meanwhile may be lost. Overloaded, or a virtual machine "
        "that was stopped?"
    ),
    Code.COMPUTER_SUSPENDED: "it was suspended for {suspended_s:.1f s}; what was sent meanwhile is lost",
    Code.LINK_AWAY: "back after {away_s:.1f s}",
    Code.LINK_CONNECTED: "connected",
    Code.LINK_DISCONNECTED: "disconnected on request",
    Code.LINK_ENDED: "ended",
    Code.LINK_EVENT: "{event}: {details}",
    Code.LINK_LOST: "connection lost",
    Code.LINK_NOT_OPEN: "not open yet",
    Code.LINK_RESTORED: "reconnected",
    Code.LINK_RETRYING: "reconnecting fails",
    Code.MARK: "mark: {text}",
    Code.MARK_NOT_KEPT: "not kept, nothing is recorded",
    Code.MTU: "MTU {mtu}",
    Code.MTU_TOO_SMALL: "MTU {mtu} is less than the {needed} that frames need: expect losses",
    Code.MTU_UNKNOWN: "MTU unknown (frames need {needed})",
    Code.NOTIFICATIONS_DROPPED: "{count} notifications dropped because this computer is too slow",
    Code.QUOTED_TEXT: "{text}",
    Code.SYSTEM_TIME_SET: (
        "its system time jumped by {step_s:+.1f s}. The times of this session stay those of the clock at its start: "
        "{ahead_s:+.1f s} makes them those of the new time"
    ),
    Code.RETRY_INTERVAL: "trying again every {interval_s:g s} or sooner",
    # - Live outputs
    Code.SINK_CLOSED: "finished",
    Code.SINK_CONNECTED: "publishing",
    Code.SINK_CONNECTING: "connecting",
    Code.SINK_DOWN: "nothing is published, {waiting} items wait: {state}",
    Code.SINK_DROPS: "items are dropped, {dropped} so far: {state}",
    Code.SINK_ENDED: "the reader has closed its end",
    Code.SINK_FAULT: "internal error: {error}",
    Code.SINK_FULL: "the receiver is slower than the session",
    Code.SINK_LOST: "{error}; trying again every {interval_s:g s} or sooner",
    Code.SINK_STALLED: "the receiver takes nothing",
    # - Health of links
    Code.FIRMWARE_TOO_NEW: (
        "the firmware uses protocol {major}.x and treadlink {own}.x, so no frame can be read. Update treadlink"
    ),
    Code.FIRMWARE_TOO_OLD: (
        "the firmware uses protocol {major}.x and treadlink {own}.x, so no frame can be read. Update the hub's firmware"
    ),
    Code.FRAMES_DAMAGED: (
        "{share:.0f %} of the frames arrive damaged and are left out. Check cable, ground, distance and baud rate"
    ),
    Code.FRAMES_RESUMED: "frames arrive now",
    Code.FRAMES_WITH_BAD_PAYLOAD: (
        "frames with a valid checksum whose content violates the protocol are skipped: a fault of the firmware"
    ),
    Code.FRAMES_WITH_UNKNOWN_FLAGS: "frames with unknown flags are skipped and counted",
    Code.HUB_RESTARTED: "restarted (boot count {boot_count}); its counters and times start again",
    Code.HUB_RESTARTS_REPEATEDLY: "restarts again and again. Check its supply. Further restarts are not reported",
    Code.LINK_NO_DATA_YET: (
        "open, but no data yet. Is the hub powered, awake and set to send? Are TX and RX connected correctly?"
    ),
    Code.LINK_RESUMED: "data arrives again",
    Code.LINK_SILENT: (
        "open, but no data for {silence_s:.0f s}. Is the hub powered, awake and set to send? Are TX and RX "
        "connected correctly?"
    ),
    Code.NEWER_FRAME_LAYOUT: (
        "frames of a layout newer than protocol {own} are skipped and counted: the firmware is newer. Update treadlink"
    ),
    Code.OLDER_PROTOCOL: (
        "its firmware uses protocol {version}, older than treadlink's {own}: it takes only unsigned commands"
    ),
    Code.NEWER_PROTOCOL: (
        "its firmware uses protocol {version}, newer than treadlink's {own}. What both support is read, the rest "
        "is skipped and counted. Update treadlink"
    ),
    Code.NO_FRAMES: "data arrives, but it contains no frame: {content}",
    Code.NO_FRAMES_ANY_MORE: "data arrives, but no frame any more, after {frames} frames: {content}",
    Code.NO_HELLO: (
        "samples arrive, but no hello for {silence_s:.0f s}: without rate and scale nothing can be estimated. A "
        "hub sends a hello every 2 s. Restart the hub or update its firmware"
    ),
    # - Content of a line without frames
    Code.CHECK_SOURCE_ADDRESS: "Check the address of the source",
    Code.CHOOSE_HUB_PORT: "Choose the hub's port; `treadlink doctor` lists the ports",
    Code.LINE_ALL_FRAMES_DAMAGED: (
        "frames start, but all are damaged: a bad cable or ground, an overrun, or firmware with a wrong CRC "
        "(`treadlink protocol` prints test vectors)"
    ),
    Code.LINE_CONSTANT: (
        "every byte is {byte}: the line is held at one level. Is the hub powered, and are its data wire and "
        "ground connected?"
    ),
    Code.LINE_GPS_RECEIVER: "this is a GPS receiver (NMEA text), not a hub. {remedy}",
    Code.LINE_NOT_A_HUB: "this is not a hub. {remedy}",
    Code.LINE_SYNC_SWAPPED: (
        "this is not a hub as it is: the two sync bytes of its frames are swapped (5A A5 instead of A5 5A). A fault"
        " of the firmware"
    ),
    Code.LINE_TEXT: "this is another device, which sends text: '{line}'. {remedy}",
    Code.LINE_UBLOX_RECEIVER: "this is a u-blox receiver, not a hub. {remedy}",
    Code.LINE_WRONG_BAUD_RATE: (
        "wrong baud rate, or another device on the port. Set the hub's rate, for example ?baudrate=115200; the "
        "default is {default_baud}"
    ),
    # - Wheels and their sensors
    Code.SENSOR_REPLACED: "sensor {sensor} is here, but the configuration names {expected}: a new sensor or tire?",
    Code.SENSOR_SWAPPED: (
        "sensor {sensor} of {owner} is here: wheels swapped? Estimates use load and tire of {position}"
    ),
    Code.WHEEL_ADDRESS: "{position} (hub {hub}, wheel {wheel})",
    Code.WHEEL_NOT_CONFIGURED: (
        "not configured: belt radius {radius_m:g mm} assumed, load unknown; give --config VEHICLE.toml"
    ),
    Code.WHEEL_NOT_IN_CONFIGURATION: (
        "not configured (the configuration has {configured}): belt radius {radius_m:g mm} assumed, load unknown"
    ),
    # - False statements of a hub
    Code.HELLO_AC_WITH_STEADY_VALUE: (
        "HELLO states AC coupling, but the {axis} axis has a steady value of {steady_mps2:.0f m/s²} ({count} so "
        "far): the sensor passes it. State DC coupling: without it, swapped axes and wrong signs are not seen "
        "either"
    ),
    Code.HELLO_AXES_DIFFER: (
        "samples have the axes {sent}, but HELLO states {stated}: {count} blocks are not used. A fault of the firmware"
    ),
    Code.HELLO_HIGHPASS_WITH_DC: (
        "HELLO states DC coupling and a high-pass at {highpass_hz:g Hz} ({count} so far). The high-pass is ignored; if "
        "there is one, the firmware must state AC"
    ),
    Code.HELLO_KEEPS_CHANGING: (
        "HELLO keeps changing without a restart ({count} so far): each change of sensor, rate or axes starts the wheel "
        "anew. A faulty hub, two sensors under one number, or forged frames"
    ),
    Code.HELLO_RATE_DIFFERS: (
        "HELLO states {stated_hz:g Hz}, but samples come at {measured_hz:.0f Hz} by the hub's clock ({count} "
        "so far, each over {duration_s:g s}). One of the two is wrong: a fault of the firmware"
    ),
    Code.HELLO_SCALE_ABSURD: (
        "HELLO states a full scale of {full_scale_mps2:.3g m/s²} for the {axis} axis, which no tire sensor has "
        "({count} so far). Its accelerations are wrong"
    ),
    Code.HELLO_SCALE_AGAINST_RANGE: (
        "HELLO states a range of {range_mps2:.4g m/s²} for the {axis} axis, but scale and saturation give "
        "{full_scale_mps2:.4g m/s²} ({count} so far). Its accelerations may be wrong"
    ),
    Code.HELLO_SCALE_ZERO: (
        "HELLO states a scale of 0 for {axes} ({count} so far): such an axis cannot be used. A fault of the firmware"
    ),
    Code.HELLO_SENSORS_ALTERNATE: (
        "sensors {sensor} and {other} announce themselves in turn as this wheel ({count} so far): estimates of two "
        "sensors are mixed. Give each a wheel number of its own"
    ),
    Code.HELLO_ZERO_ABSURD: (
        "HELLO states {offset_counts:.6g} counts at zero acceleration for the {axis} axis, more than a sample can have "
        "({count} so far). Its accelerations are wrong"
    ),
    Code.HUB_BOOT_COUNTS_DIFFER: (
        "its wheels state different boot counts, {own:.0f} and {other:.0f} ({count} so far): each change is taken "
        "for a restart. A fault of the firmware"
    ),
    Code.HUB_CLOCK_STILL: (
        "the hub's clock does not advance while samples arrive ({count} so far, each over {duration_s:g s}): "
        "times and the sampling rate cannot be checked. A fault of the firmware"
    ),
    Code.HUB_NUMBER_RESERVED: (
        "the hub has the number 255, which commands use for every hub ({count} HELLOs): it cannot be commanded alone"
    ),
    Code.HUB_SENDS_AS_WHEEL: (
        "the hub sends messages of a wheel under its own number, 255: {count} frames are not used. A fault of the "
        "firmware"
    ),
    Code.HUB_SENDS_COMMANDS: (
        "commands arrive from the hub ({count} frames), which only a gateway sends: is the line looped back?"
    ),
    Code.HUB_TIME_AGAINST_TICK: (
        "TIME_SYNC states {hub_us:.0f} us in a frame of tick {tick_us:.0f} us ({count} so far). A fault of the firmware"
    ),
    Code.ONLY_UNKNOWN_TYPES: (
        "sends nothing but frames of unknown types ({count} so far). Update treadlink, or check the firmware"
    ),
    Code.PRESSURE_IMPOSSIBLE: (
        "the sensor states {pressure_pa:.0f kPa} ({count} so far), which no tire has: these readings are not used"
    ),
    Code.SAMPLES_BYTES_SWAPPED: (
        "the two bytes of its samples seem to be swapped ({count} so far): the other way round, the steps from "
        "sample to sample are {ratio:.0f} times smaller. int16 is sent little endian. A fault of the firmware"
    ),
    Code.SAMPLES_REPEATED: ("sends the same samples again: {count} blocks are not used. A fault of the firmware"),
    Code.SAMPLE_NUMBERS_JUMP: (
        "sample numbers jump against the hub's clock, last by {last_s:+.3g s} ({count} so far): a restart of the "
        "sensor that HELLO does not show, or a fault of the firmware. The jumps are not counted as lost"
    ),
    Code.TEMPERATURE_IMPOSSIBLE: (
        "the sensor states {temperature_degc:.0f degC} ({count} so far), which no tire has: these readings are not used"
    ),
    Code.WHEELS_REFUSED: (
        "{count} wheel numbers beyond the {most} that a session takes are not used. A faulty hub, or forged frames: "
        "configure the wheels, and sign frames"
    ),
    # - Sessions and commands
    Code.ASSUMED_NOT_MEASURED: "assumed, not measured: {text}",
    Code.COMMAND_FAILED: "the command failed",
    Code.COMMAND_NOT_VERIFIED: "command not signed, or signed with another key",
    Code.COMMAND_OUTCOME: "outcome {outcome}",
    Code.COMMAND_REFUSED: "did not execute {command}: {outcome}",
    Code.COMMAND_REPEATED: "command repeated: its counter is not above that of an earlier one",
    Code.COMMAND_UNKNOWN: "unknown command",
    Code.COMMAND_VALUE_REFUSED: "value refused",
    Code.DECODING_BEHIND: (
        "this computer is too slow to decode and estimate; the recording is complete. Dropped data is counted"
    ),
    Code.EFFECTS_SUBTRACTED: "subtracted from its axes at {ranges}: {effects}",
    Code.HUB_LOG: "log ({severity}): {text}",
    Code.HUB_LOG_LEFT_OUT: "{count} more lines of its hubs left out: at most ten a second are shown",
    Code.LOAD_RANGE: "{low_n:.0f} to {high_n:.0f N}",
    Code.PRESSURE_RANGE: "{low_pa:.0f kPa} to {high_pa:.0f kPa}",
    Code.DISK_FULL_SOON: "the disk has {free_bytes:.1f MB} left and is full in {left_s:.0f min}: free some space",
    Code.DISK_SPACE: "the disk has {free_bytes:.1f GB} left",
    Code.DISK_TIME: "the disk has {free_bytes:.1f GB} left, which lasts {left_s:.1f h} at the present pace",
    Code.RECORDING_BEHIND: "the disk is too slow: bytes are MISSING FROM THE RECORDING. Dropped data is counted",
    Code.RECORDING_BEGUN: "recording to {path}",
    Code.RECORDING_FINISHED: "recording {path} finished",
    Code.RECORDING_STOPPED: "RECORDING STOPPED: {error}. {remedy}",
    Code.SPEED_RANGE: "{low_mps:.0f km/h} to {high_mps:.0f km/h}",
    Code.TOPICS_BEHIND: (
        "the disk is too slow: decoded values are left out of the recording, raw bytes are kept. Dropped data is "
        "counted"
    ),
    Code.VIEW_BEHIND: "the screen is too slow: lines are left out. Dropped data is counted",
    # - Recordings of a campaign
    Code.AXES_LEFT_OUT: "left out: the {axes} axes, which may not be what they are taken for",
    Code.AXIS_CONSTANT: "the {axis} axis reads one value throughout {count} revolutions, dead or stuck: left out",
    Code.SAMPLES_STUCK: (
        "data fault: {samples} samples ({share:.2%}) repeat the one before on every axis, in {runs} stretches of three "
        "or more, far beyond chance; check sensor, hub and link"
    ),
    Code.SAMPLES_BRIDGED: (
        "data fault: {samples} samples ({share:.2%}) are on {lines} straight lines in every axis, far beyond chance: "
        "bridged gaps, which bias the numbers. A new import of the measurement leaves them out"
    ),
    Code.DIFFERENT_SENSORS: "the recordings are of different sensors: {sensors}",
    Code.RECORDING_DAMAGED: "{damage}. The readable part is used",
    Code.RECORDING_ORDER_UNKNOWN: (
        "the recordings' times do not give their order: taken one after another, in the order given"
    ),
    Code.RECORDING_REPEATS: "holds the same revolutions as {other}",
    Code.RECORDING_WITHOUT_DATA: "contains nothing that can be used",
    Code.RECORDING_WITHOUT_WHEEL: "contains no revolution of wheel {wheel}",
    Code.SENSOR_ALARM: "alarm of the sensor: {reason}",
    Code.NOT_A_RING: (
        "the signal is not that of a ring: {share:.0%} of its rms is left unexplained, so no number is determined: "
        "{recordings}"
    ),
    Code.SENSOR_IN_DOUBT: "no number is determined where the sensor itself is in doubt: {recordings}",
    Code.REVOLUTIONS_CLIPPED: "the radial axis is clipped in {count} of {total} revolutions",
    Code.ABOUT_RECORDING: "{recording}: {reason}",
    Code.RECORDING_LEFT_OUT: "{recording} left out: {reason}",
    Code.SEVERAL_SENSORS: "several",
    # - Recordings of a dataset
    Code.ESTIMATION_FAILED: "a fault of treadlink, {kind}: {message}",
    Code.RECORDING_CHANGED: "the file changed while it was read",
    Code.TIRE_UNIDENTIFIED: (
        "{recordings} recordings have neither a vehicle's name nor a sensor's number, and may be of several tires: set "
        "name in [vehicle]"
    ),
    Code.RECORDING_NOTHING_READABLE: "{damage}. The readable part gives nothing: {why}",
    Code.RECORDING_NOT_READ: "{message}",
    Code.RECORDING_NOT_USED: "{message}",
    Code.WORKER_ENDED: "its worker process ended each time that it was tried: killed or crashed",
    Code.WORKER_MEMORY_ABOVE_LIMIT: (
        "its worker process was ended each time that it was tried: it used more than its limit of "
        "{limit_bytes:.0f MB} of memory"
    ),
    Code.WORKER_MEMORY_FULL: "its worker process had no memory left",
    # - Provenance of conditions
    Code.ASSUMED_LOAD: "load {load_n:.0f N} (not stated)",
    Code.ASSUMED_OFFSET: "mounting offset 0.0 mm below the neutral layer (neither stated nor measured)",
    Code.ASSUMED_PRESSURE: "pressure {pressure_pa:.0f kPa} (neither stated nor measured)",
    Code.ASSUMED_RADIUS: "belt radius {radius_m:g mm} (no configuration states it)",
    Code.ASSUMED_TEMPERATURE: "temperature steady (neither stated nor measured)",
    Code.FROM_CONFIGURATION: "--config",
    Code.FROM_RECORDING: "configuration recorded with it",
    Code.FROM_SENSOR: "measured by the sensor",
    Code.OF_RECORDINGS: "{statement}: {recordings}",
    Code.STATED_LOAD: "load {load_n:.0f N} ({source})",
    Code.STATED_LOAD_RANGE: "load {low_n:.0f} to {high_n:.0f N} ({source})",
    Code.STATED_OFFSET: "mounting offset {offset_m:z.1f mm} below the neutral layer ({source})",
    Code.STATED_PITCH: "mounting pitch {pitch_rad:g deg} ({source})",
    Code.STATED_PRESSURE: "pressure {pressure_pa:.0f kPa} ({source})",
    Code.STATED_PRESSURE_RANGE: "pressure {low_pa:.0f} to {high_pa:.0f kPa} ({source})",
    Code.STATED_RADIUS: "belt radius {radius_m:g mm} ({source})",
    Code.STATED_ROLL: "mounting roll {roll_rad:g deg} ({source})",
    # Rows of a dataset
    Code.ROW_FEW_VALID: "valid in {count} of {of} revolutions only",
    Code.ROW_SCATTERS: "varies within the recording by {ratio:.1f} times its standard error, which contains it",
    # Trends of a dataset
    Code.TREND_ALARMS: "alarm '{name}' in {count} of {of} recordings; the last: {why}",
    Code.TREND_DAMAGED: "damaged: {count} of {of} recordings, whose readable part was estimated",
    Code.TREND_FEW_VALID: "more than half of the revolutions are not used in {count} of {of} recordings: {why}",
    Code.TREND_FOREIGN_FILE: "left out, because it is not a file of this dataset: {path}",
    Code.TREND_NO_REVOLUTION: (
        "no recording has a revolution: the wheel stood still, or the sensor sent no usable signal"
    ),
    Code.TREND_PRESSURE_STUCK: (
        "sensor: the pressure is {pressure_pa:.1f kPa} in {count} recordings from {first} to {last}, while the "
        "temperature varies: it is stuck, and left out of the trends"
    ),
    Code.TREND_PROVISIONAL: "provisional in {count} of {of} recordings: {why}",
    Code.TREND_REPEATED: "recordings that repeat another and count once: {count}. {pairs}",
    Code.TREND_REPEATS: "{path} repeats {other}",
    Code.TREND_STATED_CALIBRATION: "the stated [tire.load_calibration] changed on {date}: no change of the load",
    Code.TREND_STATED_LEVELS: (
        "changes of what is stated of the tire, before and after which the levels are fitted apart: {count}"
    ),
    Code.TREND_STATED_LOAD: (
        "the stated load changed on {date}, from {before_n:.0f N} to {after_n:.0f N}: no change of the tire"
    ),
    Code.TREND_STATED_RADIUS: (
        "the stated belt radius changed on {date}, from {before_m:.1f mm} to {after_m:.1f mm}: no change of the tire"
    ),
    Code.TREND_STATED_REFERENCE: "the stated [tire.reference] changed on {date}: no change of the tire",
    Code.TREND_STATED_THICKNESS: "the stated ring_thickness_mm changed on {date}: no change of the tire",
    Code.TREND_TEMPERATURE_IMPOSSIBLE: (
        "sensor: a temperature of up to {temperature_degc:.0f} °C in {count} recordings, which no tire has; left out "
        "of the trends"
    ),
    Code.TREND_WEAR_SOFTENS: "of this, {share:.2%} ± {std:.2%} a month is the measured wear's",
    Code.TREND_CLOCK_WRONG: (
        "left out, because the clock of the recorder was wrong: {path} says it began on {date}. Set its clock and "
        "record again"
    ),
    Code.TREND_DISTANCE_CONSTANT: (
        "the distance is the same in all recordings; an odometer file needs readings before and after them"
    ),
    Code.TREND_LAST_DEVIATES: (
        "the last recording, {date}, deviates from the trend by {deviation:+.1f} standard deviations"
    ),
    Code.TREND_LEVEL_CHANGED: (
        "since {date}, {name:series} is {change:+.3g}{unit: } ± {std:.2g}{unit: } from its earlier trend: {count} "
        "recordings, {first} to {last}"
    ),
    Code.TREND_LOAD_STATED: "as stated, not measured",
    Code.TREND_LOAD_STEPS: "steps of the load: {count}",
    Code.TREND_LOSES_PRESSURE: "loses {loss_pa:.1f kPa} ± {std_pa:.1g kPa} a month",
    Code.TREND_LOSS_CHANGED: (
        "since {date}, loses {after_pa:.1f kPa} ± {after_std_pa:.1g kPa} a month; before, {before_pa:.1f kPa} ± "
        "{before_std_pa:.1g kPa}: {count} recordings, {first} to {last}"
    ),
    Code.TREND_NEWEST_LEFT: "without the last {count} recordings, which have left the trend on {date}",
    Code.TREND_NOW_SINCE: "by the {count} recordings since {date}, which have left the earlier trend",
    Code.TREND_NO_VALUES: "no recording has a value: {why}",
    Code.TREND_OUTLIERS_LEFT_OUT: "outliers left out: {count}",
    Code.TREND_PASSED: (
        "from {date} to {until}, {name:series} deviates from its trend by {deviations:.1f} standard deviations and "
        "more in {count} recordings in a row: {first} to {last}"
    ),
    Code.TREND_PRESSURE_CONSTANT: (
        "the pressure is {pressure_pa:.1f kPa} in all {count} recordings: the sensor is stuck, or too coarse to show "
        "a loss"
    ),
    Code.TREND_PRESSURE_FELL: (
        "the pressure has fallen by {fall_pa:.0f kPa} ± {std_pa:.1g kPa} in {span_s:.1f h}: {first} to {last}"
    ),
    Code.TREND_PRESSURE_NOT_MEASURED: "no sensor has sent a pressure",
    Code.TREND_RATE_SINCE: (
        "of the {count} recordings since {date}; before, it was {before:.3g}{unit: } ± {std:.2g}{unit: }"
    ),
    Code.TREND_RECORDED_DISTANCE: (
        "over the recorded {distance_m:.0f km} only, which is less than the tire has rolled (--odometer)"
    ),
    Code.TREND_REFILLS_HIDE: (
        "refills that the scatter hides are not excluded: the loss is {low_pa:.2g kPa} to {high_pa:.2g kPa} a month"
    ),
    Code.TREND_REFILLS_OFTEN: (
        "if it is refilled {often:.0f} times a month at most: the scatter hides a loss of {hidden_pa:.0f kPa} a month "
        "that is topped up every week"
    ),
    Code.TREND_SENSOR_CLIPS: "sensor: {share:.1%} more of the samples at the end of its range",
    Code.TREND_SENSOR_GAIN: "sensor: its gain has changed by {share:.1%}",
    Code.TREND_SENSOR_LOSSES: "sensor: {share:.1%} more of the samples are lost",
    Code.TREND_SENSOR_MOVES: "sensor: its distance from the neutral layer has changed by {change_m:.1f mm}",
    Code.TREND_SENSOR_NOISE: "sensor: its noise has become {factor:.1f} times as large",
    Code.TREND_SENSOR_ZERO: "sensor: its zero has changed by {change_mps2:.1f m/s²}",
    Code.TREND_SLOPE_CHANGED: (
        "since {date}, {name:series} has another trend, and is {change:+.3g}{unit: } ± {std:.2g}{unit: } from its "
        "earlier one at the end: {count} recordings, {first} to {last}"
    ),
    Code.TREND_SPEED_WITH_TIME: (
        "the speed changes with the time, so that the influences of the two cannot be separated"
    ),
    Code.TREND_SPAN_SHORT: (
        "the recordings span {span_s:.2g days}: a rate per month needs {needed_s:.0f days}, as what changes from hour "
        "to hour is no trend"
    ),
    Code.TREND_DISTANCE_SHORT: ("the recordings span {distance_m:.3g km}: a rate per 1,000 km needs {needed_m:.0f km}"),
    Code.TREND_STEPS: "steps that are fitted and left out of the trend: {count}",
    Code.TREND_STIFFNESS_DRIFTS: "{name} changes by {share:.2%} ± {std:.2%} a month",
    Code.TREND_TEMPERATURE_CONSTANT: "the temperature varies too little, or is not known",
    Code.TREND_TEMPERATURE_STUCK: (
        "the temperature is {temperature_degc:.1f} °C in all {count} recordings: if the sensor is stuck, the pressure "
        "of a colder season looks like a loss"
    ),
    Code.TREND_TEMPERATURE_UNKNOWN: "no sensor has sent a temperature, which the comparison of pressures needs",
    Code.TREND_TOO_FEW: "{count} recordings with a value, {needed} are needed",
    Code.TREND_TIRE_UNIDENTIFIED: (
        "no vehicle's name and no sensor says that all recordings are of one tire: differences between tires would be "
        "in it"
    ),
    Code.TREND_TIRES_UNIDENTIFIED: (
        "NOT IDENTIFIED: {recordings} recordings have neither a vehicle's name nor a sensor's number, and may be of "
        "several vehicles. Their numbers are marked ~ and make no finding. Set name in [vehicle], and estimate again"
    ),
    Code.TREND_UNDETERMINED: "the recordings do not determine it",
    Code.TREND_UNREADABLE_FILE: "left out, because it cannot be read: {path}",
    Code.TREND_VEHICLE_WITHOUT_ODOMETER: (
        "the odometer file does not cover vehicle {vehicle}: its distance is the recorded one"
    ),
    Code.TREND_WEAR_CHANGED: (
        "since {date}, wears by {after_m:.3f mm} ± {after_std_m:.3f mm} in 1,000 km; before, {before_m:.3f mm} ± "
        "{before_std_m:.3f mm}: {count} recordings, {first} to {last}"
    ),
    Code.TREND_WEARS_FAST: (
        "wears by {rate_m:.3f mm} ± {std_m:.3f mm} in 1,000 km; the median of the fleet is {median_m:.3f mm}"
    ),
    # Security
    Code.COUNTERS_NOT_SAVED: "frames of this session could be replayed to the next one: {error}. {remedy}",
    Code.COUNTERS_SAVED_LATE: (
        "frames of this session could be replayed to the next one: the counters of the sensors could not be "
        "written in time"
    ),
    Code.FRAMES_IGNORED: "ignored, but recorded",
    Code.FRAMES_NOT_TRUSTED: "frames not to be trusted: {counts}",
    Code.FRAMES_USED: "not refused for that (policy warn)",
    Code.FRAMES_VERDICT: "{count} {verdict}",
    Code.FRAME_BEFORE_HELLO: "signed frames arrive, but no verified hello ({count} so far); {consequence}",
    Code.FRAME_EARLIER_START: (
        "{signer} sends under boot count {start}, but {latest} was accepted before ({count} frames so far): an old "
        "recording is replayed, or the hub was replaced or has lost its boot count. If the hub is yours, set its boot "
        "count above {latest}, or give a new key: treadlink keys new {identity} --replace; {consequence}"
    ),
    Code.FRAME_LATE: (
        "a frame arrived long after later ones ({count} so far): a recording of the sensor may be replayed; "
        "{consequence}"
    ),
    Code.FRAME_NO_KEY: (
        "frames are signed by {signer}, whose key is missing ({count} so far); `treadlink keys import` admits "
        "it; {consequence}"
    ),
    Code.FRAME_REPLAYED: (
        "a frame arrived twice ({count} so far): a recording of the sensor may be replayed; {consequence}"
    ),
    Code.FRAME_UNSIGNED: "a frame is not signed ({count} so far): anyone could have sent it; {consequence}",
    Code.FRAME_WRONG_TAG: (
        "a signed frame has a wrong tag ({count} so far): forged, from an earlier start, or signed with another "
        "key; {consequence}"
    ),
    Code.NO_KEYS: ("the policy is to verify frames, but '{file}' has no key: import keys with `treadlink keys import`"),
    Code.KEY_MISSING_FRAMES_IGNORED: (
        "no key for sensor {sensor}: its frames will be ignored; add its key with `treadlink keys import`"
    ),
    Code.KEY_MISSING_FRAMES_NOT_VERIFIED: (
        "no key for sensor {sensor}: its frames cannot be verified; add its key with `treadlink keys import`"
    ),
    Code.SENSOR_NOT_ADMITTED: (
        "sensor {sensor} is here, but the configuration names {expected} ({count} frames so far); configure it "
        "to admit it; {consequence}"
    ),
    Code.SENSOR_NOT_ADMITTED_SWAPPED: (
        "sensor {sensor} of {owner} is here: wheels swapped? ({count} frames so far); {consequence}"
    ),
    Code.SENSOR_NOT_ADMITTED_UNCONFIGURED: (
        "sensor {sensor} is at a wheel that is not configured ({count} frames so far); configure it to admit it; "
        "{consequence}"
    ),
    Code.SIGNER_AT_HUB: "{signer} at hub {hub}",
    Code.SIGNER_HUB: "hub {identity}",
    Code.SIGNER_SENSOR: "sensor {identity}",
    Code.SIGNER_UNKNOWN: "an unknown sensor",
    # Bring-up of a firmware
    Code.BLOCKS_NOT_FULL: (
        "a block holds {samples:.0f} samples on average, {full} fit: the link carries {more:.0%} more bytes than it"
        " must"
    ),
    Code.BOOT_COUNT_GOES_BACK: (
        "the hub has restarted, and boot_count went from {before:.0f} back to {after:.0f}: it must be higher after "
        "every start"
    ),
    Code.BOOT_COUNT_STANDS: (
        "the hub has restarted, but boot_count is {after:.0f} as before: count every start, where it survives a "
        "loss of power"
    ),
    Code.BYTES_BETWEEN_FRAMES: (
        "{bytes} bytes between {frames} frames: frames are sent back to back, with nothing between them"
    ),
    Code.CHECK_AC_HAS_NO_SCALE: (
        "the sensor is AC-coupled, so that its steady value, and the scale with it, cannot be seen"
    ),
    Code.CHECK_AT_REST: (
        "the wheel does not roll; at rest its axes read {share:.2f} g together, where 1 g and the zero errors are "
        "expected"
    ),
    Code.CHECK_DOES_NOT_ROLL: "the wheel does not roll: roll it, or move the sensor on a turntable, at 10 m/s or more",
    Code.CHECK_FRAMES_LOST: (
        "{lost} frames are missing by their counters ({damaged} of them beside damaged bytes), {frames} arrived"
    ),
    Code.CHECK_HUB_TAKES_NO_COMMANDS: "the hub answered no command, as one that takes none",
    Code.CHECK_NO_COMMANDS: "no command can be sent: a file, or a source that is only read",
    Code.CHECK_NO_COMMANDS_WANTED: "commands were left out, as asked for",
    Code.CHECK_NO_KEY: "there is no key of {identity}: give --keys FILE",
    Code.CHECK_NO_RADIAL_AXIS: "the sensor has no radial axis",
    Code.CHECK_STOPPED_EARLY: "the check ended before it came to this: give it more time with --for",
    Code.CHECK_TOO_SHORT: "{duration_s:.1f s} are too short: {needed_s:g s} are needed",
    Code.COMMAND_ANSWERED_DAMAGED: "a command with a wrong CRC was answered: it must be dropped without an answer",
    Code.COMMAND_ANSWER_LATE: "no answer to {command} within {waited_s:g s}, although the hub answers commands",
    Code.COMMAND_ANSWER_NOT_OF_HUB: "COMMAND_RESULT comes from wheel {wheel}: it is sent by the hub itself (wheel 255)",
    Code.COMMAND_OUTCOME_WRONG: "{command} was answered with outcome {outcome}; {expected} is right here",
    Code.COMMAND_REPLY_MISMATCH: (
        "COMMAND_RESULT states command {command} and seq {seq}; the command sent was {sent}, seq {sent_seq}"
    ),
    Code.CRC_ALWAYS_ZERO: "always 0",
    Code.CRC_BIG_ENDIAN: "big endian",
    Code.CRC_BZIP2: "not reflected (CRC-32/BZIP2)",
    Code.CRC_CASTAGNOLI: "CRC-32C (Castagnoli)",
    Code.CRC_FROM_ZERO: "with the initial value 0",
    Code.CRC_FROM_ZERO_NOT_INVERTED: "with the initial value 0 and without the final inversion",
    Code.CRC_MPEG2: "not reflected (CRC-32/MPEG-2)",
    Code.CRC_NOT_INVERTED: "without the final inversion",
    Code.CRC_OF_HEADER: "over the header only",
    Code.CRC_OF_PAYLOAD: "over the payload only",
    Code.CRC_OF_WORDS: "not reflected, over words (the default of an STM32's CRC unit)",
    Code.CRC_WITHOUT_SYNC: "without the sync",
    Code.DROPS_NOT_NUMBERED: (
        "frames_dropped rose by {dropped:.0f}, but only {missing:.0f} numbers are missing: a frame that cannot be "
        "sent must use its number"
    ),
    Code.FRAME_CRC_VARIANT: "the CRC of the frames is {how}: CRC-32 of zlib over all bytes before it, little endian",
    Code.FRAME_CRC_WRONG: (
        "frames start, but the CRC of none is right: CRC-32 of zlib over all bytes before it, little endian "
        "(`treadlink protocol vectors`)"
    ),
    Code.FRAME_FLAGS_UNKNOWN: "flags are {flags}: only bit 0 is defined, all others are 0",
    Code.FRAME_LENGTH_COUNTS: "length counts {how}: it is that of the payload alone",
    Code.FRAME_TYPE_UNKNOWN: "type {type} is not defined",
    Code.FRAME_VERSION_WRONG: (
        "the version byte is {version}: 0x10, the version in which the layout of the frame appeared"
    ),
    Code.FRAME_WITHOUT_TAG: "bit 0 of flags is set, but the payload has no room for a tag",
    Code.HELLO_ABSENT_AXES_FILLED: "range, scale and zero of axes that the mask lacks should be 0: {axes}",
    Code.HELLO_OTHER_MAJOR: "HELLO states protocol {major}.{minor}, its frame 1.0",
    Code.LENGTH_OF_FRAME: "header, payload and CRC",
    Code.LENGTH_WITH_CRC: "payload and CRC",
    Code.LENGTH_WITH_HEADER: "header and payload",
    Code.LINK_NEARLY_FULL: (
        "the samples take {needed:.0f} bytes/s, {share:.0%} of the {capacity:.0f} bytes/s that the link carries"
    ),
    Code.LOG_HAS_CONTROLS: "a log text has control characters; it should be one line",
    Code.LOG_LEVEL_RESERVED: "log level {level} is reserved",
    Code.LOG_NOT_UTF8: "a log text is not UTF-8",
    Code.LOG_TOO_OFTEN: "{lines} log texts within a second, at most 10 are allowed",
    Code.MESSAGE_TOO_OFTEN: "{type} came {count} times in {span_s:.1f s}, {due:.0f} are due",
    Code.MESSAGE_TOO_RARE: "{type} came {count} times in {span_s:.1f s}, {due:.0f} are due",
    Code.PAYLOAD_LENGTH_WRONG: (
        "the payload of {type} has {length} bytes, its layout {layout}: a C struct must be packed"
    ),
    Code.PAYLOAD_VALUE_WRONG: "{field} of {type} is outside its range",
    Code.RATE_NOT_EXACT: (
        "samples come at {measured_hz:.2f Hz} by the hub's clock, {share:+.2%} from the {stated_hz:g Hz} of HELLO; "
        "0.1 % is recommended"
    ),
    Code.SAMPLES_BEFORE_HELLO: "SAMPLES come before the first HELLO of the wheel",
    Code.SAMPLES_DROPPED_BY_HUB: "the hub has dropped {holes:.0f} samples, as first_sample and HUB_STATUS say",
    Code.SAMPLES_NOT_STARTED: "no SAMPLES within {waited_s:g s} after SET_STREAM 1 was done",
    Code.SAMPLES_NOT_STOPPED: "SAMPLES still come {waited_s:g s} after SET_STREAM 0 was done",
    Code.SAMPLE_NUMBERS_HOLES: (
        "first_sample leaves out {holes:.0f} samples, but no frame is missing and samples_dropped of HUB_STATUS "
        "does not rise"
    ),
    Code.SAMPLE_NUMBERS_OVERLAP: (
        "first_sample rose by {step:.0f} after a block of {samples:.0f} samples: it counts samples"
    ),
    Code.SCALE_OFF_BY_POWER_OF_TWO: (
        "the steady radial value is {level_mps2:.0f m/s²}, {ratio:.2f} times R Omega² = {expected_mps2:.0f m/s²} (R"
        " = {radius_m:.0f mm}, --radius): is the scale wrong by a factor of 2 to the power of {power}? Check how "
        "many bits a word of the sensor has, and how they are aligned"
    ),
    Code.SEQ_BIG_ENDIAN: "seq counts in the wrong order of bytes: it is sent little endian",
    Code.SEQ_GOES_BACK: "seq {seq:.0f} is lower than before, without a restart: it has 32 bits and does not go back",
    Code.SEQ_JUMPS: "seq jumped over {gap:.0f} numbers to {seq:.0f}",
    Code.SEQ_NOT_FROM_ZERO: "the first seq after the start is {seq:.0f}: it counts from 0 at every start",
    Code.SEQ_REPEATED: "seq {seq:.0f} came again: it counts the frames of every type, and a reader drops repeated ones",
    Code.SEQ_SHARED: "all sources share one seq: every wheel, and the hub itself, has a counter of its own",
    Code.SEQ_STANDS: "seq is {seq:.0f} in every frame",
    Code.SET_RATE_NOT_STATED: (
        "HELLO states {stated_hz:g Hz} still, {waited_s:g s} after SET_RATE was done: it follows at once when the "
        "rate changes"
    ),
    Code.SOME_FRAMES_DAMAGED: (
        "{damaged} times a frame was damaged, {frames} are intact: a bad cable or ground, an overrun, or a buffer "
        "that is overwritten while it is sent"
    ),
    Code.SOURCE_SIGNS_SOME_FRAMES: "some frames are signed and some are not: a source signs all of its frames or none",
    Code.STATUS_FRAMES_SENT_WRONG: "frames_sent rose by {stated:.0f} while {arrived:.0f} frames arrived or are missing",
    Code.STATUS_UPTIME_WRONG: "uptime_s is {uptime_s:.0f} when the clock is at {clock_s:.1f s}",
    Code.TAG_WRONG: "the tag is not that of the key of {identity} and boot_count {boot_count}",
    Code.TICK_GOES_BACK: (
        "tick_us went back by {back_us:.0f} to {tick_us:.0f}: it has 32 bits, is never set, and wraps every 71.6 "
        "minutes"
    ),
    Code.TICK_IN_OTHER_UNIT: (
        "tick_us counts {unit}, not us: it advanced {pace:.4g} times as far as {duration_s:.1f s} of this "
        "computer's clock"
    ),
    Code.TICK_JITTERS: (
        "tick_us of the blocks scatters over {spread_s:.1f ms} about an even rate ({std_s:.2f ms} standard "
        "deviation): take it in the sensor's interrupt"
    ),
    Code.TICK_NOT_OF_FIRST_SAMPLE: (
        "frames sent after a block have tick_us {tick_us:.0f}, before the block's last sample: tick_us of SAMPLES "
        "is that of the first sample"
    ),
    Code.TICK_PACE_WRONG: "tick_us advanced {pace:.4f} times as far as {duration_s:.1f s} of this computer's clock",
    Code.TICK_STANDS: "tick_us is {tick_us:.0f} in two messages in a row",
    Code.TIME_NOT_ECHOED: "host_ns of TIME_SYNC is {host_ns}, not the {sent_ns} of SET_TIME",
    # Files and configuration
    Code.RECORDING_CHANNEL_UNDECLARED: (
        "'{recording}' has messages of the undeclared channel {channel:d}, which are skipped. `treadlink repair` may "
        "recover them"
    ),
    Code.RECORDING_CHUNK_DAMAGED: (
        "'{recording}' has a damaged chunk near byte {at_byte:d}; {skipped_bytes:d} bytes are skipped. `treadlink "
        "repair` recovers what is left of them"
    ),
    Code.RECORDING_CUT_OFF: (
        "'{recording}' is cut off at byte {at_byte:d}, inside a record. `treadlink repair` completes it"
    ),
    Code.RECORDING_DESCRIPTION_DAMAGED: (
        "'{recording}' has a damaged description, which contains the vehicle configuration. `treadlink repair` "
        "recovers the rest"
    ),
    Code.RECORDING_PARTS_DAMAGED: (
        "'{recording}' is damaged in {parts:d} parts, the first near byte {at_byte:d}: {unread_bytes:d} of its "
        "{size_bytes:d} bytes are not read. `treadlink repair` recovers what is left of them"
    ),
    Code.RECORDING_RECORD_DAMAGED: (
        "'{recording}' has a damaged record near byte {at_byte:d}. `treadlink repair` recovers what is left of it"
    ),
    Code.RECORDING_RECORD_MISSING: (
        "'{recording}' has no valid record at byte {at_byte:d}; the rest is not read. `treadlink repair` recovers it"
    ),
    Code.RECORDING_RECORD_TOO_LARGE: (
        "'{recording}' has {size_bytes:.1f MB} in one chunk or record at byte {at_byte:d}, which is skipped; at most "
        "{largest_bytes:.1f MB} are read at once. Check where the file comes from"
    ),
    Code.UNIT_UNLIKELY: (
        "the radial column is stated in {stated}, but {fitting} fits: with {stated}, the steady acceleration is "
        "{found_mps2:.4g m/s²}, {ratio:.3g} times the V²/R of {expected_mps2:.4g m/s²} of a revolution of "
        "{period_s:.4g s} and a belt radius of {radius_m:.0f mm}"
    ),
    Code.SIGNAL_INTERPOLATED: (
        "{share:.0%} of the samples lie on straight lines in every axis: the signal was interpolated. Import it at the "
        "rate at which it was measured"
    ),
    # Diagnosis: effects that are not identified
    Code.IMPLAUSIBLE_PARAMETER: (
        "{parameter} would be {value:.4g}{unit: }, outside its plausible range of {low:.4g} to {high:.4g}{unit: }"
    ),
    Code.FADES_WITHIN_ONE_WAVE: (
        "the packet at the {edge} edge fades within {waves:.2f} of a wavelength: a bump, not a wave"
    ),
    Code.HOLLOW_ROAD: "the road would be hollow with a radius of {radius_m:.3g m}, larger than any inner drum (5 m)",
    Code.PROBABILITY_TOO_LOW: "its probability is {probability:probability}, and {needed:.2g} is needed",
    Code.NOT_ON_EXACT_RING: (
        "it absorbs errors of this model's equations: on the exact ring {effect} is {errors:.1f} errors from zero"
    ),
    Code.LEAVES_MORE_THAN_WITHOUT: (
        "with it the fit leaves {with_it:.3g} times the noise of the means, without it {without:.3g} times"
    ),
    Code.LAW_LEAVES_MUCH: "it explains {share:.0%} of what is left beyond noise",
    Code.LAW_FAILS_UNSEEN: (
        "with the size of the other recordings, the {axis} error of {recording} goes from {before_mps2:.3g} to "
        "{after_mps2:.3g m/s²}"
    ),
    Code.LAW_SIZES_DIFFER: "its size in {recording} alone is {ratio:.2f} times that of all",
    Code.LAW_HAS_RIVALS: "{laws} explain the same as well",
    Code.LAW_UNTESTED: "no recording of another speed, load or pressure can test it",
    Code.SMALLER_THAN_LEFT: (
        "its {size_mps2:.2g m/s²} are less than the {left_mps2:.2g m/s²} that stay unexplained there: an equation "
        "that is off by as much makes any small effect certain"
    ),
    Code.LEFT_WHEN_ENDED: (
        "the search ended with {residual_ratio:.3g} times the rms of the noise of the means unexplained: no number is "
        "determined"
    ),
    Code.EVIDENCE_TEMPERED: (
        "what is left unexplained ({axes}) has {residual_ratio:.3g} times the rms of the noise of the means; evidence "
        "from there counts less by that factor"
    ),
    Code.ERROR_BY_POSSIBLE_EFFECT: (
        "most of the error of {numbers} comes from {effect}, which the data neither show nor exclude (probability "
        "{probability:probability}); without it the error would be {ratio:.2g} times smaller"
    ),
    Code.ERROR_BY_MISSING_EFFECT: (
        "most of the error of {numbers} comes from the possible absence of {effect} (probability "
        "{probability:probability}, not identified); if it were certain the error would be {ratio:.2g} times smaller"
    ),
    Code.LAW_MOVES_EFFECT: (
        "{effect}: beside the law ({law}) its {parameter} is {value:.3g}{unit: }, not {without:.3g}{unit: }: decide on "
        "the law first"
    ),
    Code.OTHER_OPTIMUM: (
        "{effect}: nearly as good with {parameter} {value:.4g}{unit: } in place of {best:.4g}{unit: } (probability "
        "{probability:probability}), which makes up most of its error"
    ),
    Code.TIME_LIMIT_SPENT: (
        "limit {limit_s:.3g s}: reading took {reading_s:.2g s}, fit and search {search_s:.2g s}; hold-out and figures "
        "came after it, {after_s:.2g s}"
    ),
    Code.SEARCH_ENDED_EARLY: (
        "the search for effects ended at its time limit before it was complete (sets tried: {sets}): others may be "
        "more probable"
    ),
    Code.SIZE_DIFFERS_BETWEEN_RECORDINGS: "its size would have to differ between recordings (most in {recording})",
    Code.LEAVES_RESIDUAL_AT_EDGES: (
        "it leaves {residual_share:.0f %} of the scatter at the contact edges, so it stands in for another cause"
    ),
    Code.NOTHING_REMAINS: "nothing of it remains beside the other effects",
    Code.ORDER_OR_FREQUENCY: (
        "the residual is {noise_floors:.1f} times the noise floor, and one speed does not distinguish an "
        "order from a fixed frequency"
    ),
    Code.BESIDE_SOMETHING_LARGER: (
        "its {own_mps2:.2f m/s²} may be part of something unknown beside it, {larger_mps2:.2f m/s²}"
    ),
    # Diagnosis: deciding recordings
    Code.RECORD_AT_SPEED: "record again at {speed_ratio:g} times the speed",
    Code.RECORD_REVERSED: "record again rolling in the opposite direction",
    Code.RECORD_WARMER: "record again with the tire {difference_k:g K} warmer",
    Code.RECORD_AT_LOAD: "record again at {load_ratio:g} times the load",
    Code.RECORD_AT_PRESSURE: "record again at {pressure_ratio:g} times the pressure",
    Code.RECORD_AT_REST: (
        "record at rest with the axle level and the tire lifted: the lateral axis then reads the zero-g offset alone"
    ),
    Code.RECORD_ROAD_AT_ANOTHER_SPEED: (
        "record again at another speed: road vibration grows with it, sensor noise does not"
    ),
    Code.RECORD_ON_ANOTHER_ROAD: (
        "record again on another road or drum: a resonance of the tire keeps its frequency, vibration from a track "
        "does not"
    ),
    Code.RECORD_LIVE: "record live, with host time stamps",
    Code.RECORD_LIVE_FOR_LONGER: "record live for longer: the hub's clock is known to {clock_std:.0f ppm} so far",
    Code.COMPARE_CLOCK: "compare the hub's clock with one better than {host_clock:.0f ppm}",
    Code.NO_RECORDING_DECIDES: "no other speed, load, pressure, temperature or direction tried here would decide",
    Code.DECIDES_AGAINST: "against {effect}: {recording}",
    # Diagnosis: notes
    Code.MEANS_NOT_COMPARED: (
        "the paper's model has no mean, so the means of the axes are not compared, and a zero-g offset or a "
        "constant gain error in them is not detected; start from --model exact to detect it"
    ),
    Code.REVOLUTIONS_LEFT_OUT: "{revolutions} revolutions left out: {reason}",
    Code.REVOLUTION_NOT_MEASURED: "the radial axis or the sampling rate is not known",
    Code.BEYOND_RECORDING_LIMIT: "beyond the first {limit} of a recording",
    Code.BEYOND_GROUP_LIMIT: "beyond the first {limit} at the same speed, load, pressure and temperature",
    Code.BETWEEN_GROUP_SPEEDS: "at speeds between those of the {groups} most informative groups",
    Code.TOO_FEW_ALIKE: "too few at the same speed, load, pressure and temperature",
    Code.OUTLIER_OF_GROUP: "an outlier at the same conditions, as after an impact",
    Code.CLIPPED_UNLIKE_GROUP: "the radial axis is clipped, unlike in others at the same conditions",
    Code.CIRCUMFERENTIAL_REVERSED: (
        "the sign of its circumferential axis is opposite to that of a rolling tire: the tire rolled backwards or was "
        "reversed on its rim, or the axis is reversed"
    ),
    Code.BASELINE_UNFITTED: (
        "the baseline model cannot be fitted to it: its belt radius, load or pressure is not as stated"
    ),
    Code.CONTACT_UNLIKE_OTHERS: (
        "its contact half angle is {angle_rad:.1f deg}, that of {count} others with the same stated load and pressure "
        "{other_rad:.1f deg}: its load, pressure or tire is not as stated"
    ),
    Code.CONTACTS_CONTRADICT: (
        "contact half angle {short_rad:.1f deg} in {short}, {long_rad:.1f deg} in {long}: load, pressure or tire is "
        "not as stated"
    ),
    Code.NUMBERS_CONTRADICT: (
        "{number} is {low:.3g} in {recording} alone and {high:.3g} in {other}, beyond their errors: tire, load or "
        "pressure is not as stated; no number is determined"
    ),
    Code.LATERAL_OPPOSITE: (
        "the lateral waveforms of {recording} and {other} are opposite: the lateral axis of one is reversed, or its "
        "sensor or tire is turned round"
    ),
    Code.LATERAL_OPPOSITE_TO_OTHERS: (
        "its lateral waveform is the opposite of that of {count} others: its lateral axis is reversed, or its sensor "
        "or tire is turned round"
    ),
    Code.LOADS_CONTRADICT: (
        "Cw, which no load changes, is {low:.4g} to {high:.4g}: a stated load or pressure is {share:.1%} off; all "
        "errors contain that"
    ),
    Code.RADIUS_UNLIKE_OTHERS: (
        "its belt radius is stated as {radius_m:.1f mm}, that of {count} others as {other_m:.1f mm}"
    ),
    Code.WIDTH_UNLIKE_OTHERS: (
        "Cw, which no load changes, is {value:.4g} in it and {other:.4g} in {count} others: its load or pressure is "
        "not as stated"
    ),
    Code.EDGES_ALIGNED: (
        "the contact edges of {revolutions} revolutions, held-out ones too, are aligned by up to {parameters} "
        "parameters of their own, whatever moves them; as recorded, the held-out rms is {before_mps2:.4g m/s²} before "
        "and {after_mps2:.4g m/s²} after"
    ),
    Code.FEW_REVOLUTIONS: "only {revolutions} revolutions: a pattern common to all of them may still be chance",
    Code.ONE_SPEED: "one speed only: effects that depend on speed cannot be separated from those that do not",
    Code.GROUPS_TOO_SHORT: (
        "no spectrum of the signal that does not repeat with the wheel: {groups} of {of} groups are too short"
    ),
    Code.NOISE_ROLLS_OFF: "the noise rolls off at about {corner_hz:.0f Hz}, as behind a low-pass filter",
}

# Printed unit: factor from SI.
_UNITS: Final = {
    "%": 100.0,
    "days": 1.0 / 86_400.0,
    "deg": math.degrees(1.0),
    "degC": 1.0,
    "K": 1.0,
    "h": 1.0 / 3_600.0,
    "g": 1.0 / STANDARD_GRAVITY_MPS2,
    "GB": 1e-9,
    "GHz": 1e-9,
    "Hz": 1.0,
    "kB": 1e-3,
    "kHz": 1e-3,
    "km": 1e-3,
    "km/h": 3.6,
    "kPa": 1e-3,
    "m": 1.0,
    "m/s²": 1.0,
    "MB": 1e-6,
    "min": 1.0 / 60.0,
    "mm": 1e3,
    "ms": 1e3,
    "ppm": 1e6,
    "N": 1.0,
    "s": 1.0,
    "us": 1e6,
}


# A standard error of more times the value says no more about it.
_MOST_TIMES: Final = 10.0


def _unsigned_zero(shown: str) -> str:
    """Return a printed number without the sign of a zero."""
    return shown[1:] if shown.startswith("-") and not any(digit in shown for digit in "123456789n") else shown


class _Template(string.Formatter):
    """`str.format` with units of display and nested reasons."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, Reason):
            return text(value)
        if isinstance(value, tuple):
            return ", ".join(self.format_field(item, format_spec) for item in value)
        if format_spec == "probability":
            return probability_text(value, ".2g")
        if format_spec == "series":
            # Sentences are about the value itself, not its logarithm.
            return label_of(str(value)).removeprefix("ln ")
        if format_spec == "times":
            return f"more than {_MOST_TIMES:g} times" if value > _MOST_TIMES else f"{value:.2g} times"
        if format_spec == " ":
            return f" {value}" if value else ""
        if isinstance(value, str) and not value.isprintable():
            # Text from a hub, a file or an error stays on its line and cannot control the terminal.
            value = escaped(value)
        number, _, unit = format_spec.partition(" ")
        if unit:
            return f"{_unsigned_zero(format(value * _UNITS[unit], number))} {unit}"
        shown = format(value, format_spec)
        return _unsigned_zero(shown) if isinstance(value, float) else shown


_FORMATTER: Final = _Template()


@lru_cache(maxsize=1024)
def text(reason: Reason) -> str:
    """Return a reason as a phrase without a full stop."""
    try:
        return _FORMATTER.vformat(TEMPLATES[reason.code], (), dict(reason.values))
    except (LookupError, TypeError, ValueError):  # a plug-in may give a code with values that are not the code's
        return str(reason.code)


def joined(reasons: Iterable[Reason]) -> str:
    """Return several reasons as one text, each once; empty when there are none."""
    return "; ".join(dict.fromkeys(text(reason) for reason in reasons))


def notice_text(notice: Notice) -> str:
    """Return a notice as one line: its subject, then its reason; a matter of security is marked as such."""
    said = f"{escaped(notice.subject)}: {text(notice.reason)}" if notice.subject else text(notice.reason)
    return f"SECURITY: {said}" if notice.level is Level.SECURITY else said


def as_json(reason: Reason) -> dict[str, Any]:
    """Return a reason as JSON: code, values (SI) and text."""
    values = {name: _plain(value) for name, value in reason.values}
    return {"code": str(reason.code), "values": values, "text": text(reason)}


def fields(code: Code) -> set[str]:
    """Return the names of the values that a code's template needs."""
    return {name for _, name, _, _ in string.Formatter().parse(TEMPLATES[code]) if name}


def _plain(value: Value) -> Any:
    if isinstance(value, Reason):
        return as_json(value)
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    # JSON has no number for what is not finite.
    return None if isinstance(value, float) and not math.isfinite(value) else value
