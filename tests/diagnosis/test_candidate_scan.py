"""Scans of candidates: the same trials in any process and after any other, and the end of the processes."""

import os
import signal
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.errors import TreadlinkError
from gateway.core.worker_pool import Workers
from gateway.diagnosis.angle.candidate_trial import Trial, shapes_of, try_effect
from gateway.diagnosis.angle.discrepancy import Discrepancy
from gateway.diagnosis.angle.discrepancy_kernels import OrderLine
from gateway.diagnosis.angle.set_evidence import evaluate
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.effects.effect import BaselineModel
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.diagnosis.effects.tread_excitation import TreadExcitation
from gateway.diagnosis.model.baseline_registry import angle_effects, make_core
from gateway.diagnosis.model.exact_baseline import ExactCore
from gateway.diagnosis.model.tire_state import references
from gateway.diagnosis.search.candidate_scan import Helpers, Scan
from tests.diagnosis.planted_campaign import ONE_SPEED, campaign_of, fitted

NAMES = ("gain", "pitch tilt", "belt extension", "drum curvature")


def dies(_: Campaign) -> None:
    os.kill(os.getpid(), signal.SIGTERM)


def same(first: list[Trial], other: list[Trial]) -> bool:
    """Return whether two scans agree to the last bit."""
    return len(first) == len(other) > 0 and all(
        a.effect.name == b.effect.name
        and np.array_equal(a.start, b.start)
        and np.array_equal(a.vector, b.vector)
        and (a.cost, a.promise) == (b.cost, b.promise)
        for a, b in zip(first, other, strict=True)
    )


def test_trials_of_another_process_are_equal_to_the_last_bit() -> None:
    """Without a discrepancy, with one, and with one that is concentrated; then the process is lost."""
    campaign = campaign_of(ONE_SPEED)
    fit, data = fitted(campaign)
    effects = {name: effect for name, effect in angle_effects(catalogue()).items() if name in NAMES}
    discrepancy = Discrepancy(campaign, data)
    smooth = evaluate(fit, data, discrepancy, None).fit
    assert smooth.applied is not None
    line = discrepancy.concentrated(OrderLine(30))
    amplitudes = np.concatenate([smooth.applied.amplitudes, np.full((*line.shape[:2], 1), 1e-3)], axis=2)
    fits = [fit, smooth, smooth.under(line.applied(amplitudes))]

    def lost() -> None:
        with Workers(1) as workers:
            helpers = Helpers(workers)
            helpers.begin(campaign, make_core(BaselineModel.EXACT), data, effects, discrepancy)
            scans = [helpers.scan(fit, list(effects.values()), [0]) for fit in fits]
            # Work is done in order, so that the process has made all trials of the scans before.
            assert len(helpers.ahead(references, campaign)()) == campaign.states
            for item, scan in zip(fits, scans, strict=True):
                assert same(scan.trials(), Scan(item, list(effects.values()), [0]).trials())
            helpers.ahead(dies, campaign)()

    with pytest.raises(TreadlinkError, match="terminated from outside"):
        lost()


def test_change_by_an_option_does_not_depend_on_earlier_ones() -> None:
    conditions = campaign_of(ONE_SPEED).groups[0].conditions
    state = np.full(5, 0.1)
    stretched, curved = RingOptions(extension_stiffness_n=4e5), RingOptions(drum_curvature_pm=0.5)
    first, again = ExactCore((480,), anchored=True), ExactCore((480,), anchored=True)
    again.shape(state + 0.3, conditions, curved, 0.0)
    again.shape(state, replace(conditions, load_n=0.5 * conditions.load_n), RingOptions(), 0.0)
    again.shape(state, conditions, curved, 0.0)
    shapes = [core.shape(state, conditions, stretched, 0.0) for core in (first, again)]
    assert np.array_equal(np.array(shapes[0].waveform), np.array(shapes[1].waveform))
    assert shapes[0].trailing_edge_rad == shapes[1].trailing_edge_rad


def test_longest_trials_come_first() -> None:
    """One that is begun last would keep the other processes waiting."""
    fit, _ = fitted(campaign_of(ONE_SPEED))
    effects = angle_effects(catalogue())
    begun = [effect.name for effect in Scan(fit, [effects[name] for name in sorted(effects)], [0]).effects]
    assert begun[0] == "tread block excitation"
    assert begun.index("travelling edge waves") < begun.index("torsional ripple") < begun.index("gain")


@pytest.mark.parametrize(("scale", "refined"), [(0.1, True), (1e4, False)])
def test_starts_that_explain_nothing_are_not_refined(
    monkeypatch: pytest.MonkeyPatch, scale: float, refined: bool
) -> None:
    """As with errors a hundred times as large, in which whatever a start explains is lost."""
    fit, _ = fitted(campaign_of(ONE_SPEED))
    asked: list[int] = []

    def nearer(_: TreadExcitation, stage: int, *__: object) -> tuple[()]:
        asked.append(stage)
        return ()

    monkeypatch.setattr(TreadExcitation, "nearer", nearer)
    assert try_effect(replace(fit, scale=scale), TreadExcitation(), shapes_of(fit, [0])) is not None
    assert bool(asked) == refined
