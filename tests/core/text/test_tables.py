import csv
import gc
import json
import sys
import tracemalloc
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gateway.core.errors import OutputError
from gateway.core.estimates.estimator import Estimate, Status, TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.result_block import blocks_of
from gateway.core.estimates.results import RevolutionResult
from gateway.core.reasons import CoreCode, Reason
from gateway.core.text.result_columns import iso_utc
from gateway.core.text.result_table import COLUMNS_FIXED_AFTER_ROWS, ResultTable, TableFormat, open_table
from gateway.core.text.text import escaped
from gateway.core.text.wording import joined, text
from tests.testkit.revolution_data import plain_revolution

FEW = Reason(CoreCode.NOT_SETTLED, revolutions=3.0, needed=8.0)
UNKNOWN = Reason(EstimateCode.UNKNOWN_ESTIMATOR, estimator='says; "none"')
FAULTS = (Reason(EstimateCode.SAMPLES_LOST), Reason(EstimateCode.RADIAL_SATURATED))
START_NS = 1_700_000_000_123_456_789
BS = Estimate("Bs", 3.08e-3, 1.2e-5, Status.PROVISIONAL, (FEW,))
SPEED = Estimate("speed_mps", 18.0554321987, 0.002, Status.VALID)
TS = Estimate.invalid("Ts", UNKNOWN)


def result(
    index: int = 0, position: str = "FL", estimates: tuple[Estimate, ...] = (SPEED, BS, TS), **conditions: Any
) -> RevolutionResult:
    revolution = plain_revolution(
        index=index,
        start_s=1.5 + index,
        omega_dot_radps2=2.0,
        trailing_edge_rad=0.21,
        trailing_edge_std_rad=0.002,
        missing_fraction=0.25,
        saturated=index % 2 == 1,
        faults=FAULTS if index == 0 else (),
    )
    return RevolutionResult(position, START_NS + index, revolution, TireConditions(0.32, **conditions), estimates)


def put(table: ResultTable, results: RevolutionResult | Sequence[RevolutionResult], recording: str = "") -> None:
    for block in blocks_of([results] if isinstance(results, RevolutionResult) else results):
        table.write(block, recording)


def read_back(path: Path, table_format: TableFormat) -> list[dict[str, Any]]:
    """Read a file into rows of Python values, unknown as None."""
    if table_format is TableFormat.JSON:
        return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    if table_format is TableFormat.PARQUET:
        parquet = pytest.importorskip("pyarrow.parquet")
        rows: list[dict[str, Any]] = parquet.read_table(path).drop_columns(["host_utc"]).to_pylist()
        return rows
    with path.open(newline="", encoding="utf-8") as file:
        return [{key: _typed(key, text) for key, text in row.items()} for row in csv.DictReader(file)]


def _typed(key: str, text: str) -> object:
    if key in ("saturated", "ac_coupled"):
        return bool(int(text))
    if key in ("recording", "position", "faults", "host_utc", "other_estimates") or key.endswith(
        ("_status", "_reason")
    ):
        return text
    if key.endswith("_source"):
        return text or None
    return None if text == "" else int(text) if key in ("revolution", "host_ns") else float(text)


FORMATS = pytest.mark.parametrize("table_format", [TableFormat.CSV, TableFormat.JSON, TableFormat.PARQUET])


@FORMATS
def test_every_value_comes_back_exactly(tmp_path: Path, table_format: TableFormat) -> None:
    path = tmp_path / "out"
    with open_table(path, table_format) as table:
        put(table, result(0, load_n=5000.0, load_std_n=50.0, pressure_pa=2.1e5))
        put(table, result(1, "FR"), "second.mcap")
    first, second = read_back(path, table_format)
    assert (first["recording"], second["recording"]) == ("", "second.mcap")
    assert (first["position"], first["revolution"], first["host_ns"]) == ("FL", 0, START_NS)
    assert (first["device_start_s"], first["device_end_s"]) == (1.5, 1.6)
    assert (first["speed_mps"], first["speed_mps_std"], first["speed_mps_status"]) == (18.0554321987, 0.002, "valid")
    assert (first["Bs"], first["Bs_status"], first["Bs_reason"]) == (3.08e-3, "provisional", text(FEW))
    assert (first["Ts"], first["Ts_std"]) == (None, None)
    assert (first["Ts_status"], first["Ts_reason"]) == ("invalid", text(UNKNOWN))
    assert (first["load_n"], first["load_std_n"], first["pressure_pa"], first["temperature_degc"]) == (
        5000.0,
        50.0,
        2.1e5,
        None,
    )
    assert first["acceleration_mps2"] == pytest.approx(0.64)
    assert (first["missing_fraction"], first["saturated"], first["faults"]) == (0.25, False, joined(FAULTS))
    assert (second["position"], second["saturated"], second["load_n"], second["load_std_n"]) == ("FR", True, None, None)
    assert second["faults"] == ""


