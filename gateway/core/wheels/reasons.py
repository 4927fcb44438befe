"""Reasons of wheels and their sensors, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class WheelCode(Codes):
    """Reasons of wheels and their sensors."""

    # Revolutions
    RADIAL_CLIPPED = Code("the radial axis is clipped below the range that the hub states")
    SAMPLES_LOST_UNMARKED = Code("about {count:.0f} samples short: samples were lost without being marked")
    SAMPLES_REPEATED_UNMARKED = Code("about {count:.0f} samples too many: samples were repeated or inserted")
    SEVERAL_TURNS = Code(
        "it spans {turns:.0f} turns: the contacts between its two were not seen, as of a wheel without its load"
    )

    # Revolutions that do not come
    NO_SAMPLES = Code("no samples were received")

    # Of load and wear
    ENVIRONMENT_SILENT = Code("no pressure or temperature for {silence_s:.0f s}: the last values are that old")
    PRESSURE_OLD = Code("rests on a pressure that is {age_s:.0f s} old")

    # Sensors
    SENSORS_SHARE_NUMBER = Code(
        "the sensors {first} and {second} send under the number of one wheel: give each its own"
    )

    # False statements of a hub
    HELLO_AC_WITH_STEADY_VALUE = Code(
        "HELLO states AC coupling, but the {axis} axis has a steady value of {steady_mps2:.0f m/s²} ({count} so "
        "far): the sensor passes it. State DC coupling: without it, swapped axes and wrong signs are not seen "
        "either"
    )
    SAMPLES_BYTES_SWAPPED = Code(
        "the two bytes of its samples seem to be swapped ({count} so far): the other way round, the steps from "
        "sample to sample are {ratio:.0f} times smaller. int16 is sent little endian. A fault of the firmware"
    )
