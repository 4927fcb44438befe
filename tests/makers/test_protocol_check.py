"""`treadlink protocol check` and `dump`: what a user of them sees, and the exit status."""

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import Result

from gateway.core.clock import SystemClock
from gateway.core.errors import RecordingError, TreadlinkError
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind
from gateway.core.recording.writer import RecordingWriter
from gateway.makers.check.clauses import Clause, Verdict
from gateway.makers.commands.clause_report import PAGE, anchor
from gateway.makers.commands.protocol_check import dump_frames
from tests.makers.wrong_firmware import WRONG, Stream, frames, right, right_stream
from tests.testkit.commands import invoked


def run(*arguments: str) -> Result:
    return invoked("protocol", *arguments)


def written(path: Path, stream: Stream) -> str:
    path.write_bytes(b"".join(data for _, data in stream))
    return str(path)


@pytest.fixture(scope="module")
def right_dump(tmp_path_factory: pytest.TempPathFactory) -> str:
    return written(tmp_path_factory.mktemp("dump") / "right.bin", right_stream())


@pytest.fixture(scope="module")
def wrong_dump(tmp_path_factory: pytest.TempPathFactory) -> str:
    return written(tmp_path_factory.mktemp("dump") / "wrong.bin", WRONG["int16 big endian"][1]())


