"""`treadlink compare`: differences with their errors, and the same numbers in Python."""

import csv
import io

import pytest

import gateway
from gateway.core.errors import RecordingError
from tests.testkit.campaign_recordings import START_NS, write_recording
from tests.testkit.commands import invoked, run


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    return [
        write_recording(folder / f"{speed}.mcap", f"[motion]\nspeed_kmh = {speed}.0", duration_s=3.0, start_ns=START_NS)
        for speed in (60, 90)
    ]


def compare(*arguments):
    return invoked("compare", *arguments)


def test_another_speed_is_significant_and_the_same_recording_is_not_different(pair):
    result = compare(*pair, "--csv", "-")
    assert result.exit_code == 0, result.output
    rows = {row["quantity"]: row for row in csv.DictReader(io.StringIO(result.stdout))}
    assert float(rows["speed_mps"]["difference"]) == pytest.approx(30.0 / 3.6, rel=0.02)
    assert rows["speed_mps"]["is_significant"] == "1"
    assert "distance_m" not in rows
    assert "load, stated" in result.stderr
    same = compare(pair[0], pair[0])
    assert same.exit_code == 0
    assert "0 of " in same.stdout.splitlines()[-1]


def test_python_gives_the_same_numbers(pair):
    rows = list(csv.DictReader(io.StringIO(compare(*pair, "--csv", "-").stdout)))
    first, second = (gateway.open(path).estimates() for path in pair)
    table = first.compare(second)
    assert table.name.tolist() == [row["quantity"] for row in rows]
    for column, key in (("difference", "difference"), ("difference_std", "difference_std"), ("other_value", "second")):
        assert table[column] == pytest.approx(
            [float(row[key]) if row[key] else float("nan") for row in rows], nan_ok=True
        )
    with pytest.raises(KeyError, match="no angle and no time"):
        table.plot()
    assert "differences of 90.mcap from 60.mcap" in repr(table)


def test_recordings_without_a_common_wheel_are_refused(pair, tmp_path):
    other = tmp_path / "other.mcap"
    run("simulate", "lab", "--duration", "2", "--out", other)
    result = compare(pair[0], other)
    assert isinstance(result.exception, RecordingError)
    assert "no wheel has revolutions in both" in str(result.exception)


def test_readable_part_of_a_damaged_recording_is_compared(pair, tmp_path):
    content = bytearray(pair[0].read_bytes())
    content[len(content) // 2 : len(content) // 2 + 400] = bytes(400)
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(content)
    result = compare(pair[1], damaged)
    assert "The readable part was compared." in getattr(result.exception, "remedy", "")
    assert "speed, km/h" in result.stdout


def test_mean_of_a_speed_that_varies_says_so(pair, tmp_path):
    ramp = write_recording(
        tmp_path / "ramp.mcap",
        "[motion]\nspeed_kmh = [[0, 30], [8, 100]]",
        duration_s=8.0,
        start_ns=START_NS,
    )
    result = compare(pair[0], ramp, "--csv", "-")
    assert result.exit_code == 0, result.output
    rows = {row["quantity"]: row for row in csv.DictReader(io.StringIO(result.stdout))}
    speed = rows["speed_mps"]
    assert abs(float(speed["second"]) - 65.0 / 3.6) < float(speed["second_std"])
    assert (speed["first_reason"], speed["is_significant"]) == ("", "0")
    assert "varied within the recording" in speed["second_reason"]
    assert "~ speed" in result.stderr
