"""The series as a baseline model, against its equations and the exact ring."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from gateway.core.types import FloatArray
from gateway.diagnosis.effects.effect import FIELD_SIZE, GroupConditions
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.diagnosis.model.series_baseline import SeriesCore
from gateway.ring.contact_pressure import road_orders
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.ring_series import Kinematics, RoadForce, modal_stiffness, signal_orders
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring
from gateway.ring.rolling_ring.sensor_waveform import waveform_orders

RADIUS_M, PRESSURE_PA, OMEGA_RADPS = 0.32, 2.1e5, 56.0
PLAIN = RingOptions()
CORRECTED = RingOptions(kinematics=1.0)
THETA = -math.pi + 2.0 * math.pi / FIELD_SIZE * np.arange(FIELD_SIZE)


def conditions(load_n: float = 5000.0, radius_m: float = RADIUS_M) -> GroupConditions:
    return GroupConditions(OMEGA_RADPS, 0.0, radius_m, load_n, PRESSURE_PA, 25.0, 25.0, 9600.0, 0.0)


def table_3_at(load_n: float) -> FloatArray:
    """Parameters of Table 3's numbers at another load."""
    return np.full(4, math.log(5000.0 / load_n))


def exact(load_n: float, **others: float) -> RingSolution:
    ring = RingParameters.from_numbers(
        *TABLE_3_NUMBERS, radius_m=RADIUS_M, pressure_pa=PRESSURE_PA, extension_stiffness_n=2e10, **others
    )
    return solve_rolling_ring(ring, load_n, PRESSURE_PA, OMEGA_RADPS, nodes=1440)


def legendre_amounts(ring: RingSolution) -> tuple[float, float]:
    """a_2 and a_4 of a solution's contact pressure."""
    x = (ring.theta_rad - ring.contact_centre_rad) / ring.half_angle_rad
    share = ring.contact_pressure_npm * RADIUS_M * (ring.theta_rad[1] - ring.theta_rad[0]) / ring.load_n
    clipped = np.clip(x, -1.0, 1.0)
    a2, a4 = ((2 * m + 1) * float(share @ np.polynomial.legendre.legval(clipped, [0.0] * m + [1.0])) for m in (2, 4))
    return a2, a4


@pytest.mark.parametrize(
    ("options", "kinematics", "road"),
    [(PLAIN, Kinematics.PRINTED, RoadForce.RADIAL), (CORRECTED, Kinematics.CORRECTED, RoadForce.VERTICAL)],
)
@pytest.mark.parametrize(("load_n", "half_angle_rad"), [(5000.0, 0.24), (2000.0, 0.115), (8000.0, 0.33)])
def test_core_matches_the_series(
    options: RingOptions, kinematics: Kinematics, road: RoadForce, load_n: float, half_angle_rad: float
) -> None:
    core = SeriesCore()
    shift = np.array([0.2, -0.1, 0.3, -0.4])
    parameters = table_3_at(load_n) + shift
    numbers = tuple(np.array(TABLE_3_NUMBERS) * np.exp(shift))
    result = core.numbers(parameters, conditions(load_n))
    assert [result[name] for name in ("Bs", "Cw", "Rs", "Ts")] == pytest.approx(numbers, rel=1e-12)
    shape = core.shape(parameters, conditions(load_n), options, half_angle_rad)
    expected = signal_orders(
        np.arange(1, 111), numbers, load_n=load_n, pressure_pa=PRESSURE_PA, radius_m=RADIUS_M,
        half_angle_rad=half_angle_rad, kinematics=kinematics, road=road,
    )  # fmt: skip
    orders = waveform_orders(shape.waveform.radial_m, 110)
    assert np.abs(orders[1:] - expected).max() < 1e-12
    assert orders[0].real == pytest.approx(0.0, abs=1e-12)
    assert (shape.leading_edge_rad, shape.trailing_edge_rad) == (-half_angle_rad, half_angle_rad)
    assert not shape.waveform.circumferential_m.any()
    assert (core.gravity, core.drift, core.mean) == (False, False, False)


def test_shape_is_independent_of_load_and_size() -> None:
    core = SeriesCore()
    parameters = np.array([0.1, -0.2, 0.3, 0.2])
    options = replace(CORRECTED, pressure_p2=-0.3, tension_loss=0.5)
    single = core.shape(parameters, conditions(), options, 0.24).waveform.radial_m / RADIUS_M
    other = core.shape(parameters, conditions(3000.0, 0.3), options, 0.24).waveform.radial_m / 0.3
    assert other == pytest.approx(single, abs=1e-12)


def test_pressure_shape_matches_contact_pressure() -> None:
    p2, p4, half_angle = -0.4, -0.55, 0.24
    n = np.arange(2, 111)
    push = road_orders(n, 5000.0, RADIUS_M, half_angle, (0.0, p2, 0.0, p4)).real
    expected = -(n**2.0) * (n**2.0 - 1.0) * push / (math.pi * PRESSURE_PA * modal_stiffness(n, TABLE_3_NUMBERS))
    options = replace(CORRECTED, pressure_p2=p2, pressure_p4=p4)
    series = SeriesCore().shape(np.zeros(4), conditions(), options, half_angle)
    assert np.abs(waveform_orders(series.waveform.radial_m, 110)[2:] - expected).max() < 1e-12


