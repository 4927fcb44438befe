"""What a hub states against what it sends: named once per wheel with a count, live, by blocks and in every output."""

import json
from collections.abc import Callable

import numpy as np
import pytest

from firmware_protocol.block_decoder import BatchDecoder
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.frame_blocks import FrameList
from firmware_protocol.messages import EVERY_HUB, HUB_ITSELF, Coupling, MessageType, SetRate, SetStream, TimeSync
from firmware_protocol.reference_frames import payload_bytes
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind
from gateway.core.reasons import Code, Notice, Reason
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.core import SessionCore
from gateway.core.session.reasons import SessionCode
from gateway.core.session.statement_watch import StatementWatch
from gateway.core.text.wording import notice_text
from gateway.core.wheels.reasons import WheelCode
from gateway.diagnosis.campaign_recording import ReadOrder, read_recording
from tests.core.session.hub_frames import BLOCK, HELLO, HubFrames
from tests.testkit.commands import invoked

START_NS = 1_700_000_000_000_000_000
FL = {(0, 0): "FL"}


def streamed(hub: HubFrames) -> list[Notice]:
    watch, decoder = StatementWatch(FL), FrameDecoder()
    for data in hub.stream:
        watch.take("x", FrameList(decoder.feed(data)))
    watch.counters("x", decoder.counters)
    return watch.contradictions()


def batched(hub: HubFrames, block_bytes: int) -> list[Notice]:
    watch, decoder = StatementWatch(FL), BatchDecoder()
    data = b"".join(hub.stream)
    for index in range(0, len(data), block_bytes):
        watch.take("x", decoder.feed(data[index : index + block_bytes]))
    watch.take("x", decoder.finish())
    watch.counters("x", decoder.counters)
    return watch.contradictions()


def raw_hello(**changes: object) -> bytes:
    """Return the payload of a hello that no encoder would make."""
    fields = {**HELLO._asdict(), "coupling": int(HELLO.coupling)}
    fields |= dict(zip(("firmware_major", "firmware_minor", "firmware_patch"), fields.pop("firmware"), strict=True))
    return payload_bytes(MessageType.HELLO, {**fields, **changes})


def other_axes(hub: HubFrames) -> None:
    hub.hello(axes=4)
    hub.samples(0.1)


def other_rate(hub: HubFrames) -> None:
    hub.hello(rate_hz=4800.0)
    hub.samples(5.0)


def jumping_numbers(hub: HubFrames) -> None:
    hub.hello()
    _, us = hub.samples(1.0)
    _, us = hub.samples(1.0, first=2**30, start_us=us)
    hub.samples(1.0, first=50, start_us=us)


def zero_scale(hub: HubFrames) -> None:
    hub.add(MessageType.HELLO, raw_hello(scale_mps2=[0.125, 0.0, 0.0]))


def absurd_scale(hub: HubFrames) -> None:
    hub.hello(scale_mps2=(0.125, 0.125, 1e3))


def scale_against_range(hub: HubFrames) -> None:
    hub.hello(range_mps2=(4e3, 4e3, 400.0))


def unstated_range(hub: HubFrames) -> None:
    """Hub of an imported measurement, whose scale is no statement about the sensor."""
    hub.hello(range_mps2=(0.0, 0.0, 0.0), scale_mps2=(1e-6, 1e-6, 1e3))


def absurd_zero(hub: HubFrames) -> None:
    hub.hello(offset_counts=(0.0, 0.0, -1e5))


def highpass_with_dc(hub: HubFrames) -> None:
    hub.add(MessageType.HELLO, raw_hello(highpass_hz=2.5))


def alternating_sensors(hub: HubFrames) -> None:
    for sensor in (0xA001, 0xA002) * 3:
        hub.hello(sensor_id=sensor)


def different_boot_counts(hub: HubFrames) -> None:
    for _ in range(3):
        hub.hello(0, boot_count=5)
        hub.hello(1, boot_count=6)


