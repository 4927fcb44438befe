import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gateway.console.waveform import MIN_HEIGHT, MIN_WIDTH, Ink, Zoom, draw_waveform, nice_scale

GUTTER = 7
N = 720


def theta_deg(n=N):
    return -180.0 + 360.0 * np.arange(n) / n


def text(rows):
    return ["".join(piece for piece, _ in row) for row in rows]


def dots(rows, ink=None):
    """Return the dots of the plot (without axes) as a boolean array, of one ink or of both."""
    lines = []
    for row in rows[:-2]:
        cells = ""
        for piece, piece_ink in row[1:]:
            cells += piece if ink in (None, piece_ink) else " " * len(piece)
        lines.append([0 if cell == " " else ord(cell) - 0x2800 for cell in cells])
    bits = np.array(lines)
    grid = np.zeros((4 * bits.shape[0], 2 * bits.shape[1]), dtype=bool)
    for i, (item, right) in enumerate(((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))):
        grid[i::4, 0::2] = bits & item != 0
        grid[i::4, 1::2] = bits & right != 0
    return grid


@pytest.mark.parametrize(("width", "height"), [(24, 4), (58, 9), (80, 24), (193, 47)])
@pytest.mark.parametrize("zoom", list(Zoom))
def test_shape_is_exact(width, height, zoom):
    curve = 1000.0 + 300.0 * np.sin(np.radians(theta_deg()))
    rows = draw_waveform(curve, curve + 5.0, width, height, zoom=zoom, edges_rad=(-0.2, 0.2))
    assert len(rows) == height
    assert {len(row) for row in text(rows)} == {width}


@pytest.mark.parametrize(("width", "height"), [(MIN_WIDTH - 1, 20), (80, MIN_HEIGHT - 1), (0, 0)])
def test_too_small_area_gives_no_plot(width, height):
    assert draw_waveform(np.zeros(10), None, width, height) == ()


def test_axes_are_labelled_in_degrees_and_mps2():
    rows = text(draw_waveform(np.full(N, 1000.0), None, 67, 12))
    assert rows[-1].split() == ["m/s²", "-180°", "-90°", "0°", "90°", "180°"]
    assert text(draw_waveform(np.full(N, 1000.0), None, 67, 12, zoom=Zoom.CONTACT))[-1].split()[1:] == [
        *("-90°", "-45°", "0°", "45°", "90°")
    ]
    assert rows[0].startswith("  1000┤")
    assert rows[-3].startswith("     0┤")


@pytest.mark.parametrize("zoom", list(Zoom))
def test_dip_is_at_its_angle(zoom):
    angle = theta_deg()
    curve = np.where((angle >= -20.0) & (angle <= 40.0), 0.0, 1000.0)
    grid = dots(draw_waveform(curve, None, GUTTER + 90, 14, zoom=zoom))
    columns = np.flatnonzero(grid[-1])  # the lowest dots: where the curve is zero
    shown_deg = -zoom.value + 2.0 * zoom.value * columns / (grid.shape[1] - 1)
    step_deg = 2.0 * zoom.value / grid.shape[1]
    assert shown_deg.min() == pytest.approx(-20.0, abs=2.0 * step_deg)
    assert shown_deg.max() == pytest.approx(40.0, abs=2.0 * step_deg)
    assert len(columns) == pytest.approx(60.0 / step_deg, abs=3)


def test_height_is_proportional_to_the_value():
    ramp = np.abs(theta_deg()) / 180.0 * 1000.0
    grid = dots(draw_waveform(ramp, None, GUTTER + 60, 27))
    columns = np.arange(grid.shape[1])
    middle = np.array([np.flatnonzero(grid[:, c]).mean() for c in columns])
    expected = (1.0 - np.abs(2.0 * columns / (grid.shape[1] - 1) - 1.0)) * (grid.shape[0] - 1)
    np.testing.assert_allclose(middle, expected, atol=1.2)


def test_last_revolution_is_an_unbroken_line():
    rng = np.random.default_rng(3)
    curve = np.cumsum(rng.normal(0.0, 50.0, N)) * np.hanning(N)
    grid = dots(draw_waveform(curve, None, GUTTER + 50, 20))
    for item, right in zip(grid.T[:-1], grid.T[1:], strict=True):
        a, b = np.flatnonzero(item), np.flatnonzero(right)
        assert a.min() <= b.max() + 1
        assert b.min() <= a.max() + 1
        assert len(b) == b.max() - b.min() + 1


def test_curves_differ_without_colour():
    high, low = np.full(N, 1000.0), np.full(N, 500.0)
    rows = draw_waveform(high, low, GUTTER + 60, 20)
    last, average = dots(rows, Ink.LAST), dots(rows, Ink.AVERAGE)
    assert last.any(axis=0).all()  # solid
    assert average.any(axis=0).mean() == pytest.approx(0.5)  # every second column only
    assert np.flatnonzero(last.any(axis=1)).max() < np.flatnonzero(average.any(axis=1)).min()


def test_a_single_curve_can_be_missing():
    curve = np.full(N, 1000.0)
    assert not dots(draw_waveform(curve, None, 60, 10), Ink.AVERAGE).any()
    assert not dots(draw_waveform(None, curve, 60, 10), Ink.LAST).any()
    assert not dots(draw_waveform(None, None, 60, 10)).any()
    assert not dots(draw_waveform(np.zeros(0), None, 60, 10)).any()


def test_contact_edges_stand_on_the_axis():
    line = text(draw_waveform(np.ones(N), None, GUTTER + 73, 8, edges_rad=(math.radians(-45.0), math.radians(30.0))))[
        -2
    ]
    assert [i - GUTTER for i, c in enumerate(line) if c == "▲"] == [27, 42]
    outside = draw_waveform(np.ones(N), None, 80, 8, zoom=Zoom.CONTACT, edges_rad=(math.radians(-120.0), math.nan))
    assert "▲" not in text(outside)[-2]


def test_gaps_are_kept():
    curve = np.full(N, 1000.0)
    curve[theta_deg() > 90.0] = np.nan
    curve[theta_deg() < -90.0] = np.inf
    grid = dots(draw_waveform(curve, None, GUTTER + 60, 10))
    drawn = np.flatnonzero(grid.any(axis=0))
    assert drawn.min() == pytest.approx(30, abs=2)
    assert drawn.max() == pytest.approx(90, abs=2)


def test_few_samples_are_interpolated():
    assert dots(draw_waveform(np.array([0.0, 1000.0, 500.0, 800.0]), None, 100, 10)).any(axis=0).all()


@given(st.floats(-1e9, 1e9), st.floats(0.0, 1e9), st.integers(1, 30))
@example(-858993461.0, 1.1, 22)
def test_scale_holds_the_curve_and_few_ticks(low, span, ticks):
    high = low + span
    scale = nice_scale(low, high, ticks)
    # Large numbers round in their last digit.
    tolerance = 1e-6 * scale.step + 4.0 * np.finfo(float).eps * max(abs(low), abs(high))
    assert scale.low <= low + tolerance
    assert scale.high >= high - tolerance
    if high - low >= 1e-3:
        assert (scale.high - scale.low) / scale.step <= ticks + 1.0 + tolerance / scale.step
        assert (high - low) / scale.step > ticks / 2.5 - 1e-6


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=1, max_size=40))
def test_any_curve_can_be_drawn(values):
    curve = np.clip(np.array(values), -1e12, 1e12)
    rows = draw_waveform(curve, curve[::-1].copy(), 40, 9, edges_rad=(values[0], values[-1]))
    assert {len(row) for row in text(rows)} == {40}
