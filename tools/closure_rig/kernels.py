"""Posterior of recordings under other correlation lengths of the discrepancy."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from accuracy.tables import Table

from gateway.core.ring_quantities import RING_NUMBERS
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.discrepancy import Discrepancy
from gateway.diagnosis.angle.likelihood import whiten
from gateway.diagnosis.angle.number_estimates import estimates_of
from gateway.diagnosis.campaign import read_campaign
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.catalogue import candidates
from gateway.diagnosis.effects.effect import BaselineModel
from gateway.diagnosis.model.baseline_registry import angle_effects, make_core
from gateway.diagnosis.search.set_search import SetSearch, baseline_fit
from gateway.diagnosis.search.tempered_posterior import posterior_of

# About 0.6 and 1.6 times the lengths in use.
LENGTHS_RAD: Final = ((0.02, 0.07, 0.25), criteria.LENGTHS_RAD, (0.05, 0.2, 0.6))


def kernel_table(recordings: Sequence[Path]) -> Table:
    """Return probabilities and numbers from the exact ring under each set of lengths."""
    campaign = read_campaign(recordings)
    rows = tuple(_row(campaign, lengths_rad) for lengths_rad in LENGTHS_RAD)
    return Table(
        "Other correlation lengths", "probabilities above 0.05", ("lengths, rad", "effects", *RING_NUMBERS), rows
    )


def _row(campaign: Campaign, lengths_rad: tuple[float, ...]) -> tuple[str, ...]:
    core = make_core(BaselineModel.EXACT)
    data = whiten(campaign, core)
    effects = angle_effects(candidates(BaselineModel.EXACT))
    search = SetSearch(campaign, core, data, effects, Discrepancy(campaign, data, lengths_rad))
    search.run(baseline_fit(campaign, core, data))
    posterior = posterior_of(search)
    estimates, _ = estimates_of([(item.fit, weight) for item, weight in posterior.considered])
    listed = [name for name in posterior.names if posterior.probability([name]) >= criteria.LISTED]
    names = ", ".join(f"{name} {posterior.probability([name]):.3f}" for name in listed)
    numbers = (f"{estimates[name].value:.4g} ± {estimates[name].std:.2g}" for name in RING_NUMBERS)
    return ", ".join(f"{length:g}" for length in lengths_rad), names or "none", *numbers