def number_255(hub: HubFrames) -> None:
    hub.hub = EVERY_HUB
    hub.hello()


def wheel_messages_of_the_hub(hub: HubFrames) -> None:
    hub.hello(HUB_ITSELF)
    hub.samples(0.1, wheel=HUB_ITSELF)
    hub.environment(wheel=HUB_ITSELF)


def time_against_tick(hub: HubFrames) -> None:
    hub.send(MessageType.TIME_SYNC, TimeSync(2**32 + 7, 0), HUB_ITSELF, 7)
    hub.send(MessageType.TIME_SYNC, TimeSync(2**32 + 7, 0), HUB_ITSELF, 8)


def only_unknown_types(hub: HubFrames) -> None:
    hub.hello(1)
    for _ in range(7):
        hub.add(99, b"new", 0)


def impossible_pressure(hub: HubFrames) -> None:
    hub.environment(-2e9)


def impossible_temperature(hub: HubFrames) -> None:
    hub.environment(temperature_degc=-320.0)


def changing_hello(hub: HubFrames) -> None:
    for index in range(20):
        hub.hello(rate_hz=4800.0 + index)


def repeated_samples(hub: HubFrames) -> None:
    hub.hello()
    for _ in range(10):
        hub.samples(36 / 9600)


def repeated_stretch(hub: HubFrames) -> None:
    """Send 20 of 100 blocks again under new counters."""
    hub.hello()
    block_s = BLOCK / 9600
    first, start_us = hub.samples(80.5 * block_s)
    last = hub.samples(20.5 * block_s, first=first, start_us=start_us)
    hub.samples(20.5 * block_s, first=first, start_us=start_us)
    hub.samples(0.5, first=last[0], start_us=last[1])


def looped_back(hub: HubFrames) -> None:
    hub.send(MessageType.SET_RATE, SetRate(9600.0), HUB_ITSELF)
    hub.send(MessageType.SET_STREAM, SetStream(True), 3)


def swapped_bytes(hub: HubFrames) -> None:
    hub.hello()
    hub.samples(5.0, change=lambda counts: counts.byteswap())


def steady_value_with_ac(hub: HubFrames) -> None:
    hub.hello(coupling=Coupling.AC)
    contact = np.arange(BLOCK) < 4
    hub.samples(5.0, change=lambda counts: counts + np.where(contact[:, None], 0, [0, 0, 8000]).astype("<i2"))


