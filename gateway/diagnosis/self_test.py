"""Self-test of a diagnosis: recordings simulated from its result and from what it leaves, diagnosed again.

Each simulation has the waveforms that the best set predicts, the scatter of the blocks in another order and with random
signs, and the mean of the discrepancy turned by a random angle: as large and as smooth as what is unexplained, and the
answer of this tire to nothing. What does not repeat with the wheel stays as recorded.
"""

import logging
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from gateway.core.errors import TreadlinkError
from gateway.core.types import ComplexArray
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.angle.likelihood import as_complex
from gateway.diagnosis.angle.number_estimates import estimates_of
from gateway.diagnosis.data.campaign_data import Campaign, Group
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.result import Diagnosis, SelfTest, Verdict

_logger = logging.getLogger(__name__)

_SEED: Final = 1
_ORDER: Final = np.arange(ORDERS)

Progress = Callable[[float, str], None]


def self_test(
    fit: Fit,
    diagnosis: Diagnosis,
    diagnose: Callable[[Campaign, Progress], Diagnosis],
    count: int,
    on_progress: Progress,
    expired: Callable[[], bool],
) -> SelfTest:
    """Return how simulations of a result are diagnosed.

    Args:
        fit: of the best set, with its discrepancy.
        diagnosis: the result.
        diagnose: of a campaign.
        count: number of simulations.
        on_progress: called with the share that is done and the present step.
        expired: True when no further simulation is to be begun; one that it cuts short does not count.
    """
    effects = {effect.name: fit.vector[fit.model.layout.effect(effect.name)] for effect in fit.model.effects}
    named = {finding.name for finding in diagnosis.named if finding.name in effects}
    numbers, _ = estimates_of([(fit, 1.0)])
    rng = np.random.default_rng(_SEED)
    false, missed, pulls, done = Counter[str](), Counter[str](), list[float](), 0
    wrong, failed = 0, 0
    for number in range(count):
        if expired():
            break
        try:
            result = diagnose(simulated(fit, rng), partial(_report, on_progress, number, count))
        except TreadlinkError as error:
            # The result itself is whole: it outlives a simulation that no model fits.
            _logger.info("simulation %d has no diagnosis: %s", number + 1, error)
            failed += 1
            continue
        if not result.complete:
            # What the search did not come to would count as missed.
            break
        identified = {finding.name: finding for finding in result.findings if finding.verdict is Verdict.NAMED}
        untrue = [name for name, finding in identified.items() if finding.lock == "angle" and name not in effects]
        false.update(untrue)
        missed.update(named - identified.keys())
        wrong += bool(untrue)
        for name in effects.keys() & identified.keys():
            for value, fitted in zip(effects[name].tolist(), identified[name].parameters.values(), strict=True):
                pulls.append((fitted.value - value) / fitted.std if fitted.std > 0.0 else math.nan)
        for name, is_determined in result.determined.items():
            if is_determined and name in numbers and result.estimates_after[name].std > 0.0:
                fitted = result.estimates_after[name]
                pulls.append((fitted.value - numbers[name].value) / fitted.std)
        done += 1
    return SelfTest(
        done, wrong, failed, dict(false), dict(missed), tuple(pull for pull in pulls if math.isfinite(pull))
    )


def _report(on_progress: Progress, number: int, count: int, share: float, text: str) -> None:
    on_progress((number + share) / count, f"self-test {number + 1} of {count}: {text}")


def simulated(fit: Fit, rng: np.random.Generator) -> Campaign:
    """Return a campaign as a fit predicts it, with the recordings' scatter and what is unexplained, turned.

    Args:
        fit: with its discrepancy.
        rng: random numbers.
    """
    campaign = fit.model.campaign
    rotation = np.exp(-1j * rng.uniform(0.0, 2.0 * math.pi) * _ORDER)
    unexplained = [np.zeros((3, ORDERS), dtype=np.complex128) for _ in campaign.groups]
    if fit.applied is not None:
        means = fit.applied.mean([rows[-1] for rows in fit.weighted])
        unexplained = [as_complex(mean) * rotation for mean in means]
    groups = []
    for index, group in enumerate(campaign.groups):
        truth = fit.model.predict_group(fit.vector, index) + unexplained[index]
        scatter = _scatter(group, rng)
        blocks = tuple(
            replace(block, orders_mps2=orders + change, as_recorded_mps2=None)
            for block, orders, change in zip(group.blocks, truth, scatter, strict=True)
        )
        groups.append(replace(group, blocks=blocks))
    return replace(campaign, groups=tuple(groups))


def _scatter(group: Group, rng: np.random.Generator) -> list[ComplexArray]:
    """Return the scatter of a group's blocks, in another order and with random signs; NaN where nothing is known."""
    counts = group.counts
    orders = np.stack([block.orders_mps2 for block in group.blocks])
    measured = np.where(np.isnan(orders[0]), math.nan, 1.0)
    if len(counts) == 1:
        real, imaginary = rng.normal(size=(2, *orders.shape)) * np.sqrt(np.nan_to_num(group.variance) / counts[0])
        imaginary[..., 0] = 0.0
        return list((real + 1j * imaginary) * measured)
    # About their mean blocks scatter by less than about the truth.
    deviations = (orders - np.tensordot(counts / counts.sum(), orders, 1)) * np.sqrt(counts)[:, None, None]
    deviations *= math.sqrt(len(counts) / (len(counts) - 1.0))
    signs = rng.choice([-1.0, 1.0], len(counts))
    drawn = signs[:, None, None] * deviations[rng.permutation(len(counts))] / np.sqrt(counts)[:, None, None]
    return list(drawn * measured)
