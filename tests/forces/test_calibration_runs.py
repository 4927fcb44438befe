"""Runs of calibrations: parts of one recording, and pressures at which there is no calibration."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.core.errors import CalibrationError, ConfigError
from gateway.core.estimates.estimator import Estimate, Status
from gateway.forces import calibration_points
from gateway.forces.commands import force_runs
from gateway.forces.commands.force_runs import ForceRun, fit_side_force, measured_force_runs
from gateway.forces.known_runs import ForceRunsFile, load_runs
from gateway.forces.side_force import HORIZON_REVOLUTIONS
from tests.testkit.revolution_data import CONDITIONS, plain_revolution

FORCES_N = (-1000.0, 0.0, 1000.0)
N_PER_M = 2e5
REVOLUTIONS = 120
NO_RIG = SimpleNamespace(at=lambda *_: None)


def result(shift_m: float = 0.0, pressure_pa: float = 2.4e5, std_m: float = 2e-5) -> SimpleNamespace:
    estimates = (
        Estimate("belt_shift_m", shift_m, std_m, Status.VALID, scatter_std=1e-5),
        Estimate("belt_yaw_rad", 0.0, 1e-5, Status.VALID),
    )
    conditions = replace(CONDITIONS, pressure_pa=pressure_pa)
    return SimpleNamespace(estimates=estimates, position="FL", revolution=plain_revolution(), conditions=conditions)


def file_of(*tables: dict[str, float]) -> ForceRunsFile:
    return ForceRunsFile.model_validate({"run": [{"recording": "a.mcap", **table} for table in tables]})


def parts() -> ForceRunsFile:
    """Return three parts of one recording, which follow each other."""
    times = enumerate(FORCES_N)
    return file_of(*({"side_force_n": force, "from_s": float(s), "to_s": s + 1.0} for s, force in times))


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("", 'recording = "./a.mcap"'),
        ("", 'recording = "a.mcap"\nwheel = "FL"'),
        ('wheel = "FL"', 'recording = "a.mcap"'),
    ],
)
def test_overlapping_runs_are_refused_however_file_and_wheel_are_named(tmp_path: Path, first: str, second: str) -> None:
    path = tmp_path / "runs.toml"
    text = f'[[run]]\nrecording = "a.mcap"\nto_s = 8\n{first}\n[[run]]\nfrom_s = 6\n{second}\n'
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"run\[#2\].from_s: 6 found, .* that run\[#1\] does not have"):
        load_runs(ForceRunsFile, path)
    path.write_text(f'wheel = "FR"\n{text}' if "FL" in text else text.replace("./a.mcap", "b.mcap"))
    assert len(load_runs(ForceRunsFile, path).run) == 2


def test_parts_of_a_recording_do_not_contain_the_force_before_them() -> None:
    file = parts()
    runs = [ForceRun(str(table.side_force_n), table) for table in file.run]
    mean_m = 0.0
    for number in range(len(runs) * REVOLUTIONS):
        index = number // REVOLUTIONS
        mean_m += max(1.0 / (number + 1), 1.0 / HORIZON_REVOLUTIONS) * (FORCES_N[index] / N_PER_M - mean_m)
        runs[index].take(result(mean_m))
    for run in runs:
        run.take_force(NO_RIG, 20.0)
    side = fit_side_force(runs, file).side
    assert side.factor == pytest.approx(N_PER_M, rel=0.02)
    assert abs(side.zero) < 0.05e-3


@pytest.mark.parametrize("revolutions", [20, 2000])
def test_only_scatter_averages_out_and_the_gain_of_the_sensor_is_in_the_factor(revolutions: int) -> None:
    file = file_of(*({"side_force_n": force} for force in FORCES_N))
    runs = [ForceRun(str(table.side_force_n), table) for table in file.run]
    for run, force in zip(runs, FORCES_N, strict=True):
        shift_m = force / N_PER_M
        std_m = math.hypot(4e-5, 1e-5, CONDITIONS.lateral_gain_std * shift_m)
        for _ in range(revolutions):
            run.take(result(shift_m, std_m=std_m))
        run.take_force(NO_RIG, 0.0)
    side = fit_side_force(runs, file).side
    error_m = math.hypot(4e-5, 1e-5 / math.sqrt(math.ceil(revolutions / (2.0 * HORIZON_REVOLUTIONS))))
    assert side.zero_std == pytest.approx(error_m / math.sqrt(3.0))
    assert side.factor_std == pytest.approx(N_PER_M * error_m / (math.sqrt(2.0) * FORCES_N[2] / N_PER_M))


def measured(monkeypatch: pytest.MonkeyPatch, pressure_pa: float, file: ForceRunsFile, count: int) -> list[ForceRun]:
    def read(_path, runs, _wheels, _estimators, _fallback, take):
        for index in range(len(runs)):
            for _ in range(count):
                take(index, result(pressure_pa=pressure_pa))
        return [NO_RIG] * len(runs)

    monkeypatch.setattr(force_runs, "read_runs", read)
    return measured_force_runs(Path("runs.toml"), file, None)


def test_parts_need_more_revolutions_which_the_error_says(monkeypatch: pytest.MonkeyPatch) -> None:
    assert [len(run.shifts) for run in measured(monkeypatch, 2e5, parts(), 68)] == [68, 20, 20]
    with pytest.raises(CalibrationError, match="19 of 67 .* 20 are required after the first 48 of a part"):
        measured(monkeypatch, 2e5, parts(), 67)
    with pytest.raises(CalibrationError, match=r"19 of 19 .* 20 are required\n"):
        measured(monkeypatch, 2e5, parts(), 19)


@pytest.mark.parametrize("pressure_pa", [-1300.0, 0.0, 9e3, 2e6])
def test_a_run_or_wheel_without_pressure_in_the_tire_is_not_used(
    monkeypatch: pytest.MonkeyPatch, pressure_pa: float
) -> None:
    with pytest.raises(CalibrationError, match="kPa are required"):
        measured(monkeypatch, pressure_pa, parts(), 100)
    results = [result(pressure_pa=pressure_pa)] * 30
    reason = calibration_points._point("a FL", results, NO_RIG, is_swept=False)
    assert isinstance(reason, str)
    assert "kPa are required" in reason


def test_a_wheel_with_pressure_is_a_point() -> None:
    point = calibration_points._point("a FL", [result()] * 30, NO_RIG, is_swept=False)
    assert not isinstance(point, str)
    np.testing.assert_allclose(point.pressure_pa, 2.4e5)