CASES: list[tuple[Callable[[HubFrames], None], str, Code, dict[str, object]]] = [
    (other_axes, "FL", SessionCode.HELLO_AXES_DIFFER, {"stated": ("radial",), "count": 26}),
    (other_rate, "FL", SessionCode.HELLO_RATE_DIFFERS, {"stated_hz": 4800.0, "measured_hz": 9600, "count": 4}),
    (jumping_numbers, "FL", SessionCode.SAMPLE_NUMBERS_JUMP, {"count": 2}),
    (zero_scale, "FL", SessionCode.HELLO_SCALE_ZERO, {"axes": ("lateral", "radial"), "count": 1}),
    (absurd_scale, "FL", SessionCode.HELLO_SCALE_ABSURD, {"axis": "radial", "full_scale_mps2": 32e6, "count": 1}),
    (
        scale_against_range,
        "FL",
        SessionCode.HELLO_SCALE_AGAINST_RANGE,
        {"axis": "radial", "range_mps2": 400.0, "count": 1},
    ),
    (absurd_zero, "FL", SessionCode.HELLO_ZERO_ABSURD, {"offset_counts": -1e5, "count": 1}),
    (highpass_with_dc, "FL", SessionCode.HELLO_HIGHPASS_WITH_DC, {"highpass_hz": 2.5, "count": 1}),
    (alternating_sensors, "FL", SessionCode.HELLO_SENSORS_ALTERNATE, {"sensor": "0000a002", "count": 4}),
    (different_boot_counts, "hub 0", SessionCode.HUB_BOOT_COUNTS_DIFFER, {"own": 6.0, "other": 5.0, "count": 4}),
    (number_255, "hub 255", SessionCode.HUB_NUMBER_RESERVED, {"count": 1}),
    (wheel_messages_of_the_hub, "hub 0", SessionCode.HUB_SENDS_AS_WHEEL, {"count": 28}),
    (time_against_tick, "hub 0", SessionCode.HUB_TIME_AGAINST_TICK, {"tick_us": 8.0, "count": 1}),
    (only_unknown_types, "FL", SessionCode.ONLY_UNKNOWN_TYPES, {"count": 7}),
    (changing_hello, "FL", SessionCode.HELLO_KEEPS_CHANGING, {"count": 15}),
    (repeated_samples, "FL", SessionCode.SAMPLES_REPEATED, {"count": 9}),
    (repeated_stretch, "FL", SessionCode.SAMPLES_REPEATED, {"count": 20}),
    (looped_back, "hub 0", SessionCode.HUB_SENDS_COMMANDS, {"count": 2}),
    (impossible_pressure, "FL", SessionCode.PRESSURE_IMPOSSIBLE, {"pressure_pa": -2e9, "count": 1}),
    (swapped_bytes, "FL", WheelCode.SAMPLES_BYTES_SWAPPED, {"count": 2}),
    (steady_value_with_ac, "FL", WheelCode.HELLO_AC_WITH_STEADY_VALUE, {"axis": "radial", "count": 2}),
    (impossible_temperature, "FL", SessionCode.TEMPERATURE_IMPOSSIBLE, {"count": 1}),
]


@pytest.mark.parametrize(("bend", "subject", "code", "values"), CASES, ids=[case[0].__name__ for case in CASES])
def test_false_statement_is_named_once_with_its_count(
    bend: Callable[[HubFrames], None], subject: str, code: Code, values: dict[str, object]
) -> None:
    hub = HubFrames()
    bend(hub)
    (notice,) = streamed(hub)
    assert (notice.subject, notice.reason.code) == (subject, code)
    for name, value in values.items():
        expected = pytest.approx(value, rel=1e-3) if isinstance(value, float | int) else value
        assert notice.reason[name] == expected, name
    assert notice_text(notice).isprintable()
    for block_bytes in (300, 5000, 1 << 20):
        assert batched(hub, block_bytes) == [notice]


def test_unstated_range_is_no_statement() -> None:
    hub = HubFrames()
    unstated_range(hub)
    assert streamed(hub) == batched(hub, 4096) == []


def test_still_clock_is_named() -> None:
    hub = HubFrames()
    hub.hello()
    for first in range(0, 48_000, 36):
        hub.samples(36 / 9600, first=first)
    codes = {notice.reason.code for notice in streamed(hub)}
    assert SessionCode.HUB_CLOCK_STILL in codes
    assert batched(hub, 4096) == streamed(hub)


def test_hub_that_follows_the_protocol_is_not_named() -> None:
    rng = np.random.default_rng(4)
    hub = HubFrames()
    hub.hello()
    hub.samples(0.5, first=2**32 - 2000, start_us=2**32 - 1e5)
    hub.hello()
    first, us = hub.samples(6.0, first=2800, start_us=4e5)
    # Ten minutes without a connection, then a change of rate and a restart.
    first, us = hub.samples(3.0, first=first + 600 * 9600, start_us=us + 600e6)
    hub.hello(rate_hz=4800.0)
    hub.samples(3.0, start_us=us, rate_hz=4800.0)
    hub.hello(boot_count=6, coupling=Coupling.AC, highpass_hz=2.0)
    hub.samples(3.0, first=77, start_us=1e5, rate_hz=9600.0 * 1.0005)
    hub.environment()
    hub.send(MessageType.TIME_SYNC, TimeSync(2**32 + 7, 0), HUB_ITSELF, 7)
    remaining = [data for data in hub.stream if rng.random() > 0.02]
    for index in range(10, len(remaining) - 3, 97):
        remaining[index : index + 3] = remaining[index : index + 3][::-1]
    hub.stream = [hub.stream[0], *remaining]
    assert streamed(hub) == []
    assert batched(hub, 9999) == []


