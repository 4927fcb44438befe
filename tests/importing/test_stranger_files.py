"""Files as other loggers write them: what they state is taken, what they lack is said, and nothing is mixed."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from gateway.core.errors import ImportDataError
from gateway.importing.import_map import parse_map
from gateway.importing.importer import ImportReport, import_file
from gateway.importing.map_guess import guess_map
from tests.importing.measurements import Decoded, simple_map, write_csv
from tests.importing.rolling_wheel import rolling

G = 9.80665
RATE_HZ = 8000.0
WHEEL = rolling(RATE_HZ, 1.0, seed=5)
AXES_G = WHEEL.axes_mps2 / G
NAMES = ("ax", "ay", "az")
COLUMNS = {name: AXES_G[:, k] for k, name in enumerate(NAMES)}


def line_of(text: str, key: str) -> str:
    return next(line for line in text.splitlines() if key in line)


def imported(path: Path, text: str, name: str = "out.mcap") -> ImportReport:
    return import_file(path, parse_map(text, "map"), path.parent / name)


@pytest.mark.parametrize("rate_hz", [20.0, 100.0, 400.0])
@pytest.mark.parametrize(
    ("name", "unit", "per_s"),
    [("time_s", "s", 1.0), ("time", "s", 1.0), ("millis", "ms", 1e3), ("elapsed_ms", "ms", 1e3), ("seconds", "s", 1.0),
     ("timeUs", "us", 1e6), ("Zeit", "s", 1.0), ("t_ms", "ms", 1e3)],
)  # fmt: skip
def test_low_rate_keeps_the_unit_of_its_name(
    tmp_path: Path, name: str, unit: str, per_s: float, rate_hz: float
) -> None:
    rng = np.random.default_rng(2)
    columns = {name: np.arange(600) / rate_hz * per_s, **{axis: rng.normal(size=600) for axis in NAMES}}
    text = guess_map(write_csv(tmp_path / "slow.csv", columns))
    assert f'time_unit = "{unit}"' in text
    assert f"? {rate_hz:g} Hz in its first rows, too low" in line_of(text, "time_column")


@pytest.mark.parametrize(("per_s", "unit"), [(1.0, "s"), (1e3, "ms"), (1e6, "us")])
def test_unit_without_a_name_is_the_one_in_which_a_wheel_rolls(tmp_path: Path, per_s: float, unit: str) -> None:
    text = guess_map(write_csv(tmp_path / "run.csv", {"time": WHEEL.times_s * per_s, **COLUMNS}))
    assert f'time_unit = "{unit}"' in text
    assert "8000 Hz" in line_of(text, "time_column")


@pytest.mark.parametrize("block", [8, 32])
def test_blank_cells_between_stamps_of_blocks_are_no_rate(tmp_path: Path, block: int) -> None:
    stamps = [f"{time:.6f}" if row % block == 0 else "" for row, time in enumerate(WHEEL.times_s)]
    rows = [f"{stamp},{','.join(f'{value:.5f}' for value in axes)}" for stamp, axes in zip(stamps, AXES_G, strict=True)]
    path = tmp_path / "fifo.csv"
    path.write_text("timestamp,ax,ay,az\n" + "\n".join(rows) + "\n")
    text = guess_map(path)
    assert f"? 8000 Hz in its first rows, stamps of blocks of {block} rows" in line_of(text, "time_column")
    report = imported(path, text)
    assert report.samples == len(AXES_G)
    assert report.rate_hz == pytest.approx(RATE_HZ, rel=1e-5)


def test_uneven_stamps_of_blocks_propose_the_rate(tmp_path: Path) -> None:
    late_s = np.random.default_rng(3).uniform(0.0, 1e-3, len(AXES_G))
    stamps = [f"{time + late_s[row]:.6f}" if row % 32 == 0 else "" for row, time in enumerate(WHEEL.times_s)]
    rows = [f"{stamp},{','.join(f'{value:.5f}' for value in axes)}" for stamp, axes in zip(stamps, AXES_G, strict=True)]
    path = tmp_path / "fifo.csv"
    path.write_text("timestamp,ax,ay,az\n" + "\n".join(rows) + "\n")
    line = line_of(guess_map(path), "rate_hz")
    assert "has a time once in 32 rows, unevenly" in line
    assert float(line.split("=")[1].split("#")[0]) == pytest.approx(RATE_HZ, rel=2e-3)


@pytest.mark.parametrize("rate_hz", [8000.0, 10000.0])
def test_time_column_with_many_gaps_is_kept_with_their_number(tmp_path: Path, rate_hz: float) -> None:
    is_present = np.ones(len(AXES_G), bool)
    is_present[np.random.default_rng(9).permutation(np.arange(10, 7990, 2))[:200]] = False
    times_s = np.round(np.arange(len(AXES_G)) / rate_hz, 9)
    path = write_csv(
        tmp_path / "gaps.csv", {"time": times_s[is_present], **{n: c[is_present] for n, c in COLUMNS.items()}}
    )
    text = guess_map(path)
    assert "200 samples are missing in 200 gaps" in line_of(text, 'time_column = "time"')
    assert imported(path, text).left_out == 200


@pytest.mark.parametrize(
    "line",
    ["Sample rate;8000", "fs = 8 kHz", "Abtastrate [Hz];8000,0", "dt;0.000125", "Delta_X;1.25E-4",
     "sampling interval [us];125", "Samples/s: 8000"],
)  # fmt: skip
def test_rate_above_the_columns_is_taken(tmp_path: Path, line: str) -> None:
    path = write_csv(tmp_path / "run.csv", COLUMNS, delimiter=";")
    path.write_text(f"Measurement 12\n{line}\n\n" + path.read_text())
    assert "rate_hz = 8000   # ? stated in the file: line 2" in guess_map(path)


@pytest.mark.parametrize(
    "content",
    [{"sr": RATE_HZ}, {"dt": 1.0 / RATE_HZ}, {"SampleRate": RATE_HZ}, {"x_values": {"increment": 1.0 / RATE_HZ}}],
)
def test_rate_in_a_struct_is_taken(tmp_path: Path, content: dict[str, object]) -> None:
    path = tmp_path / "run.mat"
    scipy.io.savemat(path, {"run": {**COLUMNS, **content}})
    assert "rate_hz = 8000   # ? stated in the file: run." in guess_map(path)


def test_array_of_structs_is_read(tmp_path: Path) -> None:
    records = np.array([(AXES_G[:, 2],), (AXES_G[:, 2] * 1.01,)], dtype=[("az", object)])
    path = tmp_path / "runs.mat"
    scipy.io.savemat(path, {"run": records, "fs": RATE_HZ})
    assert 'column = "run(1).az"' in guess_map(path)


@pytest.mark.parametrize(("unit", "size_mps2"), [("mm/s^2", 1e-3), ("cm/s2", 1e-2), ("ft/s²", 0.3048)])
def test_stated_unit_of_acceleration_becomes_a_scale(tmp_path: Path, unit: str, size_mps2: float) -> None:
    columns = {f"Acc {name} ({unit})": WHEEL.axes_mps2[:, k] / size_mps2 for k, name in enumerate("XYZ")}
    path = write_csv(tmp_path / "run.csv", {"Time (s)": WHEEL.times_s, **columns})
    text = guess_map(path)
    radial = tomllib.loads(text)["axis"]["radial"]
    assert (radial["unit"], radial["scale"], radial["column"]) == ("m/s^2", size_mps2, f"Acc Z ({unit})")
    assert imported(path, text).wheels[0].findings == ()


def test_volts_without_a_sensitivity_are_no_acceleration(tmp_path: Path) -> None:
    columns = {f"Acc {name} (mV)": AXES_G[:, k] * 10.0 for k, name in enumerate("XYZ")}
    path = write_csv(tmp_path / "run.csv", {"Time (s)": WHEEL.times_s, **columns})
    text = guess_map(path)
    assert "the file says mV: state scale, in g per mV" in text
    assert "unit" not in tomllib.loads(text)["axis"]["radial"]
    path.write_text("Sensitivity: 10 mV/g\n" + path.read_text())
    radial = tomllib.loads(guess_map(path))["axis"]["radial"]
    assert (radial["unit"], radial["scale"]) == ("g", 0.1)


def test_conditions_above_the_columns_are_taken(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", {"time_s": WHEEL.times_s, **COLUMNS}, delimiter=";")
    path.write_text("Date: 17.09.2024\nTyre;205/55 R16\nWheel load [N];4200\nPressure: 2.3 bar\n" + path.read_text())
    text = guess_map(path)
    conditions = tomllib.loads(text)["conditions"]
    assert (conditions["tire"], conditions["load_n"], conditions["pressure_kpa"]) == ("205/55 R16", 4200.0, 230.0)
    assert "start_utc = 2024-09-17T12:00:00Z   # ? date by line 1" in text


def test_parts_of_the_time_of_day_are_no_references(tmp_path: Path) -> None:
    rows = np.arange(len(AXES_G))
    parts = {"h": rows * 0 + 12, "m": rows // 4000, "s": rows // 2000 % 60, "us": rows * 125 % 1_000_000}
    text = guess_map(write_csv(tmp_path / "run.csv", {**{k: v.astype(float) for k, v in parts.items()}, **COLUMNS}))
    assert "[[reference]]" not in text
    assert text.count("a part of the time of day") == 4


def test_blank_line_parts_header_and_data(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", {"time_s": WHEEL.times_s, **COLUMNS})
    header, _, data = path.read_text().partition("\n")
    path.write_text(f"{header}\n\n{data}")
    text = guess_map(path)
    assert 'column = "az"' in text
    assert imported(path, text).samples == len(AXES_G)


@pytest.mark.parametrize(
    "pattern", ["S{sensor}_{axis}", "a{axis}_{sensor}", "{axis}{sensor}", "sensor {sensor} {axis}"]
)
def test_columns_of_two_sensors_are_two_wheels(tmp_path: Path, pattern: str) -> None:
    columns = {
        pattern.format(sensor=sensor, axis=axis.lower()): AXES_G[:, k] * (1.0 + 0.05 * sensor)
        for k, axis in enumerate("XYZ")
        for sensor in (1, 2)
    }
    path = write_csv(tmp_path / "two.csv", {"time_s": WHEEL.times_s, **columns})
    text = guess_map(path)
    wheels = tomllib.loads(text)["wheel"]
    assert [wheel["axis"]["radial"]["column"] for wheel in wheels] == [
        pattern.format(sensor=sensor, axis="z") for sensor in (1, 2)
    ]
    assert len(imported(path, text).wheels) == 2
    first, second = (pattern.format(sensor=sensor, axis="z") for sensor in (1, 2))
    mixed = simple_map(
        sampling=f"rate_hz = {RATE_HZ}",
        **{"axis.radial": f'column = "{first}"\nunit = "g"', "axis.lateral": f'column = "{second}"\nunit = "g"',
           "axis.circumferential": ""},
    ).replace("[axis.circumferential]\n\n", "")  # fmt: skip
    # The same axis twice says nothing; two axes of two sensors do.
    other = mixed.replace(f'"{second}"', f'"{pattern.format(sensor=2, axis="x")}"')
    with pytest.raises(ImportDataError, match="of several sensors"):
        imported(path, other, "mixed.mcap")


@pytest.mark.parametrize("order", ["interleaved", "stacked"])
@pytest.mark.parametrize("identities", [("1", "2"), ("front", "rear")])
def test_rows_of_two_sensors_are_two_wheels(tmp_path: Path, order: str, identities: tuple[str, str]) -> None:
    rows = [
        (row, sensor, f"{WHEEL.times_s[row]:.7f},{identity},{','.join(f'{v * (1 + sensor):.5f}' for v in AXES_G[row])}")
        for row in range(4000)
        for sensor, identity in enumerate(identities)
    ]
    if order == "stacked":
        rows.sort(key=lambda row: row[1])
    path = tmp_path / "long.csv"
    path.write_text("time,sensor,ax,ay,az\n" + "\n".join(text for *_, text in rows) + "\n")
    text = guess_map(path)
    report = imported(path, text)
    assert report.rate_hz == pytest.approx(RATE_HZ, rel=1e-4)
    assert report.samples == 4000
    high = [max(axis.high_mps2 for axis in wheel.axes) for wheel in report.wheels]
    assert high[1] == pytest.approx(2.0 * high[0], rel=1e-3)


def test_samples_of_sensors_in_rows_keep_their_values(tmp_path: Path) -> None:
    path = tmp_path / "long.csv"
    lines = [f"{row / RATE_HZ:.7f},{s},{(row % 50) * s}" for row in range(2000) for s in (1, 2)]
    path.write_text("time,node,z\n" + "\n".join(lines) + "\n")
    wheels = "\n".join(
        f'[[wheel]]\nposition = "W{s}"\nsensor = "{s}"\n[wheel.axis.radial]\ncolumn = "z"\nunit = "g"' for s in (2, 1)
    )
    text = f'[file]\nsensor_column = "node"\n[sampling]\ntime_column = "time"\n[sensor]\ncoupling = "DC"\n{wheels}'
    report = imported(path, text)
    assert [wheel.axes[0].high_mps2 / G for wheel in report.wheels] == pytest.approx([98.0, 49.0])


def test_channels_of_one_step_align_by_their_starts(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    path, start = tmp_path / "late.tdms", np.datetime64("2024-05-01T12:00:00", "us")
    late = 40
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment([
            nptdms.ChannelObject(
                "g", name, AXES_G[late * (k == 2) :, k],
                {"wf_increment": 1.0 / RATE_HZ, "wf_start_time": start, "unit_string": "g",
                 "wf_start_offset": late / RATE_HZ if k == 2 else 0.0},
            )
            for k, name in enumerate(NAMES)
        ])  # fmt: skip
    text = guess_map(path)
    report = imported(path, text)
    samples = Decoded(tmp_path / "out.mcap").samples_mps2
    assert report.samples == len(AXES_G) - late
    assert report.assumed == ("belt radius 320 mm (not stated in the map)",)
    np.testing.assert_allclose(samples[:, 2], WHEEL.axes_mps2[late:, 2], atol=0.05)
    np.testing.assert_allclose(samples[:, 0], WHEEL.axes_mps2[late:, 0], atol=0.05)


@pytest.mark.parametrize("name", ["uff", "tdms"])
def test_channel_that_ends_early_cuts_the_others(tmp_path: Path, name: str) -> None:
    if name == "tdms":
        nptdms = pytest.importorskip("nptdms")
        path = tmp_path / "cut.tdms"
        with nptdms.TdmsWriter(str(path)) as writer:
            clock = {"wf_increment": 1.0 / RATE_HZ, "unit_string": "g"}
            writer.write_segment(
                [
                    nptdms.ChannelObject("g", n, AXES_G[: 5000 if k == 2 else None, k], clock)
                    for k, n in enumerate(NAMES)
                ]
            )
    else:
        pytest.importorskip("pyuff")
        from tests.importing.test_waveform_files import write_uff

        path = write_uff(tmp_path / "cut.uff", binary=False)
        path.write_bytes(path.read_bytes()[:-40000])
    text = guess_map(path)
    assert "# ? The file is cut: " in text
    radial = tomllib.loads(text)["axis"]["radial"]["column"]
    assert radial in ("g/az", "12 Z")
    report = imported(path, text)
    assert any("the file is cut" in assumed for assumed in report.assumed)
    assert report.samples == (5000 if name == "tdms" else report.samples) < 9600


def test_slow_acceleration_is_no_axis_of_a_fast_one(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "rates.tdms"
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment([
            nptdms.ChannelObject("g", n, AXES_G[::each, k], {"wf_increment": each / RATE_HZ})
            for k, (n, each) in enumerate(zip(NAMES, (1, 8, 1), strict=True))
        ])  # fmt: skip
    text = guess_map(path)
    assert "g/ay: 1000 rows, others 8000" in text
    axes = {"axis.radial": 'column = "g/az"\nunit = "g"', "axis.lateral": 'column = "g/ay"\nunit = "g"'}
    stated = simple_map(sampling='time_column = "time"', **{"axis.circumferential": ""}, **axes)
    with pytest.raises(ImportDataError, match="differ in their step"):
        imported(path, stated)


def test_unit_of_the_file_against_that_of_the_map_is_told(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", {"z (mV)": AXES_G[:, 2]})
    axes = {"axis.circumferential": "", "axis.lateral": "", "axis.radial": 'column = "z (mV)"\nunit = "g"'}
    text = simple_map(sampling=f"rate_hz = {RATE_HZ}", **axes)
    assert "'z (mV)' is in g, as the map says; the file says mV" in imported(path, text).assumed
    scaled = text.replace('unit = "g"', 'unit = "g"\nscale = 0.1')
    assert not any("the file says" in each for each in imported(path, scaled, "scaled.mcap").assumed)
