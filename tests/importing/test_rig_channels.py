"""Channels of a rig that vary in time: their value at each revolution, in calibrations and comparisons."""

import math
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.compare.views.drive import Drive
from gateway.compare.views.drive_comparison import means_of
from gateway.core.clock import ManualClock
from gateway.core.errors import CalibrationError
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.links.source import open_source
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.recording_pass import RecordingPass, open_recording
from gateway.forces.calibration_points import recording_points
from gateway.forces.commands.force_runs import measured_force_runs
from gateway.forces.commands.slip_runs import measured_runs
from gateway.forces.known_runs import ForceRunsFile, SlipRunsFile, load_runs
from gateway.importing.reference_comparison import RIG_CHANNELS, TurnLog, turn_means
from gateway.importing.reference_topic import reference_topic
from gateway.importing.rig_channels import RigValues
from gateway.importing.views.reference_lines import reference_lines

STEP_S = 0.1


def sine(times_s: np.ndarray, mean: float, part: float) -> np.ndarray:
    return mean * (1.0 + part * np.sin(2.0 * math.pi * times_s / 5.0))


def test_mean_over_a_turn_is_that_of_its_time_and_missing_outside() -> None:
    times = np.arange(0.0, 10.0, STEP_S)
    starts, periods = np.array([-0.05, 1.0, 5.0, 9.85]), np.array([0.1, 0.1, 0.4, 0.1])
    means = turn_means(times, 100.0 + 10.0 * times, starts, periods)
    np.testing.assert_allclose(means[1:3], [100.0 + 10.0 * 1.05, 100.0 + 10.0 * 5.2])
    assert np.isnan(means[[0, 3]]).all()
    gap = (times < 4.0) | (times > 6.0)
    assert np.isnan(turn_means(times[gap], times[gap], starts, periods)[2])
    assert np.isnan(turn_means([], [], starts, periods)).all()


@pytest.fixture(scope="module")
def drive() -> list:
    """Items of a drive of one wheel, 12 s, and its vehicle file."""
    source = open_source("sim:lab?speed=max&duration=12&seed=2", ManualClock(1_700_000_000_000_000_000))
    return [list(source.items(threading.Event())), source.vehicle_toml]


def with_rig(path: Path, drive: list, channels: dict[str, np.ndarray], times_s: np.ndarray) -> Path:
    """Write the drive with channels, by quantity, at hub times."""
    items, toml = drive
    writer = RecordingWriter(path, start_ns=items[0].host_ns, vehicle_toml=toml)
    for quantity, values in channels.items():
        for time_s, value in zip(times_s, values, strict=True):
            payload = {"quantity": quantity, "time_s": time_s, "value": value, "value_std": 1e-3 * abs(value)}
            writer.write_topic(reference_topic("W1", quantity), items[0].host_ns, payload)
    for item in items:
        writer.write(item)
    writer.close()
    return path


def passed(path: Path) -> tuple[Drive, list]:
    """Return the collector of a comparison after a pass, and the results of that."""
    reader = RecordingReader(path)
    drive, results = Drive.of(reader), []
    for result in RecordingPass(open_recording(reader), ("kinematic",), is_watched=False):
        drive.add(result)
        results.append(result)
    return drive, results


def test_calibration_and_comparison_take_the_load_of_the_revolutions_used(tmp_path: Path, drive: list) -> None:
    _, results = passed(with_rig(tmp_path / "none.mcap", drive, {}, np.empty(0)))
    begin_s = results[0].revolution.start_s
    # Before 4 s the rig is being set: that load is of no revolution that counts.
    times_s = begin_s + np.arange(4.0, 13.0, STEP_S)
    load_n = sine(times_s, 4300.0, 0.02)
    path = with_rig(tmp_path / "rig.mcap", drive, {"load": load_n, "camber": 0.01 + 0.0 * times_s}, times_s)
    used = [r.revolution for r in results if not r.revolution.faults and r.revolution.start_s >= times_s[0]]
    expected_n = np.mean([load_n[np.abs(times_s - r.start_s - 0.5 * r.period_s) < 0.5 * STEP_S].mean() for r in used])
    left_out: list[str] = []
    (point,) = recording_points(path, None, (), left_out.append)
    assert point.load_n == pytest.approx(expected_n, rel=2e-3)
    assert 4.3 <= point.load_std_n < 60.0
    compared, _ = passed(path)
    means = means_of(compared)
    assert means["W1", "rig_load_n"].value == pytest.approx(expected_n, rel=2e-3)
    assert means["W1", "rig_load_n"].count == pytest.approx(len(used), abs=2)
    assert means["W1", "rig_camber_rad"].value == pytest.approx(0.01)


def test_swept_load_is_a_point_for_each_band_of_it(tmp_path: Path, drive: list) -> None:
    times_s = np.arange(0.0, 30.0, STEP_S)
    load_n = np.select([times_s < 4.0, times_s < 8.0], [-3000.0, -4200.0], -5100.0)
    path = with_rig(tmp_path / "swept.mcap", drive, {"load": load_n}, times_s)
    left_out: list[str] = []
    points = recording_points(path, None, (), left_out.append)
    assert [point.load_n for point in points] == pytest.approx([3000.0, 4200.0, 5100.0], rel=0.01)
    # Only the revolutions at which a step is made have other loads.
    assert all(point.load_std_n < 0.01 * point.load_n and not point.numbers for point in points)
    assert "swept.mcap W1 at 30" in points[0].name
    assert all("valid revolutions with a load of the rig" in text for text in left_out)