def test_new_connection_begins_anew() -> None:
    watch, decoder, hub = StatementWatch(), FrameDecoder(), HubFrames()
    hub.hello()
    hub.samples(1.0)
    watch.take("x", FrameList(decoder.feed(b"".join(hub.stream))))
    watch.reopened("x")
    hub.stream.clear()
    hub.samples(1.0, first=10**6, start_us=5.0)
    watch.take("x", FrameList(decoder.feed(b"".join(hub.stream))))
    assert watch.contradictions() == []


def session(hub: HubFrames, toml: str | None = None) -> tuple[SessionCore, list[Notice]]:
    core = SessionCore(parse_vehicle(toml, "test") if toml else None)
    for number, data in enumerate(hub.stream):
        core.take(Chunk("x", START_NS + number * 3_750_000, data))
        core.tick(START_NS + number * 3_750_000)
    core.finish()
    return core, core.take_notices()


def test_session_names_it_at_once_and_counts_at_the_end() -> None:
    hub = HubFrames()
    other_axes(hub)
    core, notices = session(hub)
    assert [notice.reason.code for notice in notices].count(SessionCode.HELLO_AXES_DIFFER) == 1
    (final,) = core.false_statements()
    assert final.reason["count"] == 26
    core.take(LinkEvent("x", START_NS, LinkEventKind.RESTORED))


def test_outputs_show_it(tmp_path) -> None:
    hub = HubFrames()
    other_rate(hub)
    path = tmp_path / "x.mcap"
    writer = RecordingWriter(path, start_ns=START_NS)
    for number, data in enumerate(hub.stream):
        writer.write(Chunk("x", START_NS + number * 3_750_000, data))
    writer.close()
    said = "hub0.wheel0: HELLO states 4800 Hz, but samples come at 9600 Hz by the hub's clock (4 so far, each over 2 s)"
    assert said in invoked("inspect", path).output
    assert said in invoked("estimate", path).output
    read = read_recording(ReadOrder(path, 0, "x", None, None, 2))
    assert [notice.reason.code for notice in read.notices] == [SessionCode.HELLO_RATE_DIFFERS]
    lines = invoked("replay", path, "--plain", "--speed", "max").output.splitlines()
    notices = [line for line in lines if "HELLO states 4800 Hz" in line]
    # Once when it is found, with the count so far, and once in the summary.
    assert len(notices) == 2
    assert notices[0].startswith("# hub0.wheel0: ")
    assert notices[1].startswith(said)
    (entry,) = json.loads(invoked("inspect", path, "--json").output)["notices"]
    assert entry["subject"] == "hub0.wheel0"
    assert entry["level"] == "warning"
    assert entry["reason"]["code"] == "hello_rate_differs"
    assert entry["reason"]["values"]["count"] == 4


def test_two_links_are_told_apart() -> None:
    watch = StatementWatch()
    for link in ("a", "b"):
        hub = HubFrames()
        absurd_scale(hub)
        watch.take(link, FrameList(FrameDecoder().feed(b"".join(hub.stream))))
    assert [notice.subject for notice in watch.contradictions()] == ["a, hub0.wheel0", "b, hub0.wheel0"]
    assert [notice.reason.code for notice in watch.new()] == [SessionCode.HELLO_SCALE_ABSURD] * 2
    assert watch.new() == []


def test_reasons_are_values() -> None:
    hub = HubFrames()
    zero_scale(hub)
    (notice,) = streamed(hub)
    assert notice.reason == Reason(SessionCode.HELLO_SCALE_ZERO, axes=("lateral", "radial"), count=1)
