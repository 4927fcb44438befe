"""The codec against another reading of the declaration, byte for byte and refusal for refusal."""

import math
import zlib

import construct
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol import wire
from firmware_protocol.codec import decode_payload, encode_frame, encode_payload, encode_raw
from firmware_protocol.declaration import PAYLOADS
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import (
    CommandResult,
    Coupling,
    Environment,
    Frame,
    Hello,
    HubStatus,
    LogText,
    Message,
    MessageType,
    SampleBlock,
    SetRate,
    SetStream,
    SetTime,
    TimeSync,
)
from firmware_protocol.reference_frames import WireFrame, frame_bytes, payload_bytes
from tests.core.wire import declared_wire

U8, U16, U32, U64 = (st.integers(0, 2**bits - 1) for bits in (8, 16, 32, 64))
REAL = st.floats(width=32, allow_nan=False, allow_infinity=False)
POSITIVE = st.floats(0, width=32, allow_nan=False, allow_infinity=False)


def triples(values):
    return st.lists(values, min_size=3, max_size=3)


@st.composite
def sample_fields(draw):
    axes = draw(st.integers(1, 7))
    n = draw(st.integers(1, 218 // (2 * axes.bit_count())))
    counts = draw(st.binary(min_size=2 * n * axes.bit_count(), max_size=2 * n * axes.bit_count()))
    return {
        "first_sample": draw(U32),
        "axes": axes,
        "n": n,
        "counts": np.frombuffer(counts, "<i2").tolist(),
    }


FIELDS = {
    MessageType.HELLO: st.fixed_dictionaries(
        {
            "protocol_major": U8,
            "protocol_minor": U8,
            "firmware_major": U8,
            "firmware_minor": U8,
            "firmware_patch": U16,
            "axes": st.integers(1, 7),
            "coupling": st.integers(0, 1),
            "hub_id": U64,
            "sensor_id": U32,
            "boot_count": U32,
            "rate_hz": st.floats(2000, 25600, width=32),
            "highpass_hz": POSITIVE,
            "range_mps2": triples(POSITIVE),
            "scale_mps2": triples(REAL),
            "offset_counts": triples(REAL),
            "saturation_counts": st.integers(1, 32768),
        }
    ),
    MessageType.SAMPLES: sample_fields(),
    MessageType.ENVIRONMENT: st.fixed_dictionaries(
        {
            "pressure_pa": st.integers(-(2**31), 2**31 - 1),
            "temperature_cdegc": st.integers(-(2**15), 2**15 - 1),
            "supply_mv": U16,
        }
    ),
    MessageType.HUB_STATUS: st.fixed_dictionaries(
        {
            "uptime_s": U32,
            "frames_sent": U32,
            "frames_dropped": U32,
            "samples_dropped": U32,
            "link_retries": U32,
            "supply_uw": U32,
            "supply_mv": U16,
            "battery_percent": st.integers(0, 100) | st.just(255),
            "rssi_dbm": st.integers(-128, 127),
        }
    ),
    MessageType.TIME_SYNC: st.fixed_dictionaries({"hub_us": U64, "host_ns": U64}),
    MessageType.LOG_TEXT: st.fixed_dictionaries(
        {"level": U8, "text": st.text(max_size=55).map(lambda text: text.encode()[:223])}
    ),
    MessageType.COMMAND_RESULT: st.fixed_dictionaries({"seq": U32, "command": U8, "outcome": U8}),
    MessageType.SET_STREAM: st.fixed_dictionaries({"running": st.integers(0, 1)}),
    MessageType.SET_RATE: st.fixed_dictionaries({"rate_hz": st.floats(2000, 25600, width=32)}),
    MessageType.SET_TIME: st.fixed_dictionaries({"host_ns": U64}),
    MessageType.CHALLENGE: st.fixed_dictionaries({"nonce": U64}),
    MessageType.CHALLENGE_ANSWER: st.fixed_dictionaries({"nonce": U64, "boot_count": U32, "highest_seq": U32}),
}


def sendable(fields):
    """Return fields as they are, except that a hello keeps the rules between its fields."""
    if "scale_mps2" in fields:
        scale = [
            value or 1.0 if fields["axes"] >> axis & 1 else value for axis, value in enumerate(fields["scale_mps2"])
        ]
        fields = fields | {"scale_mps2": scale, "highpass_hz": fields["highpass_hz"] * fields["coupling"]}
    return fields


@st.composite
def wire_frames(draw):
    type_ = draw(st.sampled_from(MessageType))
    return WireFrame(type_, draw(U8), draw(U8), draw(U32), draw(U32), sendable(draw(FIELDS[type_])))


def same(a: Message, b: Message) -> bool:
    if isinstance(a, SampleBlock) and isinstance(b, SampleBlock):
        return a[:2] == b[:2] and a.counts.shape == b.counts.shape and bool((a.counts == b.counts).all())
    return a == b


@given(wire_frames())
def test_codec_and_declaration_agree_on_every_message(frame: WireFrame) -> None:
    data = frame_bytes(frame)
    payload = data[wire.HEADER_BYTES : -wire.CRC_BYTES]
    message = decode_payload(frame.type, payload)

    assert declared_wire.parse_payload(frame.type, payload) == frame.payload
    assert same(message, declared_wire.to_message(frame.type, frame.payload))
    assert encode_frame(declared_wire.to_frame(frame)) == data
    assert encode_payload(message) == payload
    (decoded,) = FrameDecoder().feed(data)
    assert decoded[:5] == frame[:5]
    assert same(decoded.message, message)


def bent_payloads(type_: MessageType):
    """Bytes that are nearly a payload: valid ones with bytes changed, cut or added."""

    @st.composite
    def bent(draw):
        payload = bytearray(payload_bytes(type_, draw(FIELDS[type_])))
        for position, value in draw(st.lists(st.tuples(st.integers(0, 80), U8), max_size=3)):
            if payload:
                payload[position % len(payload)] = value
        return (bytes(payload) + draw(st.binary(max_size=2)))[: draw(st.integers(0, 224))]

    return bent()


@given(st.sampled_from(MessageType).flatmap(lambda type_: st.tuples(st.just(type_), bent_payloads(type_))))
def test_codec_and_declaration_reject_the_same_payloads(case: tuple[MessageType, bytes]) -> None:
    type_, payload = case
    try:
        fields = declared_wire.parse_payload(type_, payload)
    except construct.ConstructError:
        with pytest.raises(ValueError):
            decode_payload(type_, payload)
        assert len(FrameDecoder().feed(encode_raw(type_, payload, 0, 0, 0, 0))) == 0
    else:
        message = decode_payload(type_, payload)
        expected = declared_wire.to_message(type_, fields)
        assert same(message, expected) or "nan" in repr(message)


HELLO = Hello(
    1, 0, 7, 8, (1, 2, 3), 9, 9600.0, 7, Coupling.AC, 2.0, (1e3, 1e3, 1e3), (0.1, 0.1, 0.1), (0.0, 0.0, 0.0), 32767
)
BLOCK = SampleBlock(0, 0b100, np.zeros((2, 1), np.int16))


@pytest.mark.parametrize(
    ("message", "name"),
    [
        (HELLO._replace(axes=0), "axes"),
        (HELLO._replace(axes=8), "axes"),
        (HELLO._replace(rate_hz=1999.0), "rate_hz"),
        (HELLO._replace(rate_hz=math.nan), "rate_hz"),
        (HELLO._replace(highpass_hz=-1.0), "highpass_hz"),
        (HELLO._replace(scale_mps2=(1.0, math.inf, 1.0)), "scale_mps2"),
        (HELLO._replace(scale_mps2=(1.0, 0.0, 1.0)), "scale_mps2"),
        (HELLO._replace(scale_mps2=(1.0, 1.0, 1e-60)), "scale_mps2"),
        (HELLO._replace(coupling=Coupling.DC), "highpass_hz"),
        (HELLO._replace(scale_mps2=(1.0, 1e39, 1.0)), "scale_mps2"),
        (HELLO._replace(range_mps2=(1.0, 1.0)), "range_mps2"),
        (HELLO._replace(saturation_counts=0), "saturation_counts"),
        (HELLO._replace(hub_id=2**64), "hub_id"),
        (HELLO._replace(firmware=(1, 2, 2**16)), "firmware_patch"),
        (BLOCK._replace(first_sample=-1), "first_sample"),
        (BLOCK._replace(axes=0), "axes"),
        (BLOCK._replace(counts=np.zeros((2, 2), np.int16)), "counts"),
        (BLOCK._replace(counts=np.zeros((110, 1), np.int16)), "counts"),
        (BLOCK._replace(counts=np.zeros((0, 1), np.int16)), "counts"),
        (BLOCK._replace(counts=np.full((2, 1), 40000)), "counts"),
        (BLOCK._replace(counts=np.full((2, 1), 0.5)), "counts"),
        (Environment(2e10, None, None), "pressure_pa"),
        (Environment(None, 400.0, None), "temperature_degc"),
        (Environment(None, math.nan, None), "temperature_degc"),
        (Environment(None, None, -0.1), "supply_v"),
        (HubStatus(0, 101, 0.0, 0.0, 0, 0, 0, 0, 0), "battery_percent"),
        (HubStatus(0, 100, 0.0, 0.0, -128, 0, 0, 0, 0), "rssi_dbm"),
        (HubStatus(2**32, 100, 0.0, 0.0, 0, 0, 0, 0, 0), "uptime_s"),
        (TimeSync(-1, 0), "hub_us"),
        (LogText(256, ""), "level"),
        (LogText(1, "ä" * 112), "text"),
        (CommandResult(2**32, 33, 0), "seq"),
        (CommandResult(0, 33, -1), "outcome"),
        (SetStream(2), "running"),
        (SetRate(1999.0), "rate_hz"),
        (SetRate(math.nan), "rate_hz"),
        (SetTime(2**64), "host_ns"),
    ],
)
def test_encoding_names_the_field_out_of_range(message: Message, name: str) -> None:
    with pytest.raises(ValueError, match=name):
        encode_payload(message)


@pytest.mark.parametrize(
    ("field", "value"), [("hub", 256), ("wheel", -1), ("seq", 2**32), ("tick_us", -1), ("type", MessageType.HELLO)]
)
def test_encoding_names_the_header_field_out_of_range(field: str, value: int) -> None:
    frame = Frame(MessageType.TIME_SYNC, 0, 0, 0, 0, TimeSync(0, 0))._replace(**{field: value})
    with pytest.raises(ValueError, match=field):
        encode_frame(frame)


def test_samples_of_any_integer_type_are_encoded() -> None:
    wide = BLOCK._replace(counts=np.array([[-32768], [32767]], np.int64))
    assert encode_payload(wide)[-4:] == b"\x00\x80\xff\x7f"


def test_absent_values_survive() -> None:
    for message in (Environment(None, None, None), HubStatus(0, None, 1.0, 0.5, None, 1, 2, 3, 4)):
        type_ = MessageType.ENVIRONMENT if isinstance(message, Environment) else MessageType.HUB_STATUS
        assert decode_payload(type_, encode_payload(message)) == message


def test_invalid_utf8_is_replaced() -> None:
    assert decode_payload(MessageType.LOG_TEXT, b"\x02a\xffb") == LogText(2, "a\ufffdb")


def test_every_format_number_is_consistent() -> None:
    assert wire.HEADER_BYTES == 16
    assert (wire.MAX_PAYLOAD_BYTES - PAYLOADS[MessageType.SAMPLES].size) // 2 == wire.MAX_SAMPLES
    assert wire.MAX_FRAME_BYTES == 244
    good = encode_raw(0, b"", 0, 0, 0, 0)
    assert zlib.crc32(good) == wire.CRC_RESIDUE
    assert zlib.crc32(b"123456789") == wire.CRC_CHECK_VALUE
