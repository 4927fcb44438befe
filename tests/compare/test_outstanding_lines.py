"""Lines between the orders: told where they stand out of noise, with what they keep, and not where there are none."""

import re
from dataclasses import replace

import numpy as np
import pytest

from gateway.compare.order_statistics import OrderAccumulator, OrderStatistics
from gateway.compare.outstanding_lines import Keeps, outstanding_lines
from gateway.compare.recorded_orders import recorded_orders
from gateway.compare.views.order_figure import orders_page
from gateway.compare.views.order_verdict import order_verdict
from gateway.core.revolutions.angle_resampling import GRID_SIZE, angle_grid
from tests.testkit.campaign_recordings import write_recording

STEADY = np.full(64, 60.0)
THREE_SPEEDS = np.repeat([37.0, 49.0, 70.0], 40)
DRIVE = np.interp(np.arange(240) % 120, [0, 20, 40, 60, 80, 100, 120], [56, 56, 87, 87, 30, 30, 56])


def rolled(speeds_radps, *, seed: int, order: float = 0.0, frequency_hz: float = 0.0, sampled_hz: float = 1e4):
    """Return orders of a contact waveform with gravity and noise, and a radial line of an order or a frequency."""
    random, angle = np.random.default_rng(seed), angle_grid()
    # A revolution begins at the contact's centre.
    part = np.mod(angle, 2.0 * np.pi) / (2.0 * np.pi)
    waveform = 0.05 - np.exp(-np.square(angle / 0.25))
    orders, time_s = OrderAccumulator(4.0), 0.0
    for index, omega_radps in enumerate(speeds_radps):
        axes = 0.3 * omega_radps**2 * np.outer([0.05, 0.1, 1.0], waveform) + 2.0 * random.normal(size=(3, GRID_SIZE))
        axes[0] += 9.8 * np.sin(angle)
        axes[2] += 9.8 * np.cos(angle)
        period_s = 2.0 * np.pi / omega_radps
        cycles = order * (index + part) + frequency_hz * (time_s + period_s * part)
        axes[2] += np.cos(2.0 * np.pi * cycles) if order or frequency_hz else 0.0
        time_s += period_s
        orders.add(index, axes, omega_radps, min(60, int(0.5 * sampled_hz * period_s)))
    statistics = orders.statistics()
    assert isinstance(statistics, OrderStatistics)
    return statistics


@pytest.mark.parametrize("speeds", [STEADY, STEADY[:8], THREE_SPEEDS, DRIVE], ids=["steady", "few", "steps", "drive"])
def test_noise_and_gravity_make_no_line(speeds):
    assert [seed for seed in range(12) if outstanding_lines(rolled(speeds, seed=seed))] == []


def test_noise_makes_no_line_at_orders_that_few_of_the_blocks_carry():
    speeds = np.repeat([43.9, 40.1], [64, 8])
    assert [seed for seed in (1, 2) if outstanding_lines(rolled(speeds, seed=seed, sampled_hz=560.0))] == []


@pytest.mark.parametrize(
    ("order", "speeds"), [(2.375, STEADY), (5.45, STEADY), (0.44, STEADY), (57.5, STEADY), (2.375, DRIVE)]
)
def test_a_line_of_an_order_is_told_once_on_its_axis(order, speeds):
    (line,) = outstanding_lines(rolled(speeds, seed=3, order=order))
    assert line.axis == "radial"
    assert line.order == pytest.approx(order, abs=0.125)
    assert line.times > 3.0
    assert line.amplitude_mps2 < 1.2


@pytest.mark.parametrize(
    ("made_by", "keeps"), [({"order": 3.375}, Keeps.ORDER), ({"frequency_hz": 50.0}, Keeps.FREQUENCY)]
)
def test_steady_speeds_tell_what_a_line_keeps_and_one_does_not(made_by, keeps):
    line = outstanding_lines(rolled(THREE_SPEEDS, seed=4, **made_by))[0]
    assert line.keeps is keeps
    if keeps is Keeps.FREQUENCY:
        assert line.frequency_hz == pytest.approx(50.0, rel=0.06)
    (line,) = outstanding_lines(rolled(STEADY, seed=4, **made_by))
    assert line.keeps is Keeps.UNKNOWN


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Return the orders of a short recording."""
    path = write_recording(tmp_path_factory.mktemp("orders") / "a.mcap", "[sensor]\nrate_hz = 3200.0", duration_s=1.8)
    return recorded_orders(path, speed_step_mps=2.0).wheels[0]


def test_the_page_says_whether_all_is_well_and_what_to_do(wheel):
    calm = order_verdict([replace(wheel, statistics=rolled(STEADY, seed=1))])
    assert calm.answer.startswith("Nothing stands out between the orders: beyond what noise makes, no line has 2 times")
    assert "Nothing to act on." in calm.answer
    assert not calm.steps
    assert not calm.lines
    told = order_verdict([replace(wheel, wheel="RL", statistics=rolled(THREE_SPEEDS, seed=1, order=2.375))])
    assert told.answer.startswith("Between the orders 1 line stands out: RL.")
    assert "Nothing to act on." not in told.answer
    assert told.lines[0].startswith("RL, radial axis: order 2.38 (about ")
    assert "it keeps its order as the speed changes: something that turns" in told.lines[0]
    assert told.steps == [{"about": "RL, order 2.38", "step": "look for what turns 2.38 times as fast as the wheel"}]


def test_pictures_of_the_page_are_narrow_enough_for_a_phone(wheel):
    pytest.importorskip("matplotlib")
    page = orders_page([wheel], "a.mcap", 1_790_000_000 * 10**9)
    assert "2026-09-21 14:13:20 UTC" in page
    widths = [float(box.split()[2]) for box in re.findall(r'<svg viewBox="([^"]*)"', page)]
    assert len(widths) == 6
    # Letters of ten points keep ten pixels where the page is 358 pixels wide.
    assert max(widths) <= 358.0
