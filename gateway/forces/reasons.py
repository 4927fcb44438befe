"""Reasons of forces, each with the template of its text."""

from gateway.core.reasons import Code, Codes
from gateway.core.trust.reasons import WITNESSES


class ForceCode(Codes):
    """Reasons of forces."""

    AC_CORNER_NOT_STATED = Code("the corner of the AC-coupled sensor is not stated, and turns the lowest orders")
    ASYMMETRY_NOT_BALANCED = Code(
        "a stone, water or waves make the signal asymmetric: {share:.0%} of it is not that of a belt, at most "
        "{limit:.0%} is accepted"
    )
    BEYOND_FRICTION = Code(
        "no friction carries that: {force:.1f} times the load as force and {torque:.1f} times load and radius as torque"
    )
    FRICTION_OF_LONGITUDINAL_ONLY = Code("of the longitudinal force alone")
    NEEDS_SIDE_FORCE_CALIBRATION = Code(
        "the side force is not calibrated: `treadlink calibrate side-force` makes tire.side_force_calibration of the "
        "vehicle file"
    )
    SLIP_LIMIT_NOT_DETERMINED = Code(
        "not determined, {low:.0%} to {high:.0%} is possible: the shape of the contact pressure is not known (the "
        "side force acts {trail_m:.1f mm} ± {std_m:.1f mm} behind the contact centre)"
    )
    SLIP_NOT_LATERAL = Code("the slip is not lateral: the longitudinal force is {ratio:.1f} times the side force")
    TIRE_GIVES_ENERGY = Code(
        "run-out, or something else that turns with the tire, looks like a force: the tire would not lose energy but "
        "supply {share:.1%} ± {std:.1%} of the load"
    )
    SIDE_FORCE_PRESSURE_UNKNOWN = Code(
        "the pressure of the side force calibration, or that of the tire, is not known: calibrate again, or state "
        "pressure_min_kpa and pressure_max_kpa of its runs"
    )
    CONICITY_NOT_SEPARATED = Code("slip, ply steer or noise may look like it: roll in both directions, without slip")
    FROM_AXIS_MEANS = Code("from the means of the lateral and the radial axis")
    FROM_LAMINATE = Code(
        "from tire.laminate, for a belt that does not twist (B16 / A66 = {length_m:.2f mm} ± {length_std_m:.2f mm})"
    )
    INCLUDES_CONICITY = Code("contains the conicity")
    LAMINATE_DIFFERS = Code(
        "check cord angles, order of the plies, conicity, slip, or a belt that twists: it differs from the measured "
        "peak, {measured_rad:.3f deg} ± {measured_std_rad:.3f deg}, by {errors:.1f} standard errors"
    )
    LAMINATE_NOT_BALANCED = Code(
        "the plies are not at opposite angles (A16 / A66 = {share:.2f}): tension shears the belt as well (Eq. 11)"
    )
    LATERAL_ZERO_CONTRADICTED = Code(
        "beyond the stated error of the sensor's zero, {stated_std_mps2:.1f m/s²}: a degree of camber is 0.17 m/s²"
    )
    NEEDS_BOTH_SLIPS = Code("needs {needed:.0f} revolutions each at left and at right slip")
    ORDERS_USED = Code("orders {first:.0f} to {last:.0f}")
    ROLL_CONTRADICTED = Code(
        "the stated roll does not agree, {stated_rad:.1f deg} ± {stated_std_rad:.1f deg} (mounting.roll_deg): the "
        "measured one is used"
    )
    ROLL_NOT_CALIBRATED = Code(
        "the roll of an AC-coupled sensor cannot be calibrated: the error includes {assumed_rad:.0f deg}"
    )
    ROLL_UNLIKELY = Code(
        "the sensor is rolled (state mounting.roll_deg), or the zero of its lateral axis is wrong (record two "
        "speeds): its means show a roll of {roll_rad:.1f deg}, {expected_rad:.1f deg} ± {expected_std_rad:.1f deg} is "
        "expected"
    )
    SCATTER_UNKNOWN = Code("the scatter is not known before {needed:.0f} revolutions")
    SLIP_BEYOND_LAW = Code("the slip angle is beyond those of the slip calibration")
    SLIP_OUTSIDE_CALIBRATION = Code(
        "the slip angle {slip_rad:.2f deg} is outside the calibrated {low_rad:.2f deg} to {high_rad:.2f deg}"
    )
    STRAIGHT_NOT_SHOWN = Code(
        "a steady turn looks like the tire's own first order: drive {needed:.0f} changes between straight and curve, "
        "{changes:.0f} so far"
    )
    SPEED_UNUSABLE = Code("the speed is not known, or too high for the sampling rate")
    ZERO_SLIP_GIVEN = Code("zero slip is that of tire.slip_calibration")
    ZERO_SLIP_IS_MEAN = Code(
        "zero slip is the mean of the latest revolutions, so constant slip is not seen: `treadlink calibrate slip` "
        "shows it"
    )
    ZERO_SLIP_NOT_SETTLED = Code("zero slip is settling: {revolutions:.0f} of {needed:.0f} revolutions")
    AT_WHEEL_ORDER = Code("it is at order {order:.0f} of the wheel, and may turn with it")
    IN_BAND = Code("{low_hz:.0f Hz} to {high_hz:.0f Hz}, sensor noise included")
    NEEDS_UNINTERRUPTED_ROLLING = Code("needs {duration_s:.0f s} of rolling without an interruption")
    NO_LINE = Code("no line stands out of the spectrum")
    GRADE_NOT_CHANGED = Code(
        "a steady grade looks like a first order that is constant in the tire: drive where the grade changes "
        "({shared_std_rad:.2f deg} of the error are by it)"
    )
    NO_GRAVITY_ALONG = Code(
        "the circumferential axis points elsewhere, or backward: it reads {share:.1f} times gravity along the belt"
    )
    CAVITY_CONTRADICTED = Code(
        "gas, cavity_length_mm or temperature is not as stated, or the line is another one: the inner liner reads "
        "{measured_degc:.0f degC}, the cavity resonates as air of {found_degc:.0f degC} would ({ratio:.2f} times "
        "gamma / M of air)"
    )
    NEEDS_CAVITY_LENGTH = Code(
        "the length of the cavity is not known: set cavity_length_mm, or a size with the rim, of the tire in the "
        "vehicle file"
    )
    NEEDS_TEMPERATURE = Code("the temperature is not known")
    ROAD_BELOW_NOISE = Code("class {letter} or better: the road is below the jitter of the contact edges")
    ROAD_CLASS = Code("class {letter} with a probability of {probability:.0%}, if G falls with n²")
    ROAD_WAVES = Code("from waves of {short_m:.1f m} to {long_m:.1f m}")
    TOO_SLOW_FOR_ROAD = Code("too slow: needs {limit_mps:.0f km/h} and more")
    LATERAL_GAIN_CONTRADICTED = Code(
        "the gain of the lateral axis, or the wheel's position, is not as stated: in curves it turns {gain:.2f} ± "
        "{std:.2f} times as fast as {witness}",
        witness=WITNESSES,
    )
    TURNS_UNRELATED = Code(
        "the wheel is not where the vehicle file states it, or its lateral axis is another: in curves it does not "
        "turn as {witness}",
        witness=WITNESSES,
    )
    WHEELS_TURN_APART = Code(
        "the gain of the lateral axis of this wheel or of {other}, or its position, is not as stated: it turns "
        "{ratio:.2f} ± {std:.2f} times as fast, on the same body"
    )
