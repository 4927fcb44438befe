"""Histories from a dataset, and odometer files."""

import shutil
import warnings
from collections import Counter

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from gateway.core.clock import ManualClock
from gateway.core.errors import OutputError, RecordingError
from gateway.core.quantity import Statement
from gateway.fleet.dataset import is_identified
from gateway.fleet.history_reading import read_histories, read_odometer
from gateway.fleet.parquet_parts import read_rows
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.stated_changes import stated_changes
from gateway.upkeep.compact import compact_recording
from tests.testkit.campaign_recordings import START_NS, write_recording

ODOMETER = "vehicle,utc,km\nvan 7,2023-11-14T00:00:00Z,1000\nvan 7,2023-11-24T00:00:00Z,1500\n"


def test_dataset_becomes_histories(campaign, recordings, tmp_path):
    (recordings / "bad.mcap").write_text("no recording")
    campaign(recordings)
    (tmp_path / "odometer.csv").write_text(ODOMETER)
    histories = read_histories(tmp_path / "dataset", read_odometer(tmp_path / "odometer.csv"))
    assert (histories.recordings, histories.failures) == (3, 1)
    assert [(tire.vehicle, tire.position, tire.sensor_id) for tire in histories.tires] == [
        ("a/b=c ü", "W0", "0000b000"), ("van 7", "W0", "0000b000")
    ]  # fmt: skip
    van = histories.tires[1]
    assert van.has_odometer
    assert van.time_ns[0] == START_NS
    assert van.km[0] == pytest.approx(1000.0 + 50.0 * (22 + 13 / 60 + 20 / 3600) / 24, abs=0.01)
    assert np.diff(van.km)[0] == pytest.approx(50.0, abs=0.01)
    assert van.column("Bs") == pytest.approx(3.08e-3, rel=0.1)
    waves = van.columns["average_orders"]
    # Short waves are a few percent of the centripetal acceleration, and two drives of a tire have the same.
    assert 1e-3 < np.abs(waves[0]).max() < 0.2
    assert np.corrcoef(waves)[0, 1] > 0.99
    assert [str(note.code) for note in histories.notes] == ["trend_vehicle_without_odometer"]
    assert len(analyse(histories.tires, recordings=3).tires) == 2


@pytest.mark.parametrize(("vehicle", "sensor_id", "known"), [
    ("van 7", "0000b000", True), ("van 7", "", True), ("unknown", "0000b000", True), ("unknown", "", False)
])  # fmt: skip
def test_a_tire_is_identified_by_vehicle_or_sensor(vehicle, sensor_id, known):
    assert is_identified(vehicle, sensor_id) is known


def test_recordings_of_unknown_tires_are_said_to_be(campaign, recordings, tmp_path, monkeypatch):
    for number in range(2):
        write_recording(
            recordings / f"nameless{number}.mcap",
            "[sensor]\nrate_hz = 2000\n[motion]\nspeed_kmh = 80\n",
            wheels=("load_n = 4000\n",),
            duration_s=1.6,
            seed=9 + number,
            start_ns=START_NS + number * 3600 * 10**9,
        )
    campaign(recordings)
    named = read_histories(tmp_path / "dataset")
    assert all(tire.is_identified for tire in named.tires)  # by their sensor
    assert named.notes == ()

    def without_sensor(*arguments):
        return [{**row, "sensor_id": ""} for row in read_rows(*arguments) or ()]

    monkeypatch.setattr("gateway.fleet.history_reading.read_rows", without_sensor)
    histories = read_histories(tmp_path / "dataset")
    assert {tire.vehicle: tire.is_identified for tire in histories.tires} == {
        "a/b=c ü": True, "van 7": True, "unknown": False
    }  # fmt: skip
    assert [(str(note.code), note["recordings"]) for note in histories.notes] == [("trend_tires_unidentified", 2)]


def test_unreadable_file_is_left_out(campaign, recordings, tmp_path):
    campaign(recordings)
    first, *_ = (tmp_path / "dataset" / "recordings").rglob("*.parquet")
    first.write_bytes(b"PAR1 nothing")
    histories = read_histories(tmp_path / "dataset")
    assert histories.recordings == 2
    assert str(histories.notes[0].code) == "trend_file_left_out"


