"""Reasons of doubt: what the signal says against what is stated, each with the template of its text."""

from typing import Final

from gateway.core.reasons import Code, Codes

WITNESSES: Final = {
    "track": "the speeds of its axle and the track width say",
    "yaw_rate": "the yaw rate of the vehicle's bus says",
    "course": "the course of the receiver says",
    "wheels": "the other wheels do",
}
"""What turn rates are compared with."""


class TrustCode(Codes):
    """Reasons of doubt: what the signal says against what is stated."""

    AC_COUPLED = Code("the sensor is AC-coupled: its steady value is lost")
    AVERAGE_ERRORS_UNKNOWN = Code("the standard errors of the average are not known")
    AXIS_MISSING = Code("the sensor has no {axis} axis")
    AXIS_AGAINST_ROLLING = Code(
        "the {axis} axis points against the rolling direction: the tire rolls in reverse, or the sign of the axis is "
        "wrong; its sign is corrected here"
    )
    EFFECTS_NOT_SUBTRACTED = Code("known effects are not subtracted: {why}")
    WOULD_FIT = Code(
        "{what} would fit",
        what={
            "contacts": "one detected contact in {every:.0f} revolutions",
            "g": "values in g that were taken for m/s²",
            "gain": "a gain of {gain:.3f}",
            "mps2": "values in m/s² that were taken for g",
            "radius": "a belt radius of {radius_m:.0f mm} in place of {stated_m:.0f mm} (stated)",
            "rate": "a sampling rate of {rate_hz:.0f Hz} in place of {stated_hz:.0f Hz} (stated)",
            "zero": "a zero-g offset of {zero_mps2:.0f m/s²}",
        },
    )
    AXES_SWAPPED = Code("the lateral and the circumferential axis are swapped: each reads what the other should")
    AXIS_LATE = Code("the {axis} axis is {late_s:size .2f ms} {late_s:later} than the radial one")
    AXIS_LATER_THAN_OTHERS = Code(
        "the {axis} axis is {late_s:size .2f ms} ± {std_s:.2f ms} {late_s:later} against the radial one than on the "
        "other wheels"
    )
    COUPLING_CONTRADICTED = Code(
        "the sensor is AC-coupled, but stated as DC-coupled: state AC (its steady radial value is {share:.2f} ± "
        "{std:.2f} times what the contact shows)"
    )
    ERROR_COVERS = Code("{why}; the standard error includes the difference")
    GRAVITY_ABSENT = Code(
        "the {axis} axis is not connected, or not the axis along the belt (it shows {share:.2f} ± {std:.1g} of gravity "
        "as it turns)"
    )
    GRAVITY_CONTRADICTED = Code(
        "the gain of the radial axis is not as stated: gravity reads {gain:.2f} ± {std:.2f} times its value"
    )
    MAY_CHANGE_BY = Code("may be wrong by {effect:.1%}: {why}")
    NOT_POSSIBLE = Code("{quantity} is outside what is possible")
    NO_SINGLE_CAUSE = Code("no single cause fits")
    NOTHING_FOLLOWS = Code("not determined: {why}")
    HUB_MOVES = Code(
        "the hub moves by {amplitude_mps2:.2g m/s²} once a turn, or the wheel turns unevenly: the error includes it"
    )
    OFFSET_CONTRADICTED = Code(
        "the sensor is not as far below the neutral layer as stated: {offset_m:.2f mm} ± {std_m:.2f mm} by the "
        "circumferential axis, {stated_m:.1f mm} ± {stated_std_m:.1f mm} (stated)"
    )
    OFFSET_UNKNOWN = Code(
        "the depth of the sensor below the neutral layer is not known: set offset_mm of its mounting (the error "
        "includes {std_m:.0f mm})"
    )
    STEADY_VALUE_CONTRADICTED = Code(
        "speed, belt radius or sensor is not as stated: {causes} (the steady radial value is {ratio:.3f} ± {std:.3f} "
        "times that of speed and belt radius)"
    )
    STEADY_VALUE_DISAGREES = Code(
        "the belt radius may not be as stated: the error includes {error:.1%} for it (the steady radial value is "
        "{ratio:.3f} ± {std:.3f} times that of speed and belt radius)"
    )
    ZERO_CONTRADICTED = Code(
        "the zero-g offset is beyond its stated error: {zero_mps2:.1f m/s²} ± {std_mps2:.1f m/s²} by several speeds, "
        "{stated_std_mps2:.1f m/s²} (stated)"
    )
    FORCE_NOT_DETERMINED = Code(
        "not determined: the standard error is {share:.1%} of the load (at most {limit:.0%}, or a third of the force, "
        "is accepted)"
    )
    LATERAL_AXIS_REVERSED = Code(
        "the lateral axis points to the right, or the positions are not as stated: this wheel rolls faster than "
        "{other} in curves of which its axis says that it is the inner one"
    )
    LATERAL_SIGN_UNVERIFIED = Code("the sign is not verified: `treadlink doctor RECORDING` says what shows it")
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
    FLAT_CONTACT_ASSUMED = Code("AC-coupled: from the contact, assumed to be flat (flat road)")
    NEEDS_TEMPERATURE_CHANGE = Code("the temperature has not changed enough yet")
    NEEDS_TWO_SPEEDS = Code("needs two speeds: {quantity} and zero-g offset are not separated yet")
    NO_REVOLUTION_YET = Code("no revolution is complete yet")
    NOT_FINITE = Code("the result is not finite")
    OTHER_OFFSET_STATED = Code("the vehicle file has {stated_m:.1f mm} (stated)")
    NEEDS_REVOLUTIONS = Code("needs {needed:.0f} revolutions, {count:.0f} so far")
    AXIS_READS = Code("{axis} at {counts:.0f}")
    PRESSURE_FROZEN = Code(
        "the pressure sensor may be stuck, and be off by {error_pa:.0f kPa}: its pressure did not change while the "
        "temperature changed by {temperature_change_k:.0f K}"
    )
    SAMPLES_HELD = Code(
        "every value is sent {count:.0f} times in a row: the band ends at {ratio:.0f} times the wheel's frequency"
    )
    SENSOR_AC_CORNER = Code(
        "the numbers are biased by the sensor's AC coupling: its corner is at {ratio:.2f} of the wheel's frequency, "
        "and has a tolerance"
    )
    SENSOR_BAND = Code(
        "the sensor is too slow for this speed: its band ends at {ratio:.0f} times the wheel's frequency, which biases "
        "contact length and bending stiffness number (Bs)"
    )
    SENSOR_DEAD = Code("the sensor is dead or has no supply: every axis reads 0")
    SENSOR_FLIPPED = Code("the radial axis points outward: its sign is corrected here")
    SENSOR_LOOSE = Code(
        "the sensor may have come loose: do not trust contact lengths and tire numbers (it rings at {frequency_hz:.0f "
        "Hz} after every contact with {share:.0%} of the steady value)"
    )
    SENSOR_STEPS = Code(
        "the sensor is too coarse, which biases the numbers: its steps of {step_mps2:.2g m/s²} are more than twice "
        "the noise"
    )
    SENSOR_STUCK = Code("the sensor is stuck: {axes} counts, unchanged for {duration_s:.0f s}")
    SENSOR_TILTED = Code(
        "the sensor is tilted by {tilt_rad:.0f deg}, or its axes are swapped: the {axis} axis has the steady value of "
        "the radial one"
    )
