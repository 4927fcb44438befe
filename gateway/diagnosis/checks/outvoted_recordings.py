"""Recordings that more than half of the others contradict: in an axis, the stated belt, the contact or the load.

One recording with an axis connected the wrong way round, or with another tire's load in its configuration, spoils what
all recordings are fitted for together. Where most recordings agree with each other, it is that one which is wrong. Of
two that differ nobody knows which: that they differ is all that can be said.
"""

import math
from collections import Counter
from collections.abc import Collection, Mapping
from typing import Final

import numpy as np

from gateway.core.errors import TreadlinkError
from gateway.core.reasons import Reason
from gateway.core.types import BoolArray, ComplexArray, FloatArray
from gateway.diagnosis.angle.number_estimates import contradict
from gateway.diagnosis.data.campaign_data import Campaign, Group
from gateway.diagnosis.data.condition_groups import contact_groups
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.effect import LATERAL
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Fitted

# Correlation from which the opposite of a waveform explains more than half of another's power.
_OPPOSITE: Final = -math.sqrt(0.5)
# Standard deviations of noise that it must exceed.
_CERTAIN: Final = 5.0


class RecordingsContradictedError(TreadlinkError):
    """Recordings contradict what is stated of them, so that no fit could include them.

    Attributes:
        recordings: index in the campaign -> why.
    """

    def __init__(self, message: str, remedy: str, recordings: Mapping[int, Reason]) -> None:
        """Store message, remedy and the recordings."""
        super().__init__(message, remedy)
        self.recordings = recordings


def unlike_signals(campaign: Campaign) -> dict[int, Reason]:
    """Return the recordings whose lateral axis or stated belt radius most others contradict, by index, and why.

    Both need no fit: a tire has one belt, and its lateral waveform over omega^2 has one sign.
    """
    return {**_opposite_lateral(campaign), **_other_radius(campaign)}


def opposite_pair(campaign: Campaign) -> tuple[int, int] | None:
    """Return two recordings whose lateral waveforms are opposite where no majority tells which is wrong, else None."""
    numbers, opposite = _opposites(campaign)
    if _opposite_lateral(campaign):
        return None
    for number, is_opposite in zip(numbers, opposite, strict=True):
        if is_opposite.any():
            return number, numbers[int(np.argmax(is_opposite))]
    return None


def unlike_contacts_of(campaign: Campaign) -> dict[int, Reason]:
    """Return the recordings whose contact differs from that of most others of its stated load, pressure and speed."""
    reasons: dict[int, Reason] = {}
    groups = campaign.groups
    for labelled in contact_groups(
        np.array([group.state for group in groups]),
        np.array([group.conditions.omega_radps for group in groups]),
        np.array([group.half_angle_rad for group in groups]),
    ):
        contacts = [{groups[index].recording for index in indices} for indices in labelled]
        all_recordings = set().union(*contacts)
        majority = max(range(len(contacts)), key=lambda number: len(contacts[number]))
        if 2 * len(contacts[majority]) <= len(all_recordings):
            continue
        majority_rad = float(np.median([groups[index].half_angle_rad for index in labelled[majority]]))
        for number, indices in enumerate(labelled):
            for index in indices if number != majority else ():
                group = groups[index]
                if group.recording not in contacts[majority]:
                    reasons[group.recording] = Reason(
                        DiagnosisCode.CONTACT_UNLIKE_OTHERS,
                        angle_rad=group.half_angle_rad,
                        other_rad=majority_rad,
                        count=len(contacts[majority]),
                    )
    return reasons


