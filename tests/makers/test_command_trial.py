"""The trial of a hub's commands: a right hub passes, each wrong one is named by its clause."""

from collections.abc import Callable
from functools import partial

import pytest

from firmware_protocol import wire
from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import (
    HUB_ITSELF,
    CommandResult,
    Environment,
    Frame,
    HubStatus,
    Message,
    MessageType,
    Outcome,
    SampleBlock,
    SetRate,
    SetStream,
    SetTime,
    TimeSync,
)
from firmware_protocol.signing import is_signed, sign
from gateway.core.links.source import Chunk
from gateway.core.reasons import Reason
from gateway.makers.check.clauses import CheckReport, Clause, Verdict
from gateway.makers.check.command_trial import CLAUSES, CommandTrial
from gateway.makers.check.firmware_check import FirmwareCheck
from gateway.makers.reasons import FirmwareCode
from gateway.security.cmac import Key, mac
from tests.makers.wrong_firmware import HELLO, block

START_NS = 1_700_000_000_000_000_000
STEP_S = 0.05
SECRETS = {0: bytes(range(16)), HUB_ITSELF: bytes(range(16, 32))}
IDENTITIES = {0: HELLO.sensor_id, HUB_ITSELF: HELLO.hub_id}
KEYS = {f"{HELLO.sensor_id:08x}": Key(SECRETS[0]), f"{HELLO.hub_id:016x}": Key(SECRETS[HUB_ITSELF])}


