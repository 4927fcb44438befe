"""Assumptions under which Figs. 14 to 16 of the ring paper come out."""

import math

import numpy as np
import pytest

from gateway.papers.ring_data import OMEGA_RADPS
from gateway.papers.trend_assumptions import (
    ASSUMPTIONS,
    Edge,
    agrees,
    angle_error_exponent,
    edge_pressure,
    half_angle,
    readings,
    trend,
)

BY_NAME = {assumption.name: assumption for assumption in ASSUMPTIONS}
BASE = "constant width"


def test_constant_width_has_no_trend_of_the_paper() -> None:
    result = readings(BY_NAME[BASE])
    assert len(result) == 9
    assert trend("Cw", result).correlation < -0.5
    assert trend("Rs", result).correlation > 0.5
    assert trend("Ts", result).correlation < -0.5


@pytest.mark.parametrize("name", ["width of MF-Tyre", "width of Eq. 31", "sidewall softens"])
def test_tire_alone_does_not_give_the_trends(name: str) -> None:
    assert not agrees(readings(BY_NAME[name]))


@pytest.mark.parametrize(
    "name",
    ["edge pressure", "steepest slope, MF width", "steepest slope, firm tread", "steepest, firm tread, MF width"],
)
def test_edge_pressure_or_edges_give_all_three_trends(name: str) -> None:
    result = readings(BY_NAME[name])
    assert agrees(result)
    assert max(item.residual_share for item in result) < 0.12


def test_weak_form_finds_the_width_whatever_the_tread() -> None:
    for name in (BASE, "edge pressure", "steepest slope, firm tread"):
        assert abs(trend("Cw", readings(BY_NAME[name]), weak_form=True).exponent) < 0.01
    assert trend("Cw", readings(BY_NAME["width of Eq. 31"]), weak_form=True).exponent == pytest.approx(1.0, abs=0.02)
    for reading in readings(BY_NAME["steepest, firm tread, MF width"]):
        assert reading.weak_form[1] == pytest.approx(reading.solution.numbers.Cw, rel=0.005)


def test_width_of_mf_tyre_grows_with_load() -> None:
    """Pacejka 2012, Eq. A3.8, with the deflection of the tire of constant width."""
    places = slice(3, 6)
    x = np.array([item.solution.deflection_m / 0.32 for item in readings(BY_NAME[BASE])[places]])
    expected = 1.059 * np.cbrt(x) - 1.1878 * x
    widths = np.array([item.solution.numbers.Cw for item in readings(BY_NAME["width of MF-Tyre"])[places]])
    np.testing.assert_allclose(widths / 0.1953, expected / expected[1], rtol=1e-3)
    assert widths[2] / widths[0] == pytest.approx(1.23, abs=0.01)


def test_stiff_tread_presses_at_the_edges() -> None:
    soft, stiff = (edge_pressure(readings(BY_NAME[name])[4].solution) for name in (BASE, "edge pressure"))
    assert soft == pytest.approx(0.62, abs=0.02)
    assert stiff == pytest.approx(0.85, abs=0.02)


def test_edges_are_those_of_their_definition() -> None:
    solution = readings(BY_NAME[BASE])[4].solution
    steepest, mean = half_angle(solution, Edge.STEEPEST), half_angle(solution, Edge.BASELINE)
    assert half_angle(solution, Edge.TRUE) == solution.half_angle_rad
    assert steepest < solution.half_angle_rad < mean
    # The steepest slope of the radial axis is the peak of the circumferential one of a sensor below the neutral layer.
    slope = np.gradient(solution.sensor.radial_m, solution.theta_rad)
    after = solution.theta_rad > 0.0
    assert steepest == pytest.approx(solution.theta_rad[np.argmax(np.where(after, slope, -math.inf))], abs=0.01)
    assert np.interp(mean, solution.theta_rad, solution.sensor.radial_m) == pytest.approx(
        solution.sensor.radial_m.mean(), rel=1e-6
    )
    assert solution.omega_radps == OMEGA_RADPS


def test_error_of_the_angle_moves_along_fig_14() -> None:
    assert angle_error_exponent() == pytest.approx(3.8, abs=0.1)
