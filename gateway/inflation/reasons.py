"""Reasons of the pressure warning, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class InflationCode(Codes):
    """Reasons of the pressure warning."""

    PRESSURE_BELOW_PLACARD = Code(
        "{pressure_pa:.0f kPa} is {share:.0%} below the {warm_pa:.0f kPa} that {placard_pa:.0f kPa} of the placard are "
        "{at}: {course}",
        at={"warm": "at {temperature_degc:.0f} °C", "unknown": "at an unknown temperature"},
        course={
            "fast": "lost {fall_pa:.0f kPa} within {span_s:.0f min} of driving, a puncture or a valve",
            "slow": "no fast loss in the {span_s:.0f min} of driving that were watched",
        },
    )
    PRESSURE_NOT_MONITORED = Code(
        "{cause}, so that no loss of pressure would be warned of",
        cause={
            "missing": "no current pressure for {driven_s:.0f min} of driving",
            "frozen": "the pressure does not follow the temperature",
        },
    )