def test_kinematics_are_corrected_in_proportion() -> None:
    options = replace(CORRECTED, pressure_p2=-0.2)
    paper = SeriesCore().shape(np.zeros(4), conditions(), options, 0.24).waveform
    assert not paper.gravity_radial.any()
    half = SeriesCore().shape(np.zeros(4), conditions(), replace(options, kinematics=0.5), 0.24)
    none = SeriesCore().shape(np.zeros(4), conditions(), replace(options, kinematics=0.0), 0.24)
    assert half.waveform.radial_m == pytest.approx(0.5 * (paper.radial_m + none.waveform.radial_m), abs=1e-12)


def test_series_is_exact_at_small_load() -> None:
    ring = exact(50.0)
    p2, p4 = legendre_amounts(ring)
    parameters = table_3_at(50.0)
    options = replace(CORRECTED, pressure_p2=p2, pressure_p4=p4)
    wave = SeriesCore().shape(parameters, conditions(50.0), options, ring.half_angle_rad).waveform
    orders, true = waveform_orders(wave.radial_m, 40)[1:], waveform_orders(ring.sensor.radial_m, 40)[1:]
    assert np.abs(orders - true).max() < 0.01 * max(float(np.abs(true[1:]).max()), 1e-3 * RADIUS_M)


@pytest.mark.parametrize(("load_n", "share"), [(3000.0, 0.002), (5000.0, 0.003), (6000.0, 0.01)])
def test_tension_loss_and_pressure_give_the_exact_ring(load_n: float, share: float) -> None:
    # A tread as stiff over its load as the one that the core takes. Two Legendre amounts are its pressure but for the
    # higher ones, which grow with load.
    ring = exact(load_n, tread_stiffness_npm2=7e7 * load_n / 5000.0)
    p2, p4 = legendre_amounts(ring)
    parameters = table_3_at(load_n)
    core = SeriesCore()
    options = replace(CORRECTED, pressure_p2=p2, pressure_p4=p4)

    def distance(tension_loss: float) -> float:
        there = replace(options, tension_loss=tension_loss)
        wave = core.shape(parameters, conditions(load_n), there, ring.half_angle_rad).waveform
        true = waveform_orders(ring.sensor.radial_m, 110)[1:]
        return float(np.linalg.norm(waveform_orders(wave.radial_m, 110)[1:] - true) / np.linalg.norm(true))

    assert distance(1.0) < share
    assert distance(0.0) > 10.0 * distance(1.0)
    assert distance(0.5) == pytest.approx(0.5 * distance(0.0), rel=0.1)


def test_derivative_steps_are_accurate() -> None:
    core = SeriesCore()
    options = replace(CORRECTED, tension_loss=1.0, pressure_p2=-0.3)

    def slope(place: int, step: float) -> FloatArray:
        fields = []
        for sign in (0.0, 1.0):
            parameters = np.zeros(4)
            parameters[place] = sign * step
            fields.append(core.shape(parameters, conditions(), options, 0.24).waveform.radial_m)
        return (fields[1] - fields[0]) / step

    for index, step in enumerate(core.steps):
        single, half = slope(index, float(step)), slope(index, 0.5 * float(step))
        assert np.linalg.norm(single - half) < 0.005 * np.linalg.norm(single)


def test_paper_corrections_are_found() -> None:
    """From Eq. 27 as printed to the exact ring's own numbers, by the options that its corrections are."""
    load_n = 3000.0
    ring = exact(load_n)
    data = waveform_orders(ring.sensor.radial_m, 110).real[1:]
    core = SeriesCore()

    def misfit(vector: FloatArray) -> FloatArray:
        options = RingOptions(
            kinematics=vector[4], pressure_p2=vector[5], pressure_p4=vector[6], tension_loss=vector[7]
        )
        wave = core.shape(vector[:4], conditions(load_n), options, ring.half_angle_rad).waveform
        return (waveform_orders(wave.radial_m, 110).real[1:] - data) / np.linalg.norm(data)

    def best(free: int) -> tuple[FloatArray, float]:
        start = np.concatenate([np.zeros(4), [1.0, -0.35, -0.5, 1.0]])[:free]
        result = least_squares(lambda v: misfit(np.concatenate([v, np.zeros(8 - free)])), start, x_scale=0.3)
        return result.x, math.sqrt(2.0 * result.cost)

    _, before = best(4)
    after, remainder = best(8)
    assert before > 0.07
    assert remainder < 0.001
    assert np.exp(after[:4] - table_3_at(load_n)) == pytest.approx(1.0, abs=0.03)
    assert after[4] == pytest.approx(1.0, abs=0.05)
    assert after[5:7] == pytest.approx(legendre_amounts(ring), abs=0.05)
    assert after[7] == pytest.approx(1.0, abs=0.15)


def test_out_of_range_numbers_are_refused() -> None:
    core = SeriesCore()
    with pytest.raises(ValueError, match="finite"):
        core.shape(np.array([1000.0, 0.0, 0.0, 0.0]), conditions(), PLAIN, 0.24)
