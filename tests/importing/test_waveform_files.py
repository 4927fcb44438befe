"""TDMS, UFF and IDE files made by the libraries of these formats: names, units, steps, start, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from gateway.core.errors import ImportDataError
from gateway.importing.import_map import FileFormat, parse_map
from gateway.importing.importer import import_file
from gateway.importing.map_guess import guess_map
from gateway.importing.reader_process import ProcessColumns
from tests.importing.measurements import Decoded, simple_map
from tests.importing.rolling_wheel import rolling
from tools.reliability.logger_files import ide_file

nptdms = pytest.importorskip("nptdms")
pyuff = pytest.importorskip("pyuff")
G = 9.80665
WHEEL = rolling(9600.0, 1.0)
AXES_G = WHEEL.axes_mps2 / G
START = np.datetime64("2024-05-01T12:00:00.250000", "us")


def write_tdms(path: Path, *, other_step: bool = False) -> Path:
    clock = {"wf_increment": 1.0 / 9600.0, "wf_start_time": START, "wf_start_offset": 0.0}
    channels = [
        nptdms.ChannelObject("rig", name, AXES_G[:, k], {**clock, "unit_string": "g"}) for k, name in enumerate("xyz")
    ]
    channels.append(nptdms.ChannelObject("rig", "note", ["start", "stop"]))
    if other_step:
        channels[0] = nptdms.ChannelObject("rig", "x", AXES_G[:, 0], {**clock, "wf_increment": 1e-3})
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment(channels)
    return path


def write_uff(path: Path, *, binary: bool) -> Path:
    parts = ("abscissa", "ordinate", "orddenom", "z_axis")
    units = {f"{part}_{unit}_unit_exp": 0 for part in parts for unit in ("len", "force", "temp")}
    kinds = {f"{part}_spec_data_type": 0 for part in parts}
    labels = {f"{part}_axis_units_lab": "NONE" for part in parts} | {"ordinate_axis_units_lab": "g"}
    names = {f"id{k}": "NONE" for k in range(2, 6)} | {"rsp_ent_name": "NONE", "ref_ent_name": "NONE"}
    numbers = {"ver_num": 1, "load_case_id": 0, "rsp_node": 12, "ref_node": 1, "ref_dir": 3, "z_axis_value": 0.0}
    spacing = {"abscissa_spacing": 1, "abscissa_min": 0.0, "abscissa_inc": 1.0 / 9600.0, "num_pts": len(AXES_G)}
    sets = [
        pyuff.prepare_58(
            binary=int(binary), id1=name, func_type=1, rsp_dir=k + 1, ord_data_type=4, data=AXES_G[:, k],
            x=WHEEL.times_s, **units, **kinds, **labels, **names, **numbers, **spacing,
        )
        for k, name in enumerate(("acc x", "acc y", "NONE"))
    ]  # fmt: skip
    for dataset in sets:
        pyuff.UFF(str(path)).write_sets(dataset, "add")
    return path


def write_ide(path: Path) -> Path:
    pytest.importorskip("ebmlite")
    path.write_bytes(ide_file(AXES_G, 9600.0, int(START.astype("datetime64[s]").astype(np.int64))))
    return path


def named(x: str, y: str, z: str, time: str) -> str:
    return simple_map(
        sampling=f'time_column = "{time}"',
        **{
            "axis.circumferential": f'column = "{x}"\nunit = "g"',
            "axis.lateral": f'column = "{y}"\nunit = "g"',
            "axis.radial": f'column = "{z}"\nunit = "g"',
        },
    )


def test_tdms_gives_names_units_step_and_start(tmp_path: Path) -> None:
    path = write_tdms(tmp_path / "run.tdms")
    reader = ProcessColumns(path, FileFormat.TDMS)
    assert (reader.facts.units["rig/z"], reader.facts.time_column) == ("g", "time")
    assert reader.facts.unusable["rig/note"][0] == "contains text"
    reader.close()
    text = named("rig/x", "rig/y", "rig/z", "time")
    report = import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")
    assert report.rate_hz == pytest.approx(9600.0, rel=1e-9)
    assert not report.start_is_file_date
    decoded = Decoded(report.recording)
    assert decoded.items[0].host_ns == int(START.astype("datetime64[ns]").astype(np.int64))
    assert np.abs(decoded.samples_mps2 - WHEEL.axes_mps2).max() < 0.1


@pytest.mark.parametrize("binary", [True, False])
def test_uff_in_both_forms(tmp_path: Path, binary: bool) -> None:
    path = write_uff(tmp_path / "run.uff", binary=binary)
    report = import_file(path, parse_map(named("acc x", "acc y", "12 Z", "time"), "map"), tmp_path / "out.mcap")
    # The format keeps six digits of the step.
    assert report.rate_hz == pytest.approx(9600.0, rel=5e-6)
    assert np.abs(Decoded(report.recording).samples_mps2 - WHEEL.axes_mps2).max() < 0.1


def test_first_map_of_a_tdms_file_imports_as_it_is(tmp_path: Path) -> None:
    path = write_tdms(tmp_path / "run.tdms")
    text = guess_map(path)
    assert 'time_column = "time"   # 9600 Hz in its first rows' in text
    assert "rig/note: contains text" in text
    assert import_file(path, parse_map(text, "map"), tmp_path / "out.mcap").samples == len(AXES_G)


def test_ide_recording_has_its_calibration_times_and_start(tmp_path: Path) -> None:
    pytest.importorskip("idelib")
    path = write_ide(tmp_path / "run.ide")
    text = guess_map(path)
    assert 'column = "Accelerometer/Z (300g)"   # mean' in text
    assert "Hz in its first rows" in text
    report = import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")
    assert report.rate_hz == pytest.approx(9600.0, rel=1e-4)
    assert (report.samples, report.start_is_file_date) == (len(AXES_G), False)
    decoded = Decoded(report.recording)
    assert decoded.items[0].host_ns == int(START.astype("datetime64[s]").astype(np.int64)) * 10**9
    assert np.abs(np.sort(decoded.samples_mps2) - np.sort(WHEEL.axes_mps2)).max() < 0.2


def test_damaged_ide_recording_is_read_in_part_with_a_word(tmp_path: Path) -> None:
    pytest.importorskip("idelib")
    good = write_ide(tmp_path / "good.ide").read_bytes()
    a, b = len(good) // 2, 6 * len(good) // 10
    for damaged in (good[:b] + good[a:], good[: a - 3000] + good[a:]):
        path = tmp_path / "run.ide"
        path.write_bytes(damaged)
        assert "file is damaged" in guess_map(path)
    path.write_bytes(good[: a + 7])
    with pytest.raises(ImportDataError, match=r"run.ide is cut or damaged within a block of samples"):
        guess_map(path)


def test_channels_of_different_steps_are_refused(tmp_path: Path) -> None:
    path = write_tdms(tmp_path / "run.tdms", other_step=True)
    with pytest.raises(ImportDataError, match="differ in their step"):
        import_file(path, parse_map(named("rig/x", "rig/y", "rig/z", "time"), "map"), tmp_path / "out.mcap")


@pytest.mark.parametrize(
    ("name", "content"), [("a.tdms", b""), ("a.tdms", b"TDSm" + bytes(40)), ("a.uff", b"x" * 99), ("a.ide", b"x" * 99)]
)
def test_damaged_file_is_an_error_that_names_it(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ImportDataError, match=name):
        import_file(path, parse_map(simple_map(), "map"), tmp_path / "out.mcap")


def write_channels(path: Path, *channels: tuple[str, np.ndarray, str, float, float]) -> Path:
    """Write channels of a group `rig`: name, values, unit, rate in Hz, and start in s from START."""
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment([
            nptdms.ChannelObject("rig", name, values, {
                "wf_increment": 1.0 / rate_hz, "wf_start_offset": 0.0, "unit_string": unit,
                "wf_start_time": START + np.timedelta64(round(start_s * 1e6), "us"),
            })
            for name, values, unit, rate_hz, start_s in channels
        ])  # fmt: skip
    return path


RADIAL = {"axis.circumferential": "", "axis.lateral": "", "axis.radial": 'column = "rig/z"\nunit = "g"'}


def test_units_of_slow_columns_and_references_are_compared_with_those_of_the_file(tmp_path: Path) -> None:
    z = AXES_G[:, 2]
    others = [(name, np.full(len(z), 20.0), unit, 9600.0, 0.0) for name, unit in (("p", "bar"), ("T", "K"))]
    speed = ("v", np.full(len(z), 64.8), "km/h", 9600.0, 0.0)
    path = write_channels(tmp_path / "run.tdms", ("z", z, "g", 9600.0, 0.0), *others, speed)
    environment = 'pressure_column = "rig/p"\npressure_unit = "psi"\ntemperature_column = "rig/T"'
    text = simple_map(sampling='time_column = "time"', environment=environment, **RADIAL)
    text += '\n[[reference]]\nname = "v"\ncolumn = "rig/v"\nquantity = "speed"\nunit = "UNIT"\n'
    wrong = import_file(path, parse_map(text.replace("UNIT", "m/s"), "map"), tmp_path / "wrong.mcap")
    assert [line for line in wrong.assumed if "the file says" in line] == [
        "'rig/p' is in psi, as the map says; the file says bar",
        "'rig/T' is in degC, as the map says; the file says K",
        "'rig/v' is in m/s, as the map says; the file says km/h",
    ]
    text = text.replace("UNIT", "km/h").replace("psi", "bar").replace('\ntemperature_column = "rig/T"', "")
    assert not import_file(path, parse_map(text, "map"), tmp_path / "right.mcap").assumed


@pytest.mark.parametrize("sampling", ["rate_hz = 9600", 'time_column = "time"'])
def test_recording_starts_with_its_own_channels(tmp_path: Path, sampling: str) -> None:
    temperature = ("T", np.full(10, 30.0), "degC", 1.0, -5.0)
    path = write_channels(tmp_path / "run.tdms", temperature, ("z", AXES_G[:, 2], "g", 9600.0, 0.0))
    text = simple_map(sampling=sampling, environment='temperature_column = "rig/T"', **RADIAL)
    report = import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")
    start_ns = int(START.astype("datetime64[ns]").astype(np.int64))
    assert Decoded(report.recording).items[0].host_ns == pytest.approx(start_ns, abs=1000)


def test_slower_acceleration_of_another_wheel_is_refused(tmp_path: Path) -> None:
    z = AXES_G[:, 2]
    path = write_channels(tmp_path / "run.tdms", ("FL z", z, "g", 9600.0, 0.0), ("FR z", z[::2], "g", 4800.0, 0.0))
    text = simple_map(sampling='time_column = "time"', **dict.fromkeys(RADIAL, ""))
    for position in ("FL", "FR"):
        text += f'\n[[wheel]]\nposition = "{position}"\n[wheel.axis.radial]\ncolumn = "rig/{position} z"\nunit = "g"'
    with pytest.raises(ImportDataError, match=r"differ in their step: rig/FL z has 0.000104167 s, rig/FR z has"):
        import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")
