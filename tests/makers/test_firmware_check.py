"""The check of a firmware names every deliberate fault by its clause, and finds none where there is none."""

import re
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.messages import MessageType
from firmware_protocol.reference_cmac import aes_cmac
from firmware_protocol.reference_frames import payload_bytes
from firmware_protocol.signing import sign
from gateway.core.contacts.reasons import ContactCode
from gateway.core.links.source import Chunk
from gateway.core.reasons import Code, Reason
from gateway.core.session.reasons import SessionCode
from gateway.core.session.statement_watch import __file__ as watch_file
from gateway.core.wheels.reasons import WheelCode
from gateway.makers.check.clauses import CheckReport, Clause, Verdict
from gateway.makers.check.firmware_check import CLAUSE_OF, FirmwareCheck
from gateway.makers.commands.clause_report import report_lines
from gateway.makers.reasons import FirmwareCode
from gateway.security.cmac import Key
from tests.makers.wrong_firmware import BLOCK, HELLO, WRONG, Sent, Stream, frames, right, right_stream

START_NS = 1_700_000_000_000_000_000
KEYS = {f"{HELLO.sensor_id:08x}": Key(bytes(range(16))), f"{HELLO.hub_id:016x}": Key(bytes(range(16, 32)))}
# Clauses that cannot but break with the fault's own.
ALSO = {
    "boot_count not counted": {Clause.ONCE},
    "tick in ms": {Clause.RATE},
    "tick of 16 bits": {Clause.RATE},
    "clock 5 % fast": {Clause.RATE},
    "first_sample leaves holes": {Clause.RATE},
    "scale against range": {Clause.SCALE},
    "no HELLO": {Clause.HELLO_FIRST},
    "values of absent axes": {Clause.AXES},
    "drops without their numbers": {Clause.NUMBERS},
}
# Without commands, keys or a known link.
ONLY_WITH_MORE = {clause for clause in Clause if clause.startswith("command-")} | {
    Clause.DROPS,
    Clause.HELLO_ABSENT,
    Clause.SIGNED_ALL,
    Clause.TAG,
}


def check(stream: Stream, *, piece: int | None = None, dated: bool = True, **options: object) -> CheckReport:
    firmware = FirmwareCheck("tcp:hub", options.pop("keys", {}), **options)
    if piece is not None:
        data = b"".join(data for _, data in stream)
        stream = [(1.0, data[index : index + piece]) for index in range(0, len(data), piece)]
    for time_s, data in stream:
        firmware.chunk(Chunk("tcp:hub", START_NS + round(time_s * 1e9) if dated else 0, data))
    return firmware.finish()


def with_verdict(report: CheckReport, *verdicts: Verdict) -> set[Clause]:
    return {result.clause for result in report.clauses if result.verdict in verdicts}


def test_a_right_firmware_passes_everything_it_exercises() -> None:
    report = check(right_stream())
    assert with_verdict(report, Verdict.FAILED, Verdict.ADVISED) == set()
    assert with_verdict(report, Verdict.NOT_EXERCISED) == ONLY_WITH_MORE
    assert report.frames == len(right_stream())


@pytest.mark.parametrize("name", WRONG)
def test_every_wrong_firmware_is_named_by_its_clause(name: str) -> None:
    clause, make = WRONG[name]
    stream = make()
    report = check(stream)
    assert with_verdict(report, Verdict.FAILED, Verdict.ADVISED) == {Clause(clause), *ALSO.get(name, ())}
    result = next(result for result in report.clauses if result.clause == clause)
    assert result.findings
    data = b"".join(data for _, data in stream)
    for finding in result.findings:
        if finding.at_byte is not None:
            assert finding.example
            assert data[finding.at_byte :].startswith(finding.example)


