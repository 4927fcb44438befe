"""CAN frames on real buses of python-can, read back with the DBC file by cantools."""

import itertools
import math
import threading
from dataclasses import replace

import can
import cantools
import pytest
from can.interfaces.virtual import VirtualBus

from gateway.core.errors import ConfigError
from gateway.core.estimates.results import Silence, SilentPart, WheelState
from gateway.core.links.reconnect import Backoff
from gateway.core.reasons import Reason
from gateway.core.wheels.reasons import WheelCode
from gateway.publishing import can_bus, sink_worker
from gateway.publishing.can_frames import CONDITIONS, GATEWAY, LAYOUTS, MOTION, SLOTS, FrameEncoder, dbc_text, slots_of
from gateway.publishing.sink import SinkSetting, open_sink
from tests.publishing.receivers import finish, publish, worker_of
from tests.testkit.commands import invoked, run
from tests.testkit.waiting import TIMEOUT_S, until


@pytest.fixture(scope="module")
def dbc():
    return cantools.database.load_string(dbc_text(), "dbc")


def received(bus: can.BusABC) -> list[can.Message]:
    frames = []
    while (frame := bus.recv(0.2)) is not None:
        frames.append(frame)
    return frames


def decoded(dbc, frames):
    results = {}
    for frame in frames:
        message = dbc.get_message_by_frame_id(frame.arbitration_id)
        results.setdefault(message.name, []).append(message.decode(frame.data))
    return results


def test_frames_carry_estimates_within_one_count(items, dbc) -> None:
    with can.Bus(interface="virtual", channel="estimates") as bus:
        worker = publish("can:virtual:estimates", items)
        frames = received(bus)
    assert (worker.snapshot().published, worker.snapshot().dropped) == (len(items) - 1, 0)
    actual = decoded(dbc, frames)
    results = [item.result for item in items[:-3] if item.result.position == "FL"]
    motion = actual["FL_Motion"]
    assert len(motion) == len(results)
    assert [frame["Counter"] for frame in motion] == [index % 16 for index in range(len(motion))]
    for result, speed, belt, conditions in zip(
        results, motion, actual["FL_Belt"], actual["FL_Conditions"], strict=True
    ):
        estimates = {estimate.name: estimate for estimate in result.estimates}
        assert speed["Revolution"] == result.revolution.index
        assert speed["Speed"] == pytest.approx(estimates["speed_mps"].value, abs=0.005)
        assert speed["SpeedError"] == pytest.approx(estimates["speed_mps"].std, abs=0.005)
        assert speed["SpeedStatus"] == str(estimates["speed_mps"].status)
        assert belt["Bs"] == pytest.approx(estimates["Bs"].value, abs=0.5e-6)
        assert belt["BsStatus"] == str(estimates["Bs"].status)
        assert conditions["Pressure"] == pytest.approx(result.conditions.pressure_pa, abs=5.0)
        assert conditions["PressureStatus"] == "valid"
    assert actual["Treadlink_Gateway"][0]["RollingWheels"] == 4
    alarms = actual["FL_Alarms"]
    assert [frame["PressureAlarm"] for frame in alarms] == [1, 0, 0]


def test_frames_cross_a_network(items, dbc) -> None:
    options = {"interface": "udp_multicast", "channel": "239.74.163.2", "port": 43213, "hop_limit": 0}
    try:
        bus = can.Bus(**options)
    except (OSError, can.CanError) as error:
        pytest.skip(f"no multicast here: {error}")
    with bus:
        publish("can:udp_multicast:239.74.163.2?port=43213&hop_limit=0", items[:4])
        result = decoded(dbc, received(bus))
    assert {name.split("_")[1] for name in result} == set(LAYOUTS) - {"Alarms"}


