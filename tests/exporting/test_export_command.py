"""The command `treadlink export`: files, pipes, memory and errors."""

import errno
import json
import os
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from gateway.core.errors import OutputError, TreadlinkError
from gateway.core.links.source import Chunk
from gateway.core.recording.reader import RecordingReader
from gateway.core.table_columns import Column
from gateway.exporting import column_file
from gateway.exporting.column_file import ColumnFile
from gateway.exporting.export_registry import FORMATS, check_format, format_of
from gateway.exporting.export_table import Condition, WheelTable
from gateway.exporting.formats import mat_file, mcap_file, mdf_file, parquet_file
from gateway.exporting.recording_export import ExportFile, ExportRequest, export_recording
from tests.testkit.campaign_recordings import write_recording
from tests.testkit.commands import invoked

TABLE = WheelTable(
    "samples",
    "FL",
    (
        Column("time_s", "time"),
        Column("radial_mps2", "acceleration"),
        Column("host_ns", "time", int),
        Column("saturated", "flag", bool),
        Column("note", "text", str),
    ),
    (Condition("load_n", 4200.0, "N", "stated"), Condition("start_ns", 10**18, "ns")),
)
ROWS = 200


def block(number):
    position = np.arange(ROWS, dtype=np.int64) + number * ROWS
    return {
        "time_s": position * 1e-4,
        "radial_mps2": np.sin(position.astype(float)),
        "host_ns": position,
        "saturated": position % 2 == 0,
        "note": np.full(ROWS, "a note", object),
    }


def write(path, name, blocks=1, error=None, table=TABLE):
    with ExportFile(path, name) as file:
        file.begin([table])
        for number in range(blocks):
            file.write(table, block(number))
        if error is not None:
            raise error


def peak_bytes(path, name, blocks):
    # asammdf keeps eight bytes for each text, of which samples have none.
    table = replace(TABLE, columns=TABLE.columns[:-1])
    tracemalloc.start()
    write(path, name, blocks, table=table)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


@pytest.mark.parametrize("name", list(FORMATS))
def test_memory_does_not_grow_with_the_length(tmp_path, monkeypatch, name):
    if name in ("parquet", "mf4"):
        pytest.importorskip({"parquet": "pyarrow", "mf4": "asammdf"}[name])
    # What is held at most is less than the shorter of the two files.
    monkeypatch.setattr(parquet_file, "_GROUP_ROWS", 2 * ROWS)
    monkeypatch.setattr(column_file, "_STORED_ROWS", 2 * ROWS)
    monkeypatch.setattr(mcap_file, "_CHUNK_BYTES", 1 << 14)
    monkeypatch.setattr(mdf_file, "_FRAGMENT_BYTES", 1 << 14)
    peak_bytes(tmp_path / "warm", name, 1)  # imports
    short = peak_bytes(tmp_path / "short", name, 10)
    long = peak_bytes(tmp_path / "long", name, 30)
    assert (tmp_path / "long").stat().st_size > 2.0 * (tmp_path / "short").stat().st_size
    # A writer that kept its rows would keep at least 33 bytes of each.
    assert long - short < 20 * ROWS * 20 + 60_000


