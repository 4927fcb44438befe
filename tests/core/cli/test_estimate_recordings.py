"""`treadlink estimate` of several recordings, of a dump, and with expanded uncertainties."""

import csv
import io
import subprocess
import sys

import pytest

from gateway.core.compiled import core
from gateway.core.errors import RecordingError
from gateway.core.recording.reader import RecordingReader
from tests.testkit.campaign_recordings import START_NS, write_recording
from tests.testkit.commands import invoked

TABLES = ("csv", "json", "parquet", "metadata", "html")


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    motion = "[motion]\nspeed_kmh = 60.0"
    return [
        write_recording(folder / f"{number}.mcap", motion, duration_s=duration_s, start_ns=START_NS + number * 10**10)
        for number, duration_s in enumerate((3.0, 0.5, 1.5))
    ]


def estimate(recordings, folder):
    outputs = [word for kind in TABLES for word in (f"--{kind}", str(folder / f"out.{kind}"))]
    # Fewer quantities, each of which the page draws.
    return invoked("estimate", *recordings, "--estimator", "kinematic", *outputs)


def test_recordings_follow_each_other_in_the_order_given(recordings, tmp_path):
    result = estimate(reversed(recordings), tmp_path)
    printed = [line for line in result.output.splitlines() if line.startswith(str(recordings[0].parent))]
    assert [line.split()[0] for line in printed] == [str(path) for path in reversed(recordings)]
    rows = csv.DictReader((tmp_path / "out.csv").read_text(encoding="utf-8").splitlines())
    assert list(dict.fromkeys(row["recording"] for row in rows)) == ["2.mcap", "1.mcap", "0.mcap"]
    assert len(list(tmp_path.iterdir())) == len(TABLES)


def test_first_error_leaves_no_table(recordings, tmp_path):
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(b"no recording")
    folder = tmp_path / "out"
    folder.mkdir()
    result = estimate([recordings[0], broken, recordings[1]], folder)
    assert isinstance(result.exception, RecordingError)
    assert "broken.mcap" in str(result.exception)
    assert str(recordings[0]) in result.output
    assert str(recordings[1]) not in result.output
    assert list(folder.iterdir()) == []


def test_a_missing_recording_is_named_before_the_first_is_estimated(recordings, tmp_path):
    result = estimate([recordings[0], tmp_path / "missing.mcap"], tmp_path)
    assert "missing.mcap' does not exist" in str(result.exception)
    assert result.output == ""
    assert list(tmp_path.iterdir()) == []


def test_dump_of_a_link_has_the_same_estimates_and_no_times(recordings, tmp_path):
    dump, vehicle = tmp_path / "raw.bin", tmp_path / "vehicle.toml"
    reader = RecordingReader(recordings[0])
    dump.write_bytes(b"".join(item.data for item in reader.items()))
    vehicle.write_text(reader.vehicle_toml, encoding="utf-8")
    rows = []
    for path in (recordings[0], dump):
        arguments = ["estimate", str(path), "--config", str(vehicle), "--csv", "-"]
        result = invoked(*arguments)
        assert result.exit_code == 0, result.output
        rows.append(list(csv.DictReader(io.StringIO(result.stdout))))
    timed, untimed = rows
    assert {row["host_utc"] for row in untimed} == {""}
    for name in ("recording", "host_utc", "host_ns", "alarms"):
        for row in (*timed, *untimed):
            del row[name]
    assert timed == untimed
    assert len(timed) > 10


def test_coverage_without_a_table_is_refused(recordings, tmp_path):
    for page in ((), ("--html", str(tmp_path / "page.html"))):
        result = invoked("estimate", recordings[1], "--coverage", "0.95", *page)
        assert result.exit_code == 2
        assert "give --csv, --json or --parquet" in result.output
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(core is None, reason="the core is not compiled; LAPACK does its work")
def test_an_estimate_imports_no_package_that_it_does_not_need(recordings, tmp_path):
    pytest.importorskip("pyarrow")
    words = ["estimate", str(recordings[0]), "--parquet", str(tmp_path / "out.parquet")]
    code = (
        "import sys\nfrom gateway.core.cli import treadlink\n"
        f"treadlink({words}, standalone_mode=False)\n"
        "print([name for name in ('scipy', 'pandas', 'matplotlib', 'gateway.diagnosis.result') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert (tmp_path / "out.parquet").exists()