@pytest.mark.parametrize(
    ("factor", "code"),
    [
        (1.0 / 9.80665, ContactCode.RADIAL_IS_IN_G),
        (9.80665, ContactCode.RADIAL_IS_IN_MPS2),
        # The standard deviation that is stated is that of a wheel at rest.
        (1.0 / 100.0, FirmwareCode.SCALE_OFF_BY_POWER_OF_TWO),
    ],
)
def test_a_wrong_unit_of_a_wheel_that_rolls_is_named(factor: float, code: Code) -> None:
    hello = HELLO._replace(scale_mps2=(0.128 * factor,) * 3, range_mps2=(4096.0 * factor,) * 3)
    report = check(frames(right(5.0, hello)))
    result = next(result for result in report.clauses if result.clause is Clause.SCALE)
    assert {finding.reason.code for finding in result.findings} == {code}


def test_hum_at_rest_is_no_rotation() -> None:
    def at_rest(sent: Sent) -> Sent:
        if sent.type != MessageType.SAMPLES:
            return sent
        time_s = (int.from_bytes(sent.payload[:4], "little") + np.arange(BLOCK)) / HELLO.rate_hz
        rows = np.stack([0.0 * time_s, 0.0 * time_s, 9.8 + 4.0 * np.sin(2.0 * np.pi * 25.0 * time_s)], axis=1)
        return sent._replace(payload=sent.payload[:6] + np.round(rows / 0.128).astype("<i2").tobytes())

    report = check(frames(map(at_rest, right(5.0))))
    result = next(result for result in report.clauses if result.clause is Clause.SCALE)
    assert result.verdict is Verdict.NOT_EXERCISED
    assert result.why is not None
    assert result.why["why"] == "at_rest"


def test_a_clock_in_ms_is_named_without_arrival_times_too() -> None:
    report = check(WRONG["tick in ms"][1](), dated=False)
    result = next(result for result in report.clauses if result.clause is Clause.TICK)
    assert [finding.reason["how"] for finding in result.findings] == ["ms"]
    assert not [result for result in report.clauses if result.why is not None and result.why["why"] == "too_short"]
    # What rests on the clock is no fault of its own.
    assert with_verdict(report, Verdict.FAILED, Verdict.ADVISED) == {Clause.TICK, Clause.RATE}


def test_rows_claims_no_more_than_it_sees() -> None:
    def swapped(sent: Sent) -> Sent:
        if sent.type != MessageType.SAMPLES:
            return sent
        counts = np.frombuffer(sent.payload[6:], "<i2").reshape(-1, 3)
        return sent._replace(payload=sent.payload[:6] + counts[:, [1, 0, 2]].tobytes())

    result = next(r for r in check(frames(map(swapped, right(5.0)))).clauses if r.clause is Clause.ROWS)
    assert result.verdict is Verdict.PASSED
    assert result.clause.words == "rows of signed counts, the radial axis in its place, positive inward"


@pytest.mark.parametrize(
    ("old", "new", "cause"),
    [
        (rb"[\x11\x13]", b"", "altered"),
        (rb"\n", b"\r\n", "altered"),
        (rb"\r", b"\n", "altered"),
        (rb"\x12", b"\x92", "unknown"),
    ],
)
def test_bytes_that_a_terminal_altered_are_told_from_a_bad_cable(old: bytes, new: bytes, cause: str) -> None:
    data = re.sub(old, new, b"".join(data for _, data in right_stream()))
    report = check([(0.0, data)], piece=4096, dated=False)
    reasons = [
        finding.reason for result in report.clauses if result.clause is Clause.CRC for finding in result.findings
    ]
    assert [(reason.code, reason["cause"]) for reason in reasons] == [(FirmwareCode.SOME_FRAMES_DAMAGED, cause)]


def test_counters_that_restart_are_not_called_one_counter() -> None:
    """Most frames of a hub with one wheel are its samples, whose steps tell nothing of the other sources."""
    of_one_wheel = [sent for sent in right() if sent.wheel != 1]
    report = check(frames(of_one_wheel, boot=lambda sent: sent.type == MessageType.HELLO))
    result = next(result for result in report.clauses if result.clause is Clause.SEQ)
    assert result.verdict is Verdict.FAILED
    assert Reason(FirmwareCode.SEQ_WRONG, how="shared") not in {finding.reason for finding in result.findings}


