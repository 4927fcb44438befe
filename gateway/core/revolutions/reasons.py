"""Reasons of revolutions, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class RevolutionCode(Codes):
    """Reasons of revolutions."""

    # Revolutions
    CONTACT_HAS_NO_SLOPE = Code("the contact edges have no clear slope")
    CONTACT_IN_NOISE = Code("the contact does not stand out of the noise")
    NO_CONTACT = Code("no contact around angle 0")
    EFFECTS_OUTSIDE_LOADS = Code(
        "{load_n:.0f N} is outside the {low_n:.0f N} to {high_n:.0f N} at which the effects were found"
    )
    EFFECTS_OUTSIDE_PRESSURES = Code(
        "{pressure_pa:.0f kPa} is outside the {low_pa:.0f kPa} to {high_pa:.0f kPa} at which the effects were found"
    )
    EFFECTS_OUTSIDE_SPEEDS = Code(
        "{speed_mps:.0f km/h} is outside the {low_mps:.0f km/h} to {high_mps:.0f km/h} at which the effects were found"
    )
    EFFECTS_OF_OTHER_TIRE = Code("the effects were found on a tire {found_on}, but this is {tire}")
    EFFECTS_OF_OTHER_VEHICLE = Code("the effects were found on vehicle {found_on}, but this is {vehicle}")

    # Of any estimator
    AXIS_NOT_FINITE = Code("the {axis} axis is not finite")