def test_a_compacted_recording_counts_once(campaign, recordings, tmp_path):
    compact_recording(recordings / "drive0.mcap", recordings / "small.mcap")
    campaign(recordings)
    histories = read_histories(tmp_path / "dataset")
    assert histories.recordings == 3
    assert sum(len(tire.recordings) for tire in histories.tires) == 3
    (note,) = histories.notes
    assert (str(note.code), note["count"]) == ("trend_repeated", 1)


def test_foreign_and_copied_files_are_named_and_left_out(campaign, recordings, tmp_path):
    campaign(recordings)
    first, *_ = (tmp_path / "dataset" / "recordings").rglob("*.parquet")
    shutil.copy(first, first.with_name(f"{first.stem} (1).parquet"))
    shutil.copytree(first.parent, first.parent.with_name("day=2020-01-01"))
    pq.write_table(pa.table({"x": [1]}), first.with_name("mine.parquet"))
    pq.write_table(pa.table({"x": [1]}), first.with_name("a-b-c.parquet"))
    histories = read_histories(tmp_path / "dataset")
    assert histories.recordings == 3
    assert sum(len(tire.recordings) for tire in histories.tires) == 3
    said = Counter(str(note.code) for note in histories.notes)
    assert said == {"trend_file_left_out": 5}


def test_status_alarms_and_statements_reach_the_history(campaign, recordings, tmp_path):
    path = recordings / "drive0.mcap"
    path.unlink()
    write_recording(
        path,
        "[sensor]\nrate_hz = 2000\n[motion]\nspeed_kmh = 80\n",
        wheels=("load_n = 4000\n",),
        duration_s=4.0,
        change=lambda toml: toml.replace("radius_mm = 320.0", "radius_mm = 345.0\nradius_std_mm = 0.5"),
    )
    campaign(path)
    (tire,) = read_histories(tmp_path / "dataset").tires
    assert "steady" in tire.doubts_of("Bs")[0]
    assert tire.doubts_of("nothing") == ("",)
    assert tire.alarms[0][0][0] == "steady value"
    assert tire.stated[Statement.RADIUS] == ("0.345",)
    assert '"Bs": ' in tire.stated[Statement.REFERENCE][0]


@pytest.mark.parametrize("is_loose", [True, False], ids=["loose", "not stated"])
def test_a_radius_in_use_that_differs_is_no_statement(campaign, recordings, tmp_path, is_loose):
    for number, path in enumerate(sorted(recordings.iterdir())):
        path.unlink()
        write_recording(
            path,
            f"[sensor]\nrate_hz = 2000\n[motion]\nspeed_kmh = {70 + 5 * number}\n",
            wheels=("load_n = 4000\n",),
            duration_s=2.0,
            seed=number + 1,
            start_ns=START_NS + number * 86_400 * 10**9,
            configured=is_loose,
            change=lambda toml: toml.replace("radius_mm = 320.0", "radius_mm = 325.0\nradius_std_mm = 30.0"),
        )
    campaign(recordings)
    (tire,) = read_histories(tmp_path / "dataset").tires
    used = [row["radius_m"] for path in (tmp_path / "dataset" / "recordings").rglob("*.parquet")
            for row in read_rows(path, ["radius_m"]) or ()]  # fmt: skip
    assert len(set(used)) == 3  # measured in each recording
    assert tire.stated[Statement.RADIUS] == (("0.325",) * 3 if is_loose else ("",) * 3)
    assert not [stated_change for stated_change in stated_changes(tire) if stated_change.statement is Statement.RADIUS]


