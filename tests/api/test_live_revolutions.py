"""The iterator over live revolutions: same results as a recording, and nothing left running."""

import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest

import gateway

URI = "sim:lab?speed=max&duration=4&seed=3"


@pytest.fixture
def sessions():
    """Return what lists the threads that a test has begun: others may have left some of theirs."""
    earlier = set(threading.enumerate())
    return lambda: [thread.name for thread in threading.enumerate() if thread not in earlier]


@pytest.fixture(scope="module")
def recorded_live(tmp_path_factory):
    """Revolutions of a session, and the recording that it made."""
    path = tmp_path_factory.mktemp("live") / "live.mcap"
    with gateway.live(URI, record=path, estimators="kinematic") as session:
        results = list(session)
        yield results, path, session


def test_revolutions_equal_those_of_the_recording(recorded_live):
    result, path, _ = recorded_live
    again = list(gateway.open(path).stream("kinematic"))
    assert len(result) == len(again) > 20
    for first, other in zip(result, again, strict=True):
        assert first.wheel == other.wheel
        assert first.device_start_s == pytest.approx(other.device_start_s, abs=1e-9)
        np.testing.assert_allclose(first.axes_mps2, other.axes_mps2, atol=1e-6)
        values = [[revolution[name].value for name in first.estimates] for revolution in (first, other)]
        np.testing.assert_allclose(*values, rtol=1e-9)


def test_session_ends_with_its_sources(recorded_live):
    _, path, session = recorded_live
    assert gateway.open(path).info.finished
    assert "closed, wheels W1" in repr(session)
    assert list(session) == []
    assert session.dropped == 0
    assert "mean speed" in session.summary()


def test_notices_and_alarms_are_words():
    with gateway.live(URI, estimators="kinematic") as session:
        next(session)
        assert any("connected" in notice for notice in session.notices())
        assert session.alarms == {}
        assert session.wheels == ("W1",)


def test_leaving_the_loop_closes_the_source(sessions):
    for revolution in gateway.live("sim:lab", estimators="kinematic"):
        assert revolution.wheel == "W1"
        break
    assert sessions() == []


def test_error_in_the_loop_closes_the_source(tmp_path, sessions):
    path = tmp_path / "part.mcap"

    def fails():
        with gateway.live("sim:lab", record=path, estimators="kinematic") as session:
            for _ in session:
                raise RuntimeError("of the loop")

    with pytest.raises(RuntimeError, match="of the loop"):
        fails()
    assert sessions() == []
    assert gateway.open(path).info.finished


def test_ctrl_c_finishes_the_recording(tmp_path):
    path = tmp_path / "stopped.mcap"
    code = (
        "import gateway\n"
        f"for revolution in gateway.live('sim:lab', record={str(path)!r}, estimators='kinematic'):\n"
        "    print(revolution.number, flush=True)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        assert process.stdout.readline().strip() == "0"
        os.kill(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert errors.strip().endswith("KeyboardInterrupt")
    assert errors.count("Traceback") == 1
    assert gateway.open(path).info.finished


def test_source_that_cannot_be_opened_leaves_no_file(tmp_path, sessions):
    path = tmp_path / "never.mcap"
    with pytest.raises(gateway.SourceError, match="no port"):
        list(gateway.live("serial:///dev/treadlink-none", record=path))
    assert not path.exists()
    assert sessions() == []


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((), {}, "there is no source"),
        (("magic:here",), {}, "unknown source"),
        ((URI,), {"config": "none.toml"}, "cannot be read"),
        ((URI,), {"estimators": "magic"}, "unknown estimator"),
    ],
)
def test_wrong_options_are_errors_at_the_call(arguments, options, message, sessions):
    with pytest.raises(gateway.Error, match=message):
        gateway.live(*arguments, **options)
    assert sessions() == []


def test_duration_limits_the_data():
    results = list(gateway.live("sim:lab?speed=max&seed=3", duration_s=2.0, estimators="kinematic"))
    assert results[-1].device_start_s + results[-1].period_s < 2.0
    assert results[-1].device_start_s > 1.5


def test_several_sources_come_together(recorded):
    results = list(gateway.live(URI, f"replay:{recorded}?speed=max", estimators="kinematic"))
    assert {"W1", "hub0.wheel1"} <= {revolution.wheel for revolution in results}
