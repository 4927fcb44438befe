import math
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from firmware_protocol.messages import Coupling
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.errors import ConfigError, ImportDataError, RecordingError
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind
from gateway.core.types import FloatArray
from gateway.importing.columns import BLOCK_ROWS
from gateway.importing.import_map import parse_map
from gateway.importing.importer import ImportReport, import_file
from tests.importing.measurements import Decoded, simple_map, waveform, write_csv
from tests.testkit.commands import invoked


def imported(path: Path, map_text: str) -> tuple[ImportReport, Decoded]:
    out = path.with_suffix(".mcap")
    report = import_file(path, parse_map(map_text, "test.map.toml"), out)
    return report, Decoded(report.recording)


def check_round_trip(decoded: Decoded, expected_mps2: FloatArray) -> None:
    """Check equality within half a quantisation step, which must be fine."""
    assert decoded.samples_mps2.shape == expected_mps2.shape
    steps = [decoded.hello.scale_mps2[axis] for axis in range(3) if decoded.hello.axes >> axis & 1]
    for channel, step in enumerate(steps):
        error = np.abs(decoded.samples_mps2[:, channel] - expected_mps2[:, channel]).max()
        assert error <= 0.5 * step * (1 + 1e-9)
        assert step == pytest.approx(np.abs(expected_mps2[:, channel]).max() / 32767, rel=1e-6)


def test_csv(tmp_path: Path) -> None:
    data = waveform(5000)
    path = write_csv(tmp_path / "run.csv", dict(zip("xyz", data.T, strict=True)))
    report, decoded = imported(path, simple_map())
    check_round_trip(decoded, data * STANDARD_GRAVITY_MPS2)
    assert (report.samples, report.skipped, report.rate_hz) == (5000, 0, 10000.0)
    assert report.duration_s == pytest.approx(0.5)
    assert decoded.hello.rate_hz == 10000.0
    assert decoded.hello.coupling is Coupling.DC
    for axis in report.wheels[0].axes:
        assert 0 < axis.error_mps2 <= 0.5 * axis.step_mps2 * (1 + 1e-9)
        assert axis.high_mps2 == pytest.approx(data[:, axis.axis].max() * STANDARD_GRAVITY_MPS2)


@pytest.mark.parametrize(
    ("sampling", "std"),
    [
        ("rate_hz = 10000", 0.01),
        ("rate_hz = 10000\nrate_std_percent = 0.002", 2e-5),
        ('time_column = "t"', 1e-4),
    ],
)
def test_rate_has_the_error_of_what_it_rests_on(tmp_path: Path, sampling: str, std: float) -> None:
    """Nothing has measured a rate that is only stated; the times of a column are those of a clock."""
    columns = {"t": np.arange(500) * 1e-4, **dict(zip("xyz", waveform(500).T, strict=True))}
    report, decoded = imported(write_csv(tmp_path / "run.csv", columns), simple_map(sampling=sampling))
    assert decoded.vehicle_toml is not None
    (setup,) = parse_vehicle(decoded.vehicle_toml, "recording").wheel_setups()
    assert setup.sensor.rate_std == pytest.approx(std, rel=1e-6)
    assert any("stated rate 1 %" in text for text in report.assumed) is (std == 0.01)


def test_long_csv_is_one_continuous_stream(tmp_path: Path) -> None:
    count = BLOCK_ROWS + 1001
    values = np.sin(np.arange(count) * 0.01)
    path = write_csv(tmp_path / "run.csv", {"z": values})
    text = simple_map(**{"axis.circumferential": "", "axis.lateral": ""})
    _, decoded = imported(path, text)
    check_round_trip(decoded, values[:, None] * STANDARD_GRAVITY_MPS2)
    firsts = [block.message.first_sample for block in decoded.blocks]  # type: ignore[union-attr]
    lengths = [len(block.message.counts) for block in decoded.blocks]  # type: ignore[union-attr]
    assert firsts == [0, *np.cumsum(lengths)[:-1]]
    assert [frame.seq for frame in decoded.frames] == list(range(len(decoded.frames)))
    ticks_us = np.array([block.tick_us for block in decoded.blocks])
    assert np.abs(ticks_us - np.array(firsts) * 100.0).max() <= 0.5
    assert decoded.counters.crc_errors == 0
    assert decoded.counters.noise_bytes == 0


