"""Tables of a dataset in few files: the same rows, whole or not there."""

import errno
import json
import re
import subprocess
import sys
from pathlib import Path

import duckdb
import pyarrow.parquet as pq
import pytest

from gateway.core.errors import OutputError
from gateway.fleet import packed_tables
from gateway.fleet.packed_tables import pack_tables
from gateway.fleet.recording_estimation import RECORDINGS, REVOLUTIONS
from tests.testkit.commands import invoked, run
from tools.bench_campaign import estimate, main, pack


@pytest.fixture
def dataset(campaign, recordings, tmp_path: Path) -> Path:
    campaign(recordings)
    return tmp_path / "dataset"


def rows_of(files: str) -> list[str]:
    columns = [name for name, *_ in duckdb.sql(f"DESCRIBE SELECT * FROM '{files}'").fetchall()]
    # Times with a zone need another package as values of Python.
    named = ", ".join(f'CAST("{name}" AS VARCHAR)' for name in sorted(columns))
    return sorted(map(str, duckdb.sql(f"SELECT {named} FROM '{files}'").fetchall()))


@pytest.mark.parametrize(("file_bytes", "group_rows"), [(100_000_000, 1), (1, 1), (100_000_000, 65_536)])
def test_packed_tables_have_the_rows_of_the_dataset(
    dataset, tmp_path, monkeypatch, file_bytes: int, group_rows: int
) -> None:
    monkeypatch.setattr(packed_tables, "_FILE_BYTES", file_bytes)
    monkeypatch.setattr(packed_tables, "_GROUP_ROWS", group_rows)
    monkeypatch.setattr(packed_tables, "_SMALL_TABLES", 2)
    before = {path: path.read_bytes() for path in dataset.rglob("*.parquet")}
    shares: list[tuple[int, int]] = []
    target = tmp_path / "tables"
    tables = {table.name: table for table in pack_tables(dataset, target, lambda *share: shares.append(share))}
    for name in (RECORDINGS, REVOLUTIONS):
        packed = rows_of(f"{target}/{name}-*.parquet")
        assert packed == rows_of(f"{dataset}/{name}/*/*/*.parquet")
        assert tables[name].rows == len(packed)
        assert tables[name].parts == 3
        assert tables[name].files == len(list(target.glob(f"{name}-*"))) == (1 if file_bytes > 1 else 3)
        assert tables[name].size_bytes == sum(path.stat().st_size for path in target.glob(f"{name}-*"))
    metadata = pq.read_metadata(target / f"{REVOLUTIONS}-0001.parquet").metadata
    assert json.loads(metadata[b"treadlink.units"])["speed_mps"] == "m/s"
    assert shares[-1] == (6, 6)
    assert {path: path.read_bytes() for path in dataset.rglob("*.parquet")} == before


def test_damaged_file_is_named_and_the_others_are_packed(dataset, tmp_path) -> None:
    damaged = sorted((dataset / REVOLUTIONS).glob("*/*/*.parquet"))[1]
    damaged.write_bytes(damaged.read_bytes()[:1000])
    result = invoked("compact", dataset, "--out", tmp_path / "tables")
    assert result.exit_code == 1
    assert isinstance(result.exception, OutputError)
    assert damaged.name in str(result.exception)
    assert "rows of 2 files in 1 file" in result.output
    assert len(rows_of(f"{tmp_path}/tables/{RECORDINGS}-*.parquet")) == 3


def test_refusals_leave_nothing(dataset, tmp_path, monkeypatch) -> None:
    with pytest.raises(OutputError, match="already exists"):
        pack_tables(dataset, dataset, lambda *_: None)
    with pytest.raises(OutputError, match="is not a dataset"):
        pack_tables(tmp_path / "recordings", tmp_path / "tables", lambda *_: None)

    class Full:
        def __init__(self, *_arguments: object, **_options: object) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(pq, "ParquetWriter", Full)
    with pytest.raises(OutputError, match="No space left"):
        pack_tables(dataset, tmp_path / "tables", lambda *_: None)
    assert not (tmp_path / "tables").exists()
    assert not list(tmp_path.glob(".*"))


def test_dataset_is_packed_beside_itself_and_never_in_place(dataset, monkeypatch) -> None:
    monkeypatch.chdir(dataset)
    run("compact", ".")
    assert (dataset.parent / "dataset.tables" / "recordings-0001.parquet").is_file()
    result = invoked("compact", dataset, "--in-place")
    assert result.exit_code == 2


def test_benchmark_of_packing_counts_files_and_asks_both(dataset, tmp_path, capfd) -> None:
    pack(dataset, tmp_path / "tables")
    before, after = (line for line in capfd.readouterr().out.splitlines() if "Parquet files" in line)
    assert before.startswith("  dataset: 6 Parquet files")
    assert after.startswith("  compact: 2 Parquet files")
    assert "mean speed of 2 vehicles" in before


def test_benchmark_states_the_memory_of_the_campaign_alone(tmp_path, capfd) -> None:
    subprocess.run([sys.executable, "-c", "b'x' * (200 << 20)"], check=True)
    estimate(tmp_path, 0, None)
    printed = capfd.readouterr().out
    assert "exit status 2" in printed  # no campaign without a worker: it ends at once
    (peak_mb,) = re.findall(r"worker (\d+) MB", printed)
    assert 0 < int(peak_mb) < 200


@pytest.mark.slow
def test_benchmark_of_packing_makes_its_recordings(tmp_path, monkeypatch, capfd) -> None:
    monkeypatch.setattr("sys.argv", ["bench_campaign", str(tmp_path), "--packing", "8"])
    main()
    printed = capfd.readouterr().out
    assert "8 recordings of 3 s" in printed
    assert "exit status 0" in printed
    assert "dataset: 16 Parquet files" in printed
    assert "compact: 2 Parquet files" in printed