@pytest.mark.parametrize("start_ns", [0, 946_684_800 * 10**9, START_NS + 3 * 86_400 * 10**9])
def test_a_recording_with_a_wrong_clock_is_left_out(campaign, recordings, tmp_path, start_ns):
    write_recording(
        recordings / "lost_time.mcap",
        "[sensor]\nrate_hz = 2000\n[motion]\nspeed_kmh = 80\n",
        wheels=("load_n = 4000\n",),
        duration_s=1.6,
        start_ns=start_ns,
        seed=9,
    )
    campaign(recordings)
    histories = read_histories(tmp_path / "dataset", clock=ManualClock(START_NS + 86_400 * 10**9))
    assert [str(note.code) for note in histories.notes] == ["trend_clock_wrong"]
    assert str(histories.notes[0]["path"]).endswith("lost_time.mcap")
    assert sum(len(tire.recordings) for tire in histories.tires) == 3


def test_only_wrong_clocks_are_an_error(campaign, recordings, tmp_path):
    campaign(recordings)
    with pytest.raises(OutputError, match="the clock was wrong in all recordings.* 3 began before"):
        read_histories(tmp_path / "dataset", clock=ManualClock(START_NS - 10 * 86_400 * 10**9))


def test_recordings_without_samples_are_not_blamed_on_the_clock(campaign, recordings, tmp_path, monkeypatch):
    campaign(recordings)
    monkeypatch.setattr("gateway.fleet.history_reading.read_rows", lambda *_: [])
    with pytest.raises(OutputError, match="a wheel sent samples: 3 are without a row") as caught:
        read_histories(tmp_path / "dataset")
    assert "clock" not in f"{caught.value} {caught.value.remedy}"


def test_odometer_times_may_have_an_offset(tmp_path):
    path = tmp_path / "odometer.csv"
    path.write_text("vehicle,utc,km\nvan,2026-01-01T02:00:00+02:00,1\nvan,2026-01-01 12:00,2\nvan,2026-01-02,3\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        times, _ = read_odometer(path)["van"]
    begin = int(np.datetime64("2026-01-01", "ns").astype(np.int64))
    assert times.tolist() == [begin, begin + 12 * 3600 * 10**9, begin + 86_400 * 10**9]


def test_a_long_vehicle_name_finds_its_odometer(campaign, recordings, tmp_path):
    name = "x" * 120
    path = recordings / "long.mcap"
    tables = "[sensor]\nrate_hz = 2000\n[motion]\nspeed_kmh = 80\n"
    write_recording(path, tables, duration_s=1.6, change=lambda toml: toml.replace('name = ""', f'name = "{name}"'))
    campaign(path)
    (tmp_path / "odometer.csv").write_text(ODOMETER.replace("van 7", name))
    (tire,) = read_histories(tmp_path / "dataset", read_odometer(tmp_path / "odometer.csv")).tires
    assert tire.has_odometer


def test_missing_dataset_is_an_error(tmp_path):
    with pytest.raises(OutputError, match="is not a dataset: it has no file"):
        read_histories(tmp_path)
    recording = tmp_path / "drive.mcap"
    recording.touch()
    with pytest.raises(OutputError, match=r"drive.mcap' is not a dataset: it is no folder"):
        read_histories(recording)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("vehicle,km\nvan,1\n", "no column utc"),
        ("vehicle,utc,km\nvan,yesterday,1\n", "line 2"),
        ("vehicle,utc,km\nvan,20260101,1\n", "line 2: utc is '20260101'"),
        ("vehicle,utc,km\nvan,2026-01-01,1\nvan,46023,2\n", "line 3: utc is '46023'"),
        ("vehicle,utc,km\nvan,,1\n", "line 2: utc is ''"),
        ("vehicle,utc,km\nvan,2026-02-30,1\n", "line 2"),
        ("vehicle,utc,km\nvan,9999-01-01,1\n", "line 2"),
        ("vehicle,utc,km\nvan,2026-01-01,many\n", "line 2"),
        ("vehicle,utc,km\nvan,2026-01-01,nan\n", "not a number"),
        ("vehicle,utc,km\nvan,2026-01-01,9\nvan,2026-01-02,8\n", "decreases"),
    ],
)
def test_wrong_odometer_file_is_an_error(tmp_path, content, message):
    path = tmp_path / "odometer.csv"
    path.write_text(content)
    with pytest.raises(RecordingError, match=message):
        read_odometer(path)
