"""Check of the stated rolling direction of a recording."""

import math
from typing import Final

import numpy as np

from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.angle.likelihood import Whitened
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL

# The sensor sits on or below the belt's neutral layer, where ring and depth move the circumferential axis alike, so
# that its share of the model's is positive for any error of depth, gain or tilt; rolling backwards makes it negative.
_OPPOSITE: Final = -0.3
# Standard errors, from the residual, that it must differ from 0.
_CERTAIN: Final = 5.0


def turned_round(fit: Fit, data: Whitened) -> list[int]:
    """Return the numbers of recordings whose circumferential axis has the opposite sign of the model's.

    A recording's share b of the model's waveform m minimises sum |w (d - b m)|^2 over its orders d with weights w:
    b = sum w^2 Re(d m*) / sum w^2 |m|^2. Order 0 is left out: it has no direction.

    Args:
        fit: of the baseline model.
        data: whitened.
    """
    groups = fit.model.campaign.groups
    reversed_recordings = []
    for recording in sorted({group.recording for group in groups}):
        product = square = measured_square = used = 0.0
        for index in (index for index, group in enumerate(groups) if group.recording == recording):
            weight = data.weights[index][:, CIRCUMFERENTIAL, 1:]
            measured = weight * data.orders[index][:, CIRCUMFERENTIAL, 1:]
            modelled = weight * fit.predicted[index][CIRCUMFERENTIAL, 1:]
            product += float(np.sum((measured * modelled.conj()).real))
            square += float(np.sum(np.abs(modelled) ** 2))
            measured_square += float(np.sum(np.abs(measured) ** 2))
            used += 2.0 * float(np.count_nonzero(weight))
        if square <= 0.0:
            continue
        share = product / square
        std = math.sqrt(max(1.0, (measured_square - share * product) / used) / square)
        if share < _OPPOSITE and share < -_CERTAIN * std:
            reversed_recordings.append(recording)
    return reversed_recordings
