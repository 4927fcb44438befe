"""Where the forward fit starts when it knows nothing: a ring with the contact's length, and the packets' orders."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gateway.estimators.forward_model import PRIOR_MEAN, ForwardModel, ForwardSolution, P, stacked
from gateway.types import BoolArray, ComplexArray, FloatArray

_SEARCH_ORDERS: Final = range(15, 90)
# Share of R omega^2 below which a packet may be one that has just come out of the noise.
_FAINT: Final = 0.01


def cold_start(model: ForwardModel, half_angle_rad: float) -> FloatArray:
    """Table 3's tire, all of it stiffer or softer until the contact is as long as the one seen."""
    start = PRIOR_MEAN.copy()
    scaled = [P.BS, P.CW, P.RS, P.TS, P.TREAD, P.EXTENSION]
    solution = model.solve(start)
    for _ in range(3):
        # The half angle goes with about the 0.8th power of load over stiffness.
        step = 1.25 * math.log(solution.half_angle_rad / half_angle_rad)
        start = start.copy()
        start[scaled] += np.clip(step, -1.0, 1.0)
        solution = model.solve(start, solution.ring)
    return start


def place_centre(model: ForwardModel, here: ForwardSolution, orders: ComplexArray) -> ForwardSolution:
    """Turn the model to where the data have their contact, and give it the data's gain."""
    moved = here.parameters.copy()
    n = np.arange(2, min(40, len(orders)))
    trials = np.linspace(-0.06, 0.06, 121)
    overlap = (np.exp(1j * np.multiply.outer(trials, n)) @ (orders[n] * here.orders[n].conj())).real
    moved[P.CENTRE] = trials[int(np.argmax(overlap))]
    moved[P.GAIN] = math.log(max(float(overlap.max() / np.sum(np.abs(here.orders[n]) ** 2)), 0.3))
    return model.solve(moved, here.ring)


def begin_waves(
    model: ForwardModel,
    here: ForwardSolution,
    residual: ComplexArray,
    variance: FloatArray,
    used: BoolArray,
    *,
    all_sides: bool,
) -> ForwardSolution:
    """Give the packets the orders that explain most of the residual, each side by itself.

    Without `all_sides` only a faint packet is moved: a fit that goes on keeps what it has found.
    """
    p = here.parameters.copy()
    weight = np.where(used, 1.0 / np.sqrt(variance), 0.0)
    data = stacked(residual * weight)
    for place, packet in zip((P.BEFORE_ORDER, P.AFTER_ORDER), here.packets(), strict=True):
        if not all_sides and packet.amplitude > _FAINT:
            continue
        best = -1.0
        for order in _SEARCH_ORDERS:
            if order > 0.9 * model.max_order:
                break
            trial = p.copy()
            trial[place] = order
            basis = (
                model.wave_orders(trial, here.ring)[:2]
                if place is P.BEFORE_ORDER
                else (model.wave_orders(trial, here.ring)[6:8])
            )
            columns = np.stack([stacked(row * weight) for row in basis], axis=1)
            found, *_ = np.linalg.lstsq(columns, data, rcond=None)
            gain = float(data @ (columns @ found))
            if gain > best:
                best, p[place] = gain, order
    return model.solve(p, here.ring)