class Hub:
    """A right hub with one wheel, whose time is advanced by the test."""

    def __init__(self, *, signs: bool = False) -> None:
        self.signs = signs
        self.now_us = 0
        self.seq: dict[int, int] = {}
        self.hello = HELLO
        self.running = True
        self.host_ns = 0
        self.highest: int | None = None
        self.first = 0
        self.begin_us = 0
        self.out = b""
        self.decoder = FrameDecoder()

    def send(self, type_: MessageType, message: Message, wheel: int = HUB_ITSELF, tick_us: int | None = None) -> None:
        seq = self.seq.get(wheel, 0)
        self.seq[wheel] = seq + 1
        frame = encode_frame(Frame(type_, 0, wheel, seq, self.now_us if tick_us is None else tick_us, message))
        if self.signs:
            frame = sign(frame, IDENTITIES[wheel], self.hello.boot_count, partial(mac, Key(SECRETS[wheel])))
        self.out += frame

    def advance(self, commands: bytes) -> bytes:
        """Take bytes of the gateway, let STEP_S pass, and return what was sent."""
        for frame in self.decoder.feed(commands):
            self.command(frame)
        for now_us in range(self.now_us, self.now_us + round(STEP_S * 1e6), 10_000):
            self.now_us = now_us
            if now_us % 2_000_000 == 0:
                self.send(MessageType.HELLO, self.hello, 0)
            if now_us % 1_000_000 == 0:
                sent = sum(self.seq.values())
                status = HubStatus(now_us // 1_000_000, None, 3.7, 0.1, None, sent, 0, 0, 0)
                self.send(MessageType.HUB_STATUS, status)
                self.send(MessageType.ENVIRONMENT, Environment(2.3e5, 31.0, 3.0), 0)
                self.send(MessageType.TIME_SYNC, TimeSync(now_us, self.host_ns))
            self.samples()
        self.now_us += 10_000
        out, self.out = self.out, b""
        return out

    def samples(self) -> None:
        rate_hz = self.hello.rate_hz
        while self.begin_us + (self.first + 30) / rate_hz * 1e6 <= self.now_us:
            if self.running:
                tick_us = self.begin_us + round(self.first / rate_hz * 1e6)
                self.send(MessageType.SAMPLES, self.block(), 0, tick_us)
            self.first += 30

    def block(self) -> SampleBlock:
        return block(self.first, 30)

    def command(self, frame: Frame) -> None:
        outcome = self.verify(frame)
        if outcome is None:
            outcome = self.execute(frame.message)
        self.answer(frame, outcome)

    def verify(self, frame: Frame) -> Outcome | None:
        return None

    def execute(self, message: Message) -> Outcome:
        if isinstance(message, SetTime):
            self.set_time(message.host_ns)
        elif isinstance(message, SetStream):
            self.running = message.running
        elif isinstance(message, SetRate):
            self.set_rate(message.rate_hz)
        return Outcome.DONE

    def set_time(self, host_ns: int) -> None:
        self.host_ns = host_ns

    def set_rate(self, rate_hz: float) -> None:
        self.hello = self.hello._replace(rate_hz=rate_hz)
        self.send(MessageType.HELLO, self.hello, 0)
        self.first, self.begin_us = 0, self.now_us

    def answer(self, frame: Frame, outcome: int) -> None:
        self.send(MessageType.COMMAND_RESULT, CommandResult(frame.seq, frame.type, outcome))


class RawHub(Hub):
    """A hub that reads commands as bytes, as its decoder must: unknown types, values out of range, tags."""

    def advance(self, commands: bytes) -> bytes:
        while commands:
            size = wire.OVERHEAD_BYTES + commands[wire.LENGTH_OFFSET]
            frame, commands = commands[:size], commands[size:]
            self.bytes_came(frame)
        return super().advance(b"")

    def bytes_came(self, frame: bytes) -> None:
        decoded = FrameDecoder().feed(frame)
        type_, seq = frame[3], int.from_bytes(frame[8:12], "little")
        if not FrameDecoder().feed(frame) and not self.is_intact(frame):
            return
        shown = Frame(type_, 0, HUB_ITSELF, seq, 0, SetStream(True))
        refused = self.refusal(frame, seq)
        if refused is not None:
            self.answer(shown._replace(seq=self.highest or 0) if refused == Outcome.REPEATED else shown, refused)
        elif not decoded:
            reference = type_ in (32, 33, 34)
            self.answer(shown, self.outcome_of_value() if reference else self.outcome_of_unknown())
        else:
            self.command(decoded[0])

    def refusal(self, frame: bytes, seq: int) -> Outcome | None:
        if not self.signs:
            return None
        if not is_signed(frame):
            return Outcome.NOT_VERIFIED
        if self.highest is not None and seq <= self.highest:
            return Outcome.REPEATED
        self.highest = seq
        return None

    def is_intact(self, frame: bytes) -> bool:
        decoder = FrameDecoder()
        decoder.feed(frame)
        return not decoder.counters.crc_errors

    def outcome_of_unknown(self) -> Outcome:
        return Outcome.UNKNOWN_COMMAND

    def outcome_of_value(self) -> Outcome:
        return Outcome.VALUE_REFUSED


def tried(hub: Hub, keys: dict[str, Key] | None = None, seconds: float = 15.0, behind_steps: int = 0) -> CheckReport:
    """Check a hub; a computer that is `behind_steps` behind what arrives sends its commands as much later."""
    check = FirmwareCheck("tcp:hub", keys or {})
    trial = CommandTrial(check.ledger, keys or {})
    waiting = [b""] * (behind_steps + 1)
    for step in range(round(seconds / STEP_S)):
        now_ns = START_NS + round((step + 1) * STEP_S * 1e9)
        sent = hub.advance(waiting.pop(0))
        frames = check.chunk(Chunk("tcp:hub", now_ns, sent)) if sent else []
        waiting.append(trial.step(frames, now_ns))
        if waiting[-1]:
            trial.sent(now_ns + round(behind_steps * STEP_S * 1e9))
        if trial.pausing is not None:
            check.may_pause(trial.pausing)
            trial.pausing = None
    trial.finish()
    return check.finish()


def verdicts(report: CheckReport) -> dict[Clause, Verdict]:
    return {result.clause: result.verdict for result in report.clauses if result.clause in CLAUSES}


def failed(report: CheckReport) -> set[Clause]:
    return {result.clause for result in report.clauses if result.verdict is Verdict.FAILED}


def test_a_right_hub_passes_every_command() -> None:
    report = tried(RawHub())
    assert failed(report) == set()
    assert {clause for clause, verdict in verdicts(report).items() if verdict is not Verdict.PASSED} == {
        Clause.COMMAND_VERIFIED
    }


def test_a_computer_that_is_behind_does_not_blame_the_hub() -> None:
    report = tried(RawHub(), seconds=60.0, behind_steps=round(2.5 / STEP_S))
    assert failed(report) == set()
    assert sum(verdict is Verdict.PASSED for verdict in verdicts(report).values()) == len(CLAUSES) - 1


def test_a_hub_that_signs_passes_every_command() -> None:
    report = tried(RawHub(signs=True), KEYS)
    assert failed(report) == set()
    assert set(verdicts(report).values()) == {Verdict.PASSED}


def test_without_its_key_a_hub_that_signs_is_sent_one_unsigned_command() -> None:
    report = tried(RawHub(signs=True))
    assert failed(report) == set()
    exercised = {clause for clause, verdict in verdicts(report).items() if verdict is Verdict.PASSED}
    assert exercised == {Clause.COMMAND_VERIFIED, Clause.COMMAND_ANSWER}


def test_a_hub_that_takes_no_commands_is_not_at_fault() -> None:
    class Deaf(Hub):
        def advance(self, commands: bytes) -> bytes:
            return super().advance(b"")

    report = tried(Deaf())
    assert failed(report) == set()
    assert set(verdicts(report).values()) == {Verdict.NOT_EXERCISED}
    result = next(result for result in report.clauses if result.clause is Clause.COMMAND_ANSWER)
    assert result.why is not None
    assert result.why == Reason(FirmwareCode.CHECK_NOT_DONE, why="hub_takes_no_commands")


def test_a_check_that_ends_early_says_so() -> None:
    report = tried(RawHub(), seconds=2.0)
    result = next(result for result in report.clauses if result.clause is Clause.COMMAND_RATE)
    assert result.why is not None
    assert result.why == Reason(FirmwareCode.CHECK_NOT_DONE, why="stopped_early")


def test_a_trial_that_has_ended_waits_for_no_answer() -> None:
    check, hub = FirmwareCheck("tcp:hub", {}), RawHub()
    trial = CommandTrial(check.ledger, {})
    data = b""
    for step in range(round(8.0 / STEP_S)):
        now_ns = START_NS + round((step + 1) * STEP_S * 1e9)
        # The link takes no more: what was asked last has no answer.
        answered = step * STEP_S < 4.0
        data = trial.step(check.chunk(Chunk("tcp:hub", now_ns, hub.advance(data if answered else b""))), now_ns)
        if not answered:
            trial.finish()
    assert failed(check.finish()) == set()


class AnswersDamaged(RawHub):
    def is_intact(self, frame: bytes) -> bool:
        return True


class AnswersAsWheel(RawHub):
    def answer(self, frame: Frame, outcome: int) -> None:
        self.send(MessageType.COMMAND_RESULT, CommandResult(frame.seq, frame.type, outcome), 0)


class AnswersOwnSeq(RawHub):
    def answer(self, frame: Frame, outcome: int) -> None:
        super().answer(frame._replace(seq=self.seq.get(HUB_ITSELF, 0)), outcome)


class AnswersOnce(RawHub):
    def answer(self, frame: Frame, outcome: int) -> None:
        if frame.type == MessageType.SET_TIME:
            super().answer(frame, outcome)


class TakesUnknown(RawHub):
    def outcome_of_unknown(self) -> Outcome:
        return Outcome.DONE


class TakesAnyValue(RawHub):
    def outcome_of_value(self) -> Outcome:
        return Outcome.DONE


class ForgetsTime(RawHub):
    def set_time(self, host_ns: int) -> None:
        self.host_ns = host_ns // 1000


class NeverStops(RawHub):
    def samples(self) -> None:
        self.running = True
        super().samples()


class NeverStartsAgain(RawHub):
    def execute(self, message: Message) -> Outcome:
        return Outcome.DONE if isinstance(message, SetStream) and message.running else super().execute(message)


class StopsWithItsStatus(RawHub):
    def send(self, type_: MessageType, message: Message, wheel: int = HUB_ITSELF, tick_us: int | None = None) -> None:
        if self.running or type_ == MessageType.COMMAND_RESULT:
            super().send(type_, message, wheel, tick_us)


class RefusesRate(RawHub):
    def execute(self, message: Message) -> Outcome:
        return Outcome.FAILED if isinstance(message, SetRate) else super().execute(message)


class KeepsOtherRate(RawHub):
    def set_rate(self, rate_hz: float) -> None:
        if rate_hz < self.hello.rate_hz:
            super().set_rate(rate_hz)
        else:
            self.send(MessageType.HELLO, self.hello, 0)


class RefusesTheSameAgain(RawHub):
    def verify(self, frame: Frame) -> Outcome | None:
        repeated, self.highest = frame.seq == self.highest, frame.seq
        return Outcome.REPEATED if repeated else None


class TakesUnsigned(RawHub):
    def refusal(self, frame: bytes, seq: int) -> Outcome | None:
        return super().refusal(frame, seq) if is_signed(frame) else None


class TakesReplays(RawHub):
    def refusal(self, frame: bytes, seq: int) -> Outcome | None:
        return None if is_signed(frame) else Outcome.NOT_VERIFIED


@pytest.mark.parametrize(
    ("make", "clause"),
    [
        (AnswersDamaged, Clause.COMMAND_CRC),
        (AnswersAsWheel, Clause.COMMAND_ANSWER),
        (AnswersOwnSeq, Clause.COMMAND_ANSWER),
        (AnswersOnce, Clause.COMMAND_ANSWER),
        (TakesUnknown, Clause.COMMAND_UNKNOWN),
        (TakesAnyValue, Clause.COMMAND_VALUE),
        (ForgetsTime, Clause.COMMAND_TIME),
        (NeverStops, Clause.COMMAND_STREAM),
        (NeverStartsAgain, Clause.COMMAND_STREAM),
        (StopsWithItsStatus, Clause.COMMAND_STREAM),
        (RefusesRate, Clause.COMMAND_RATE),
        (KeepsOtherRate, Clause.COMMAND_RATE),
        (RefusesTheSameAgain, Clause.COMMAND_REPEATED),
        (partial(TakesUnsigned, signs=True), Clause.COMMAND_VERIFIED),
        (partial(TakesReplays, signs=True), Clause.COMMAND_REPEATED),
    ],
)
def test_every_wrong_hub_is_named_by_its_clause(make: Callable[[], Hub], clause: Clause) -> None:
    hub = make()
    report = tried(hub, KEYS if hub.signs else None, seconds=20.0)
    assert {result for result in failed(report) if result in CLAUSES} == {clause}
    result = next(result for result in report.clauses if result.clause is clause)
    assert all(finding.example or finding.reason.code in ABSENT for finding in result.findings)


# What did not come has no bytes.
ABSENT = {FirmwareCode.COMMAND_FUTILE, FirmwareCode.MESSAGE_RATE_WRONG}
