"""Samples that treadlink has exported come back whole: wheels, samples, start, load, radius, pressure, temperature."""

from pathlib import Path

import numpy as np
import pytest

import gateway
from gateway.core.errors import ImportDataError
from gateway.importing.exported_file import import_exported
from tests.testkit.commands import run

SCENARIO = {
    "scenario": {"seed": 7, "faults": ["drop:rate=0.01"]},
    "motion": {"speed_kmh": 70},
    "hub": [{"hub": 0, "clock_ppm": 120}],
    "tire": {"radius_mm": 315.0},
    "wheel": [
        {"position": "FL", "wheel": 0, "load_n": 4200, "sensor_id": "0000a001"},
        {"position": "FR", "wheel": 1, "load_n": 3900, "sensor_id": "0000a002", "sensor": {"range_g": 150}},
        {"position": "RL", "wheel": 2, "load_n": 3100, "sensor_id": "0000a003"},
        {"position": "RR", "wheel": 3, "load_n": 3300, "sensor_id": "0000a004"},
    ],
}


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> gateway.Recording:
    path = tmp_path_factory.mktemp("own") / "drive.mcap"
    gateway.simulate(SCENARIO, duration_s=4.0, out=path)
    return gateway.open(path)


@pytest.mark.parametrize("suffix", ["csv", "mf4"])
def test_four_wheels_come_back_whole(drive, suffix: str, tmp_path: Path) -> None:
    if suffix == "mf4":
        pytest.importorskip("asammdf")
    exported = drive.export(tmp_path / f"drive.{suffix}")
    again = gateway.import_measurement(exported, out=tmp_path / "again.mcap")
    assert again.wheels == drive.wheels == ("FL", "FR", "RL", "RR")
    assert again.info.start_ns == drive.info.start_ns
    for position in drive.wheels:
        before, after = drive[position].samples(), again[position].samples()
        assert len(after) == len(before)
        # The same range has the same counts.
        np.testing.assert_allclose(after.axes_mps2, before.axes_mps2, rtol=1e-6)
        shifts_s = (after.host_utc - before.host_utc).astype(np.int64) * 1e-9
        np.testing.assert_allclose(shifts_s, 0.0, atol=0.02)
        np.testing.assert_array_equal(after.saturated, before.saturated)
        assert before.saturated.any() == (position == "FR")
        assert after.lost_before.sum() == before.lost_before.sum()
        assert before.lost_before.sum() > 0
        assert again[position].sensor_id == drive[position].sensor_id
        assert again[position].radius_m == pytest.approx(drive[position].radius_m)
    loads = {setup.position: setup.load_n for setup in again.vehicle.wheel_setups()}
    assert loads == {"FL": 4200.0, "FR": 3900.0, "RL": 3100.0, "RR": 3300.0}
    for name in ("pressure_pa", "temperature_degc"):
        for position in drive.wheels:
            expected = np.nanmean(getattr(drive[position].environment(), name))
            assert np.nanmean(getattr(again[position].environment(), name)) == pytest.approx(expected, rel=1e-3)
    speeds = [recording.estimates().select("speed_mps", status="valid") for recording in (drive, again)]
    assert np.median(speeds[1].value) == pytest.approx(np.median(speeds[0].value), rel=1e-4)


def test_command_needs_no_map(drive, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    drive.export(tmp_path / "drive.csv")
    done = run("import", "drive.csv")
    assert "wheel RR; range" in done
    assert gateway.open(tmp_path / "drive.mcap").wheels == ("FL", "FR", "RL", "RR")


def test_what_is_stated_is_stated_again(tmp_path: Path) -> None:
    text = (
        "# FL exported_by: treadlink 0.1.0\r\n# FL load_n: 4000.0 N (configuration)\r\n"
        "# FL radius_m: 0.31 m (configuration)\r\n# FL radius_std_m: 0.0005 m (configuration)\r\n"
        "# FL pressure_pa: 220000.0 Pa (configuration)\r\n"
        "# FL temperature_degc: 45.0 degC (configuration)\r\n# FL axes: radial\r\n# FL coupling: ac (measured)\r\n"
        "# FL relative_rate_std: 0.01 (configuration)\r\n"
        "# column wheel: position\r\nwheel,time_s,radial_mps2,device_s\r\n"
    )
    rows = [f"FL,{0.5 + k / 9600!r},{float(np.sin(k / 50))!r},{k / 9600!r}" for k in range(4000)]
    path = tmp_path / "one.csv"
    path.write_text(text + "\r\n".join(rows) + "\r\n", newline="")
    for name in ("one", "two"):
        recording = gateway.open(import_exported(path, tmp_path / f"{name}.mcap").recording)
        (setup,) = recording.vehicle.wheel_setups()
        assert (setup.pressure_pa, setup.temperature_degc, setup.load_n) == (220e3, 45.0, 4000.0)
        assert (setup.radius_m, setup.radius_std_m) == pytest.approx((0.31, 0.0005))
        assert setup.sensor.rate_std == pytest.approx(0.01)
        path = recording.export(tmp_path / f"{name}-again.csv")


def test_rates_of_all_wheels_have_the_largest_error(tmp_path: Path) -> None:
    head = "".join(
        f"# {wheel} exported_by: treadlink 0.1.0\r\n# {wheel} relative_rate_std: {std} (configuration)\r\n"
        for wheel, std in (("FL", 0.0001), ("FR", 0.02))
    )
    rows = [f"{wheel},{k / 2000!r},{k % 7}.0,{k / 2000!r}" for wheel in ("FL", "FR") for k in range(100)]
    path = tmp_path / "two.csv"
    path.write_text(f"{head}wheel,time_s,radial_mps2,device_s\r\n" + "\r\n".join(rows) + "\r\n", newline="")
    vehicle = gateway.open(import_exported(path, tmp_path / "two.mcap").recording).vehicle
    assert [setup.sensor.rate_std for setup in vehicle.wheel_setups()] == pytest.approx([0.02, 0.02])


def test_other_files_and_contents_are_refused(drive, tmp_path: Path) -> None:
    foreign = tmp_path / "foreign.csv"
    foreign.write_text("t,z\n0,1\n")
    parquet = drive.export(tmp_path / "samples.parquet")
    for path in (foreign, parquet):
        with pytest.raises(ImportDataError, match="is no CSV or MF4 file of `treadlink export`"):
            import_exported(path, tmp_path / "a.mcap")
    exported = drive.export(tmp_path / "samples.mcap")
    with pytest.raises(ImportDataError, match="is an MCAP file of `treadlink export`"):
        import_exported(exported, tmp_path / "a.mcap")
    exported.unlink()
    recording = tmp_path / "drive.mcap"
    recording.touch()
    with pytest.raises(ImportDataError) as error:
        import_exported(recording, tmp_path / "a.mcap")
    assert error.value.remedy == "This is a recording already. Run: treadlink estimate drive.mcap"
    recording.unlink()
    estimates = drive.export(tmp_path / "estimates.csv", what="estimates")
    with pytest.raises(ImportDataError, match="has no column"):
        import_exported(estimates, tmp_path / "b.mcap")
    assert not list(tmp_path.glob("*.mcap"))
