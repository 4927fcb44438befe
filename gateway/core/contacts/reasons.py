"""Reasons of contacts, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class ContactCode(Codes):
    """Reasons of contacts."""

    CONTACTS_NOT_ALIKE = Code(
        "no three contacts in a row are alike, as of a rolling wheel (radial axis: mean {mean_mps2:.0f m/s²}, "
        "standard deviation {std_mps2:.0f m/s²})"
    )
    NO_CONTACT_IN_AC_SIGNAL = Code(
        "no contact with the road is seen: is the sensor on the rim, or the wheel without load? (The AC-coupled "
        "radial axis falls by {depth_mps2:.0f m/s²}, its rotation has a centripetal acceleration of "
        "{expected_mps2:.0f m/s²})"
    )
    NO_CONTACT_SEEN = Code(
        "no contact with the road is seen: is the sensor on the rim, or the wheel without load? (The radial axis has "
        "a mean of {mean_mps2:.0f m/s²} and never falls below {lowest_mps2:.0f m/s²})"
    )
    RADIAL_AT_RANGE_END = Code(
        "the range of the sensor is too small: {share:.0%} of the samples are at its end, {level_mps2:.0f m/s²}"
    )
    RADIAL_IS_IN_G = Code(
        "the unit of the radial axis is g, not m/s²: it reads {level_mps2:.0f m/s²}, {ratio:.3f} of the "
        "{expected_mps2:.0f m/s²} of its rotation (a rate of {fitting_hz:.0f Hz} would fit as well)"
    )
    RADIAL_IS_IN_MPS2 = Code(
        "the unit of the radial axis is m/s², not g: it reads {level_mps2:.0f m/s²}, {ratio:.2f} times the "
        "{expected_mps2:.0f m/s²} of its rotation (a rate of {fitting_hz:.0f Hz} would fit as well)"
    )
    RADIAL_OUTWARD = Code("the radial axis points outward, its mean is {mean_mps2:.0f m/s²}: reverse its sign")
    RADIAL_SCALE_DOES_NOT_FIT = Code(
        "the scale or the unit of the radial axis is wrong: it reads {level_mps2:.3g m/s²}, {ratio:.3g} times the "
        "{expected_mps2:.0f m/s²} of its rotation, too far for a wrong rate"
    )
    RATE_DOES_NOT_FIT = Code(
        "the sampling rate is not {rate_hz:.0f Hz}, {fitting_hz:.0f Hz} would fit: the radial axis reads "
        "{level_mps2:.0f m/s²}, {ratio:.3g} times the {expected_mps2:.0f m/s²} of its rotation"
    )
    SAMPLES_INTERRUPTED = Code(
        "samples were lost too often: at most {duration_s:.1f s} are without a gap, {needed_s:.1f s} are needed"
    )
    SAMPLES_TOO_SHORT = Code("three revolutions take {needed_s:.1f s}, but the samples last {duration_s:.1f s}")
    WHEEL_STANDS = Code(
        "the wheel stands still: the radial axis is {mean_mps2:.1f m/s²} with a standard deviation of "
        "{std_mps2:.1f m/s²}"
    )
    WHEEL_TOO_SLOW = Code(
        "the wheel rolls at about {speed_mps:.0f km/h}: contacts can be seen from {limit_mps:.0f km/h} on"
    )
