"""Commands that write, killed at each of their calls: the quick ones; `tools/reliability/kill_sweep.py` has all."""

import shutil
import sys
from pathlib import Path

import pyarrow as pa
import pytest
from pyarrow import parquet

from gateway.core.links.source import Chunk
from gateway.core.recording.writer import RecordingWriter
from tools.reliability.kill_sweep import Case, Forked, Sweep, first_difference, sweep

needs_library = pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("cc") is None, reason="needs Linux and a C compiler"
)

QUICK = (
    "repair",
    "compact",
    "compact --in-place",
    "note",
    "import",
    "keys new",
    "calibrate load",
    "orders",
)


@needs_library
@pytest.mark.slow
def test_no_kill_leaves_half_a_result_or_stops_the_next_run(tmp_path: Path) -> None:
    swept = list(sweep(tmp_path.resolve(), QUICK))
    assert [each.name for each in swept] == list(QUICK)
    for each in swept:
        assert each.faults == []
        assert each.kills >= each.terminated == each.calls > 1


@needs_library
@pytest.mark.slow
@pytest.mark.parametrize("name", ["diagnose", "campaign, grown", "trends"])
def test_no_kill_of_a_long_command_leaves_half_a_result(tmp_path: Path, name: str) -> None:
    (swept,) = sweep(tmp_path.resolve(), (name,), most_s=20.0)
    assert swept.faults == []
    assert min(swept.kills, swept.terminated) > 0


@needs_library
@pytest.mark.slow
def test_a_limit_of_time_kills_at_calls_of_the_whole_command(tmp_path: Path) -> None:
    for name in ("none", "some"):
        (tmp_path / name).mkdir()
    (none,) = sweep(tmp_path.resolve() / "none", ("note",), most_s=0.0)
    (some,) = sweep(tmp_path.resolve() / "some", ("note",), most_s=600.0)
    assert (none.kills, none.faults, some.faults) == (0, [], [])
    assert some.kills >= some.calls > 1


@needs_library
@pytest.mark.slow
def test_commands_run_from_a_copy_which_a_commit_during_the_sweep_does_not_change(tmp_path: Path) -> None:
    forked = Forked(tmp_path)
    try:
        assert not (forked.code / ".git").exists()
        (forked.code / "gateway" / "core" / "cli" / "__init__.py").write_text("def main():\n    print('of the copy')\n")
        (tmp_path / "work").mkdir()
        assert forked.run(["--version"], tmp_path / "work") == 0
    finally:
        forked.close()
    assert forked.output.read_text() == "of the copy\n"


def test_a_difference_names_the_first_cell_or_byte(tmp_path: Path) -> None:
    path, other = tmp_path / "a.parquet", tmp_path / "b.parquet"
    parquet.write_table(pa.table({"effect": ["camber", "yaw"], "rms": [1.0, 2.0]}), path)
    parquet.write_table(pa.table({"effect": ["camber", "yaw"], "rms": [1.0, 2.5]}), other)
    assert first_difference(path, other) == "row 1, rms: at byte 2 of 3 b'2.0' instead of b'2.5', of 3"
    path.write_bytes(other.read_bytes()[:-9])
    whole = other.stat().st_size
    assert first_difference(path, other).startswith(f"at byte {whole - 9} of {whole - 9} ")


class Recorder:
    """Records two files at each run, the first with the later name; at a kill or a run after it, fewer bytes."""

    calls, last = 1, "fsync"

    def __init__(self, killed: int, again: int) -> None:
        self.sizes = [6, 6, killed, again, killed, again]  # two undisturbed, SIGKILL, SIGTERM
        self.output = Path()

    def run(self, _arguments: object, folder: Path, **_how: object) -> int:
        names, size = (f"{10 + len(self.sizes)}.mcap", f"{len(self.sizes)}.mcap"), self.sizes.pop(0)
        (folder / "new").mkdir(exist_ok=True)
        for number, (name, data) in enumerate(zip(names, (b"abc"[:size], b"def"[: max(size - 3, 0)]), strict=True)):
            writer = RecordingWriter(folder / "new" / name, start_ns=0, vehicle_toml="", sources=["sim"])
            writer.write(Chunk("sim", 1 + number, data))
            writer.close()
        self.output = folder.parent / "output"
        self.output.touch()
        return 0


@pytest.mark.parametrize(
    ("killed", "again", "faults"), [(4, 6, []), (4, 5, ["the second run has not recorded all that came"])]
)
def test_a_second_run_records_all_that_came(tmp_path: Path, killed: int, again: int, faults: list[str]) -> None:
    (tmp_path / "inputs").mkdir()
    recorder = Recorder(killed, again)
    case = Case("record", "record", is_recording=True)
    swept = Sweep(case, tmp_path / "inputs", tmp_path / "case", recorder).run()  # type: ignore[arg-type]
    assert swept.faults == [f"after {by} at fsync: {fault}" for by in ("SIGKILL", "SIGTERM") for fault in faults]
