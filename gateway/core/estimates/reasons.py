"""Reasons of estimates, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class EstimateCode(Codes):
    """Reasons of estimates."""

    CONTACT_INTERPOLATED = Code("a contact was lost, or disturbed by an impact: its time is taken from its neighbours")
    CONTACT_NOT_SEEN = Code("samples of a contact were lost: its begin and end are taken from an earlier one")
    RADIAL_SATURATED = Code("the radial axis reached the end of its range")
    SAMPLES_LOST = Code("samples were lost on the link")
    PLUGIN_FAILED = Code("the plug-in failed: {error}")
    PLUGIN_FIELD_REFUSED = Code("the plug-in returned an estimate whose {field} cannot be used: {given}")
    PLUGIN_GAVE_NO_REASON = Code("the plug-in gives no reason")
    EDGE_ERRORS_UNKNOWN = Code("the standard errors of where the contact begins and ends are not known")
    NEEDS_PRESSURE = Code(
        "the pressure is not known: set pressure_kpa of the tire in the vehicle file, or use a sensor that measures it"
    )
    NO_CONTACT_EDGES = Code("begin and end of the contact are not seen in the signal")
    REVOLUTION_NOT_USED = Code("this revolution was not used: {faults}")
    SPEED_OR_RADIUS_UNKNOWN = Code("the angular speed or the belt radius is not known")
    SCALE_BY_WIDTH = Code(
        "load, pressure and belt radius are together known within {error:.1%}, better than stated (contact width "
        "number Cw is {ratio:.3f} ± {std:.3f} times that of the new tire)"
    )
    WIDTH_CONTRADICTED = Code(
        "load, pressure or belt radius is not as stated: check the vehicle file (contact width number Cw, which wear "
        "does not change, is {ratio:.3f} ± {std:.3f} times that of the new tire)"
    )
    WIDTH_DISAGREES = Code(
        "load, pressure or belt radius may not be as stated: the error includes {error:.1%} for it (contact width "
        "number Cw is {ratio:.3f} ± {std:.3f} times that of the new tire)"
    )
    DISTANCE_BRIDGED = Code(
        "{distance_m:.0f m} ± {std_m:.0f m} of it was not measured: it is taken from the speeds before and after "
        "{duration_s:.0f s} without revolutions"
    )
    DISTANCE_INTERRUPTED = Code("the hub restarted {count:.0f} times: the distance rolled meanwhile is missing")
    BENDING_NOT_POSITIVE = Code("the bending stiffness number (Bs) is not positive")
    CORRECTED_FOR_BENDING = Code(
        "corrected for a bending stiffness number (Bs) {change:+.0%} from that of the calibration"
    )
    CORRECTED_FOR_WEAR = Code("corrected for {wear_m:.1f mm} of wear since the calibration")
    FROM_BELT_WIDTH = Code("from the contact width number (Cw)")
    FROM_CONTACT_ANGLE = Code("from contact angle and pressure")
    FROM_RATIO = Code("from {ratio}, because the load is not known")
    HALF_ANGLE_OUTSIDE_CALIBRATION = Code(
        "the contact half angle {half_angle_rad:.1f deg} is outside the calibrated {low_rad:.1f deg} to "
        "{high_rad:.1f deg}"
    )
    LOAD_CONTRADICTED = Code("the stated load does not agree: {stated_n:.0f N} ± {stated_std_n:.0f N}")
    LOADS_DISAGREE = Code(
        "the load is {angle_n:.0f N} by the contact angle and {width_n:.0f N} by the contact width number (Cw): the "
        "error includes the difference"
    )
    NEEDS_ESTIMATOR = Code("needs the estimator {estimator}: add --estimator {estimator}")
    NEEDS_LOAD_CALIBRATION = Code(
        "the load is not calibrated: `treadlink calibrate` makes tire.load_calibration of the vehicle file"
    )
    NEEDS_REFERENCE_NUMBER = Code(
        "{number} of the new tire is not known: `treadlink calibrate` makes tire.reference of the vehicle file"
    )
    NEEDS_RING_THICKNESS = Code(
        "the thickness of belt and tread is not known: set ring_thickness_mm of the tire in the vehicle file"
    )
    NEEDS_WEAR_VALUES = Code("needs {revolutions:.0f} revolutions with a valid wear")
    NO_LOAD_FROM = Code(
        "not from the {source}: {why}",
        source={
            "belt_width": "contact width number (Cw)",
            "contact_angle": "contact angle",
        },
    )
    NUMBER_MISSING = Code("the estimator {estimator} does not give {number}")
    OVER_REVOLUTIONS = Code("mean over {revolutions:.0f} revolutions")
    PRESSURE_NOT_COMPENSATED = Code("not corrected for pressure")
    PRESSURE_OUTSIDE_CALIBRATION = Code(
        "the pressure {pressure_pa:.0f kPa} is outside the calibrated {low_pa:.0f kPa} to {high_pa:.0f kPa}"
    )
    TEMPERATURE_NOT_COMPENSATED = Code(
        "not corrected for temperature: its error assumes a difference of {difference_k:.0f K}"
    )
    UNKNOWN_ESTIMATOR = Code("tire.reference names '{estimator}', which is not an estimator")
    WEAR_CONTRADICTED = Code("the stated wear does not agree: {stated_m:.1f mm} ± {stated_std_m:.1f mm}")
    WEAR_UNKNOWN = Code("wear since the calibration is not known: the error includes {relative_error:.0%} for it")
    WEARS_DISAGREE = Code(
        "wear is {number_m:.1f mm} by Bs and {ratio_m:.1f mm} by Bs/Cw: the error includes the difference"
    )
    SIGN_NOT_DETERMINED = Code(
        "its sign is not determined: {why}",
        why={
            "near_zero": "it is {errors:.1f} standard errors from zero",
            "no_error": "its standard error is not known yet",
        },
    )
    ROW_SCATTERS = Code("it varied within the recording: its standard error contains the scatter")
