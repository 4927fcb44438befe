"""Reasons of the pressure warning, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class InflationCode(Codes):
    """Reasons of the pressure warning."""

    PRESSURE_BELOW_PLACARD = Code(
        "the pressure is {share:.0%} too low: {pressure_pa:.0f kPa}, where the placard's {placard_pa:.0f kPa} are "
        "{warm_pa:.0f kPa} {at}; {course}",
        at={
            "warm": "at {temperature_degc:.0f degC}",
            "unknown": "at an unknown temperature",
        },
        course={
            "fast": (
                "it fell by {fall_pa:.0f kPa} within {span_s:.1g min} of driving: stop and look for a puncture or a "
                "leaking valve"
            ),
            "slow": "no fast loss was seen: inflate the tire",
        },
    )
    PRESSURE_NOT_MONITORED = Code(
        "a loss of pressure would not be noticed: {cause}",
        cause={
            "missing": "there was no current pressure for {driven_s:.0f min} of driving",
            "frozen": "the pressure does not follow the temperature",
        },
    )
