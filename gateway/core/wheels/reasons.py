"""Reasons of wheels and their sensors, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class WheelCode(Codes):
    """Reasons of wheels and their sensors."""

    RADIAL_CLIPPED = Code("the radial axis is cut off below the range that the hub states")
    SAMPLES_LOST_UNMARKED = Code("about {count:.0f} samples are missing without being marked as lost")
    SAMPLES_REPEATED_UNMARKED = Code("about {count:.0f} samples are too many: samples were repeated or inserted")
    SEVERAL_TURNS = Code("it spans {turns:.0f} turns: the contacts between were not seen, as of a wheel that is lifted")
    NO_SAMPLES = Code("no samples were received")
    ENVIRONMENT_SILENT = Code("no pressure or temperature for {silence_s:.0f s}: the last values are that old")
    PRESSURE_OLD = Code("it uses a pressure that is {age_s:.0f s} old")
    SENSORS_SHARE_NUMBER = Code("the sensors {first} and {second} send under one wheel number: give each its own")
    HELLO_AC_WITH_STEADY_VALUE = Code(
        "HELLO states AC coupling, but the sensor passes the steady value ({steady_mps2:.0f m/s²} on the {axis} axis, "
        "{count} so far): state DC coupling. Until then swapped axes and wrong signs are not detected"
    )
    SAMPLES_BYTES_SWAPPED = Code(
        "the two bytes of its samples seem to be swapped ({count} so far), a fault of the firmware: send int16 little "
        "endian (the other way round, the steps from sample to sample are {ratio:.0f} times smaller)"
    )