@pytest.mark.parametrize("error", [can.CanError("full"), OSError(105, "No buffer space"), ValueError("ctypes")])
def test_no_item_is_lost_by_an_error_of_the_adapter(items, monkeypatch, error) -> None:
    # The libraries of adapters raise errors of every kind, in every call.
    really_open, calls, sent = can.Bus, itertools.count(), []

    def fails() -> bool:
        return next(calls) % 5 == 3 and len(sent) < 60

    def open_bus(**options):
        if fails():
            raise error
        bus = really_open(**options)
        send, recv = bus.send, bus.recv

        def failing_send(message, timeout=None):
            if fails():
                raise error
            sent.append(message)
            send(message, timeout)

        def failing_recv(timeout=None):
            if fails():
                raise error
            return recv(timeout)

        bus.send, bus.recv = failing_send, failing_recv
        return bus

    monkeypatch.setattr(can, "Bus", open_bus)
    monkeypatch.setattr(sink_worker, "BACKOFF", Backoff(1_000_000, 1_000_000))
    monkeypatch.setattr(can_bus, "_SEND_S", 0.001)
    worker = publish("can:virtual:failing", items)
    assert (worker.snapshot().published, worker.snapshot().dropped) == (len(items) - 1, 0)


def test_unknown_and_impossible_values_are_not_available(dbc) -> None:
    encoder = FrameEncoder()

    def frame(layout, values):
        made = encoder.wheel("FL", layout, values)
        return dbc.decode_message(made.can_id, made.data)

    empty = frame(MOTION, {})
    assert (empty["Speed"], empty["SpeedError"], empty["SpeedStatus"]) == ("not_available",) * 3
    assert frame(MOTION, {"SpeedStatus": 0})["SpeedStatus"] == "invalid"
    for value in (math.nan, math.inf, -1.0, 656.0):
        broken = frame(MOTION, {"Speed": value, "SpeedStatus": 2})
        assert (broken["Speed"], broken["SpeedStatus"]) == ("not_available", "not_available")
    low = frame(LAYOUTS["Contact"], {"LeadingEdge": -3.2767, "LeadingEdgeStatus": 2})
    assert low["LeadingEdge"] == pytest.approx(-3.2767)
    assert frame(CONDITIONS, {"Temperature": -40.0, "TemperatureStatus": 2})["Temperature"] == pytest.approx(-40.0)


def test_resting_wheel_states_that_it_has_no_speed(items, dbc) -> None:
    state = items[-1]
    wheels = tuple(replace(wheel, state=WheelState.STANDSTILL) for wheel in state.snapshot.wheels)
    with can.Bus(interface="virtual", channel="resting") as bus:
        publish("can:virtual:resting", [replace(state, snapshot=replace(state.snapshot, wheels=wheels))])
        result = decoded(dbc, received(bus))
    (motion,) = result["RR_Motion"]
    assert (motion["State"], motion["Speed"], motion["SpeedStatus"]) == ("standstill", "not_available", "not_available")
    assert result["RR_Conditions"][0]["PressureStatus"] == "valid"
    assert result["Treadlink_Gateway"][0]["RollingWheels"] == 0


def test_load_is_the_stated_one_also_at_rest(items, dbc) -> None:
    state = items[-1]
    wheels = tuple(
        replace(wheel, state=WheelState.STANDSTILL, stated=frozenset() if wheel.position == "RR" else wheel.stated)
        for wheel in state.snapshot.wheels
    )
    with can.Bus(interface="virtual", channel="load") as bus:
        publish("can:virtual:load", [replace(state, snapshot=replace(state.snapshot, wheels=wheels))])
        result = decoded(dbc, received(bus))
    load = {name: result[f"{name}_Conditions"][0]["LoadStatus"] for name in ("RL", "RR")}
    assert load == {"RL": "valid", "RR": "not_available"}, "that of RR is an estimate"


def test_old_pressure_of_a_rolling_wheel_is_not_available(items, dbc) -> None:
    state, revolution = items[-1], next(item for item in items if item.result.position == "FL")
    old = Silence(SilentPart.ENVIRONMENT, 9.0, Reason(WheelCode.ENVIRONMENT_SILENT, silence_s=9.0))
    snapshots = [
        replace(state.snapshot, wheels=tuple(replace(wheel, silences=silences) for wheel in state.snapshot.wheels))
        for silences in ((old,), ())
    ]
    sink = open_sink("can:virtual:old", SinkSetting())[1]
    stop = threading.Event()
    with can.Bus(interface="virtual", channel="old") as bus:
        sink.open(stop)
        for snapshot in snapshots:
            sink.send(replace(state, snapshot=snapshot), stop)
            sink.send(revolution, stop)
        sink.close()
        result = decoded(dbc, received(bus))["FL_Conditions"]
    for name in ("Pressure", "Temperature"):
        assert [frame[f"{name}Status"] for frame in result] == ["not_available", "valid"]


