"""Output files appear complete or not at all."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.core.errors import OutputError
from gateway.core.text.output_file import OutputFile, check_outputs, write_whole
from gateway.core.writing_lock import lock_for_writing

# Writes half a table, then dies.
KILLED = """
import os, signal, sys
from pathlib import Path
from gateway.core.writing_lock import lock_for_writing
from gateway.core.text.output_file import OutputFile

output = OutputFile(Path(sys.argv[1]), force=True)
output.file.write(b"half a ta" * 100_000)
output.file.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""


def files_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_file_appears_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    with OutputFile(path) as output:
        output.file.write(b"whole")
        output.file.flush()
        assert not path.exists()
        assert len(files_in(tmp_path)) == 1, "it must be in the same folder, so that it can be renamed"
    assert path.read_bytes() == b"whole"
    assert files_in(tmp_path) == ["out.csv"]


def test_error_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    path.write_bytes(b"old")

    def fail() -> None:
        with OutputFile(path, force=True) as output:
            output.file.write(b"new")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert path.read_bytes() == b"old"
    assert files_in(tmp_path) == ["out.csv"]


@pytest.mark.parametrize("before", [b"old", None])
def test_killed_process_leaves_no_half_file(tmp_path: Path, before: bytes | None) -> None:
    path = tmp_path / "out.csv"
    if before is not None:
        path.write_bytes(before)
    done = subprocess.run([sys.executable, "-c", KILLED, path], check=False)
    assert done.returncode == -signal.SIGKILL
    assert (path.read_bytes() if path.exists() else None) == before


def test_next_run_removes_what_a_killed_process_left(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    subprocess.run([sys.executable, "-c", KILLED, path], check=False)
    others = [".other.csv.1.part", ".out.csv.part", ".out.csv.x.part", ".out.csv.1.2.part"]
    for name in others:
        (tmp_path / name).touch()
    # The processes are gone; that of the first is in another container, and holds its lock.
    for number in (5 * 10**8, 6 * 10**8):
        (tmp_path / f".out.csv.{number}.scratch").mkdir()
        (tmp_path / f".out.csv.{number}.scratch" / "lock").touch()
    others.append(f".out.csv.{5 * 10**8}.scratch")
    with (tmp_path / others[-1] / "lock").open("r+b", buffering=0) as lock:
        lock_for_writing(lock)
        write_whole(path, b"whole")
    assert files_in(tmp_path) == sorted([*others, "out.csv"])


def test_next_run_keeps_the_part_of_a_running_process(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    writes = KILLED.replace("os.kill(os.getpid(), signal.SIGKILL)", "print(flush=True); input(); output.close()")
    with subprocess.Popen([sys.executable, "-c", writes, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        other.stdout.readline()
        write_whole(path, b"ours", force=True)
        other.communicate(b"\n")
    assert path.read_bytes().startswith(b"half a ta")
    assert files_in(tmp_path) == ["out.csv"]


def test_file_made_meanwhile_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    output = OutputFile(path)
    output.file.write(b"mine")
    path.write_bytes(b"theirs")
    with pytest.raises(OutputError, match="another program"):
        output.close()
    assert path.read_bytes() == b"theirs"
    assert files_in(tmp_path) == ["out.csv"]


def test_symbolic_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "link.csv").symlink_to("folder/real.csv")
    write_whole(tmp_path / "link.csv", "text")
    assert (tmp_path / "link.csv").is_symlink()
    assert (tmp_path / "folder" / "real.csv").read_text() == "text"


def test_device_is_written_directly(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_whole(pipe, "text")
    assert os.read(reader, 100) == b"text"
    os.close(reader)
    assert files_in(tmp_path) == ["pipe"]


def test_dash_is_standard_output(capsysbinary: pytest.CaptureFixture[bytes]) -> None:
    write_whole(Path("-"), "first\n")
    with OutputFile(Path("-")) as output:
        output.file.write(b"second\n")
    assert capsysbinary.readouterr().out == b"first\nsecond\n"
    with pytest.raises(OutputError, match="standard output"):
        check_outputs((Path("-"), Path("-")), ())
