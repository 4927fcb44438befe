"""Edge waves in the measured inner-liner recording: the figures of docs/evidence/closure-drum.md."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.core.types import FloatArray
from gateway.diagnosis.angle.candidate_trial import refit, shapes_of, try_effect
from gateway.diagnosis.angle.fit import Fit, fit_model
from gateway.diagnosis.angle.likelihood import Whitened, whiten
from gateway.diagnosis.campaign import read_campaign, reading_orders
from gateway.diagnosis.campaign_diagnosis import diagnose_recordings
from gateway.diagnosis.closed_loop import diagnose
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.angle_orders import THETA, orders_field
from gateway.diagnosis.effects.belt_dispersion import BlockTread, belt_wave
from gateway.diagnosis.effects.belt_geometry import slopes
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, RADIAL
from gateway.diagnosis.model.baseline_registry import angle_effects
from gateway.diagnosis.model.closure_model import AngleEffect, ClosureModel
from gateway.diagnosis.model.exact_baseline import ExactCore
from gateway.diagnosis.result import Verdict
from gateway.importing.import_map import load_map
from gateway.importing.importer import import_file

ROOT = Path(__file__).parents[2]
MEASURED = ROOT / ".." / "shared" / "measured" / "innerliner_drum_80kmh.csv"
MAP = ROOT / "examples" / "innerliner_drum_80kmh.map.toml"
WAVES = "travelling edge waves"


@dataclass(frozen=True, slots=True)
class Fitted:
    """The recording, and the ring with what goes before edge waves.

    Attributes:
        campaign: one group, five revolutions.
        data: whitened.
        before: mounting offset in.
        after: edge waves in as well.
    """

    campaign: Campaign
    data: Whitened
    before: Fit
    after: Fit

    def left(self, fit: Fit) -> FloatArray:
        """Return what every revolution has beyond a fit, without its mean, (revolutions, 3, FIELD_SIZE)."""
        orders = self.data.orders[0] - fit.predicted[0]
        orders[..., 0] = 0.0
        return orders_field(orders)


def effect_of(name: str) -> AngleEffect:
    return angle_effects(catalogue())[name]


def with_mounting(campaign: Campaign, data: Whitened) -> Fit:
    """Return the fit of the ring with a mounting offset."""
    core = ExactCore()
    plain = fit_model(ClosureModel(campaign, core), data, from_afar=True)
    trial = try_effect(plain, effect_of("mounting offset"), shapes_of(plain, [0]))
    assert trial is not None
    return refit(trial, data)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not MEASURED.exists():
        pytest.skip("the measured recording is not part of the repository; it is looked for in ../shared/measured")
    path = tmp_path_factory.mktemp("drum") / "drum.mcap"
    import_file(MEASURED, load_map(MAP), path)
    return path


@pytest.fixture(scope="module")
def fitted(recording: Path) -> Fitted:
    campaign = read_campaign(reading_orders([recording]))
    data = whiten(campaign, ExactCore())
    before = with_mounting(campaign, data)
    trial = try_effect(before, effect_of(WAVES), shapes_of(before, [0]))
    assert trial is not None
    # The trial's linear step bends the ring too far; the effect's own values are near enough.
    start = before.model.layout.moved(before.vector, trial.model.layout)
    of_waves = trial.model.layout.effect(WAVES)
    start[of_waves] = trial.vector[of_waves]
    return Fitted(campaign, data, before, fit_model(trial.model, data, start))


def parameters(fit: Fit) -> dict[str, float]:
    effect = effect_of(WAVES)
    names = [parameter.name for parameter in effect.parameters]
    return dict(zip(names, fit.vector[fit.model.layout.effect(WAVES)].tolist(), strict=True))


def within(low_deg: float, high_deg: float) -> NDArray[np.bool_]:
    result: NDArray[np.bool_] = (np.degrees(THETA) >= low_deg) & (np.degrees(THETA) < high_deg)
    return result


def repeating(curves: FloatArray) -> float:
    """Return the share of the power that is in every revolution, of curves (revolutions, n)."""
    scatter = float(curves.var(axis=0, ddof=1).mean())
    mean = float(np.square(curves.mean(axis=0)).mean()) - scatter / len(curves)
    return mean / (mean + scatter)


def test_waves_travel_away_from_the_contact(fitted: Fitted) -> None:
    remainder = fitted.left(fitted.before).mean(axis=0)
    spectrum = np.fft.rfft(remainder, axis=-1)
    spectrum[:, :14] = 0.0
    spectrum[:, 55:] = 0.0
    band = np.fft.irfft(spectrum, n=len(THETA), axis=-1)
    slope = slopes(band[RADIAL])[0]
    for window, sign in (((-33.0, -20.0), -1.0), ((30.0, 60.0), 1.0), ((60.0, 120.0), 1.0)):
        there = within(*window)
        assert sign * np.corrcoef(slope[there], band[CIRCUMFERENTIAL][there])[0, 1] > 0.9
    # A shape that stands still has -(e/R) of the slope, e/R = 0.020, on both sides; here kappa is -0.32.
    there = within(30.0, 60.0)
    share = float(slope[there] @ band[CIRCUMFERENTIAL][there]) / float(slope[there] @ slope[there])
    assert share == pytest.approx(0.0071, abs=0.0008)


def test_orders_and_decays_fit_one_belt(fitted: Fitted) -> None:
    result = parameters(fitted.after)
    conditions = fitted.campaign.groups[0].conditions
    names = ("blocks", "bending_over_mass_m4ps2", "tension_over_mass_m2ps2", "sidewall_loss_ps", "bending_loss_m4ps")
    tread = BlockTread(*(result[name] for name in names))
    before, after = (belt_wave(tread, side, conditions.omega_radps, conditions.radius_m) for side in (0, 1))
    second = belt_wave(replace(tread, blocks=2.0 * tread.blocks), 1, conditions.omega_radps, conditions.radius_m)
    assert (before.order, after.order) == pytest.approx((97.4, 52.4), abs=1.0)
    assert (second.order, second.decay_per_rad) == pytest.approx((113.5, 4.0), rel=0.05)
    # The free orders, decays and pitch of before are here those of a whole number of blocks on a car tire's belt.
    assert tread.blocks == pytest.approx(71.1, abs=0.75)
    assert tread.bending_m4ps2 == pytest.approx(0.43, abs=0.2)
    assert tread.tension_m2ps2 == pytest.approx(1290.0, abs=900.0)
    # Bending damping makes the shorter wave ahead decay faster than the one behind; the sidewall's damping would not.
    assert before.decay_per_rad / after.decay_per_rad == pytest.approx(3.9, abs=0.5)
    undamped = belt_wave(replace(tread, bending_loss_m4ps=0.0, sidewall_loss_ps=100.0), 0, 70.8, 0.3)
    behind = belt_wave(replace(tread, bending_loss_m4ps=0.0, sidewall_loss_ps=100.0), 1, 70.8, 0.3)
    assert undamped.decay_per_rad < 1.5 * behind.decay_per_rad


def test_waves_reduce_the_misfit(fitted: Fitted) -> None:
    assert fitted.before.misfit - fitted.after.misfit == pytest.approx(2054.0, abs=60.0)
    result = parameters(fitted.after)
    assert (result["ahead_order"], result["ahead_place_rad"]) == pytest.approx((28.8, 0.241), rel=0.06)
    # Of an acceleration, so that the second harmonic of the deflection is a sixth of the first.
    first, second = (math.hypot(result[f"{name}_cosine"], result[f"{name}_sine"]) for name in ("after", "second"))
    assert second / first == pytest.approx(0.8, abs=0.15)


@pytest.mark.parametrize(
    ("window", "share_before", "share_after"),
    [
        ((-60.0, -33.0), 0.26, 0.33),
        ((-33.0, -20.0), 0.78, 0.25),
        ((-20.0, -11.5), 0.43, 0.14),
        ((12.0, 60.0), 0.85, 0.46),
    ],
)
def test_waves_explain_the_repeating_part(
    fitted: Fitted, window: tuple[float, float], share_before: float, share_after: float
) -> None:
    there = within(*window)
    shares = [max(0.0, repeating(fitted.left(fit)[:, RADIAL, there])) for fit in (fitted.before, fitted.after)]
    assert shares == pytest.approx([share_before, share_after], abs=0.06)


@pytest.mark.slow
def test_diagnosis_names_the_waves(recording: Path) -> None:
    diagnosis = diagnose_recordings(reading_orders([recording]))
    results = {finding.name: finding for finding in diagnosis.findings if finding.verdict is Verdict.NAMED}
    assert set(results) == {"mounting offset", WAVES}
    assert all(finding.probability > 0.999 for finding in results.values())
    assert diagnosis.held_out.rms_before_mps2 == pytest.approx(88.5, abs=1.0)
    assert diagnosis.held_out.rms_after_mps2 == pytest.approx(53.2, abs=1.0)
    assert diagnosis.noise_floor_mps2 == pytest.approx(44.2, abs=1.5)
    radial = next(axis for axis in diagnosis.held_out.axes if axis.axis == "radial")
    assert (radial.before_mps2, radial.after_mps2) == pytest.approx((108.8, 79.1), abs=1.5)
    assert radial.with_discrepancy_mps2 == pytest.approx(72.9, abs=1.5)
    along = next(axis for axis in diagnosis.held_out.axes if axis.axis == "circumferential")
    assert (along.before_mps2, along.after_mps2) == pytest.approx((103.7, 36.7), abs=1.5)
    offset = results["mounting offset"].parameters["offset_m"]
    assert (offset.value, offset.std) == pytest.approx((6.36e-3, 0.32e-3), abs=2e-4)
    assert not any(diagnosis.determined.get(number, True) for number in ("Bs", "Cw", "Rs", "Ts"))
    assert diagnosis.determined["Bs/Cw"]
    assert diagnosis.estimates_after["Bs/Cw"].value == pytest.approx(4.6e-4, abs=0.9e-4)


@pytest.mark.slow
def test_three_revolutions_give_the_same(recording: Path) -> None:
    campaign = read_campaign(reading_orders([recording]))
    (group,) = campaign.groups
    blocks = group.blocks[::2]
    omega = math.sqrt(np.mean([block.conditions.omega_radps**2 for block in blocks]))
    errors = group.edge_errors_mps2
    few = replace(
        group,
        blocks=blocks,
        conditions=replace(group.conditions, omega_radps=omega),
        edge_errors_mps2=None if errors is None else errors * math.sqrt(5.0 / 3.0),
    )
    diagnosis = diagnose(replace(campaign, groups=(few,)))
    results = {finding.name: finding for finding in diagnosis.findings if finding.verdict is Verdict.NAMED}
    assert set(results) == {"mounting offset", WAVES}
    assert results["mounting offset"].parameters["offset_m"].value == pytest.approx(6.1e-3, abs=3e-4)
    second = [results[WAVES].parameters[f"second_{part}"].value for part in ("cosine", "sine")]
    assert second == pytest.approx([0.14, -0.06], abs=0.04)
    # A second optimum of nearly the same evidence has 70 blocks, as the best one of all five revolutions has.
    blocks = results[WAVES].parameters["blocks"]
    assert blocks.value == pytest.approx(67.3, abs=0.5)
    assert 1.0 < blocks.std < 2.0