def test_dbc_states_ranges_units_and_no_overlap(dbc) -> None:
    assert len(dbc.messages) == SLOTS * len(LAYOUTS) + 1
    speed = dbc.get_message_by_name("RL_Motion").get_signal_by_name("Speed")
    assert (speed.scale, speed.unit, speed.minimum, speed.maximum) == (0.01, "m/s", 0.0, 655.34)
    assert {int(raw): str(name) for raw, name in speed.choices.items()} == {65535: "not_available"}
    assert all(message.length == 8 and message.senders == ["Treadlink"] for message in dbc.messages)
    assert all("Counter" in message.signal_tree for message in dbc.messages)
    assert sorted({layout.offset for layout in LAYOUTS.values()}) == [layout.offset for layout in LAYOUTS.values()]
    for layout in (*LAYOUTS.values(), GATEWAY):
        assert sum(signal.bits for signal in layout.signals) + 4 <= 64


def test_ninth_wheel_has_no_frames() -> None:
    encoder = FrameEncoder(positions=["FL", "T1", "T2"])
    ids = [encoder.wheel(name, MOTION, {}).can_id for name in ("FL", "RR", "T1", "hub0.wheel3", "x")]
    assert ids == [0x500, 0x530, 0x540, 0x560, 0x570]
    assert encoder.wheel("y", MOTION, {}) is None
    assert slots_of(["a"]) == {"FL": 0, "FR": 1, "RL": 2, "RR": 3, "a": 4}


def test_large_base_identifier_gives_extended_frames() -> None:
    encoder = FrameEncoder(0x18FF0000)
    frame = encoder.wheel("FR", MOTION, {})
    assert (frame.can_id, frame.is_extended) == (0x18FF0010, True)
    message = cantools.database.load_string(dbc_text(0x18FF0000), "dbc").get_message_by_name("FR_Motion")
    assert (message.frame_id, message.is_extended_frame) == (0x18FF0010, True)
    with pytest.raises(ConfigError, match="leaves no room"):
        dbc_text(0x7A0)


def test_bus_that_cannot_be_opened_is_named(items) -> None:
    worker = worker_of("can:socketcan:nosuch0")
    worker.start()
    until(lambda: worker.snapshot().state == "down")
    assert worker.snapshot().note["error"].startswith("cannot open socketcan:nosuch0: ")
    worker.abandon()
    assert worker.join(TIMEOUT_S)


@pytest.mark.parametrize("error", [can.CanOperationError("bus off"), OSError(19, "No such device")])
@pytest.mark.parametrize("call", ["send", "recv", "shutdown"])
def test_bus_that_fails_is_opened_again_and_gets_what_waits(items, monkeypatch, call: str, error: Exception) -> None:
    """An adapter is pulled out, or the bus goes off after errors; the next one that is opened is sound."""
    opened: list[can.BusABC] = []

    def fail(*_: object) -> None:
        raise error

    def open_bus(**_: object) -> can.BusABC:
        bus = VirtualBus(channel=f"fails-{call}-{type(error).__name__}")
        if not opened:
            for name in {call, "send"}:  # a failing shutdown follows another failure
                monkeypatch.setattr(bus, name, fail)
        opened.append(bus)
        return bus

    monkeypatch.setattr(can, "Bus", open_bus)
    with VirtualBus(channel=f"fails-{call}-{type(error).__name__}") as other:
        worker = worker_of("can:virtual:x")
        worker.start()
        worker.offer(items[0])
        until(lambda: worker.snapshot().published >= 1)
        finish(worker)
        assert worker.snapshot().dropped == 0
        assert len(opened) == 2
        assert len(received(other)) >= 4
    for bus in opened:
        VirtualBus.shutdown(bus)


def test_command_writes_the_dbc_and_the_schema(tmp_path) -> None:
    for name, file in (("dbc", "treadlink.dbc"), ("schema", "treadlink-live.schema.json")):
        run("protocol", name, "--out", tmp_path)
        assert (tmp_path / file).stat().st_size > 1000
    result = invoked("protocol", "dbc", "--base-id", "five")
    assert result.exit_code == 2
    assert (tmp_path / "treadlink.dbc").read_text("utf-8") == dbc_text()
