"""Clauses of the protocol that a firmware is checked against, and the ledger of what was found."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, NamedTuple

from gateway.core.reasons import Reason
from gateway.makers.check.seen_frame import SeenFrame, source_name

EXAMPLE_BYTES: Final = 48
"""Bytes that a finding keeps as its example."""


class Clause(StrEnum):
    """A clause of the specification, in the order of the report.

    Attributes:
        section: heading of the page of the protocol that states it.
        words: the clause in short.
    """

    section: str
    words: str

    def __new__(cls, value: str, section: str, words: str) -> "Clause":  # noqa: D102
        clause = str.__new__(cls, value)
        clause._value_ = value
        clause.section, clause.words = section, words
        return clause

    # Frame
    SYNC = "sync", "Frame", "a frame starts with A5 5A"
    CONTIGUOUS = "contiguous", "Frame", "frames are back to back, with nothing between them"
    LENGTH = "length", "Frame", "length is that of the payload"
    CRC = "crc", "Frame", "CRC-32 over all bytes before it"
    VERSION = "version", "Frame", "the version byte is that of the layout"
    TYPES = "types", "Frame", "types are defined, and those of a hub"
    FLAGS = "flags", "Frame", "flags are 0, except bit 0 of signed frames"
    LAYOUT = "layout", "Payloads", "payloads have the length of their layout"
    RANGES = "ranges", "Payloads", "values are within their ranges"
    # Counters and time
    SEQ = "seq", "Counters and time", "seq counts the frames of every source, one by one"
    START = "start", "Counters and time", "seq counts from 0 at every start"
    DROPS = "drops", "Counters and time", "a frame that could not be sent uses its number"
    TICK = "tick", "Counters and time", "tick_us counts us"
    TICK_MONOTONIC = "tick-monotonic", "Counters and time", "tick_us advances and is never set"
    TICK_FIRST = "tick-first", "Counters and time", "tick_us of SAMPLES is that of the first sample"
    JITTER = "jitter", "Counters and time", "tick_us of SAMPLES is even to 2 ms (recommended)"
    # HELLO and its values
    HELLO_FIRST = "hello-first", "HELLO and its values", "HELLO comes before the first SAMPLES"
    HELLO_PERIOD = "hello-period", "Counters and time", "HELLO every 2 s"
    HELLO_VALUES = "hello-values", "HELLO and its values", "scale and zero of present axes can be used"
    HELLO_ABSENT = "hello-absent", "HELLO and its values", "values of absent axes are 0 (recommended)"
    SCALE_RANGE = "scale-range", "HELLO and its values", "range, scale and saturation agree within a factor of 2"
    HELLO_COUPLING = "hello-coupling", "HELLO and its values", "highpass_hz is 0 with DC coupling"
    BOOT_COUNT = "boot-count", "HELLO and its values", "boot_count is that of the hub, and higher after every start"
    HELLO_SENSOR = "hello-sensor", "HELLO and its values", "one sensor per wheel"
    HUB_ITSELF = "hub-itself", "HELLO and its values", "no message of a wheel comes from wheel 255"
    HUB_NUMBER = "hub-number", "HELLO and its values", "the hub's number is not 255 (recommended)"
    # Samples
    AXES = "axes", "Sample numbers", "SAMPLES have the axes of HELLO"
    NUMBERS = "numbers", "Sample numbers", "first_sample counts every sample, and does not jump"
    RATE = "rate", "Sample numbers", "clock, samples and rate_hz agree within 3 % over 2 s"
    RATE_EXACT = "rate-exact", "Sample numbers", "clock, samples and rate_hz agree within 0.1 % (recommended)"
    ONCE = "once", "Sample numbers", "a sample is sent once"
    BYTE_ORDER = "byte-order", "Payloads", "counts are little endian"
    ROWS = "rows", "Payloads", "rows of signed counts, the radial axis in its place, positive inward"
    COUPLING = "coupling", "HELLO and its values", "AC coupling is stated of a signal without a steady value"
    SCALE = "scale", "Payloads", "the steady radial value is R Omega^2"
    # Other messages
    ENVIRONMENT_PERIOD = "environment-period", "Counters and time", "ENVIRONMENT every second"
    ENVIRONMENT_VALUES = "environment-values", "Payloads", "pressure and temperature are possible"
    STATUS_PERIOD = "status-period", "Counters and time", "HUB_STATUS every second"
    STATUS_VALUES = "status-values", "Payloads", "uptime_s and frames_sent are those of the hub"
    TIME_PERIOD = "time-period", "Counters and time", "TIME_SYNC every second"
    TIME_VALUES = "time-values", "Sample numbers", "the low bits of hub_us are tick_us"
    LOG = "log", "LOG_TEXT", "UTF-8, a defined level, at most 10 a second"
    # Signed frames
    SIGNED_ALL = "signed-all", "Signed frames", "a source signs all of its frames or none"
    TAG = "tag", "Signed frames", "tags are right under the key of their source"
    # Commands
    COMMAND_ANSWER = "command-answer", "Commands", "COMMAND_RESULT of the hub repeats seq and type"
    COMMAND_CRC = "command-crc", "Commands", "a command with a bad CRC is dropped without an answer"
    COMMAND_UNKNOWN = "command-unknown", "Commands", "an unknown command has outcome 1"
    COMMAND_VALUE = "command-value", "Commands", "a value out of range has outcome 2"
    COMMAND_TIME = "command-time", "Commands", "TIME_SYNC repeats the time of SET_TIME"
    COMMAND_STREAM = "command-stream", "Commands", "SET_STREAM stops and starts the samples, and nothing else"
    COMMAND_RATE = "command-rate", "Commands", "HELLO follows SET_RATE at once"
    COMMAND_REPEATED = "command-repeated", "Commands", "a repeated command is done again; signed, it has outcome 5"
    COMMAND_VERIFIED = (
        "command-verified",
        "Signed commands",
        "a hub that signs refuses unsigned commands with outcome 4",
    )
    # Link
    THROUGHPUT = "throughput", "Counters and time", "blocks are full, and the link carries them"
    LOSS = "loss", "Counters and time", "no frame and no sample is lost"


class Verdict(StrEnum):
    """What became of a clause."""

    PASSED = "passed"
    ADVISED = "advised"
    """Only recommendations (SHOULD) are not followed."""
    FAILED = "failed"
    NOT_EXERCISED = "not exercised"


@dataclass(slots=True)
class Finding:
    """A violation of a clause by one source.

    Attributes:
        subject: name of the source, empty for the link.
        reason: what is wrong, with its values at the first time.
        is_advice: whether the clause recommends rather than demands.
        at_byte: place in the stream of the first example, None where there is no single one.
        example: bytes there, EXAMPLE_BYTES at most.
        count: how often.
    """

    subject: str
    reason: Reason
    is_advice: bool
    at_byte: int | None
    example: bytes
    count: int = 1


class ClauseResult(NamedTuple):
    """Result of one clause.

    Attributes:
        clause: which.
        verdict: what became of it.
        checked: how often it was exercised.
        findings: its violations.
        why: why it was not exercised, None where that is plain or it was.
    """

    clause: Clause
    verdict: Verdict
    checked: int
    findings: tuple[Finding, ...]
    why: Reason | None


class CheckReport(NamedTuple):
    """Result of a check.

    Attributes:
        link: name of the link.
        duration_s: time between the first byte and the last, 0 when not known.
        size_bytes: bytes received.
        frames: intact frames.
        clauses: all of them, in the order of `Clause`.
    """

    link: str
    duration_s: float
    size_bytes: int
    frames: int
    clauses: tuple[ClauseResult, ...]

    def count(self, verdict: Verdict) -> int:
        """Return how many clauses have a verdict."""
        return sum(result.verdict is verdict for result in self.clauses)


@dataclass(slots=True)
class Ledger:
    """What was exercised and what was found, clause by clause."""

    _checked: dict[Clause, int] = field(default_factory=dict)
    _findings: dict[Clause, dict[tuple[object, ...], Finding]] = field(default_factory=dict)
    _unexercised: dict[Clause, Reason] = field(default_factory=dict)

    def check(self, clause: Clause, count: int = 1) -> None:
        """Note that a clause was exercised."""
        self._checked[clause] = self._checked.get(clause, 0) + count

    def fail(
        self,
        clause: Clause,
        subject: str | SeenFrame,
        reason: Reason,
        example: bytes = b"",
        at_byte: int | None = None,
        *,
        is_advice: bool = False,
        count: int = 1,
    ) -> None:
        """Note a violation; of several with one code by one source, the first is the example.

        A frame stands for its source, its bytes and their place.
        """
        if isinstance(subject, SeenFrame):
            example, at_byte, subject = subject.data, subject.at_byte, source_name(subject.source)
        findings = self._findings.setdefault(clause, {})
        key = subject, reason.kind, is_advice
        if key in findings:
            findings[key].count += count
        else:
            findings[key] = Finding(subject, reason, is_advice, at_byte, example[:EXAMPLE_BYTES], count)

    def restate(self, clause: Clause, subject: str, reason: Reason, count: int) -> None:
        """Give a violation noted before its present values and count."""
        for finding in self._findings.get(clause, {}).values():
            if (finding.subject, finding.reason.kind) == (subject, reason.kind):
                finding.reason, finding.count = reason, count

    def leave(self, clause: Clause, why: Reason) -> None:
        """Note why a clause is not exercised; nothing where it was."""
        self._unexercised[clause] = why

    def has_failed(self, *clauses: Clause) -> bool:
        """Return whether anything was found against one of the clauses."""
        return any(self._findings.get(clause) for clause in clauses)

    def results(self) -> tuple[ClauseResult, ...]:
        """Return the results of all clauses."""
        return tuple(map(self._result, Clause))

    def _result(self, clause: Clause) -> ClauseResult:
        findings = tuple(self._findings.get(clause, {}).values())
        checked = self._checked.get(clause, 0)
        if any(not finding.is_advice for finding in findings):
            verdict = Verdict.FAILED
        elif findings:
            verdict = Verdict.ADVISED
        else:
            verdict = Verdict.PASSED if checked else Verdict.NOT_EXERCISED
        reason = self._unexercised.get(clause) if verdict is Verdict.NOT_EXERCISED else None
        return ClauseResult(clause, verdict, checked, findings, reason)
