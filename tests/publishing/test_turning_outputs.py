"""Turn rate and curve radius in live outputs: of a simulated wheel in a curve, and at the ends of their ranges."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import cantools
import pytest
from websockets.sync.client import connect

from gateway.console.page import ViewState, compose
from gateway.core.clock import SystemClock
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import RevolutionResult, SessionSnapshot
from gateway.core.quantity_catalogue import in_state
from gateway.core.text.recording_topics import revolution_payload
from gateway.publishing.can_frames import LAYOUTS, FrameEncoder, dbc_text
from gateway.publishing.foxglove_server import FoxgloveSink
from gateway.publishing.sink import Item, PublishedRevolution, PublishedState
from gateway.publishing.sink_worker import SinkWorker
from gateway.publishing.web_page.page_state import page_state
from tests.publishing.receivers import finish, publish
from tests.publishing.test_foxglove import Viewer
from tests.testkit.simulated_session import simulated_session
from tests.testkit.waiting import TIMEOUT_S, until
from tools.mqtt_broker import PROGRAM, Broker, Listener

DBC = cantools.database.load_string(dbc_text(), "dbc")
TURN_RADPS, SPEED_MPS = 0.2, 65.0 / 3.6
CURVE = """
[scenario]
name = "One curve"
seed = 2
[motion]
speed_kmh = 65.0
yaw_rate_degps = [[0, 0], [1.6, 0], [2.0, 11.459], [3.4, 11.459], [4.2, 11.459]]
[sensor]
noise_mg_rthz = 3.0
[[hub]]
hub = 0
[[wheel]]
position = "FL"
wheel = 0
load_n = 4500
"""


@pytest.fixture(scope="module")
def curve(tmp_path_factory) -> tuple[list[RevolutionResult], SessionSnapshot]:
    """Revolutions of a simulated wheel that drives into a curve to the left, and the state of the session in it."""
    path = tmp_path_factory.mktemp("curve") / "curve.toml"
    path.write_text(CURVE, "utf-8")
    return simulated_session(f"sim:{path}?speed=max&duration=3.5", 3.5, ("kinematic", "ply-steer", "turning"))


def items_of(curve: tuple[list[RevolutionResult], SessionSnapshot]) -> list[Item]:
    results, snapshot = curve
    items: list[Item] = [PublishedRevolution(result.host_ns, result) for result in results]
    return [*items, PublishedState(results[-1].host_ns, snapshot)]


def check(document: Mapping[str, Any]) -> None:
    """Hold a published revolution in the curve against the truth."""
    for name, truth in (("turn_rate_radps", TURN_RADPS), ("curve_radius_m", SPEED_MPS / TURN_RADPS)):
        value, std = document[name], document[f"{name}_std"]
        assert abs(value - truth) < 3.0 * std < 0.6 * truth
        assert document[f"{name}_status"] == "provisional"
        assert "straight_not_shown" in {reason["code"] for reason in document[f"{name}_reasons"]}


def test_bus_has_the_turn_of_a_simulated_curve(curve) -> None:
    with can.Bus(interface="virtual", channel="curve") as bus:
        publish("can:virtual:curve", items_of(curve))
        frames = []
        while (message := bus.recv(0.2)) is not None:
            frames.append(message)
    decoded = {}
    for message in frames:
        layout = DBC.get_message_by_frame_id(message.arbitration_id)
        decoded[layout.name] = layout, layout.decode(message.data)
    estimates = {estimate.name: estimate for estimate in curve[0][-1].estimates}
    for layout, signal, name, unit, counts in (
        ("FL_Turning", "TurnRate", "turn_rate_radps", "rad/s", (1e-4, 5e-4)),
        ("FL_Curve", "CurveRadius", "curve_radius_m", "m", (0.05, 1.0)),
    ):
        message, values = decoded[layout]
        assert message.get_signal_by_name(signal).unit == unit
        for suffix, value, count in zip(("", "Error"), estimates[name][1:3], counts, strict=True):
            assert values[f"{signal}{suffix}"] == pytest.approx(value, abs=1.001 * count)
        assert values[f"{signal}Status"] == "provisional"
    assert decoded["FL_Turning"][1]["TurnRate"] == pytest.approx(TURN_RADPS, abs=0.05)


def test_lines_have_the_turn_of_a_simulated_curve(curve, tmp_path: Path) -> None:
    publish(f"jsonl:{tmp_path}/lines.jsonl", items_of(curve))
    check([json.loads(line) for line in (tmp_path / "lines.jsonl").read_text("utf-8").splitlines()][-1])


@pytest.mark.skipif(PROGRAM is None, reason="needs mosquitto")
def test_broker_has_the_turn_of_a_simulated_curve(curve, tmp_path: Path) -> None:
    broker = Broker(tmp_path).start()
    listener = Listener(broker.port)
    try:
        publish(f"mqtt://127.0.0.1:{broker.port}/car", items_of(curve))
        until(lambda: listener.of("car/status")[-1:] == ["offline"])
        assert len(listener.of("car/wheel/FL/revolution")) == len(curve[0])
        check(listener.of("car/wheel/FL/revolution")[-1])
        states = [state for state in listener.of("car/wheel/FL/state") if state.get("turn_rate_radps") is not None]
        assert states[0]["turn_rate_radps"] == pytest.approx(TURN_RADPS, abs=0.05)
        assert states[0]["curve_radius_m"] == pytest.approx(SPEED_MPS / TURN_RADPS, rel=0.25)
    finally:
        listener.close()
        broker.kill()


def test_viewer_has_the_turn_of_a_simulated_curve(curve) -> None:
    sink = FoxgloveSink("127.0.0.1", 0)
    worker = SinkWorker("foxglove://x", sink, SystemClock())
    worker.start()
    until(lambda: worker.snapshot().state == "up")
    topic = "/wheel/FL/revolution"
    with connect(f"ws://127.0.0.1:{sink.port}", subprotocols=["foxglove.sdk.v1"], open_timeout=TIMEOUT_S) as socket:
        viewer = Viewer(socket)
        for _ in range(100):  # what was sent before a subscription does not come
            if topic in viewer.messages:
                break
            worker.offer(items_of(curve)[-2])
            viewer.read_all()
    finish(worker)
    check(json.loads(viewer.messages[topic][-1][1]))
    schema = next(channel["schema"] for channel in viewer.channels.values() if channel["topic"] == topic)
    assert json.loads(schema)["properties"]["turn_rate_radps"]["type"] == "number"


def test_screen_and_page_show_the_turn_of_a_simulated_curve(curve) -> None:
    snapshot = curve[1]
    rows = ["".join(text for text, _ in row) for row in compose(snapshot, ViewState(), 130, 60)]
    page = json.dumps(page_state(snapshot, run_form=None), ensure_ascii=False)
    (line,) = (row for row in rows if "turn rate" in row)
    assert "±" in line
    assert "rad/s" in line
    assert any("curve radius" in row and " m" in row for row in rows)
    for word in ("turn rate", "curve radius", "rad/s"):
        assert word in page


def frame(layout: str, values: dict[str, float]) -> dict[str, object]:
    made = FrameEncoder().wheel("FL", LAYOUTS[layout], values)
    return DBC.decode_message(made.can_id, made.data)


@pytest.mark.parametrize("radius_m", [-12.4, 850.0, 3276.0])
def test_bus_carries_rate_and_radius_with_sign_error_and_status(radius_m: float) -> None:
    turning = frame("Turning", {"TurnRate": -0.31, "TurnRateError": 0.012, "TurnRateStatus": 2})
    assert (turning["TurnRate"], turning["TurnRateError"]) == pytest.approx((-0.31, 0.012))
    curve = frame("Curve", {"CurveRadius": radius_m, "CurveRadiusError": 24.0, "CurveRadiusStatus": 1})
    assert (curve["CurveRadius"], curve["CurveRadiusError"]) == pytest.approx((radius_m, 24.0))
    assert curve["CurveRadiusStatus"] == "provisional"


def test_nearly_straight_has_no_radius_on_the_bus() -> None:
    assert frame("Curve", {"CurveRadius": 9000.0, "CurveRadiusStatus": 2})["CurveRadius"] == "not_available"


def test_state_and_plots_have_rate_and_radius(made) -> None:
    names = ("turn_rate_radps", "curve_radius_m")
    assert set(names) <= set(in_state())
    estimates = tuple(Estimate(name, 0.5 * (index + 1), 0.1, Status.VALID) for index, name in enumerate(names))
    payload = revolution_payload(replace(made.result(), estimates=estimates))
    assert [(payload[name], payload[f"{name}_std"]) for name in names] == [(0.5, 0.1), (1.0, 0.1)]
