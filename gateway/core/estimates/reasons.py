"""Reasons of estimates, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class EstimateCode(Codes):
    """Reasons of estimates."""

    # Revolutions
    CONTACT_INTERPOLATED = Code("a contact was lost or disturbed by an impact: its time is taken from its neighbours")
    CONTACT_NOT_SEEN = Code("samples of a contact were lost: where it begins and ends is taken from an earlier one")
    RADIAL_SATURATED = Code("the radial axis reached the end of its range")
    SAMPLES_LOST = Code("samples were lost on the link")

    # Plug-ins
    PLUGIN_FAILED = Code("the plug-in failed: {error}")
    PLUGIN_FIELD_REFUSED = Code("the plug-in gave an estimate whose {field} cannot be used: {given}")
    PLUGIN_GAVE_NO_REASON = Code("the plug-in gives no reason")
    PLUGIN_NAME_DIFFERS = Code("it calls itself {name}")
    PLUGIN_QUANTITY_TAKEN = Code("its quantity {name} is that of {by}")

    # Of any estimator
    EDGE_ERRORS_UNKNOWN = Code("the standard errors of the contact edges are not known")
    NEEDS_PRESSURE = Code(
        "needs the pressure (set pressure_kpa of the tire in the vehicle file, or use a sensor that reports it)"
    )
    NO_CONTACT_EDGES = Code("no contact edges were found")
    REVOLUTION_NOT_USED = Code("this revolution was not used: {faults}")
    SPEED_OR_RADIUS_UNKNOWN = Code("the angular speed or the belt radius is not known")

    # Of what the signal says against what is stated
    SCALE_BY_WIDTH = Code(
        "load, pressure and belt radius are together known within {error:.1%}, better than stated: Cw is {ratio:.3f} ± "
        "{std:.3f} times that of the new tire"
    )
    WIDTH_CONTRADICTED = Code(
        "load, pressure or belt radius is not as stated: Cw, which wear does not change, is {ratio:.3f} ± {std:.3f} "
        "times that of the new tire; check the vehicle file"
    )
    WIDTH_DISAGREES = Code(
        "load, pressure or belt radius may not be as stated: the error includes {error:.1%} for it (Cw is "
        "{ratio:.3f} ± {std:.3f} times that of the new tire)"
    )

    # Of distance
    DISTANCE_BRIDGED = Code(
        "{distance_m:.0f m} ± {std_m:.0f m} of it was not measured, in {duration_s:.0f s} without revolutions: taken "
        "from the speeds before and after"
    )
    DISTANCE_INTERRUPTED = Code("the hub restarted {count:.0f} times; what was rolled meanwhile is missing")

    # Of load and wear
    BENDING_NOT_POSITIVE = Code("the bending stiffness is not positive")
    CORRECTED_FOR_BENDING = Code("corrected for a bending stiffness {change:+.0%} from that of the calibration")
    CORRECTED_FOR_WEAR = Code("corrected for {wear_m:.1f mm} of wear since the calibration")
    FROM_BELT_WIDTH = Code("from the belt width")
    FROM_CONTACT_ANGLE = Code("from contact angle and pressure")
    FROM_RATIO = Code("from {ratio}, because the load is not known")
    HALF_ANGLE_OUTSIDE_CALIBRATION = Code(
        "the contact half angle {half_angle_rad:.1f deg} is outside the calibrated {low_rad:.1f deg} to "
        "{high_rad:.1f deg}"
    )
    LOAD_CONTRADICTED = Code("contradicts the stated load, {stated_n:.0f N} ± {stated_std_n:.0f N}")
    LOADS_DISAGREE = Code(
        "loads by contact angle, {angle_n:.0f N}, and by belt width, {width_n:.0f N}, disagree: the error includes it"
    )
    NEEDS_ESTIMATOR = Code("needs the estimator {estimator}, which made the reference numbers")
    NEEDS_LOAD_CALIBRATION = Code("needs tire.load_calibration in the vehicle file (treadlink calibrate)")
    NEEDS_REFERENCE_NUMBER = Code(
        "needs {number} of the new tire, tire.reference in the vehicle file (treadlink calibrate)"
    )
    NEEDS_RING_THICKNESS = Code("needs ring_thickness_mm of the tire in the vehicle file")
    NEEDS_WEAR_VALUES = Code("needs {revolutions:.0f} revolutions with valid wear")
    NO_LOAD_FROM_BELT_WIDTH = Code("not from the belt width: {why}")
    NO_LOAD_FROM_CONTACT_ANGLE = Code("not from the contact angle: {why}")
    NUMBER_MISSING = Code("the estimator {estimator} does not give {number}")
    OVER_REVOLUTIONS = Code("over {revolutions:.0f} revolutions")
    PRESSURE_NOT_COMPENSATED = Code("pressure not compensated")
    PRESSURE_OUTSIDE_CALIBRATION = Code(
        "the pressure {pressure_pa:.0f kPa} is outside the calibrated {low_pa:.0f kPa} to {high_pa:.0f kPa}"
    )
    TEMPERATURE_NOT_COMPENSATED = Code(
        "temperature not compensated, its error assumes a difference of {difference_k:.0f K}"
    )
    UNKNOWN_ESTIMATOR = Code("tire.reference names '{estimator}', which is not an estimator")
    WEAR_CONTRADICTED = Code("contradicts the stated wear of {stated_m:.1f mm} ± {stated_std_m:.1f mm}")
    WEAR_UNKNOWN = Code("wear since the calibration is not known: an error of {relative_error:.0%} is included")
    WEARS_DISAGREE = Code(
        "wear by Bs, {number_m:.1f mm}, and by Bs/Cw, {ratio_m:.1f mm}, disagree: the error includes it"
    )

    # Of the lateral axis
    SIGN_NOT_DETERMINED = Code("the sign is not determined: {errors:.1f} standard errors from zero")
    SIGN_WITHOUT_ERROR = Code("the sign is not determined: the standard error is not known yet")

    # Rows of a dataset
    ROW_SCATTERS = Code(
        "it varied within the recording: the mean says little, and its standard error contains the scatter"
    )