def test_every_clause_has_a_firmware_that_breaks_it() -> None:
    """Those of commands and signatures are broken in tests of their own."""
    elsewhere = {clause for clause in Clause if clause.startswith("command-")} | {
        Clause.SIGNED_ALL,
        Clause.TAG,
        Clause.THROUGHPUT,
    }
    assert {Clause(clause) for clause, _ in WRONG.values()} == set(Clause) - elsewhere


def test_every_code_of_the_watch_over_statements_has_a_clause() -> None:
    source = Path(watch_file).read_text("utf-8")
    named = {getattr(SessionCode, name) for name in re.findall(r"SessionCode\.(\w+)[,)]", source)}
    named |= {WheelCode.SAMPLES_BYTES_SWAPPED, WheelCode.HELLO_AC_WITH_STEADY_VALUE}
    # Types that are not defined are found in every frame; wheels are refused by the reader's own limit.
    assert named - set(CLAUSE_OF) == {SessionCode.ONLY_UNKNOWN_TYPES, SessionCode.WHEELS_REFUSED}
    assert set(CLAUSE_OF) <= named


@pytest.mark.parametrize("piece", [1000, 4096])
def test_a_dump_without_times_passes_too(piece: int) -> None:
    report = check(right_stream(), piece=piece, dated=False)
    assert with_verdict(report, Verdict.FAILED, Verdict.ADVISED) == set()
    assert Clause.TICK in with_verdict(report, Verdict.NOT_EXERCISED)
    assert Clause.HELLO_PERIOD in with_verdict(report, Verdict.PASSED)


def test_a_stream_joined_in_the_middle_passes_too() -> None:
    stream = right_stream()[500:]
    report = check([(stream[0][0], stream[0][1][7:]), *stream[1:]])
    assert with_verdict(report, Verdict.FAILED, Verdict.ADVISED) == set()
    assert Clause.START in with_verdict(report, Verdict.NOT_EXERCISED)


