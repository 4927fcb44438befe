"""Reasons of revolutions, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class RevolutionCode(Codes):
    """Reasons of revolutions."""

    CONTACT_HAS_NO_SLOPE = Code("the signal has no clear slope where the contact begins and ends")
    CONTACT_IN_NOISE = Code("the contact does not stand out of the noise")
    NO_CONTACT = Code("no contact around angle 0")
    AXIS_NOT_FINITE = Code("the {axis} axis is not finite")
    EFFECTS_OF_OTHER = Code(
        "the effects were identified on {kind} {found_on}, but this is {name}",
        kind={
            "tire": "a tire",
        },
    )
    EFFECTS_OUTSIDE_RANGE = Code(
        "{quantity} at which the effects were identified",
        quantity={
            "load_n": "{value:.0f N} is outside the {low:.0f N} to {high:.0f N}",
            "pressure_pa": "{value:.0f kPa} is outside the {low:.0f kPa} to {high:.0f kPa}",
            "speed_mps": "{value:.0f km/h} is outside the {low:.0f km/h} to {high:.0f km/h}",
        },
    )
