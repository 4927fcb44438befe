"""Reasons of the ring model, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class RingCode(Codes):
    """Reasons of the ring model."""

    BENDING_LIKE_SHEAR = Code("bending and shear of the belt cannot be separated here (correlation {correlation:+.2f})")
    FIT_AT_ZERO = Code("not determined: the best fit has {number} at zero")
    FIT_NOT_CONVERGED = Code("the fit has not converged")
    NEEDS_LOAD = Code("the load is not known: set load_n of the wheel, or weight_kg of its axle, in the vehicle file")
    NO_BELT_SHAPE = Code("the radial signal does not have the shape of a belt")
    NO_FLAT_CONTACT = Code(
        "the contact is not flat at angle 0: its curvature is {curvature:.2f} of the mean, at most {limit:.2f} is "
        "accepted"
    )
    NO_RING_EQUILIBRIUM = Code("the model of the tire has no equilibrium with this waveform")
    ORDERS_UNUSABLE = Code("the orders of the average are zero or not finite")
    RING_DOES_NOT_FIT = Code(
        "the model of the tire does not describe these orders: the residual is {residual:.0%} of the signal, at most "
        "{limit:.0%} is accepted"
    )
    SIGNAL_OF_LINEAR_RING = Code("the signal is stated to be that of a linear ring: this estimator assumes a real tire")
    TOO_FEW_ORDERS = Code(
        "the sampling is too slow for this speed: it gives {orders:.0f} orders, {needed:.0f} are needed"
    )