@pytest.mark.parametrize("fast_s", [0, 30])
def test_clock_and_numbers_may_wrap(fast_s: int) -> None:
    def later(sent):
        tick = sent.tick_us + 2**32 - 3_000_000
        payload = sent.payload
        if sent.type == MessageType.SAMPLES:
            payload = ((int.from_bytes(payload[:4], "little") + 2**32 - 5000) % 2**32).to_bytes(4, "little") + payload[
                4:
            ]
        elif sent.type == MessageType.TIME_SYNC:
            payload = payload_bytes(MessageType.TIME_SYNC, {"hub_us": tick, "host_ns": 0})
        elif sent.type == MessageType.HUB_STATUS:
            payload = (tick // 1_000_000 + fast_s).to_bytes(4, "little") + payload[4:]
        return sent._replace(tick_us=tick, payload=payload)

    report = check(frames(map(later, right())))
    wrong = [finding.reason for result in report.clauses for finding in result.findings]
    assert with_verdict(report, Verdict.FAILED, Verdict.ADVISED) == ({Clause.STATUS_VALUES} if fast_s else set())
    assert [round(reason["uptime_s"] - reason["clock_s"]) for reason in wrong] == [fast_s] * len(wrong)


def test_a_restart_with_a_higher_boot_count_passes() -> None:
    second = [s._replace(time_s=s.time_s + 4.0) for s in right(4.0, HELLO._replace(boot_count=6))]
    report = check(frames([*right(4.0), *second], boot=lambda sent: sent == second[0]))
    assert with_verdict(report, Verdict.FAILED, Verdict.ADVISED) == set()
    assert next(r for r in report.clauses if r.clause is Clause.START).checked == 6


def test_no_frames_is_no_pass() -> None:
    report = check([(0.0, b"$GPGGA,123519,4807.038,N\r\n" * 40)])
    assert with_verdict(report, Verdict.FAILED) == {Clause.SYNC}
    assert with_verdict(report, Verdict.PASSED) == set()
    assert report.clauses[0].findings[0].reason.code is SessionCode.LINE_NOT_A_HUB


def test_the_link_must_carry_the_samples() -> None:
    needed = 2 * 4000.0 * (6 + 26 / 36)
    assert (
        with_verdict(check(right_stream(), capacity_bytes_per_s=2 * needed), Verdict.ADVISED, Verdict.FAILED) == set()
    )
    assert with_verdict(check(right_stream(), capacity_bytes_per_s=1.1 * needed), Verdict.ADVISED) == {
        Clause.THROUGHPUT
    }
    assert with_verdict(check(right_stream(), capacity_bytes_per_s=0.9 * needed), Verdict.FAILED) == {Clause.THROUGHPUT}


def signed(stream: Stream, secrets: dict[int, bytes], *, every: int = 1) -> Stream:
    """Sign the frames of wheel 0 and of the hub; blocks keep their length, so only short frames are signed."""
    result = []
    for index, (time_s, data) in enumerate(stream):
        secret = secrets.get(data[6])
        if secret is not None and data[4] <= 216 and index % every == 0:
            identity = HELLO.hub_id if data[6] == 255 else HELLO.sensor_id
            data = sign(data, identity, HELLO.boot_count, lambda body, secret=secret: aes_cmac(secret, body))
        result.append((time_s, data))
    return result


def of_hub_and_one_wheel() -> Stream:
    short = [sent for sent in right() if sent.type != MessageType.SAMPLES and sent.wheel != 1]
    return frames(short)


def test_signatures_pass_under_their_keys() -> None:
    stream = signed(of_hub_and_one_wheel(), {0: bytes(range(16)), 255: bytes(range(16, 32))})
    report = check(stream, keys=KEYS)
    assert {Clause.SIGNED_ALL, Clause.TAG} <= with_verdict(report, Verdict.PASSED)


def test_a_wrong_key_is_named() -> None:
    report = check(signed(of_hub_and_one_wheel(), {0: bytes(16)}), keys=KEYS)
    assert with_verdict(report, Verdict.FAILED) == {Clause.TAG}


def test_a_source_that_signs_some_of_its_frames_is_named() -> None:
    stream = signed(of_hub_and_one_wheel(), {0: bytes(range(16)), 255: bytes(range(16, 32))}, every=2)
    report = check(stream, keys=KEYS)
    assert with_verdict(report, Verdict.FAILED) == {Clause.SIGNED_ALL}


def test_without_the_key_the_tag_is_not_exercised() -> None:
    report = check(signed(of_hub_and_one_wheel(), {0: bytes(range(16))}))
    result = next(r for r in report.clauses if r.clause is Clause.TAG)
    assert result.verdict is Verdict.NOT_EXERCISED
    assert result.why is not None
    assert result.why.code is FirmwareCode.CHECK_NOT_DONE
    assert result.why["why"] == "no_key"


@given(st.binary(max_size=2000), st.integers(0, 2**31))
@settings(max_examples=60)
def test_any_bytes_give_a_report(noise: bytes, seed: int) -> None:
    """Whatever a firmware sends: noise, and intact frames with any content."""
    rng = np.random.default_rng(seed)
    stream = [(0.01 * k, data) for k, (_, data) in enumerate(right_stream()[:: max(1, seed % 37)][:120])]
    for _ in range(40):
        k = int(rng.integers(len(stream)))
        body = bytearray(stream[k][1][:-4])
        body[int(rng.integers(2, len(body)))] = int(rng.integers(256))
        stream[k] = stream[k][0], bytes(body) + crc32(bytes(body)).to_bytes(4, "little")
    stream.insert(int(rng.integers(len(stream))), (0.5, noise))
    report = check(stream, keys=KEYS)
    assert len(report.clauses) == len(Clause)
    assert list(report_lines(report))
