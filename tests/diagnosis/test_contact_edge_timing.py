"""Contact-edge jitter: detected in single revolutions, corrected, and distinguished from other causes."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from closure_rig.draw import Kind, Order, draw
from closure_rig.record import record
from scipy.interpolate import CubicSpline

from gateway.core.reasons import Code
from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.campaign import read_campaign, reading_orders
from gateway.diagnosis.data.campaign_data import Block, EdgeTiming, Group
from gateway.diagnosis.data.contact_edge_timing import TERMS, Edges, bent_back, compare_edges, orders_bent_back
from gateway.diagnosis.data.revolution_orders import waveform_orders
from gateway.diagnosis.data.revolution_scatter import regressors
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.catalogue import candidates, catalogue
from gateway.diagnosis.effects.effect import BaselineModel, ScatterEffect
from gateway.diagnosis.model.baseline_registry import angle_effects
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.remainder.contact_edge_jitter import edge_findings
from gateway.diagnosis.result import Verdict
from tests.diagnosis.belt_data import CONDITIONS, OMEGA, RADIUS_M, THETA, block_of

HALF_RAD = 0.5 * (block_of().trailing_edge_rad - block_of().leading_edge_rad)
NOISE_MPS2 = 0.5
PER_MM = 1e-3 / RADIUS_M


def wheel(
    count: int, leading_mm: float, trailing_mm: float, seed: int, ahead: float = 0.3
) -> tuple[FloatArray, FloatArray]:
    """Return waveforms (count, 3, n) of a wheel with jittering edges, as the pipeline segments them, and the periods.

    The pipeline puts angle 0 of contact k at a + ahead (b - a), as early as that is.
    """
    rng = np.random.default_rng(seed)
    early = rng.standard_normal((count + 1, 2)) * (leading_mm * PER_MM, trailing_mm * PER_MM)
    centre = early[:, 1] + ahead * (early[:, 0] - early[:, 1])
    signal = block_of().signal_mps2
    curve = CubicSpline(np.append(THETA, math.pi), np.append(signal, signal[:, :1], axis=1), axis=1, bc_type="periodic")
    # Wide enough to be constant where the signal is steep.
    felt = np.clip(np.abs(THETA) / (0.3 * HALF_RAD), 0.0, 1.0) * (np.abs(THETA) < HALF_RAD + 0.3)
    waves = np.empty((count, 3, len(THETA)))
    for index in range(count):
        moved = np.where(THETA < 0.0, early[index + 1, 0] - centre[index + 1], early[index, 1] - centre[index])
        waves[index] = curve(THETA + moved * felt)
    waves += NOISE_MPS2 * rng.standard_normal(waves.shape)
    period_s = (2.0 * math.pi - np.diff(centre)) / OMEGA
    return waves, period_s


def compared(waves: FloatArray, period_s: FloatArray | None = None) -> Edges:
    count = len(waves)
    return compare_edges(
        waveform_orders(waves),
        index=np.arange(count),
        period_s=np.full(count, 2.0 * math.pi / OMEGA) if period_s is None else period_s,
        omega_radps=np.full(count, OMEGA),
        omega_dot_radps2=np.zeros(count),
        half_angle_rad=HALF_RAD,
        folds=5,
    )


@pytest.mark.parametrize(("leading_mm", "trailing_mm"), [(0.3, 0.1), (0.2, 0.4), (2.0, 0.5)])
def test_jitter_is_measured_at_its_edge(leading_mm: float, trailing_mm: float) -> None:
    edges = compared(*wheel(150, leading_mm, trailing_mm, 1))
    assert edges.evident
    assert edges.timing.chi2 > 100.0
    length_mm = math.hypot(leading_mm, trailing_mm)
    assert math.sqrt(edges.timing.scatter_rad2) == pytest.approx(length_mm * PER_MM, rel=0.2)
    error = abs(edges.timing.leading_share - (leading_mm / length_mm) ** 2)
    assert error < max(0.1, 3.0 * edges.timing.leading_share_std)
    assert edges.timing.left_m2ps4 < 0.1 * edges.timing.explained_m2ps4


def test_edges_are_corrected() -> None:
    waves, period_s = wheel(600, 3.0, 0.5, 2)
    orders = waveform_orders(waves)
    edges = compared(waves, period_s)
    bent = orders_bent_back(orders, edges.early_rad, HALF_RAD)
    still = waveform_orders(wheel(600, 0.0, 0.0, 2)[0])
    noise, moving, remainder = (o[:, 2].var(axis=0)[:60].mean() for o in (still, orders, bent))
    # The wheel's edges move their surroundings differently from the model's.
    assert remainder - noise < 0.05 * (moving - noise)
    # The mean is sharp again.
    high = slice(30, 60)
    power, smeared, sharp = (np.square(np.abs(o[:, 2].mean(axis=0)))[high].sum() for o in (still, orders, bent))
    assert abs(sharp / power - 1.0) < 0.4 * abs(smeared / power - 1.0)


@pytest.mark.parametrize("seed", range(6))
def test_noise_is_no_jitter(seed: int) -> None:
    edges = compared(*wheel(100, 0.0, 0.0, seed))
    assert not edges.evident
    assert edges.timing.chi2 < 12.0


@pytest.mark.parametrize("hz", [4.3, 11.3, 24.9, 212.0])
def test_signal_away_from_contact_is_no_jitter(hz: float) -> None:
    """A tone continues through the revolutions and is fixed in space like a hub."""
    count = 100
    waves, _ = wheel(count, 0.0, 0.0, 3)
    # In time, a revolution runs from angle 0 through pi to 0.
    turned = np.where(THETA < 0.0, THETA + 2.0 * math.pi, THETA) + 2.0 * math.pi * np.arange(count)[:, None]
    tone = 5.0 * np.cos(2.0 * math.pi * hz / OMEGA * turned)
    waves[:, 2] += tone * np.cos(THETA)
    waves[:, 0] -= tone * np.sin(THETA)
    assert compared(waves).timing.chi2 < 12.0


def test_slow_contact_growth_is_no_jitter() -> None:
    count = 100
    grown = np.linspace(-1.0, 1.0, count)[:, None] * PER_MM
    signal = block_of().signal_mps2
    curve = CubicSpline(np.append(THETA, math.pi), np.append(signal, signal[:, :1], axis=1), axis=1, bc_type="periodic")
    near = np.clip(THETA / (0.3 * HALF_RAD), -1.0, 1.0) * (np.abs(THETA) < HALF_RAD + 0.3)
    places = THETA + grown * near
    waves = np.moveaxis(curve(places), 0, 1)
    waves += NOISE_MPS2 * np.random.default_rng(4).standard_normal(waves.shape)
    assert not compared(waves).evident


def test_few_revolutions_and_gaps_give_nothing() -> None:
    waves, period_s = wheel(3, 2.0, 0.5, 5)
    assert compared(waves, period_s).timing == EdgeTiming()
    waves, _ = wheel(40, 2.0, 0.5, 5)
    edges = compare_edges(
        waveform_orders(waves),
        index=2 * np.arange(40),
        period_s=np.full(40, 0.1),
        omega_radps=np.full(40, OMEGA),
        omega_dot_radps2=np.zeros(40),
        half_angle_rad=HALF_RAD,
        folds=5,
    )
    assert edges.timing == EdgeTiming()
    assert not edges.evident


def test_edges_of_five_revolutions_are_aligned_where_evident() -> None:
    waves, period_s = wheel(5, 3.0, 0.5, 5)
    edges = compared(waves, period_s)
    assert edges.evident
    orders = waveform_orders(waves)
    scatter = [
        float(np.square(np.abs(item - item.mean(axis=0))).sum())
        for item in (orders, orders_bent_back(orders, edges.early_rad, HALF_RAD))
    ]
    assert scatter[1] < 0.2 * scatter[0]
    still, period_s = wheel(5, 0.0, 0.0, 5)
    assert not compared(still, period_s).evident
    ramp = compare_edges(
        orders,
        index=np.arange(5),
        period_s=np.full(5, 0.1),
        omega_radps=OMEGA * (1.0 + 0.005 * np.arange(5)),
        omega_dot_radps2=np.zeros(5),
        half_angle_rad=HALF_RAD,
        folds=5,
    )
    assert not ramp.evident


def test_absent_axes_stay_unknown() -> None:
    waves, period_s = wheel(60, 1.0, 0.3, 6)
    waves[:, 1] = np.nan
    edges = compared(waves, period_s)
    assert edges.evident
    bent = orders_bent_back(waveform_orders(waves), edges.early_rad, HALF_RAD)
    assert np.isnan(bent[:, 1]).all()
    assert np.isfinite(bent[:, [0, 2]]).all()


def test_correction_reverses_a_shift() -> None:
    early = np.zeros((1, TERMS))
    early[0] = 4e-3, -2e-3, 1e-3, 0.0
    plain = np.cos(3.0 * THETA) + 0.3 * np.cos(40.0 * THETA)
    effect = catalogue()["contact edge scatter"]
    assert isinstance(effect, ScatterEffect)
    position = THETA + early[0] @ effect.windows(THETA, HALF_RAD)
    moved = np.cos(3.0 * position) + 0.3 * np.cos(40.0 * position)
    assert np.abs(moved - plain).max() > 0.03
    back = bent_back(moved[None, None], THETA, early, HALF_RAD)[0, 0]
    assert np.abs(back - plain).max() < 1e-3


def test_mean_waveform_is_not_used() -> None:
    for model in BaselineModel:
        assert "contact edge scatter" in candidates(model)
        assert "contact edge scatter" not in angle_effects(candidates(model))


def test_steady_acceleration_is_no_jitter() -> None:
    rng = np.random.default_rng(7)
    true = OMEGA * np.linspace(0.995, 1.005, 100)
    timed = true * (1.0 + 4e-4 * rng.standard_normal(100))
    square = regressors(timed, np.zeros(100))[:, 0]
    truth = np.square(true) / np.square(true).mean()
    assert np.std(square - truth) < 0.5 * np.std(np.square(timed) / np.square(timed).mean() - truth)
    # No distortion at the ends.
    assert regressors(true, np.zeros(100))[:, 0] == pytest.approx(truth, abs=1e-5)


def group(timing: EdgeTiming, label: str = "run") -> Group:
    block = Block(50, CONDITIONS, np.zeros((3, ORDERS), complex))
    return Group(label, 0, 0, CONDITIONS, (block,) * 5, np.ones((3, ORDERS)), HALF_RAD, edges=timing)


def timing(scatter_mm: float, noise_mm: float = 0.05, *, left: float = 0.0) -> EdgeTiming:
    square, noise = np.square(np.array([scatter_mm, noise_mm]) * PER_MM).tolist()
    spread = np.array([0.9, 1.1, 1.0, 0.95, 1.05])
    return EdgeTiming((14.0,) * 5, tuple((spread * (square + noise)).tolist()), noise, 0.8, 0.05, 100.0, left)


def test_finding_has_sizes_and_evidence() -> None:
    (result,) = edge_findings([group(timing(0.5)), group(timing(0.4)), group(EdgeTiming())])
    assert result.verdict is Verdict.NAMED
    assert result.name == "contact edge scatter"
    mean = math.sqrt(0.5 * (0.25 + 0.16))
    assert result.parameters["leading_m"].value == pytest.approx(1e-3 * mean * math.sqrt(0.8), rel=0.02)
    assert result.parameters["trailing_m"].value == pytest.approx(1e-3 * mean * math.sqrt(0.2), rel=0.02)
    assert 0.0 < result.parameters["leading_m"].std < 0.2 * result.parameters["leading_m"].value
    assert result.probability >= criteria.NAMED
    assert result.log_odds > 20.0


def test_weak_jitter_has_a_probability_but_no_name() -> None:
    (result,) = edge_findings([group(timing(0.035)), group(timing(0.035))])
    assert result.verdict is Verdict.REFUSED
    assert criteria.LISTED < result.probability < criteria.NAMED
    assert result.reason is not None
    assert result.reason.code is DiagnosisCode.PROBABILITY_TOO_LOW


def test_no_finding_without_evidence() -> None:
    assert edge_findings([]) == ()
    assert edge_findings([group(EdgeTiming())]) == ()
    assert edge_findings([group(timing(0.01)), group(timing(0.0))]) == ()


def test_one_unsteady_stretch_is_no_jitter() -> None:
    """As a fold that begins with the end of a ramp."""
    steady = timing(0.0)
    ramp = replace(steady, power_rad2=(10.0 * steady.power_rad2[0], *steady.power_rad2[1:]))
    assert edge_findings([group(ramp)]) == ()


@pytest.mark.parametrize(
    ("groups", "why"),
    [
        ([group(timing(0.5)), group(timing(0.0)), group(timing(0.5))], DiagnosisCode.SIZE_DIFFERS_BETWEEN_RECORDINGS),
        ([group(timing(0.5, left=60.0))], DiagnosisCode.LEAVES_RESIDUAL_AT_EDGES),
        ([group(timing(40.0))], DiagnosisCode.IMPLAUSIBLE_PARAMETER),
    ],
)
def test_failed_acceptance_test_is_refused(groups: list[Group], why: Code) -> None:
    (result,) = edge_findings(groups)
    assert result.verdict is Verdict.REFUSED
    assert result.reason is not None
    assert result.reason.code is why


@pytest.mark.parametrize(("size", "seed"), [(1, 21), (2, 22)])
def test_jitter_is_found_in_recordings(tmp_path: Path, size: int, seed: int) -> None:
    case = draw(Order(Kind.EFFECT, seed, ("contact edge scatter",), size))
    stated = record(case, tmp_path, 5.0)
    campaign = read_campaign(reading_orders(stated.paths, reverse=stated.reverse))
    (result,) = edge_findings(campaign.groups)
    assert result.verdict is Verdict.NAMED
    truth = case.tables["road"]["leading_jitter_mm"]
    # In a short contact each edge moves the other.
    assert 0.5 * truth < 1e3 * result.parameters["leading_m"].value < 1.3 * truth


@pytest.fixture(scope="module")
def steep() -> tuple[FloatArray, FloatArray]:
    """Mean of many steady revolutions, and its scatter."""
    orders = waveform_orders(wheel(400, 0.0, 0.0, 31)[0])
    return orders.mean(axis=0), orders.var(axis=0)


def test_mean_waveform_errs_as_its_mean_edges_do(steep: tuple[FloatArray, FloatArray]) -> None:
    """Deviations of corrected means have unit size along the stated errors, and next to none beside them."""
    still, scatter = steep
    count, sizes, beside, power = 60, [], 0.0, 0.0
    for seed in range(24):
        waves, period_s = wheel(count, 1.0, 0.3, 100 + seed, ahead=0.5)
        edges = compared(waves, period_s)
        mean = orders_bent_back(waveform_orders(waves), edges.early_rad, HALF_RAD).mean(axis=0)
        away = (mean - still)[2, 1:60]
        errors = edges.errors_of_mean(mean, np.arange(count))[:, 2, 1:60]
        largest = errors[np.argmax(np.square(np.abs(errors)).sum(axis=1))]
        size = float((np.conj(largest) * away).real.sum() / np.square(np.abs(largest)).sum())
        sizes.append(size)
        beside += float(np.square(np.abs(away - size * largest)).sum() - scatter[2, 1:60].sum() / count)
        power += float(np.square(np.abs(away)).sum() - scatter[2, 1:60].sum() / count)
    assert 0.6 < float(np.std(sizes)) < 1.6
    assert beside < 0.3 * power


def test_steady_edges_have_no_error() -> None:
    edges = compared(wheel(60, 0.0, 0.0, 5)[0])
    assert not edges.evident
    assert not len(edges.errors_of_mean(np.zeros((3, ORDERS), dtype=complex), np.arange(60)))


def test_jitter_that_goes_with_the_speed_is_corrected() -> None:
    """By chance edges come earlier and earlier while the speed falls: no change of the waveform with speed."""
    count = 60
    waves, period_s = wheel(count, 1.0, 0.0, 7)
    drift = np.linspace(0.005, -0.005, count)
    omega = OMEGA * (1.0 + drift)
    edges = compare_edges(
        waveform_orders(waves * np.square(omega / OMEGA)[:, None, None]),
        index=np.arange(count),
        period_s=period_s,
        omega_radps=omega,
        omega_dot_radps2=np.full(count, -0.01 * OMEGA / (count * 2.0 * math.pi / OMEGA)),
        half_angle_rad=HALF_RAD,
        folds=5,
    )
    same = compared(waves, period_s)
    slopes = [np.polyfit(drift, item.early_rad[:, 0], 1)[0] for item in (edges, same)]
    assert abs(slopes[1]) > 0.02
    assert slopes[0] == pytest.approx(slopes[1], rel=0.25)


def test_mean_edges_make_the_mean_uncertain_not_its_orders(tmp_path: Path) -> None:
    case = draw(Order(Kind.EFFECT, 23, ("contact edge scatter",), 2))
    seen = []
    for name, tables in (("moving", case.tables), ("still", {})):
        folder = tmp_path / name
        folder.mkdir()
        reading = record(replace(case, tables=tables), folder, 4.0)
        (group,) = read_campaign(reading_orders(reading.paths[1:2])).groups
        assert bool(group.edges.explained_m2ps4) == (name == "moving")
        seen.append(group)
    moving, still = seen
    assert still.edge_errors_mps2 is None
    assert moving.edge_errors_mps2 is not None
    count = sum(block.count for block in moving.blocks)
    stated = np.square(np.abs(moving.edge_errors_mps2[:, 2, 5:30])).sum()
    assert stated > 3.0 * still.variance[2, 5:30].sum() / count
    # The scatter of the orders themselves is that of corrected revolutions.
    assert moving.variance[2, 5:30].sum() < 0.3 * count * stated