def test_chunks_arrive_at_the_sampling_rate(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", dict(zip("xyz", waveform(4000).T, strict=True)))
    text = simple_map(sampling="rate_hz = 10000\nstart_utc = 2014-05-01T12:00:00Z")
    report, decoded = imported(path, text)
    start_ns = 1_398_945_600_000_000_000
    assert not report.start_is_file_date
    first, *chunks, last = decoded.items
    assert isinstance(first, LinkEvent)
    assert (first.kind, first.host_ns, first.link) == (LinkEventKind.CONNECTED, start_ns, "import:run.csv")
    assert isinstance(last, LinkEvent)
    assert (last.kind, last.host_ns) == (LinkEventKind.ENDED, start_ns + 400_000_000)
    arrivals_s = np.array([chunk.host_ns - start_ns for chunk in chunks]) * 1e-9
    assert all(isinstance(chunk, Chunk) for chunk in chunks)
    assert np.allclose(np.diff(arrivals_s)[:-1], 0.0108)  # three frames of 36 samples
    assert arrivals_s[-1] == pytest.approx(0.4)


def test_units_sign_and_offset(tmp_path: Path) -> None:
    data = waveform(300)
    path = write_csv(tmp_path / "run.csv", dict(zip("xyz", data.T, strict=True)))
    text = simple_map(
        **{
            "axis.circumferential": 'column = "x"\nunit = "mps2"\nsign = -1',
            "axis.lateral": 'column = "y"\nunit = "mg"',
            "axis.radial": 'column = "z"\nunit = "m/s^2"\noffset = 2.5',
        }
    )
    _, decoded = imported(path, text)
    check_round_trip(
        decoded, np.column_stack((-data[:, 0], data[:, 1] * 1e-3 * STANDARD_GRAVITY_MPS2, data[:, 2] - 2.5))
    )


def test_stated_full_scale_marks_saturated_samples(tmp_path: Path) -> None:
    values = np.array([0.0, 99.0, 100.0, 130.0, -100.0, 5.0])
    path = write_csv(tmp_path / "run.csv", {"x": values, "z": values})
    text = simple_map(
        **{
            "axis.circumferential": 'column = "x"\nunit = "g"',
            "axis.lateral": "",
            "axis.radial": 'column = "z"\nunit = "g"\nfull_scale = 100',
        }
    )
    _, decoded = imported(path, text)
    saturated = np.abs(decoded.counts.astype(int)) >= decoded.hello.saturation_counts
    assert saturated[:, 1].tolist() == [False, False, True, True, True, False]
    assert not saturated[:, 0].any()
    # The circumferential axis states none.
    assert decoded.hello.range_mps2 == pytest.approx((0.0, 0.0, 100 * STANDARD_GRAVITY_MPS2))


def test_no_saturation_without_full_scale(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", dict(zip("xyz", waveform(100).T, strict=True)))
    _, decoded = imported(path, simple_map())
    assert np.abs(decoded.counts.astype(int)).max() == 32767
    assert decoded.hello.saturation_counts > 32767


def test_undeclared_full_scale_says_nothing_about_the_sensor(tmp_path: Path) -> None:
    """A measurement of 1 m/s^2 is of a wheel that stands, and not of a sensor that no tire has."""
    path = write_csv(tmp_path / "run.csv", dict(zip("xyz", 1e-3 * waveform(3000).T, strict=True)))
    _, decoded = imported(path, simple_map())
    assert decoded.hello.range_mps2 == (0.0, 0.0, 0.0)
    recording = str(path.with_suffix(".mcap"))
    assert "radial of unknown range" in invoked("inspect", recording).output
    assert "full scale" not in invoked("estimate", recording).output


def test_mounting_becomes_that_of_the_configuration(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", dict(zip("xyz", waveform(100).T, strict=True)))
    text = simple_map() + "\n[mounting]\noffset_mm = 6.0\noffset_std_mm = 0.5\n"
    _, decoded = imported(path, text)
    assert decoded.vehicle_toml is not None
    assert decoded.vehicle_toml is not None
    (setup,) = parse_vehicle(decoded.vehicle_toml, "recording").wheel_setups()
    assert setup.sensor.offset_m == pytest.approx(6e-3)
    assert setup.sensor.offset_std_m == pytest.approx(5e-4)
    with pytest.raises(ConfigError, match=r"sensor.offset_mm: 6.0 found, move it to \[mounting\]"):
        parse_map(simple_map(sensor='coupling = "DC"\noffset_mm = 6.0'), "map")


def test_dead_axis_is_imported_as_zero(tmp_path: Path) -> None:
    data = waveform(100)
    path = write_csv(tmp_path / "run.csv", {"x": data[:, 0], "y": np.zeros(100), "z": data[:, 2]})
    _, decoded = imported(path, simple_map())
    assert not decoded.samples_mps2[:, 1].any()


def test_conditions_become_the_configuration(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", dict(zip("xyz", waveform(100).T, strict=True)))
    text = 'assumed = ["the rate"]\n' + simple_map(
        conditions='position = "RL"\nload_n = 4000\nload_std_n = 40\npressure_kpa = 220\ntire = "205/55R16"',
        sensor='coupling = "AC"\nhighpass_hz = 0.5\nsensor_id = "a1"',
    )
    report, decoded = imported(path, text)
    assert decoded.vehicle_toml is not None
    assert decoded.vehicle_toml is not None
    (setup,) = parse_vehicle(decoded.vehicle_toml, "recording").wheel_setups()
    assert (setup.position, setup.hub, setup.wheel) == ("RL", 0, 0)
    assert (setup.load_n, setup.load_std_n, setup.pressure_pa) == (4000.0, 40.0, 220_000.0)
    assert setup.radius_m == pytest.approx(0.32)
    assert any("320 mm" in text for text in report.assumed)
    assert "the rate" in report.assumed
    assert parse_vehicle(decoded.vehicle_toml, "recording").notices()
    assert (decoded.hello.coupling, decoded.hello.highpass_hz, decoded.hello.sensor_id) == (Coupling.AC, 0.5, 0xA1)
    assert decoded.environments == []


def test_measured_pressure_and_temperature_become_messages(tmp_path: Path) -> None:
    data = waveform(25_000)
    pressure_bar = np.linspace(2.1, 2.2, 25_000)
    temperature = np.full(25_000, 31.25)
    columns = {**dict(zip("xyz", data.T, strict=True)), "p": pressure_bar, "T": temperature}
    path = write_csv(tmp_path / "run.csv", columns)
    section = 'pressure_column = "p"\npressure_unit = "bar"\ntemperature_column = "T"'
    report, decoded = imported(path, simple_map(environment=section))
    assert report.wheels[0].environment_frames == len(decoded.environments) == 3  # at 0, 1 and 2 s
    for second, message in enumerate(decoded.environments):
        assert message.temperature_degc == pytest.approx(31.25)
        # Mean of a chunk of 108 samples, plus at most one chunk of delay.
        assert message.pressure_pa == pytest.approx(np.interp(second * 1e4, [0, 24_999], [2.1e5, 2.2e5]), abs=150 * 0.4)
    check_round_trip(decoded, data * STANDARD_GRAVITY_MPS2)


def test_time_column_gives_the_rate_and_the_start(tmp_path: Path) -> None:
    data = waveform(3000)
    rng = np.random.default_rng(5)
    times_ms = 7000.0 + (np.arange(3000) + rng.uniform(-0.1, 0.1, 3000)) / 8.0
    path = write_csv(tmp_path / "run.csv", {"t": times_ms, **dict(zip("xyz", data.T, strict=True))})
    text = simple_map(sampling='time_column = "t"\ntime_unit = "ms"\nstart_s = 0.1')
    report, decoded = imported(path, text)
    assert report.rate_hz == pytest.approx(8000.0, rel=1e-4)
    assert report.jitter_s == pytest.approx(0.2 / 8000.0, rel=0.1)
    assert report.skipped == pytest.approx(800, abs=1)
    check_round_trip(decoded, data[report.skipped :] * STANDARD_GRAVITY_MPS2)


def test_rows_before_the_start_are_left_out(tmp_path: Path) -> None:
    data = waveform(3000)
    path = write_csv(tmp_path / "run.csv", dict(zip("xyz", data.T, strict=True)))
    report, decoded = imported(path, simple_map(sampling="rate_hz = 10000\nstart_s = 0.1"))
    assert (report.skipped, report.samples) == (1000, 2000)
    check_round_trip(decoded, data[1000:] * STANDARD_GRAVITY_MPS2)


@pytest.mark.parametrize("kind", ["matrix", "struct"])
def test_mat(tmp_path: Path, kind: str) -> None:
    scipy_io = pytest.importorskip("scipy.io")
    data = waveform(4000)
    path = tmp_path / "run.mat"
    content = {"data": data} if kind == "matrix" else {"run": {"acc": data, "note": "text"}}
    scipy_io.savemat(path, content)
    name = "data" if kind == "matrix" else "run.acc"
    text = simple_map(
        **{
            "axis.circumferential": f'column = "{name}(:,1)"\nunit = "g"',
            "axis.lateral": "",
            "axis.radial": f'column = "{name}(:,3)"\nunit = "g"',
        }
    )
    _, decoded = imported(path, text)
    assert decoded.hello.axes == 0b101
    check_round_trip(decoded, data[:, [0, 2]] * STANDARD_GRAVITY_MPS2)


@pytest.mark.parametrize("dtype", ["float64", "float32", "int32"])
def test_parquet(tmp_path: Path, dtype: str) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    data = (waveform(BLOCK_ROWS + 500) * 100).astype(dtype)
    path = tmp_path / "run.parquet"
    # Not in the order of the map, and in row groups that do not match the blocks.
    pq.write_table(pa.table({name: data[:, k] for k, name in enumerate("xyz")}).select(["z", "x", "y"]), path, 10_000)
    _, decoded = imported(path, simple_map())
    check_round_trip(decoded, data.astype(np.float64) * STANDARD_GRAVITY_MPS2)


def test_recording_is_never_overwritten(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", dict(zip("xyz", waveform(100).T, strict=True)))
    out = tmp_path / "run.mcap"
    out.write_text("precious")
    with pytest.raises(RecordingError, match="already exists"):
        import_file(path, parse_map(simple_map(), "map"), out)
    assert out.read_text() == "precious"


def test_failed_import_leaves_no_file(tmp_path: Path) -> None:
    data = waveform(30_000)
    temperature = np.linspace(20.0, 500.0, 30_000)  # the protocol carries 327 degC
    columns = {**dict(zip("xyz", data.T, strict=True)), "T": temperature}
    path = write_csv(tmp_path / "run.csv", columns)
    import_map = parse_map(simple_map(environment='temperature_column = "T"'), "map")
    with pytest.raises(ImportDataError, match="temperature_degc"):
        import_file(path, import_map, tmp_path / "run.mcap")
    assert sorted(item.name for item in tmp_path.iterdir()) == ["run.csv"]


def test_progress_rises_from_zero_to_one(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", {"z": np.sin(np.arange(2.5 * BLOCK_ROWS))})
    import_map = parse_map(simple_map(**{"axis.circumferential": "", "axis.lateral": ""}), "map")
    shares: list[float] = []
    import_file(path, import_map, tmp_path / "run.mcap", shares.append)
    assert shares == sorted(shares)
    assert len(shares) == 6
    assert math.isclose(shares[-1], 1.0)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_memory_does_not_grow_with_length(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str) -> None:
    monkeypatch.setattr("gateway.importing.csv_columns.BLOCK_ROWS", 2000)
    import_map = parse_map(simple_map(**{"axis.circumferential": "", "axis.lateral": ""}), "map")
    peaks_bytes = []
    # A Parquet file is read by another process, in blocks that no test can make shorter.
    for count in (8_000, 64_000) if suffix == ".csv" else (2 * BLOCK_ROWS, 6 * BLOCK_ROWS):
        path = tmp_path / f"run{count}{suffix}"
        if suffix == ".csv":
            write_csv(path, {"z": np.sin(np.arange(count))})
        else:
            pq = pytest.importorskip("pyarrow.parquet")
            pq.write_table(pytest.importorskip("pyarrow").table({"z": np.sin(np.arange(count))}), path, 4000)
        tracemalloc.start()
        import_file(path, import_map, path.with_suffix(".mcap"))
        peaks_bytes.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    # Only the recording's index grows, by some bytes a chunk.
    assert peaks_bytes[1] - peaks_bytes[0] < 400_000
