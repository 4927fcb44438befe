"""Reasons of the ring model, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class RingCode(Codes):
    """Reasons of the ring model."""

    # Of the tire's four numbers
    BENDING_LIKE_SHEAR = Code("bending and shear of the belt cannot be separated here (correlation {correlation:+.2f})")
    FIT_NOT_CONVERGED = Code("the fit has not converged")
    NO_BELT_SHAPE = Code("the radial signal does not describe a belt")
    NO_FLAT_CONTACT = Code(
        "no flat contact at angle 0: its curvature is {curvature:.2f} of the mean, the limit {limit:.2f}"
    )
    NO_RING_EQUILIBRIUM = Code("no ring in equilibrium reproduces this waveform")
    ORDERS_UNUSABLE = Code("the orders of the average are flat or not finite")
    RING_DOES_NOT_FIT = Code(
        "the ring does not describe these orders: the residual is {residual:.0%} of the signal, the limit {limit:.0%}"
    )
