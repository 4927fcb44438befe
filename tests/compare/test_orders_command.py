"""The command `treadlink orders`."""

import csv
import io
import json
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.compare.order_statistics import BLOCK_REVOLUTIONS, OrderAccumulator
from gateway.compare.recorded_orders import _Wheel, recorded_orders
from gateway.compare.views.order_figure import write_figure
from gateway.core.errors import OutputError, RecordingError
from gateway.core.recording.recorded_file import open_recorded_file
from gateway.core.revolutions.angle_resampling import GRID_SIZE
from gateway.core.revolutions.order_spectrum import order_coefficients
from gateway.core.session.recording_pass import OpenedRecording
from gateway.exporting.recorded_signals import revolutions
from tests.testkit.campaign_recordings import write_recording
from tests.testkit.commands import invoked
from tests.testkit.revolution_data import plain_revolution


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Two wheels, the sensor of W1 without a lateral axis; 14 revolutions each."""
    wheels = ("", "[wheel.sensor]\naxes = ['circumferential', 'radial']")
    path = tmp_path_factory.mktemp("orders") / "drive.mcap"
    return write_recording(path, "[sensor]\nrate_hz = 3200.0", wheels=wheels, duration_s=1.8)


@pytest.fixture(scope="module")
def two_speeds(tmp_path_factory):
    """One wheel at 50 and at 70 km/h, at least a block of revolutions each."""
    path = tmp_path_factory.mktemp("orders") / "speeds.mcap"
    motion = "[motion]\nspeed_kmh = [[0, 50], [1.8, 50], [2.2, 70], [4, 70]]\n[sensor]\nrate_hz = 3200.0"
    return write_recording(path, motion, duration_s=4.0)


def run(*words):
    return invoked("orders", *words)


def test_terminal_shows_shares_and_amplitudes(recorded):
    done = run(recorded, "--orders", "3")
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    first, second = (next(line for line in lines if line.startswith(wheel)) for wheel in ("W0", "W1"))
    assert "revolutions at 65.0 to 65.0 km/h" in first
    assert second.startswith("W1  ")
    share = next(line for line in lines if "power on integer orders" in line)
    assert share.count("%") == 3
    assert [line.split()[:2] for line in lines if line.startswith("  order")][:3] == [
        ["order", str(n)] for n in (1, 2, 3)
    ]
    of_second = lines[lines.index(second) :]
    assert "—" in next(line for line in of_second if "order 2" in line)


def test_json_agrees_with_the_revolutions(recorded, tmp_path):
    path = tmp_path / "o.json"
    assert run(recorded, "--json", path, "--wheel", "W0").exit_code == 0
    (wheel,) = json.loads(path.read_text("utf-8"))["wheels"]
    selected = [
        speed.revolution
        for speed in revolutions(OpenedRecording(open_recorded_file(recorded)))
        if speed.position == "hub0.wheel0"
    ]
    usable = [speed for speed in selected if not speed.faults]
    orders = np.array([order_coefficients(speed.axes_mps2, speed.order_max) for speed in usable])
    expected = np.sqrt(np.mean(np.abs(orders) ** 2, axis=0))
    reference = np.isfinite(expected[2])
    result = np.array(wheel["amplitude_mps2"]["radial"], dtype=float)
    np.testing.assert_allclose(result[reference], expected[2][reference], rtol=1e-9)
    assert (wheel["revolutions"], wheel["revolutions_with_faults"]) == (len(usable), len(selected) - len(usable))
    assert 0.9 < wheel["integer_share"]["radial"] <= 1.0
    assert len(wheel["average"]["angle_rad"]) == 1024
    assert sum(speed["revolutions"] for speed in wheel["speeds"]) == len(usable)


def test_a_revolution_after_a_gap_of_the_recording_begins_a_block():
    wheel = _Wheel(0.3, OrderAccumulator(5.0))
    for index in range(BLOCK_REVOLUTIONS):
        revolution = plain_revolution(GRID_SIZE, index=index, follows=index not in (0, 4))
        wheel.add(SimpleNamespace(revolution=revolution))
    assert wheel.orders.statistics().block_revolutions == 4


def test_json_has_a_spectrum_for_each_speed(two_speeds, tmp_path):
    assert run(two_speeds, "--speed-step", "20", "--json", tmp_path / "o.json").exit_code == 0
    wheel = json.loads((tmp_path / "o.json").read_text("utf-8"))["wheels"][0]
    measured = [speed for speed in wheel["speeds"] if speed["fine_blocks"]]
    assert len(measured) >= 2
    assert sum(speed["fine_blocks"] for speed in measured) == wheel["fine_blocks"]
    for speed in measured:
        assert 0.9 < speed["integer_share"]["radial"] <= 1.0
        assert len(speed["fine_mps2"]["radial"]) == len(wheel["fine_order"])


def test_terminal_shows_the_share_of_each_speed(two_speeds):
    lines = run(two_speeds, "--speed-step", "20", "--orders", "0").output.splitlines()
    speeds = [line for line in lines if line.startswith("    ") and " km/h " in line]
    assert len(speeds) >= 2
    assert all(line.rstrip().endswith("%") for line in speeds)


def test_csv_to_a_pipe_has_every_order_and_speed(recorded):
    done = run(recorded, "--csv", "-")
    rows = list(csv.DictReader(io.StringIO(done.stdout)))
    assert {row["wheel"] for row in rows} == {"W0", "W1"}
    selected = [row for row in rows if row["wheel"] == "W1" and row["order"] == "5"]
    assert len(selected) >= 2
    assert all(float(row["speed_low_kmh"]) % 5.0 == 0.0 for row in selected[1:])
    assert all(row["lateral_mps2"] == "" for row in selected)
    assert float(selected[0]["radial_repeated_mps2"]) <= float(selected[0]["radial_mps2"])
    assert done.stderr.startswith("W0  ")


@pytest.fixture(scope="module")
def orders(recorded):
    return recorded_orders(recorded, wheels=["W0"], speed_step_mps=2.0).wheels


@pytest.mark.parametrize(("suffix", "start"), [("svg", b"<?xml"), ("png", b"\x89PNG"), ("html", b"<!doctype html>")])
def test_figures_are_drawn_the_same_way_twice(orders, tmp_path, suffix, start):
    pytest.importorskip("matplotlib")
    first, second = tmp_path / f"a.{suffix}", tmp_path / f"b.{suffix}"
    for path in (first, second):
        write_figure(path, orders, "drive.mcap")
    assert first.read_bytes().startswith(start)
    assert first.read_bytes() == second.read_bytes()


def test_page_loads_nothing_and_escapes_names(orders, tmp_path):
    pytest.importorskip("matplotlib")
    write_figure(tmp_path / "o.html", orders, "<script>x.mcap")
    page = (tmp_path / "o.html").read_text("utf-8")
    assert "order 5" in page
    assert "src=" not in page
    assert "<script" not in page


def test_errors_name_what_is_missing(recorded, tmp_path):
    done = run(recorded, "--wheel", "XX")
    assert isinstance(done.exception, RecordingError)
    assert "wheel XX" in str(done.exception)
    done = run(recorded, "--figure", tmp_path / "o.pdf")
    assert isinstance(done.exception, OutputError)
    assert ".svg" in done.exception.remedy
