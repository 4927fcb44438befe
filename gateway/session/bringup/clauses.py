"""Clauses of the protocol that a firmware is checked against, and the ledger of what was found."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, NamedTuple

from gateway.reasons import Reason
from gateway.session.bringup.seen_frame import SeenFrame, source_name

EXAMPLE_BYTES: Final = 48
"""Bytes that a finding keeps as its example."""


class Clause(StrEnum):
    """A clause of the specification, in the order of the report. The views have its words and its section."""

    # Frame
    SYNC = "sync"
    CONTIGUOUS = "contiguous"
    LENGTH = "length"
    CRC = "crc"
    VERSION = "version"
    TYPES = "types"
    FLAGS = "flags"
    LAYOUT = "layout"
    RANGES = "ranges"
    # Counters and time
    SEQ = "seq"
    START = "start"
    DROPS = "drops"
    TICK = "tick"
    TICK_MONOTONIC = "tick-monotonic"
    TICK_FIRST = "tick-first"
    JITTER = "jitter"
    # HELLO and its values
    HELLO_FIRST = "hello-first"
    HELLO_PERIOD = "hello-period"
    HELLO_VALUES = "hello-values"
    HELLO_ABSENT = "hello-absent"
    SCALE_RANGE = "scale-range"
    HELLO_COUPLING = "hello-coupling"
    BOOT_COUNT = "boot-count"
    HELLO_SENSOR = "hello-sensor"
    HUB_ITSELF = "hub-itself"
    HUB_NUMBER = "hub-number"
    # Samples
    AXES = "axes"
    NUMBERS = "numbers"
    RATE = "rate"
    RATE_EXACT = "rate-exact"
    ONCE = "once"
    BYTE_ORDER = "byte-order"
    ROWS = "rows"
    COUPLING = "coupling"
    SCALE = "scale"
    # Other messages
    ENVIRONMENT_PERIOD = "environment-period"
    ENVIRONMENT_VALUES = "environment-values"
    STATUS_PERIOD = "status-period"
    STATUS_VALUES = "status-values"
    TIME_PERIOD = "time-period"
    TIME_VALUES = "time-values"
    LOG = "log"
    # Signed frames
    SIGNED_ALL = "signed-all"
    TAG = "tag"
    # Commands
    COMMAND_ANSWER = "command-answer"
    COMMAND_CRC = "command-crc"
    COMMAND_UNKNOWN = "command-unknown"
    COMMAND_VALUE = "command-value"
    COMMAND_TIME = "command-time"
    COMMAND_STREAM = "command-stream"
    COMMAND_RATE = "command-rate"
    COMMAND_REPEATED = "command-repeated"
    COMMAND_VERIFIED = "command-verified"
    # Link
    THROUGHPUT = "throughput"
    LOSS = "loss"


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
        key = subject, reason.code, is_advice
        if key in findings:
            findings[key].count += count
        else:
            findings[key] = Finding(subject, reason, is_advice, at_byte, example[:EXAMPLE_BYTES], count)

    def restate(self, clause: Clause, subject: str, reason: Reason, count: int) -> None:
        """Give a violation noted before its present values and count."""
        for finding in self._findings.get(clause, {}).values():
            if (finding.subject, finding.reason.code) == (subject, reason.code):
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
        why = self._unexercised.get(clause) if verdict is Verdict.NOT_EXERCISED else None
        return ClauseResult(clause, verdict, checked, findings, why)
