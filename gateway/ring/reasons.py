"""Reasons of the ring model, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class RingCode(Codes):
    """Reasons of the ring model."""

    # Of the tire's four numbers
    BENDING_LIKE_SHEAR = Code("bending and shear of the belt cannot be separated here (correlation {correlation:+.2f})")
    FIT_AT_ZERO = Code("not determined: the fit puts {number} at zero")
    FIT_NOT_CONVERGED = Code("the fit has not converged")
    NEEDS_LOAD = Code("needs the load (set load_n of the wheel, or weight_kg of its axle, in the vehicle file)")
    NO_BELT_SHAPE = Code("the radial signal does not describe a belt")
    NO_FLAT_CONTACT = Code(
        "no flat contact at angle 0: its curvature is {curvature:.2f} of the mean, the limit {limit:.2f}"
    )
    NO_RING_EQUILIBRIUM = Code("no ring in equilibrium reproduces this waveform")
    ORDERS_UNUSABLE = Code("the orders of the average are flat or not finite")
    RING_DOES_NOT_FIT = Code(
        "the ring does not describe these orders: the residual is {residual:.0%} of the signal, the limit {limit:.0%}"
    )
    SIGNAL_OF_LINEAR_RING = Code(
        "the signal is stated to be that of a linear ring, which this estimator does not assume"
    )
    TOO_FEW_ORDERS = Code("only {orders:.0f} orders, {needed:.0f} are needed: the sampling is too slow for this speed")
