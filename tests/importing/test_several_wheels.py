"""Several wheels in one file, and the detection of a radial column in another unit than stated."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Environment, Hello, SampleBlock
from gateway.core.config.vehicle import recorded_vehicle
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.errors import ConfigError
from gateway.core.links.source import Chunk
from gateway.core.recording.reader import RecordingReader
from gateway.core.types import FloatArray
from gateway.importing.commands.import_measurement import import_, report_lines
from gateway.importing.import_map import parse_map
from gateway.importing.importer import import_file
from gateway.importing.unit_check import unlikely_unit
from tests.importing.measurements import simple_map, write_csv

ONE_WHEEL = {"axis.circumferential": "", "axis.lateral": "", "axis.radial": ""}
WHEELS = """
[[wheel]]
position = "FL"
load_n = 4000.0
[wheel.axis.radial]
column = "left z"
unit = "g"
[[wheel]]
position = "FR"
radius_mm = 310.0
pressure_kpa = 230.0
mounting.offset_mm = 5.0
[wheel.axis.circumferential]
column = "right x"
unit = "m/s^2"
[wheel.axis.radial]
column = "right z"
unit = "g"
sign = -1
[wheel.environment]
pressure_column = "p"
"""


def test_each_wheel_has_its_own_frames_and_conditions(tmp_path: Path) -> None:
    rng, rows = np.random.default_rng(1), 3000
    columns = {name: rng.normal(size=rows) for name in ("left z", "right x", "right z")}
    columns["p"] = np.full(rows, 231.0)
    columns["left z"][100] = np.nan
    path = write_csv(tmp_path / "run.csv", columns)
    report = import_file(path, parse_map(simple_map(**ONE_WHEEL) + WHEELS, "map"), tmp_path / "out.mcap")
    assert [(wheel.position, wheel.gaps) for wheel in report.wheels] == [("FL", 1), ("FR", 0)]
    assert [len(wheel.axes) for wheel in report.wheels] == [1, 2]
    assert report.wheels[1].environment_frames > 0
    assert sum("wheel F" in line for line in report_lines(report)) == 2
    decoder, samples, hellos, pressures = FrameDecoder(), {0: [], 1: []}, {}, []
    reader = RecordingReader(tmp_path / "out.mcap")
    times = []
    for item in reader.items():
        times.append(item.host_ns)
        for frame in decoder.feed(item.data) if isinstance(item, Chunk) else ():
            if isinstance(frame.message, Hello):
                hellos[frame.wheel] = frame.message
            elif isinstance(frame.message, SampleBlock):
                samples[frame.wheel].append(frame.message.counts)
            elif isinstance(frame.message, Environment):
                pressures.append((frame.wheel, frame.message.pressure_pa))
    assert times == sorted(times)
    assert decoder.counters.lost == 0
    assert set(pressures) == {(1, 231_000.0)}
    assert hellos[0].sensor_id != hellos[1].sensor_id
    right = np.concatenate(samples[1]) * np.array([hellos[1].scale_mps2[0], hellos[1].scale_mps2[2]])
    np.testing.assert_allclose(right[:, 0], columns["right x"], atol=1e-3)
    np.testing.assert_allclose(right[:, 1], -9.80665 * columns["right z"], atol=1e-2)
    assert len(np.concatenate(samples[0])) == rows - 1
    setups = recorded_vehicle(reader.vehicle_toml or "", "out").wheel_setups()
    assert [setup.position for setup in setups] == ["FL", "FR"]
    assert [setup.sensor.offset_m for setup in setups] == [None, pytest.approx(5e-3)]
    assert [setup.radius_m for setup in setups] == [pytest.approx(0.300), pytest.approx(0.310)]


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (simple_map() + WHEELS, "axis: beside .*wheel"),
        (simple_map(**ONE_WHEEL, conditions="load_n = 100") + WHEELS, "conditions.load_n: beside .*each wheel"),
        (simple_map(**ONE_WHEEL) + WHEELS.replace('"FR"', '"FL"'), r"wheel\[#2\].position: .*same position"),
        (simple_map(**ONE_WHEEL) + WHEELS.replace("right z", "left z"), r"wheel\[#1\].axis.radial has the same column"),
        (simple_map(**ONE_WHEEL) + WHEELS.replace("load_n", "load_std_n"), r"wheel\[#1\].load_std_n: .*needs load_n"),
        (
            simple_map(**ONE_WHEEL) + WHEELS.replace('position = "F', 'sensor_id = "a1"\nposition = "F'),
            r"^map: wheel\[FR\].sensor_id: .*wheel\[FL\] has the same sensor",
        ),
        (
            simple_map(**ONE_WHEEL, file='sensor_column = "node"')
            + WHEELS.replace('position = "F', 'sensor = "1"\nposition = "F').replace("right x", "right z"),
            r"wheel\[#2\].axis.radial.column: .*wheel\[#2\].axis.circumferential has the same column",
        ),
        (simple_map(conditions="load_n = 60\nload_std_n = 61"), "^map: .*load_std_n: .* up to load_n = 60"),
        (simple_map(conditions="radius_mm = 200\nring_thickness_mm = 70"), "^map: tire.ring_thickness_mm: .* 30 %"),
        (simple_map(**ONE_WHEEL), r"axis: missing, \[axis.radial\] is required, or \[\[wheel\]\]"),
    ],
)
def test_faults_of_wheels_are_named(text: str, fault: str) -> None:
    with pytest.raises(ConfigError, match=fault):
        parse_map(text, "map")


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
    assert "the radial column is in g, not in m/s^2" in line
    assert "0.1" in line


def two_sensors(path: Path, rate_hz: float) -> Path:
    """Write rows of two sensors: one skips 200 rows, the other has 150 empty cells."""
    lines = ["node,t,acc [m/s^2],fz"]
    for row, value in enumerate(np.random.default_rng(5).normal(size=4000).tolist()):
        lines += [] if 1000 <= row < 1200 else [f"1,{row / rate_hz!r},{value!r},4000"]
        lines.append(f"2,{row / rate_hz!r},{'' if 2000 <= row < 2150 else value},4000")
    path.write_text("\n".join(lines) + "\n")
    return path


def test_what_the_rows_of_any_sensor_show_is_told(tmp_path: Path) -> None:
    text = simple_map(file='sensor_column = "node"', sampling='time_column = "t"', **ONE_WHEEL)
    for node, position in (("1", "FL"), ("2", "FR")):
        text += f'\n[[wheel]]\nposition = "{position}"\nsensor = "{node}"\n'
        text += '[wheel.axis.radial]\ncolumn = "acc [m/s^2]"\nunit = "g"\n'
    text += '[[reference]]\nname = "fz"\ncolumn = "fz"\nquantity = "load"\nunit = "N"\nstd = 10\nwheels = ["FR"]\n'
    import_map = parse_map(text, "map")
    slow = import_file(two_sensors(tmp_path / "slow.csv", 9600.0), import_map, tmp_path / "slow.mcap")
    assert [wheel.left_out for wheel in slow.wheels] == [200, 0]
    assert "150 rows without a value in an axis are gaps between samples" in report_lines(slow)
    assert slow.references == {"fz": 4}
    fast = import_file(two_sensors(tmp_path / "fast.csv", 51200.0), import_map, tmp_path / "fast.mcap")
    assert "'acc [m/s^2]' is in g, as the map says; the file says m/s^2" in fast.assumed
    assert sum("decimated 2 times" in line for line in fast.assumed) == 1
    vehicle = recorded_vehicle(RecordingReader(fast.recording).vehicle_toml or "", "out")
    assert [(wheel.load_n, wheel.load_std_n) for wheel in vehicle.wheel] == [(None, None), (4000.0, 10.0)]
