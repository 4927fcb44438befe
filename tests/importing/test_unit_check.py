"""Detection of a radial column in another unit than stated, on simulated wheels."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from gateway.cli.import_measurement import import_
from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.importing.unit_check import unlikely_unit
from gateway.types import FloatArray
from tests.importing.measurements import simple_map, write_csv

RATE_HZ = 9600.0
RADIUS_M = 0.32


@cache
def wheel_mps2(speed_mps: float) -> FloatArray:
    """Return the radial axis of a rolling wheel: V^2/R, in the contact 0 between two peaks, with noise."""
    angle = np.arange(40_000) / RATE_HZ * speed_mps / RADIUS_M
    angle = (angle + np.pi) % (2 * np.pi) - np.pi
    inside = 0.5 * (1 - np.tanh((np.abs(angle) - 0.2) / 0.02))
    peaks = 0.4 * np.exp(-(((np.abs(angle) - 0.3) / 0.05) ** 2))
    steady = speed_mps**2 / RADIUS_M
    noise = np.random.default_rng(1).normal(size=len(angle)) * 0.05 * steady
    return steady * (1 - inside + peaks) + noise


@pytest.mark.parametrize("speed_mps", [5.0, 18.0, 70.0])
@pytest.mark.parametrize("dc", [True, False])
def test_unit_that_fits_is_not_reported(speed_mps: float, dc: bool) -> None:
    signal = wheel_mps2(speed_mps)
    for unit in ("m/s^2", "g", "mg"):
        assert unlikely_unit(signal - (0 if dc else signal.mean()), RATE_HZ, RADIUS_M, unit, dc=dc) is None


@pytest.mark.parametrize("speed_mps", [5.0, 18.0, 70.0])
@pytest.mark.parametrize("dc", [True, False])
def test_wrong_unit_is_reported_with_its_factor(speed_mps: float, dc: bool) -> None:
    signal = wheel_mps2(speed_mps) - (0 if dc else wheel_mps2(speed_mps).mean())
    in_g = unlikely_unit(signal / STANDARD_GRAVITY_MPS2, RATE_HZ, RADIUS_M, "m/s^2", dc=dc)
    assert in_g is not None
    assert (in_g["stated"], in_g["fitting"]) == ("m/s^2", "g")
    in_mps2 = unlikely_unit(signal * STANDARD_GRAVITY_MPS2, RATE_HZ, RADIUS_M, "g", dc=dc)
    assert in_mps2 is not None
    assert in_mps2["fitting"] == "m/s^2"
    assert in_mps2["ratio"] == pytest.approx(STANDARD_GRAVITY_MPS2, rel=0.35)


def test_noise_and_standstill_are_not_judged() -> None:
    noise = np.random.default_rng(2).normal(size=40_000)
    assert unlikely_unit(noise, RATE_HZ, RADIUS_M, "g", dc=True) is None
    assert unlikely_unit(np.full(40_000, 9.8), RATE_HZ, RADIUS_M, "g", dc=True) is None
    assert unlikely_unit(np.full(40_000, np.nan), RATE_HZ, RADIUS_M, "g", dc=True) is None


def test_gaps_do_not_hide_the_unit() -> None:
    signal = wheel_mps2(18.0) / STANDARD_GRAVITY_MPS2
    signal = np.where(np.random.default_rng(3).random(len(signal)) < 0.1, np.nan, signal)
    finding = unlikely_unit(signal, RATE_HZ, RADIUS_M, "m/s^2", dc=True)
    assert finding is not None
    assert finding["fitting"] == "g"


def test_import_names_the_unlikely_unit(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", {"z": wheel_mps2(18.0) / STANDARD_GRAVITY_MPS2})
    map_path = tmp_path / "m.toml"
    sections = {"axis.circumferential": "", "axis.lateral": "", "axis.radial": 'column = "z"\nunit = "m/s^2"'}
    map_path.write_text(simple_map(sampling=f"rate_hz = {RATE_HZ}", conditions="radius_mm = 320", **sections))
    result = CliRunner().invoke(import_, [str(path), "--map", str(map_path), "--out", str(tmp_path / "out.mcap")])
    assert result.exit_code == 0, result.output
    (line,) = [line for line in result.output.splitlines() if line.startswith("check: ")]
    assert "the radial column is stated in m/s^2, but g fits" in line
    assert "0.1" in line