@contextmanager
def served(data: bytes, *, waits: bool = True) -> Iterator[str]:
    """Serve bytes to one client, and end when it leaves or, without waiting, hang up first."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            client, _ = server.accept()
            with client:
                client.sendall(data)
                if not waits:
                    client.shutdown(socket.SHUT_WR)
                while client.recv(4096):
                    pass

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}"
        thread.join()


def test_a_right_dump_passes(right_dump: str) -> None:
    result = run("check", right_dump)
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert lines[0].startswith("dump:right.bin: 1591 frames, ")
    assert lines[-1].endswith("0 advised, 0 failed, " + lines[-1].split(", ")[-1])
    assert "  passed         CRC-32 over all bytes before it [crc]" in lines
    assert "no command can be sent" in result.output


def test_a_fault_is_named_with_its_bytes_and_ends_with_1(wrong_dump: str) -> None:
    result = run("check", wrong_dump)
    assert result.exit_code == 1
    lines = result.output.splitlines()
    offset = lines.index("  FAILED         counts are little endian [byte-order]")
    assert "hub0.wheel1: the two bytes of its samples seem to be swapped" in lines[offset + 1]
    position, _, shown = lines[offset + 2].strip().removeprefix("at byte ").partition(": ")
    data = Path(wrong_dump).read_bytes()
    assert bytes.fromhex(shown) == data[int(position) : int(position) + 48]


def test_junit_counts_and_names_the_failure(wrong_dump: str, tmp_path: Path) -> None:
    target = tmp_path / "check.xml"
    assert run("check", wrong_dump, "--junit", str(target)).exit_code == 1
    [suite] = ElementTree.parse(target).getroot()
    assert suite.attrib["tests"] == str(len(Clause))
    assert suite.attrib["failures"] == "1"
    [case] = [case for case in suite if case.find("failure") is not None]
    assert case.attrib == {"classname": "Payloads", "name": "byte-order: counts are little endian"}
    assert "at byte" in case.find("failure").text
    assert len(suite.findall("testcase/skipped")) == int(suite.attrib["skipped"])
    again = run("check", wrong_dump, "--junit", str(target))
    assert isinstance(again.exception, TreadlinkError)
    assert run("check", wrong_dump, "--junit", str(target), "--force").exit_code == 1


def test_json_has_every_clause(wrong_dump: str) -> None:
    document = json.loads(run("check", wrong_dump, "--json").output)
    assert [clause["clause"] for clause in document["clauses"]] == list(Clause)
    failed = [clause for clause in document["clauses"] if clause["verdict"] == Verdict.FAILED]
    assert [clause["clause"] for clause in failed] == [Clause.BYTE_ORDER]
    assert failed[0]["findings"][0]["reason"]["code"] == "samples_bytes_swapped"


def test_recommendations_do_not_fail(tmp_path: Path) -> None:
    source = written(tmp_path / "log.bin", WRONG["log with line feeds"][1]())
    result = run("check", source)
    assert result.exit_code == 0
    assert "  advised        UTF-8" in result.output


def test_no_frame_ends_with_1(tmp_path: Path) -> None:
    (tmp_path / "text.bin").write_bytes(b"hello there\n" * 50)
    result = run("check", str(tmp_path / "text.bin"))
    assert result.exit_code == 1
    assert "this is another device, which sends text" in result.output


def test_an_empty_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "empty.bin").write_bytes(b"")
    result = run("check", str(tmp_path / "empty.bin"), "--junit", str(tmp_path / "check.xml"))
    assert result.exit_code == 1
    assert isinstance(result.exception, RecordingError)
    assert "no byte of a hub is in" in str(result.exception)
    assert result.exception.remedy
    assert (tmp_path / "check.xml").exists()


def test_a_hub_over_tcp_is_checked_for_the_time_asked(right_dump: str) -> None:
    with served(Path(right_dump).read_bytes()) as uri:
        result = run("check", uri, "--for", "1s", "--json")
    clauses = {clause["clause"]: clause["verdict"] for clause in json.loads(result.output)["clauses"]}
    assert clauses[Clause.CRC] == Verdict.PASSED
    # It hears the command and does not answer.
    assert clauses[Clause.COMMAND_ANSWER] == Verdict.NOT_EXERCISED


def test_a_link_that_breaks_ends_the_check_with_its_report(right_dump: str) -> None:
    with served(Path(right_dump).read_bytes(), waits=False) as uri:
        result = run("check", uri, "--for", "60s")
    assert result.exit_code == 0, result.output
    assert "connection lost: " in result.stderr
    assert "1591 frames" in result.stdout


def test_a_link_that_breaks_in_a_recording_ends_no_other(tmp_path: Path) -> None:
    dump = b"".join(data for _, data in right_stream())
    writer = RecordingWriter(tmp_path / "run.mcap", start_ns=10**9, sources=["a", "b"])
    for item in (
        LinkEvent("a", 10**9, LinkEventKind.LOST, "unplugged"),
        Chunk("a", 2 * 10**9, dump[:20_000]),
        LinkEvent("a", 3 * 10**9, LinkEventKind.LOST, "unplugged"),
        Chunk("b", 4 * 10**9, dump[:9_000] + b"?" + dump[9_000:20_000]),
        Chunk("a", 5 * 10**9, dump[30_000:50_000]),
    ):
        writer.write(item)
    writer.close()
    result = run("check", str(tmp_path / "run.mcap"), "--json")
    reports = [json.loads(line) for line in result.stdout.splitlines()]
    crc = [clause["verdict"] for report in reports for clause in report["clauses"] if clause["clause"] == Clause.CRC]
    assert [report["link"] for report in reports] == ["a", "b", "a"]
    assert crc == [Verdict.PASSED, Verdict.FAILED, Verdict.PASSED]
    assert not any(clause["verdict"] == Verdict.FAILED for clause in reports[0]["clauses"] + reports[2]["clauses"])
    assert result.exit_code == 1


def test_a_silent_hub_does_not_keep_the_check() -> None:
    with served(b"") as uri:
        result = run("check", uri, "--for", "0.2s")
    assert result.exit_code == 1
    assert "0 frames, 0 bytes" in result.output
    assert isinstance(result.exception, TreadlinkError)
    assert f"no byte arrived from '{uri}'" in str(result.exception)


@pytest.mark.parametrize("shown", ["soon", "0s", "-3s", "1h", "nan", ""])
def test_a_bad_duration_is_named(right_dump: str, shown: str) -> None:
    result = run("check", right_dump, "--for", shown)
    assert isinstance(result.exception, TreadlinkError)
    assert f"'{shown}' is no duration" in str(result.exception)


def test_for_limits_a_file_too(right_dump: str) -> None:
    full = run("dump", right_dump).output.splitlines()
    assert len(full) == 1591
    assert run("dump", right_dump, "--for", "2min").output.splitlines() == full


def test_dump_shows_frames_and_what_was_none(tmp_path: Path) -> None:
    stream = frames(right(0.5))
    damaged = stream[0][1][:-1] + b"\0"
    source = written(tmp_path / "some.bin", [(0.0, damaged), *stream[1:]])
    lines = run("dump", source).output.splitlines()
    assert "hub 0 wheel 1  HELLO" in lines[0]
    assert "scale_mps2=(0.128 0.128 0.128)" in lines[0]
    assert any("SAMPLES" in line and "first_sample 36 axes 7 n 36: " in line for line in lines)
    assert any(line.endswith("level 1: awake") for line in lines)
    assert any(line.endswith("! CRC wrong: +1") for line in lines)


def test_a_dump_whose_reader_stops_does_not_fill_the_memory(right_dump: str) -> None:
    threads = set()
    with served(Path(right_dump).read_bytes()[:4000]) as uri:
        dump_frames(
            uri, for_s=0.1, clock=SystemClock(), write=lambda _: threads.update(t.name for t in threading.enumerate())
        )
    assert threads, "no frame was written"
    assert not [name for name in threads if name.startswith("read ")], "it reads ahead"


def test_every_clause_has_words_and_a_section_of_the_page() -> None:
    page = Path(__file__).parents[2].joinpath(PAGE).read_text("utf-8")
    anchors = {anchor(line.lstrip("# ")) for line in page.splitlines() if line.startswith("#")}
    assert all(clause.words for clause in Clause)
    assert {anchor(clause.section) for clause in Clause} <= anchors
