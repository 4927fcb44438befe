"""JSON lines: valid by the schema, alone on standard output, whole lines only, whatever the reader does."""

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import jsonschema
import pytest

from gateway.core.cli import exit_status, treadlink
from gateway.core.recording.revolution_fields import PARTS
from gateway.publishing.line_schema import line_schema
from gateway.publishing.payloads import encoded, messages
from gateway.publishing.sink import SinkError
from tests.publishing.receivers import finish, publish, worker_of
from tests.testkit.waiting import TIMEOUT_S, until

ROOT = Path(__file__).parents[2]
VALIDATOR = jsonschema.Draft202012Validator(line_schema())


def checked(line: str | bytes) -> dict:
    document = json.loads(line)
    VALIDATOR.validate(document)
    return document


def test_every_line_is_valid_by_the_schema(items, tmp_path) -> None:
    jsonschema.Draft202012Validator.check_schema(line_schema())
    path = tmp_path / "out.jsonl"
    publish(f"jsonl:{path}?states=yes", items)
    lines = [checked(line) for line in path.read_text("utf-8").splitlines()]
    assert {line["type"] for line in lines} == {"revolution", "alarm", "wheel", "link", "session"}
    first, result = next(line for line in lines if line["type"] == "revolution"), items[0].result
    assert (first["load_n"], first["load_source"]) == (result.conditions.load_n, "stated")
    assert (first["pressure_pa"], first["pressure_source"]) == (result.conditions.pressure_pa, "measured")
    assert (first["wheel"], first["time_s"]) == (result.position, round(result.host_ns * 1e-9, 6))
    speed = next(estimate for estimate in result.estimates if estimate.name == "speed_mps")
    assert [first[f"speed_mps{part}"] for part in ("", "_std", "_status")] == [speed.value, speed.std, "valid"]
    reason = first["Bs_reasons"][0]
    assert (reason["code"], set(reason["values"])) == ("not_settled", {"revolutions", "needed"})
    raised, over = (line for line in lines if line["type"] == "alarm")
    assert (raised["raised"], over["raised"], over["stood_s"]) == (True, False, 1.0)
    assert raised["reason"]["values"] == {"quantity": "pressure_pa", "value": 180e3, "limit": 200e3}


def test_schema_tells_of_every_part_of_an_estimate() -> None:
    told = line_schema()["$defs"]["revolution"]["description"]
    assert [part for part in PARTS if f"NAME{part}" not in told] == []


def test_schema_refuses_what_is_not_published(items) -> None:
    good = json.loads(encoded(next(messages(items[0]))))
    for wrong in (
        {**good, "type": "turn"},
        {**good, "speed_mps": "fast"},
        {**good, "Bs_status": "fine"},
        {**good, "Bs_reasons": [{"code": "x"}]},
        {key: value for key, value in good.items() if key != "wheel"},
    ):
        assert not VALIDATOR.is_valid(wrong)
    assert VALIDATOR.is_valid(good)


def test_standard_output_carries_lines_only(capfd) -> None:
    treadlink.main(["live", "sim:demo?speed=max&duration=1.5", "--publish", "jsonl:-"], standalone_mode=False)
    out, errors = capfd.readouterr()
    kinds = [checked(line)["type"] for line in out.splitlines()]
    assert len(kinds) > 20
    assert set(kinds) == {"revolution"}
    assert f"jsonl:-: {len(kinds)} published, 0 dropped" in errors
    assert "# sim:demo: connected" in errors


def test_closed_pipe_ends_quietly() -> None:
    command = [sys.executable, "-m", "gateway.core.cli", "live", "sim:demo", "--publish", "jsonl:-"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT)
    assert process.stdout is not None
    assert process.stderr is not None
    assert checked(process.stdout.readline())["type"] == "revolution"
    process.stdout.close()
    errors = process.stderr.read().decode()
    process.stderr.close()
    assert process.wait(30) == exit_status.CLOSED_PIPE
    assert "Traceback" not in errors
    assert "published" not in errors


def test_existing_file_is_kept_unless_appended_to(items, tmp_path) -> None:
    path = tmp_path / "out.jsonl"
    path.write_text('{"old":1}\n')
    with pytest.raises(SinkError, match="exists"):
        worker_of(f"jsonl:{path}")
    publish(f"jsonl:{path}?append=yes", [items[0]])
    old, new = path.read_text("utf-8").splitlines()
    assert old == '{"old":1}'
    assert checked(new)["index"] == 0


def test_half_a_line_of_a_killed_session_stands_alone(items, tmp_path) -> None:
    path = tmp_path / "out.jsonl"
    path.write_text('{"old":1}\n{"ha')
    publish(f"jsonl:{path}?append=yes", [items[0]])
    old, half, new = path.read_text("utf-8").splitlines()
    assert (old, half) == ('{"old":1}', '{"ha')
    assert checked(new)["index"] == 0


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_reader_of_a_pipe_may_stall_leave_and_return(items, tmp_path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    worker = worker_of(f"jsonl:{path}")
    worker.start()
    worker.offer(items[0])
    until(lambda: worker.snapshot().state == "down")
    reader = os.open(path, os.O_RDONLY)
    with os.fdopen(reader, "rb") as pipe:
        assert checked(pipe.readline())["index"] == 0
        for item in items * 3:  # more than the pipe holds: the reader stalls
            worker.offer(item)
        until(lambda: worker.snapshot().published > 5)
    # It left in the middle of a line.
    until(lambda: worker.snapshot().state == "down")
    lines: list[dict] = []

    def read() -> None:
        with path.open("rb") as pipe:
            lines.extend(checked(line) for line in pipe)

    thread = threading.Thread(target=read)
    thread.start()
    finish(worker)
    thread.join(TIMEOUT_S)
    assert lines[-1]["type"] == "alarm"
    result = worker.snapshot()
    assert result.dropped == 0
    assert result.published == 3 * (len(items) - 1) + 1


def test_full_disk_is_waited_for(items) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("needs /dev/full")
    worker = worker_of("jsonl:/dev/full?append=yes")
    worker.start()
    worker.offer(items[0])
    until(lambda: worker.snapshot().state == "down")
    assert worker.snapshot().note["error"] == "No space left on device"
    worker.abandon()
    assert worker.join(TIMEOUT_S)
    worker.discard()
    assert (worker.snapshot().published, worker.snapshot().dropped) == (0, 1)