def unlike_loads(campaign: Campaign, widths: Mapping[int, Fitted]) -> dict[int, Reason]:
    """Return the recordings of states whose Cw contradicts that of most others: their load or pressure is wrong.

    Args:
        campaign: the data.
        widths: Cw of the states that are compared, before their errors contain the contradiction.
    """
    recordings = {state: {group.recording for group in campaign.groups if group.state == state} for state in widths}
    all_recordings = set().union(*recordings.values())
    outvoted: dict[int, tuple[float, int]] = {}
    for state, width in widths.items():
        rivals = [rival for rival, rival_width in widths.items() if contradict(width, rival_width)]
        others = set().union(*(recordings[rival] for rival in rivals))
        if 2 * len(others) > len(all_recordings):
            outvoted[state] = float(np.median([widths[rival].value for rival in rivals])), len(others)
    sound = set().union(*(state_recordings for state, state_recordings in recordings.items() if state not in outvoted))
    if not sound:  # all contradict each other
        return {}
    return {
        number: Reason(DiagnosisCode.WIDTH_UNLIKE_OTHERS, value=widths[state].value, other=median, count=count)
        for state, (median, count) in outvoted.items()
        for number in recordings[state] - sound
    }


def _other_radius(campaign: Campaign) -> dict[int, Reason]:
    """Return the recordings that state another belt radius than most."""
    radius_m = {group.recording: group.conditions.radius_m for group in campaign.groups}
    (usual_m, count), *_ = Counter(radius_m.values()).most_common(1)
    if 2 * count <= len(radius_m):
        return {}
    return {
        number: Reason(DiagnosisCode.RADIUS_UNLIKE_OTHERS, radius_m=stated_m, other_m=usual_m, count=count)
        for number, stated_m in radius_m.items()
        if stated_m != usual_m
    }


def _opposite_lateral(campaign: Campaign) -> dict[int, Reason]:
    """Return the recordings whose lateral waveform is the opposite of that of most others."""
    numbers, opposite = _opposites(campaign)
    return {
        number: Reason(DiagnosisCode.LATERAL_OPPOSITE_TO_OTHERS, count=int(is_opposite.sum()))
        for number, is_opposite in zip(numbers, opposite, strict=True)
        if 2 * int(is_opposite.sum()) > len(numbers)
    }


def _opposites(campaign: Campaign) -> tuple[list[int], BoolArray]:
    """Return the recordings, and (n, n) which of them have opposite lateral waveforms."""
    numbers = sorted({group.recording for group in campaign.groups})
    laterals = [_lateral(campaign.groups, number) for number in numbers]
    waves, variances = np.array([wave for wave, _ in laterals]), np.array([variance for _, variance in laterals])
    # One weight for all, so that pairs are compared by the same orders.
    used = np.isfinite(variances).all(axis=0)
    if not used.any():
        return numbers, np.zeros((len(numbers), len(numbers)), dtype=np.bool_)
    waves, variances = waves[:, used], variances[:, used]
    weights = 1.0 / variances.mean(axis=0)
    products = np.einsum("in,n,jn->ij", waves, weights, waves.conj()).real
    # Noise adds to the power of a waveform two real coefficients an order, and to a product its scatter.
    power = np.diag(products) - 2.0 * variances @ weights
    sizes = np.sqrt(np.where(power > 0.0, power, math.inf))
    scatter = (weights**2 * np.abs(waves) ** 2) @ variances.T
    certain = products < -_CERTAIN * np.sqrt(scatter + scatter.T)
    opposite: BoolArray = certain & (products < _OPPOSITE * np.outer(sizes, sizes))
    return numbers, opposite


def _lateral(groups: Collection[Group], number: int) -> tuple[ComplexArray, FloatArray]:
    """Return the lateral waveform over omega^2 of a recording, (ORDERS - 1,), and the variance of a coefficient.

    Order 0 is left out: it is the sensor's offset as well. Unknown orders have an infinite variance.
    """
    weighted, weights = np.zeros(ORDERS - 1, dtype=np.complex128), np.zeros(ORDERS - 1)
    for group in groups:
        if group.recording != number:
            continue
        square = group.conditions.omega_radps**2
        for block in group.blocks:
            orders = block.orders_mps2[LATERAL, 1:] / square
            weight = block.count * square**2 / group.variance[LATERAL, 1:]
            used = np.isfinite(orders) & np.isfinite(weight)
            weighted[used] += weight[used] * orders[used]
            weights[used] += weight[used]
    with np.errstate(divide="ignore"):
        variance = np.where(weights > 0.0, 1.0 / weights, math.inf)
    return np.where(weights > 0.0, weighted / np.maximum(weights, np.finfo(float).tiny), 0.0), variance
