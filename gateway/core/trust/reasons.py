"""Reasons of doubt: what the signal says against what is stated, each with the template of its text."""

from typing import Final

from gateway.core.reasons import Code, Codes

WITNESSES: Final = {
    "track": "the speeds of its axle say with the track width",
    "yaw_rate": "the yaw rate of the vehicle's bus says",
    "course": "the course of the receiver says",
    "wheels": "the other wheels do",
}
"""What turn rates are compared with."""


class TrustCode(Codes):
    """Reasons of doubt: what the signal says against what is stated."""

    # Of any estimator
    AC_COUPLED = Code("AC-coupled: the steady value is lost")
    AVERAGE_ERRORS_UNKNOWN = Code("the standard errors of the average are not known")
    AXIS_MISSING = Code("the sensor has no {axis} axis")
    AXIS_AGAINST_ROLLING = Code(
        "the {axis} axis points against the rolling direction: the tire rolls in reverse, or the sign of the axis is "
        "wrong; it is turned round here"
    )
    EFFECTS_NOT_SUBTRACTED = Code("known effects were not subtracted: {why}")

    # Of what the signal says against what is stated
    CONTACTS_MISSED = Code("finding only one contact in {every:.0f} revolutions would fit")
    AXES_SWAPPED = Code("the lateral and the circumferential axis are swapped: each reads what the other one should")
    AXIS_LATE = Code("the {axis} axis is {late_s:.2f ms} later than the radial one")
    AXIS_LATER_THAN_OTHERS = Code(
        "the {axis} axis is {late_s:.2f ms} ± {std_s:.2f ms} later behind the radial one than those of the other wheels"
    )
    COUPLING_CONTRADICTED = Code(
        "the sensor is AC-coupled, but stated as DC-coupled: its steady radial value is {share:.2f} ± {std:.2f} "
        "times what the contact shows; state its coupling as AC"
    )
    ERROR_COVERS = Code("{why}; the standard error covers the difference")
    GAIN_WOULD_FIT = Code("a gain of {gain:.3f} would fit")
    GRAVITY_ABSENT = Code(
        "the {axis} axis is not connected, or not the axis along the belt (it shows {share:.2f} ± {std:.1g} of gravity "
        "as it turns)"
    )
    GRAVITY_CONTRADICTED = Code(
        "the gain of the radial axis is {gain:.2f} ± {std:.2f} times the stated one, as gravity shows"
    )
    MAY_CHANGE_BY = Code("may be wrong by {effect:.1%}: {why}")
    NOT_POSSIBLE = Code("{quantity} is beyond what is possible")
    NO_SINGLE_CAUSE = Code("no single cause fits")
    NOTHING_FOLLOWS = Code("not determined: {why}")
    HUB_MOVES = Code(
        "the hub moves by {amplitude_mps2:.2g m/s²} once a turn, or the wheel turns unevenly: the error includes it"
    )
    OFFSET_CONTRADICTED = Code(
        "the sensor is stated {stated_m:.1f mm} ± {stated_std_m:.1f mm} below the neutral layer, the circumferential "
        "axis gives {offset_m:.2f mm} ± {std_m:.2f mm}"
    )
    OFFSET_UNKNOWN = Code(
        "offset of the sensor not known (set offset_mm of its mounting): the error includes {std_m:.0f mm}"
    )
    RADIUS_WOULD_FIT = Code("a belt radius of {radius_m:.0f mm} would fit ({stated_m:.0f mm} stated)")
    RATE_WOULD_FIT = Code("a sampling rate of {rate_hz:.0f Hz} would fit ({stated_hz:.0f Hz} stated)")
    STEADY_VALUE_CONTRADICTED = Code(
        "the steady radial value is {ratio:.3f} ± {std:.3f} times that of speed and belt radius: {causes}"
    )
    STEADY_VALUE_DISAGREES = Code(
        "the belt radius may not be as stated: the error includes {error:.1%} for it (the steady radial value is "
        "{ratio:.3f} ± {std:.3f} times that of speed and belt radius)"
    )
    UNIT_IS_G = Code("values in g taken for m/s² would fit")
    UNIT_IS_MPS2 = Code("values in m/s² taken for g would fit")
    ZERO_CONTRADICTED = Code(
        "the zero-g offset is {zero_mps2:.1f m/s²} ± {std_mps2:.1f m/s²} by several speeds, beyond its stated error of "
        "{stated_std_mps2:.1f m/s²}"
    )
    ZERO_WOULD_FIT = Code("a zero-g offset of {zero_mps2:.0f m/s²} would fit")

    # Of forces
    FORCE_NOT_DETERMINED = Code(
        "not determined: the standard error is {share:.1%} of the load, the limit {limit:.0%} or a third of the force"
    )

    # Of the lateral axis
    LATERAL_AXIS_REVERSED = Code(
        "the lateral axis points to the right, or the positions are not as stated: where the axis says that this is "
        "the inner wheel of a curve, it rolls faster than {other}"
    )
    LATERAL_SIGN_UNVERIFIED = Code("the sign is not verified (state lateral_is_left of the mounting)")
    LATERAL_SLIP_APART = Code(
        "the lateral axis of this wheel or of {other} points the wrong way, or their positions are not as stated: "
        "they slip to opposite sides in {opposite:.0f} revolutions, to the same side in {same:.0f}"
    )
    TURNS_OPPOSITE = Code(
        "the lateral axis points to the right, or the position is not as stated: it turns to the other side than "
        "{witness}",
        witness=WITNESSES,
    )
    WHEELS_ROLL_APART = Code(
        "the belt radius or the sampling rate of this wheel or of {other} is not as stated: it rolls {ratio:.3f} ± "
        "{std:.3f} times as fast, more than in a curve"
    )
    YAW_RATE_REVERSED = Code(
        "the yaw rate of the vehicle's bus has the other sign than the speeds of the axle in curves (state factor = -1 "
        "of its signal)"
    )

    # Of the sensor's calibration
    FLAT_CONTACT_ASSUMED = Code("AC-coupled: from the contact, assumed to be flat (flat road)")
    NEEDS_TEMPERATURE_CHANGE = Code("needs a change of temperature")
    NEEDS_TWO_SPEEDS = Code("needs two speeds: {quantity} and zero-g offset are not separated yet")
    NO_REVOLUTION_YET = Code("no revolution yet")
    NOT_FINITE = Code("the result is not finite")
    OTHER_OFFSET_STATED = Code("the vehicle file states {stated_m:.1f mm}")

    # Of the road
    NEEDS_REVOLUTIONS = Code("needs {needed:.0f} revolutions, {count:.0f} so far")

    # Sensors
    AXIS_READS = Code("{axis} at {counts:.0f}")
    PRESSURE_FROZEN = Code(
        "the pressure has not changed while the temperature changed by {temperature_change_k:.0f} K; it may be "
        "off by {error_pa:.0f kPa}"
    )
    SAMPLES_HELD = Code(
        "every value stays for {count:.0f} samples: the band ends at {ratio:.0f} times the wheel's frequency"
    )
    SENSOR_AC_CORNER = Code(
        "the sensor's AC coupling moves the numbers: its corner, {ratio:.2f} of the wheel's frequency, has a tolerance"
    )
    SENSOR_BAND = Code(
        "the sensor is too slow for this speed: its band ends at {ratio:.0f} times the wheel's frequency, which biases "
        "contact length and bending stiffness number (Bs)"
    )
    SENSOR_DEAD = Code("every axis reads 0: the sensor is dead or its element has no supply")
    SENSOR_FLIPPED = Code("the radial axis points outward; its sign is corrected here")
    SENSOR_LOOSE = Code(
        "rings at {frequency_hz:.0f Hz} after every contact with {share:.0%} of the steady value: the sensor "
        "may have come loose; do not trust contact lengths and tire numbers"
    )
    SENSOR_STEPS = Code(
        "the sensor's steps of {step_mps2:.2g m/s²} are more than twice the noise, which biases the numbers"
    )
    SENSOR_STUCK = Code("does not move by one count for {duration_s:.0f s}: {axes} counts")
    SENSOR_TILTED = Code(
        "the {axis} axis carries the steady value of the radial axis: tilted by {tilt_rad:.0f deg}, or the axes "
        "are swapped"
    )
