"""The dataset on disk: other programs read it, two processes share it, and a crash leaves it whole."""

import json
import re
import threading
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from gateway.core.errors import OutputError
from gateway.core.quantity import Trend
from gateway.core.recording.file_content import FileContent, read_content
from gateway.core.table_columns import Column, recording_columns, revolution_columns
from gateway.fleet.content_keys import path_key
from gateway.fleet.dataset import Dataset, Description, opened, partition
from gateway.fleet.parquet_parts import PartFile
from gateway.fleet.recording_estimation import RECORDINGS, REVOLUTIONS
from gateway.fleet.trends.trend_result import Quantity, rate_of
from gateway.fleet.trends.watched_series import followed_by
from tools.docs_site.filled_tables import filled

ROOT = Path(__file__).parents[2]
DESCRIPTION = Description(("kinematic",), ("speed_mps",), "second")
START_NS = 1_769_860_800 * 10**9  # 31 January 2026, 12:00 UTC


def open_dataset(root: Path) -> Dataset:
    with opened(root, DESCRIPTION, lambda _: False) as dataset:
        return dataset


def add(dataset: Dataset, path: Path, *, settings: str = "s1", vehicle: str = "car") -> FileContent:
    """Add a file's rows."""
    content = read_content(path)
    assert content is not None
    parts = {}
    for table, columns in ((RECORDINGS, recording_columns(())), (REVOLUTIONS, revolution_columns(()))):
        parts[table] = dataset.incoming / f"part.{table}.parquet"
        dataset.incoming.mkdir(exist_ok=True)
        with PartFile(parts[table], columns, table) as part:
            part.row({"recording_id": content.recording_id, "recording": path.name, "position": "FL"})
    dataset.commit(content, settings, parts, vehicle, START_NS)
    return content


def written(root: Path, table: str) -> list[str]:
    return sorted(path.name.split("-")[1] for path in (root / table).rglob("*.parquet"))


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / f"r{number}.mcap" for number in range(3)]
    for path in paths:
        path.write_text(path.name)
    return paths


def test_three_programs_read_it_in_one_line(campaign, recordings, tmp_path, monkeypatch):
    import duckdb
    import pandas
    import polars

    campaign(recordings)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fleet.dataset").symlink_to("dataset")
    page = (ROOT / "docs" / "how-to" / "evaluate-a-fleet.md").read_text("utf-8")
    lines = re.findall(r"^(?:duckdb|polars|pandas)\.\w+\(.*\)$", page, re.MULTILINE)
    modules = {"duckdb": duckdb, "polars": polars, "pandas": pandas}
    by_duckdb, by_polars, by_pandas = (eval(line, modules) for line in lines)
    for table in (by_duckdb.df(), by_polars.to_pandas(), by_pandas):
        assert len(table) == 3
        assert set(table["vehicle"]) == {"van 7", "a/b=c ü"}
        assert {str(day)[:10] for day in table["day"]} == {"2023-11-14", "2023-11-15", "2023-11-16"}
        assert table["Bs"].notna().all()
    assert len(pandas.read_parquet("dataset/revolutions")) == polars.read_parquet("dataset/revolutions/").height > 3
    (query,) = re.findall(r"```sql\n(.*?)```", page, re.DOTALL)
    query = query.replace("2026-01", "2023-11").replace("r.estimated_load_n", "r.load_n")
    result = duckdb.sql(query).df()
    assert len(result) > 0
    assert set(result["load_n"]) == {4000.0}


def test_metadata_state_units_and_time_zone(campaign, recordings, tmp_path):
    campaign(recordings / "drive0.mcap")
    (path,) = (tmp_path / "dataset" / "recordings").rglob("*.parquet")
    metadata = pq.read_metadata(path).metadata
    units = json.loads(metadata[b"treadlink.units"])
    assert metadata[b"treadlink.time_zone"] == b"UTC"
    assert units["pressure_pa"] == units["pressure_std_pa"] == "Pa"
    assert (units["wear_mm"], units["wear_mm_scatter"], units["duration_s"]) == ("mm", "mm", "s")
    assert "Bs" not in units
    assert "wear_mm_count" not in units


def test_reference_page_lists_all_columns():
    page = filled((ROOT / "docs" / "reference" / "dataset.md").read_text("utf-8"))
    sections = dict(zip(*[iter(re.split(r"^## (\w+)$", page, flags=re.MULTILINE)[1:])] * 2, strict=True))
    assert "<!-- table" not in page
    assert "| `duration_s` | s | time from the first to the last data |" in sections["recordings"]
    assert "| `NAME_count` | revolutions in the mean |" in sections["recordings"]
    assert "| `host_ns` | ns |" in sections["revolutions"]
    assert "| `attempts` |" in sections["failures"]
    assert "| `rms_mps2` | m/s^2 |" in sections["diagnoses"]
    (names,) = re.findall(r"^`quantity` is (.+?)\n\n", sections["Trends"], re.MULTILINE | re.DOTALL)
    assert set(re.findall(r"`(\w+)`", names)) == {
        *Quantity,
        *(rate_of(item.watch) for item in followed_by(Trend.SENSOR) if item.name in recording_columns(())),
    }