def test_json_lines_list_reasons_as_values(tmp_path: Path) -> None:
    path = tmp_path / "out"
    with open_table(path, TableFormat.JSON) as table:
        put(table, result(0))
    (row,) = read_back(path, TableFormat.JSON)
    values = {"revolutions": 3.0, "needed": 8.0}
    assert row["Bs_reasons"] == [{"code": "not_settled", "values": values, "text": text(FEW)}]
    assert row["speed_mps_reasons"] == []
    assert [fault["code"] for fault in row["fault_reasons"]] == ["samples_lost", "radial_saturated"]


def test_parquet_fields_have_unit_and_description(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    with open_table(tmp_path / "out", TableFormat.PARQUET) as table:
        put(table, result())
    metadata = {field.name: field.metadata for field in parquet.read_schema(tmp_path / "out")}
    assert metadata["speed_mps"][b"unit"] == metadata["speed_mps_std"][b"unit"] == b"m/s"
    assert metadata["speed_mps_status"][b"unit"] == b""
    assert b"rolling speed" in metadata["speed_mps"][b"description"]
    assert metadata["pressure_pa"] == {b"unit": b"Pa", b"description": b"gauge pressure, measured or else stated"}


def test_metadata_beside_a_table_is_that_of_parquet(tmp_path: Path) -> None:
    for kind in (TableFormat.METADATA, TableFormat.CSV):
        with open_table(tmp_path / kind, kind, coverage_factor=1.96) as table:
            put(table, result())
    about = json.loads((tmp_path / "metadata").read_text(encoding="utf-8"))
    columns = {column["name"]: column for column in about["tableSchema"]["columns"]}
    (row,) = read_back(tmp_path / "csv", TableFormat.CSV)
    assert list(columns) == list(row)
    assert columns["speed_mps"]["schema:unitText"] == "m/s"
    assert columns["revolution"]["datatype"] == "integer"
    (note,) = about["notes"]
    assert note["treadlink"]["axes"].startswith("ISO 8855")
    parquet = pytest.importorskip("pyarrow.parquet")
    with open_table(tmp_path / "out", TableFormat.PARQUET) as table:
        put(table, result())
    schema = parquet.read_schema(tmp_path / "out")
    for field in schema:
        if field.name != "host_utc":
            assert columns[field.name]["dc:description"].encode() == field.metadata[b"description"]
    assert {f"treadlink.{key}".encode(): text.encode() for key, text in note["treadlink"].items()} == {
        key: value for key, value in schema.metadata.items() if key.startswith(b"treadlink.")
    }


def test_parquet_has_text_in_utf8_and_null_where_nothing_is_known(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    empty = replace(result(1, "hinten links, 後輪"), host_ns=0)
    with open_table(tmp_path / "out", TableFormat.PARQUET) as table:
        put(table, result(0))
        put(table, empty)
    rows = parquet.read_table(tmp_path / "out")
    rows.validate(full=True)
    assert rows.column("position").to_pylist() == ["FL", "hinten links, 後輪"]
    assert rows.column("host_ns").to_pylist() == [START_NS, None]
    assert rows.column("host_utc").null_count == 1
    assert rows.column("saturated").to_pylist() == [False, True]
    assert rows.column("other_estimates").null_count == 2
    assert rows.column("Ts").null_count == 2


def test_host_time_is_iso_and_parquet_timestamp(tmp_path: Path) -> None:
    assert iso_utc(START_NS) == "2023-11-14T22:13:20.123456Z"
    parquet = pytest.importorskip("pyarrow.parquet")
    with open_table(tmp_path / "out", TableFormat.PARQUET) as table:
        put(table, result(0))
    column = parquet.read_table(tmp_path / "out").column("host_utc")
    assert str(column.type) == "timestamp[ns, tz=UTC]"
    assert column.cast("int64").to_pylist() == [START_NS]


@FORMATS
def test_late_estimates_are_kept(tmp_path: Path, table_format: TableFormat) -> None:
    path = tmp_path / "out"
    late = Estimate("wear_mm", 1.25, 0.1, Status.VALID)
    count = COLUMNS_FIXED_AFTER_ROWS + 3
    with open_table(path, table_format) as table:
        for index in range(count):
            put(table, result(index, estimates=(SPEED,) if index < count - 1 else (late, SPEED)))
    rows = read_back(path, table_format)
    assert [row["revolution"] for row in rows] == list(range(count))
    assert rows[-1]["speed_mps"] == SPEED.value
    last = rows[-1] if table_format is TableFormat.JSON else json.loads(rows[-1]["other_estimates"])
    assert (last["wear_mm"], last["wear_mm_std"], last["wear_mm_status"]) == (1.25, 0.1, "valid")


@pytest.mark.parametrize("table_format", [TableFormat.CSV, TableFormat.PARQUET])
def test_wheels_with_different_estimates_share_columns(tmp_path: Path, table_format: TableFormat) -> None:
    path = tmp_path / "out"
    ratio = Estimate("Cw_over_Bs", 63.0, 1.0, Status.VALID)
    with open_table(path, table_format) as table:
        put(table, result(0, estimates=(SPEED, BS)))
        put(table, result(1, "FR", estimates=(SPEED, ratio)))
    first, second = read_back(path, table_format)
    assert (first["Bs"], first["Cw_over_Bs"]) == (BS.value, None)
    assert (second["Bs"], second["Cw_over_Bs"]) == (None, 63.0)
    assert first.keys() == second.keys()


@FORMATS
def test_estimated_load_does_not_replace_the_stated_one(tmp_path: Path, table_format: TableFormat) -> None:
    path = tmp_path / "out"
    with open_table(path, table_format) as table:
        put(table, result(0, estimates=(Estimate("load_n", 4900.0, 20.0, Status.VALID),), load_n=5000.0))
    (row,) = read_back(path, table_format)
    assert (row["load_n"], row["estimated_load_n"], row["estimated_load_n_std"]) == (5000.0, 4900.0, 20.0)


@FORMATS
def test_rows_say_what_of_load_and_pressure_is_stated(tmp_path: Path, table_format: TableFormat) -> None:
    path = tmp_path / "out"
    with open_table(path, table_format) as table:
        put(table, result(0, load_n=5000.0, pressure_pa=2.1e5))
        put(table, result(1, pressure_pa=2.2e5, pressure_measured=True))
        put(table, result(2))
    sources = [(row["load_source"], row["pressure_source"]) for row in read_back(path, table_format)]
    assert sources == [("stated", "stated"), (None, "measured"), (None, None)]


@FORMATS
def test_file_without_rows_is_valid(tmp_path: Path, table_format: TableFormat) -> None:
    path = tmp_path / "out"
    table = open_table(path, table_format)
    table.close()
    table.close()
    assert read_back(path, table_format) == []


@FORMATS
def test_nothing_is_overwritten_without_force(tmp_path: Path, table_format: TableFormat) -> None:
    path = tmp_path / "out"
    path.write_text("precious")
    with pytest.raises(OutputError, match="already exists") as caught:
        open_table(path, table_format)
    assert "--force" in caught.value.remedy
    assert path.read_text() == "precious"
    with open_table(path, table_format, force=True) as table:
        put(table, result(1))
    assert len(read_back(path, table_format)) == 1


def test_missing_folder_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written"):
        open_table(tmp_path / "none" / "out.csv", TableFormat.CSV)


def test_missing_pyarrow_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "out"
    path.write_text("precious")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(OutputError, match="pyarrow") as caught:
        open_table(path, TableFormat.PARQUET, force=True)
    assert "treadlink[parquet]" in caught.value.remedy
    assert path.read_text() == "precious"


def test_full_disk_is_reported() -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("/dev/full, a disk that is always full, exists on Linux only")
    table = open_table(full, TableFormat.JSON, force=True)
    with pytest.raises(OutputError, match="No space left"):  # noqa: PT012 - buffered: any of the two may raise
        for index in range(100):
            put(table, result(index))
        table.close()


@pytest.mark.parametrize("most_bytes", [0, 3, 2000, 8000])
@FORMATS
def test_disk_that_fills_up_leaves_no_part(tmp_path: Path, table_format: TableFormat, most_bytes: int) -> None:
    resource = pytest.importorskip("resource", reason="a limit of files stands for a disk that is full")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    rows = [result(index) for index in range(300)]
    resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, before[1]))
    try:
        with (  # noqa: PT012 - a row or the end may raise
            pytest.raises(OutputError, match="cannot be written"),
            open_table(tmp_path / "out", table_format) as table,
        ):
            for row in rows:
                put(table, row)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("table_format", [TableFormat.CSV, TableFormat.JSON])