def test_load_of_few_revolutions_is_refused(tmp_path: Path, drive: list) -> None:
    times_s = np.arange(0.0, 1.5, STEP_S)
    left_out: list[str] = []
    path = with_rig(tmp_path / "short.mcap", drive, {"load": sine(times_s, 4000.0, 0.0)}, times_s)
    assert not recording_points(path, None, (), left_out.append)
    assert "valid revolutions with a load of the rig, 20 are required" in left_out[0]


def test_side_force_of_a_run_is_that_of_the_rig_at_its_revolutions(tmp_path: Path, drive: list) -> None:
    times_s = np.arange(0.0, 30.0, STEP_S)
    with_rig(tmp_path / "a.mcap", drive, {"side_force": np.where(times_s < 3.2, -400.0, 900.0)}, times_s)
    path = tmp_path / "runs.toml"
    runs = '[[run]]\nrecording = "a.mcap"\nto_s = 2.6\n[[run]]\nrecording = "a.mcap"\nfrom_s = 3.6\n'
    path.write_text(runs)
    low, high = measured_force_runs(path, load_runs(ForceRunsFile, path), None)
    assert (low.force_n, high.force_n) == pytest.approx((-400.0, 900.0))
    assert low.force_std_n == pytest.approx(math.hypot(0.4, 20.0))
    path.write_text(runs.replace("to_s = 2.6", "to_s = 2.6\nside_force_n = 50"))
    assert measured_force_runs(path, load_runs(ForceRunsFile, path), None)[0].force_n == 50.0
    with_rig(tmp_path / "b.mcap", drive, {"side_force": np.full(20, 1.0)}, times_s[:20])
    path.write_text(runs.replace("a.mcap", "b.mcap"))
    with pytest.raises(CalibrationError, match=r"side force at \d+ of \d+ revolutions"):
        measured_force_runs(path, load_runs(ForceRunsFile, path), None)


@pytest.mark.parametrize(("sign", "quantity"), [(1.0, "side_force"), (-1.0, "load"), (1.0, "load")])
def test_estimate_is_compared_with_the_channel_at_each_revolution(sign: float, quantity: str) -> None:
    rng, starts = np.random.default_rng(8), np.arange(300) * 0.11
    times_s = np.arange(0.0, 34.0, 0.05)
    channel = 4000.0 + 1500.0 * np.sin(times_s)
    # The mean of a sine over a turn is that in its middle, to 1e-3.
    at_turn = 4000.0 + 1500.0 * np.sin(starts + 0.055)
    turns = TurnLog()
    for start_s, load_n in zip(starts, at_turn, strict=True):
        estimate = Estimate(RIG_CHANNELS[quantity], 0.96 * load_n + rng.normal() * 40.0, 40.0, Status.VALID)
        turns.add(SimpleNamespace(faults=(), period_s=0.11, start_s=start_s), (estimate,))  # type: ignore[arg-type]
    compared = turns.compare("W1", "cell", quantity, times_s, sign * channel, 10.0, 0.3)
    assert (compared.revolutions, compared.measured) == (300, pytest.approx(at_turn.mean(), rel=1e-3))
    assert compared.difference == pytest.approx(-0.04 * at_turn.mean(), rel=0.06)
    assert compared.slope == pytest.approx(0.96, abs=4.0 * compared.slope_std)
    assert 0.0 < compared.slope_std < 0.01
    assert 3.0 < compared.share_of_error < 5.0
    assert compared.difference_std > 10.0
    first, second = reference_lines([compared])
    assert "300 revolutions" in first
    assert "N estimated" in first
    assert "where it varies, the estimate changes 0.9" in second
    steady = turns.compare("W1", "cell", quantity, times_s, np.full(len(times_s), sign * 4000.0), 1e4, 0.3)
    assert math.isnan(steady.slope)


def test_slip_run_without_a_slip_angle_takes_that_of_the_rig(tmp_path: Path, drive: list) -> None:
    times_s = np.arange(0.0, 30.0, STEP_S)
    with_rig(tmp_path / "a.mcap", drive, {"slip_angle": np.where(times_s < 5.0, 0.01, 0.02)}, times_s)
    with_rig(tmp_path / "b.mcap", drive, {"slip_angle": np.full(60, 0.01)}, times_s[:60])
    runs = """
[[run]]
recording = "a.mcap"
to_s = 3
[[run]]
recording = "a.mcap"
from_s = 7
[[run]]
recording = "a.mcap"
from_s = 3
to_s = 6
slip_deg = 1.5
"""
    (tmp_path / "runs.toml").write_text(runs)
    low, high, stated = measured_runs(tmp_path / "runs.toml", load_runs(SlipRunsFile, tmp_path / "runs.toml"), None)
    assert low.slip_rad == pytest.approx(0.01, rel=1e-6)
    assert high.slip_rad == pytest.approx(0.02, rel=1e-6)
    assert stated.slip_rad == math.radians(1.5)
    assert low.slip_std_rad == pytest.approx(math.hypot(1e-5, math.radians(0.05)))
    (tmp_path / "runs.toml").write_text(runs.replace("a.mcap", "b.mcap"))
    with pytest.raises(CalibrationError, match=r"slip angle at \d+ of \d+ revolutions"):
        measured_runs(tmp_path / "runs.toml", load_runs(SlipRunsFile, tmp_path / "runs.toml"), None)


def test_mean_has_the_error_of_the_channel_and_its_variation() -> None:
    values = RigValues(np.array([1.0, 2.0, math.nan, 3.0]), 0.5)
    mean = values.mean()
    assert (values.covered, mean.value, mean.count) == (3, 2.0, 3)
    assert mean.std == pytest.approx(math.hypot(0.5, 1.0 / math.sqrt(3.0)))
