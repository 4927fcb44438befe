"""A hub in memory that signs, verifies commands and answers challenges as the protocol page says."""

import threading
from collections import deque
from collections.abc import Iterator

from firmware_protocol import wire
from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import (
    HUB_ITSELF,
    Challenge,
    ChallengeAnswer,
    Command,
    CommandResult,
    Coupling,
    Frame,
    Hello,
    MessageType,
    Outcome,
)
from firmware_protocol.signing import is_signed, sign
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem
from gateway.security.cmac import Key, Verifier, mac
from gateway.security.key_file import hub_identity, sensor_identity

HUB_ID, SENSOR_ID = 0xABCD, 0xA001
HUB_KEY, SENSOR_KEY = Key(bytes(range(16))), Key(bytes(range(16, 32)))
KEYS = {hub_identity(HUB_ID): HUB_KEY, sensor_identity(SENSOR_ID): SENSOR_KEY}
SECONDS = 1_700_000_000


def hello_message(boot_count: int, minor: int) -> Hello:
    present = (1.0, 1.0, 1.0)
    return Hello(
        1,
        minor,
        HUB_ID,
        SENSOR_ID,
        (1, 0, 0),
        boot_count,
        9600.0,
        7,
        Coupling.DC,
        0.0,
        present,
        present,
        present,
        32767,
    )


class Hub:
    """A hub in memory: a two-way source that greets, carries out commands as the protocol says, and replies."""

    vehicle_toml = None
    link = "test:hub"
    rate_hz: float | None = None

    def __init__(self, *, signs: bool = True, minor: int = 1, boot_count: int = 41, highest: int = 0) -> None:
        self.signs, self.minor, self.boot_count, self.highest = signs, minor, boot_count, highest
        self.executed: list[tuple[int, Command]] = []
        self.received: list[bytes] = []
        self.replies = self.sign
        self.waiting: deque[bytes] = deque([self.hello()])
        self._seq = 0

    def sign(self, frame: bytes) -> bytes:
        if not self.signs:
            return frame
        of_hub = frame[wire.WHEEL_OFFSET] == HUB_ITSELF
        key, identity = (HUB_KEY, HUB_ID) if of_hub else (SENSOR_KEY, SENSOR_ID)
        return sign(frame, identity, self.boot_count, lambda data: mac(key, data))

    def hello(self) -> bytes:
        return self.sign(encode_frame(Frame(MessageType.HELLO, 0, 0, 0, 0, hello_message(self.boot_count, self.minor))))

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        yield LinkEvent(self.link, 0, LinkEventKind.CONNECTED)
        while self.waiting and not stop.is_set():
            yield Chunk(self.link, 0, self.waiting.popleft())

    def send(self, data: bytes) -> None:
        self.received.append(data)
        (frame,) = FrameDecoder().feed(data)
        if isinstance(frame.message, Challenge) and self.signs:
            self.highest = min(self.highest + 1, 2**32 - 1)
            answer = ChallengeAnswer(frame.message.nonce, self.boot_count, self.highest)
            self._reply(MessageType.CHALLENGE_ANSWER, answer)
            return
        seq, outcome = frame.seq, Outcome.DONE
        if self.signs and self.minor >= 1:
            if not is_signed(data) or not Verifier(HUB_KEY, HUB_ID, self.boot_count).is_genuine(data):
                outcome = Outcome.NOT_VERIFIED
            elif seq <= self.highest:
                seq, outcome = self.highest, Outcome.REPEATED
            else:
                self.highest = seq
        elif is_signed(data):
            return
        if outcome is Outcome.DONE:
            self.executed.append((frame.seq, frame.message))  # type: ignore[arg-type]
        self._reply(MessageType.COMMAND_RESULT, CommandResult(seq, frame.type, outcome))

    def _reply(self, kind: MessageType, message: ChallengeAnswer | CommandResult) -> None:
        self._seq += 1
        self.waiting.append(self.replies(encode_frame(Frame(kind, 0, HUB_ITSELF, self._seq, 0, message))))

    def close(self) -> None:
        self.waiting.clear()
