"""Reasons of forces, each with the template of its text."""

from gateway.core.reasons import Code, Codes
from gateway.core.trust.reasons import WITNESSES


class ForceCode(Codes):
    """Reasons of forces."""

    # Of any estimator
    AC_CORNER_NOT_STATED = Code("AC-coupled with a corner that is not stated, by which the lowest orders are turned")

    # Of forces
    ASYMMETRY_NOT_BALANCED = Code(
        "a stone, water or waves make the signal asymmetric ({share:.0%} of it remain in the balance of a belt, the "
        "limit is {limit:.0%})"
    )
    BEYOND_FRICTION = Code(
        "no friction carries {force:.1f} times the load as force and {torque:.1f} times load and radius as torque"
    )
    FRICTION_OF_LONGITUDINAL_ONLY = Code(
        "of the longitudinal force only: the side force needs the tire's side force calibration"
    )
    NEEDS_SIDE_FORCE_CALIBRATION = Code(
        "needs the tire's side force calibration ([tire.side_force_calibration] in the vehicle file;"
        " run: treadlink calibrate side-force)"
    )
    SLIP_LIMIT_NOT_DETERMINED = Code(
        "not determined: the side force acts {trail_m:.1f mm} ± {std_m:.1f mm} behind the contact centre; the shape of"
        " the contact pressure, which is not known, leaves {low:.0%} to {high:.0%}"
    )
    SLIP_NOT_LATERAL = Code("the longitudinal force is {ratio:.1f} times the side force, so the slip is not lateral")
    TIRE_GIVES_ENERGY = Code(
        "run-out, or something else that turns with the tire, looks like a force: the tire would not lose energy but "
        "give {share:.1%} ± {std:.1%} of the load"
    )

    # Of load and wear
    SIDE_FORCE_PRESSURE_UNKNOWN = Code(
        "the pressure of the side force calibration, or that of the tire, is not known: calibrate again, or state "
        "pressure_min_kpa and pressure_max_kpa of its runs"
    )

    # Of the lateral axis
    CONICITY_NOT_SEPARATED = Code("slip, ply steer or noise may look like it: roll in both directions, without slip")
    FROM_AXIS_MEANS = Code("from the means of the lateral and the radial axis")
    FROM_LAMINATE = Code(
        "from tire.laminate: B16 / A66 = {length_m:.2f mm} ± {length_std_m:.2f mm}, belt kept from twisting"
    )
    INCLUDES_CONICITY = Code("ply steer plus conicity")
    LAMINATE_DIFFERS = Code(
        "differs from the measured peak, {measured_rad:.3f deg} ± {measured_std_rad:.3f deg}, by {errors:.1f} standard "
        "errors: cord angles, order of the plies, conicity, slip, or a belt that twists"
    )
    LAMINATE_NOT_BALANCED = Code(
        "the plies are not at opposite angles (A16 / A66 = {share:.2f}): tension shears the belt as well (Eq. 11)"
    )
    LATERAL_ZERO_CONTRADICTED = Code(
        "contradicts the stated accuracy of the sensor's zero, {stated_std_mps2:.1f m/s²}; a degree of camber is "
        "0.17 m/s²"
    )
    NEEDS_BOTH_SLIPS = Code("needs {needed:.0f} revolutions each at left and at right slip")
    ORDERS_USED = Code("orders {first:.0f} to {last:.0f}")
    ROLL_CONTRADICTED = Code(
        "contradicts the stated roll, {stated_rad:.1f deg} ± {stated_std_rad:.1f deg} (mounting.roll_deg); the "
        "measured one is used"
    )
    ROLL_NOT_CALIBRATED = Code(
        "AC-coupled: the roll tilt of the sensor cannot be calibrated; the error includes {assumed_rad:.0f deg}"
    )
    ROLL_UNLIKELY = Code(
        "the sensor is rolled (state mounting.roll_deg), or the zero of its lateral axis is wrong (record two speeds): "
        "its means give a roll of {roll_rad:.1f deg}, {expected_rad:.1f deg} ± {expected_std_rad:.1f deg} is expected"
    )
    SCATTER_UNKNOWN = Code("the scatter is not known before {needed:.0f} revolutions")
    SLIP_BEYOND_LAW = Code("beyond the slip angles that the slip calibration describes")
    SLIP_OUTSIDE_CALIBRATION = Code(
        "the slip angle {slip_rad:.2f deg} is outside the calibrated {low_rad:.2f deg} to {high_rad:.2f deg}"
    )
    STRAIGHT_NOT_SHOWN = Code(
        "a steady turn looks like the tire's own first order: {changes:.0f} of {needed:.0f} changes between straight"
        " and curve so far"
    )
    SPEED_UNUSABLE = Code("the speed is not known or too high for the sampling")
    ZERO_SLIP_GIVEN = Code("zero slip from tire.slip_calibration")
    ZERO_SLIP_IS_MEAN = Code(
        "zero slip is the mean of the latest revolutions, so constant slip is not seen; it needs tire.slip_calibration "
        "(treadlink calibrate slip)"
    )
    ZERO_SLIP_NOT_SETTLED = Code("zero slip is settling: {revolutions:.0f} of {needed:.0f} revolutions")

    # Of what is not locked to the wheel
    AT_WHEEL_ORDER = Code("at order {order:.0f} of the wheel: may be locked to it")
    IN_BAND = Code("{low_hz:.0f Hz} to {high_hz:.0f Hz}, sensor noise included")
    NEEDS_UNINTERRUPTED_ROLLING = Code("needs {duration_s:.0f s} of uninterrupted rolling")
    NO_LINE = Code("no line stands out")

    # Of the road
    CAVITY_CONTRADICTED = Code(
        "gas, cavity_length_mm or temperature is not as stated, or it is another line: the inner liner reads "
        "{measured_degc:.0f} °C, the cavity resonates as air of {found_degc:.0f} °C would, or another gas "
        "({ratio:.2f} times gamma / M of air)"
    )
    NEEDS_CAVITY_LENGTH = Code("needs cavity_length_mm or a size with the rim of the tire in the vehicle file")
    NEEDS_TEMPERATURE = Code("needs the temperature")
    ROAD_BELOW_NOISE = Code("not determined beside the jitter of the contact edges: class {letter} or better")
    ROAD_CLASS = Code("class {letter} with a probability of {probability:.0%}, if G falls with n²")
    ROAD_WAVES = Code("from waves of {short_m:.1f m} to {long_m:.1f m}")
    TOO_SLOW_FOR_ROAD = Code("needs at least {limit_mps:.0f km/h}")

    # Of curves
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
