"""Line protocol: read by a parser of the protocol, complete in a file, and confirmed by a server that may be away."""

import pytest

from gateway.core.estimates.results import SinkState
from gateway.core.text.wording import text
from gateway.publishing.payloads import messages
from gateway.publishing.sink import SinkError, SinkSetting, open_sink
from tests.publishing.receivers import finish, publish, worker_of
from tests.testkit.waiting import TIMEOUT_S, until

influx = pytest.importorskip("gateway.publishing.influx")
TOKEN, lines = influx.TOKEN, influx.lines
parse_line = pytest.importorskip("line_protocol_parser").parse_line


def test_points_are_what_the_json_lines_say(items) -> None:
    for item in items:
        expected = list(messages(item))
        results = [parse_line(line) for line in lines(item)]
        assert [point["measurement"] for point in results] == [f"treadlink_{message['type']}" for message in expected]
        for point, message in zip(results, expected, strict=True):
            assert point["time"] == item.host_ns
            numbers = {k: v for k, v in message.items() if type(v) in (int, float) and k not in ("time_s", "link")}
            assert {k: point["fields"][k] for k in numbers} == pytest.approx(numbers)
            assert all(type(point["fields"][name]) is float for name in numbers)
            assert {name: point["tags"][name] for name in ("wheel", "link") if name in message} == {
                name: message[name] for name in ("wheel", "link") if name in message
            }


def test_status_and_invalid_numbers_are_fields(items) -> None:
    fields = parse_line(next(iter(lines(items[0]))))["fields"]
    assert fields["speed_mps_status"] == "valid"
    assert fields["speed_mps_std"] > 0.0


def test_file_has_every_revolution_alarm_and_state(items, tmp_path) -> None:
    path = tmp_path / "drive #1.lp"
    publish(f"influx:{path}", items)
    assert path.read_text("utf-8").splitlines() == [line for item in items for line in lines(item)]
    with pytest.raises(SinkError, match="exists"):
        open_sink(f"influx:{path}", SinkSetting())
    open_sink(f"influx:{path}?append=yes", SinkSetting())


def test_half_a_line_of_a_killed_session_stands_alone(items, tmp_path) -> None:
    path = tmp_path / "drive.lp"
    path.write_text("treadlink_revolu")
    publish(f"influx:{path}?append=yes", [items[0]])
    assert path.read_text("utf-8").splitlines() == ["treadlink_revolu", *lines(items[0])]


def test_server_gets_everything_with_bucket_org_and_token(items, server, monkeypatch) -> None:
    monkeypatch.setenv(TOKEN, "secret")
    worker = publish(f"influx://127.0.0.1:{server.server_port}/car%20a?org=rig", items)
    assert sorted(server.lines) == sorted(line for item in items for line in lines(item))
    path, authorization, _ = server.requests[0]
    assert "bucket=car+a" in path
    assert "org=rig" in path
    assert "precision=ns" in path
    assert authorization == "Token secret"
    assert worker.snapshot().dropped == 0


def test_what_the_server_refuses_is_sent_again(items, server) -> None:
    server.status = 401
    worker = worker_of(f"influx://127.0.0.1:{server.server_port}/car")
    worker.start()
    for item in items:
        worker.offer(item)
    until(lambda: worker.snapshot().state is SinkState.DOWN)
    assert TOKEN in str(worker.snapshot().note)
    server.status = 204
    finish(worker)
    assert {line for item in items[:-1] for line in lines(item)} <= set(server.lines)


@pytest.mark.parametrize("status", [400, 413, 422])
def test_points_that_are_wrong_for_the_server_hold_no_others_up(items, server, status) -> None:
    server.status = 500
    worker = worker_of(f"influx://127.0.0.1:{server.server_port}/car")
    worker.start()
    for item in (items[0], items[-1]):
        worker.offer(item)
    until(lambda: worker.snapshot().state is SinkState.DOWN)
    server.status = status
    until(lambda: worker.snapshot().dropped == 1)
    assert str(status) in text(worker.snapshot().note)
    server.status = 204
    for item in (items[1], items[-1]):
        worker.offer(item)
    finish(worker)
    assert (worker.snapshot().published, worker.snapshot().dropped) == (1, 1)
    assert worker.is_left, "what was refused is said at the end"
    assert set(lines(items[1])) <= set(server.lines)
    assert not set(lines(items[0])) & set(server.lines)


def test_server_that_is_away_is_named(items) -> None:
    worker = worker_of("influx://127.0.0.1:9/car")
    worker.start()
    worker.offer(items[-1])
    until(lambda: worker.snapshot().state is SinkState.DOWN)
    assert "does not answer" in str(worker.snapshot().note)
    worker.abandon()
    assert worker.join(TIMEOUT_S)


@pytest.mark.parametrize(
    ("uri", "words"),
    [("influx://host", "names no bucket"), ("influxs:file", "has no host"), ("influx:nosuch/x.lp", "existing folder")],
)
def test_wrong_address_is_refused(uri: str, words: str) -> None:
    with pytest.raises(SinkError, match=words):
        open_sink(uri, SinkSetting())