@pytest.mark.parametrize(
    ("name", "unit"),
    [("speed_mean_mps", "m/s"), ("radius_m", "m"), ("recordings", ""), ("temperature_min_degc", "degC"), ("gain", "")],
)
def test_units_follow_names(name, unit):
    assert Column(name, "").unit == unit


@pytest.mark.parametrize(
    ("name", "folder"),
    [
        ("", "vehicle=unknown"),
        ("  ", "vehicle=unknown"),
        ("../../etc", "vehicle=..%2F..%2Fetc"),
        ("a=b", "vehicle=a%3Db"),
        ("__HIVE_DEFAULT_PARTITION__", "vehicle=%5F_HIVE_DEFAULT_PARTITION__"),
    ],
)
def test_vehicle_names_are_safe_folders(name, folder):
    assert partition(name, START_NS) == Path(folder) / "day=2026-01-31"


def test_long_vehicle_names_stay_distinct():
    first, second = (str(partition("x" * 300 + end, START_NS)) for end in "ab")
    assert first != second
    assert len(first) < 200


def test_changed_settings_replace_rows(tmp_path, files):
    dataset = open_dataset(tmp_path / "ds")
    add(dataset, files[0])
    content = add(dataset, files[0], settings="s2")
    assert written(tmp_path / "ds", RECORDINGS) == written(tmp_path / "ds", REVOLUTIONS) == [content.recording_id]
    assert dataset.done(content.recording_id, "s2")
    assert not dataset.done(content.recording_id, "s1")


def test_unfinished_parts_are_removed_at_the_next_start(tmp_path, files):
    root = tmp_path / "ds"
    dataset = open_dataset(root)
    content = add(dataset, files[0])
    add(dataset, files[1])
    # Killed between the two tables of a recording, while a part was written, and before an old file was removed.
    (summary,) = root.glob(f"recordings/*/*/*{content.recording_id}*")
    summary.unlink()
    (root / ".incoming").mkdir(exist_ok=True)
    (root / ".incoming" / "half.parquet").write_bytes(b"PAR1")
    again = open_dataset(root)
    assert not again.done(content.recording_id, "s1")
    assert written(root, REVOLUTIONS) == written(root, RECORDINGS)
    assert len(written(root, RECORDINGS)) == 1
    assert not (root / ".incoming").exists()


def test_second_campaign_waits_for_the_first(tmp_path, files):
    root, order = tmp_path / "ds", []
    holds, go_on = threading.Event(), threading.Event()

    def first() -> None:
        with opened(root, DESCRIPTION, lambda _: False) as dataset:
            holds.set()
            assert go_on.wait(10.0)
            add(dataset, files[0])
            order.append("first")

    def waiting(holder: str) -> bool:
        assert "process" in holder
        go_on.set()
        return True

    thread = threading.Thread(target=first)
    thread.start()
    assert holds.wait(10.0)
    with opened(root, DESCRIPTION, waiting) as dataset:
        order.append("second")
        add(dataset, files[1])
        assert dataset.done(read_content(files[0]).recording_id, "s1")  # type: ignore[union-attr]
    thread.join()
    assert order == ["first", "second"]
    assert len(written(root, RECORDINGS)) == 2


def test_waiting_can_be_given_up(tmp_path):
    root = tmp_path / "ds"
    with opened(root, DESCRIPTION, lambda _: False), pytest.raises(TimeoutError):
        open_dataset(root)


def test_a_dataset_whose_making_was_killed_is_taken_up(tmp_path):
    root = tmp_path / "ds"
    (root / ".incoming").mkdir(parents=True)
    (root / ".lock").touch()
    leftover = root / f".treadlink-dataset.json.{10**8 * 5}.part"
    leftover.write_text("{")
    with opened(root, DESCRIPTION, lambda _: False):
        pass
    assert (root / "treadlink-dataset.json").is_file()
    assert not leftover.exists()


def test_other_folders_are_not_taken(tmp_path, files):
    with pytest.raises(OutputError, match="is not a dataset, but contains files"):
        open_dataset(tmp_path)
    assert not (tmp_path / ".lock").exists()


def test_damaged_description_is_an_error(tmp_path):
    root = tmp_path / "ds"
    open_dataset(root)
    (root / "treadlink-dataset.json").write_text("{")
    with pytest.raises(OutputError, match="cannot be read"):
        open_dataset(root)


def test_content_identifies_files(files):
    content = read_content(files[0])
    assert content is not None
    assert content.is_unchanged()
    files[0].write_text("other")
    assert not content.is_unchanged()
    assert path_key(files[0]) != path_key(files[1])