def test_memory_does_not_grow_with_rows(tmp_path: Path, table_format: TableFormat) -> None:
    row = result(1)
    with open_table(tmp_path / "out", table_format) as table:
        for _ in range(2 * COLUMNS_FIXED_AFTER_ROWS):
            put(table, row)
        gc.collect()
        tracemalloc.start(12)
        for _ in range(300):
            put(table, row)
        snapshot = tracemalloc.take_snapshot()
        tracemalloc.stop()
    # Threads of other tests may still run in this process.
    selected = snapshot.filter_traces([tracemalloc.Filter(True, open_table.__code__.co_filename, all_frames=True)])
    assert sum(trace.size for trace in selected.traces) < 50_000


@pytest.mark.parametrize("start", ["=", "+", "-", "@", "\t", "\r"])
def test_text_that_a_spreadsheet_would_run_is_quoted(tmp_path: Path, start: str) -> None:
    name = f"{start}cmd|' /C calc'!A0"
    path = tmp_path / "out.csv"
    with open_table(path, TableFormat.CSV) as writer:
        put(writer, result(0, name, (Estimate(name, -1.5, 0.1, Status.VALID),), load_n=-4.0), f"{start}a.mcap")
    (row,) = read_back(path, TableFormat.CSV)
    assert (row["position"], row["recording"]) == (f"'{escaped(name)}", f"'{escaped(start)}a.mcap")
    assert row[f"'{escaped(name)}"] == -1.5
    assert row["load_n"] == -4.0


def test_text_of_other_formats_is_unchanged(tmp_path: Path) -> None:
    path = tmp_path / "out.jsonl"
    with open_table(path, TableFormat.JSON) as writer:
        put(writer, result(0, "=A1"))
    assert read_back(path, TableFormat.JSON)[0]["position"] == "=A1"