@pytest.mark.parametrize("name", list(FORMATS))
def test_nothing_is_left_after_an_error(tmp_path, name):
    with pytest.raises(RuntimeError, match="stopped"):
        write(tmp_path / "out", name, error=RuntimeError("stopped"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
@pytest.mark.parametrize("name", [name for name, entry in FORMATS.items() if entry.to_pipe])
def test_full_disk_is_an_error_with_a_remedy(name):
    with pytest.raises(OutputError, match="/dev/full") as caught:
        write(Path("/dev/full"), name, 10)
    assert "space" in caught.value.remedy


@pytest.mark.parametrize("name", [name for name in FORMATS if name != "tydex"])
def test_wheel_without_rows_is_an_empty_table(tmp_path, name):
    other = replace(TABLE, wheel="FR")
    with ExportFile(tmp_path / "out", name) as file:
        file.begin([TABLE, other])
        file.write(TABLE, block(0))
    if name == "npz":
        with np.load(tmp_path / "out") as archive:
            assert archive["FR/radial_mps2"].shape == (0,)
    if name == "mat":
        assert scipy.io.loadmat(tmp_path / "out", simplify_cells=True)["FR"]["Data"]["radial_mps2"].size == 0
    if name == "mf4":
        asammdf = pytest.importorskip("asammdf")
        with asammdf.MDF((tmp_path / "out").rename(tmp_path / "out.mf4")) as mdf:
            assert len(mdf.get("FL.radial_mps2").samples) == ROWS
            assert len(mdf.get("FR.radial_mps2").samples) == 0


def test_full_disk_of_mf4_leaves_no_file(tmp_path, monkeypatch):
    asammdf = pytest.importorskip("asammdf")

    def full(*args, **kwargs):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(asammdf.MDF, "save", full)
    with pytest.raises(OutputError, match="No space left"):
        write(tmp_path / "out.mf4", "mf4")
    assert list(tmp_path.iterdir()) == []


def test_full_disk_of_the_temporary_file_is_an_error_of_the_output(tmp_path, monkeypatch):
    def full(*args, **kwargs):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(ColumnFile, "_store", full)
    with pytest.raises(OutputError, match="No space left"):
        write(tmp_path / "out.npz", "npz")
    assert list(tmp_path.iterdir()) == []


def test_mat_variable_that_is_too_large_names_other_formats(tmp_path, monkeypatch):
    monkeypatch.setattr(mat_file, "MOST_BYTES", 10_000)
    with pytest.raises(OutputError, match="table of FL takes") as caught:
        write(tmp_path / "o", "mat")
    assert "Parquet" in caught.value.remedy
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("path", "name"), [("a.MF4", "mf4"), ("a.pq", "parquet"), ("a.tdx", "tydex")])
def test_format_is_guessed_from_the_suffix(path, name):
    assert format_of(Path(path), None) == name
    assert format_of(Path(path), "csv") == "csv"


@pytest.mark.parametrize("path", ["a.xlsx", "a", "-"])
def test_unknown_suffix_lists_the_formats(path):
    with pytest.raises(OutputError) as caught:
        format_of(Path(path), None)
    assert "csv, parquet, mat, mf4, npz, tydex, mcap" in caught.value.remedy


def test_formats_refuse_what_they_cannot_hold(tmp_path):
    with pytest.raises(OutputError, match="cannot be written to a pipe"):
        check_format(Path("-"), "mf4", ["samples"])
    with pytest.raises(OutputError, match="holds one content, not 2") as caught:
        check_format(tmp_path / "a.csv", "csv", ["samples", "estimates"])
    assert "mcap" in caught.value.remedy
    with pytest.raises(OutputError, match=r"one wheel, not 2 \(FL, FR\)"), ExportFile(tmp_path / "o", "tydex") as file:
        file.begin([TABLE, WheelTable("samples", "FR", TABLE.columns)])


def run(*words):
    return invoked("export", *words)


def test_command_reports_what_it_has_written(recorded, tmp_path):
    out = tmp_path / "out.csv"
    done = run(recorded, out, "--what", "orders", "--wheel", "W1")
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith(f"written: {out} (")
    assert "128 columns of orders, W1, " in done.stdout
    wheels = {line.split(",")[0] for line in out.read_text("utf-8").splitlines() if not line.startswith("#")}
    assert wheels == {"wheel", "W1"}
    again = run(recorded, out, "--what", "orders")
    assert isinstance(again.exception, OutputError)
    assert "--force" in again.exception.remedy


def test_command_to_a_pipe_writes_data_only(recorded):
    done = run(recorded, "-", "--format", "csv", "--what", "average", "--wheel", "W0")
    assert done.exit_code == 0
    lines = [line for line in done.stdout.splitlines() if not line.startswith("#")]
    assert lines[0].startswith("wheel,angle_rad,")
    assert len(lines) == 1 + 1024
    assert done.stderr == ""


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--wheel", "XX"), "no samples of wheel XX"),
        (("--config", "missing.toml"), "missing.toml"),
    ],
)
def test_command_explains_what_is_missing(recorded, tmp_path, words, message):
    done = run(recorded, tmp_path / "o.csv", *words)
    assert isinstance(done.exception, TreadlinkError)
    assert message in str(done.exception)
    assert list(tmp_path.iterdir()) == []


def test_recording_without_revolutions_has_no_orders(tmp_path):

    standing = write_recording(
        tmp_path / "s.mcap", "[motion]\nspeed_kmh = 0.0\n[sensor]\nrate_hz = 3200.0", duration_s=1.0
    )
    with pytest.raises(OutputError, match="has no orders to export"):
        export_recording(standing, tmp_path / "o.npz", ExportRequest(["orders"], "npz"))
    assert {path.name for path in tmp_path.iterdir()} == {"s.mcap"}


def test_control_characters_of_a_vehicle_reach_no_file(tmp_path):
    recording = write_recording(
        tmp_path / "r.mcap", "name = 'plain'\n[sensor]\nrate_hz = 3200.0", duration_s=1.0,
        change=lambda toml: toml.replace('"plain"', '"a\\u001b[2J<b>\\u0007"'),
    )  # fmt: skip
    for name in ("csv", "tydex"):
        out = tmp_path / name
        export_recording(recording, out, ExportRequest(["average"], name))
        data = out.read_bytes()
        assert b"\x1b" not in data
        assert rb"a\x1b[2J<b>\x07" in data


def test_dump_without_arrival_times_has_those_of_the_hub(recorded, tmp_path):
    dump = tmp_path / "dump.bin"
    items = RecordingReader(recorded).items()
    dump.write_bytes(b"".join(item.data for item in items if isinstance(item, Chunk)))
    for content in ("samples", "estimates"):
        out = tmp_path / content
        export_recording(dump, out, ExportRequest([content], "npz", ("kinematic",), ["hub0.wheel0"]))
    with np.load(tmp_path / "samples") as samples, np.load(tmp_path / "estimates") as estimates:
        device_s = samples["hub0.wheel0/device_s"]
        np.testing.assert_allclose(samples["hub0.wheel0/time_s"], device_s, atol=1e-9)
        assert np.ptp(device_s) > 1.9
        ends_s = estimates["hub0.wheel0/device_end_s"]
        np.testing.assert_allclose(estimates["hub0.wheel0/time_s"], ends_s, atol=1e-9)
        assert json.loads(str(samples["about"]))["conditions"]["hub0.wheel0"]["clock"]["value"] == "hub"


def test_progress_rises_to_the_end(recorded, tmp_path):
    shares = []
    export_recording(recorded, tmp_path / "o", ExportRequest(["samples"], "npz"), on_progress=shares.append)
    assert shares == sorted(shares)
    assert 0.4 < shares[len(shares) // 2] < 0.6
    assert shares[-1] == pytest.approx(1.0, abs=0.05)


def test_closed_pipe_ends_quietly(recorded):
    words = [sys.executable, "-m", "gateway.core.cli", "export", str(recorded), "-", "--format", "csv"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 141
