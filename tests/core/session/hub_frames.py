"""Frames of a hub that follows the protocol, to be bent by tests."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.codec import encode_payload, encode_raw
from firmware_protocol.messages import Coupling, Environment, Hello, Message, MessageType, SampleBlock

RATE_HZ = 9600.0
BLOCK = 36
HELLO = Hello(
    1, 0, 0x7EAD, 0xA001, (1, 0, 0), 5, RATE_HZ, 7, Coupling.DC, 0.0, (4e3,) * 3, (0.125,) * 3, (0.0,) * 3, 32000
)
_COUNTS = np.random.default_rng(1).integers(-300, 300, (BLOCK, 3)).astype("<i2")


class HubFrames:
    """Encoder of one hub: counts the frames of each wheel, and keeps the bytes in the order of the stream."""

    def __init__(self, hub: int = 0) -> None:
        self.hub = hub
        self.stream: list[bytes] = []
        self._seq: dict[int, int] = {}

    def add(self, type_: int, payload: bytes, wheel: int = 0, tick_us: int = 0) -> None:
        """Append a frame around any payload."""
        seq = self._seq.get(wheel, 0)
        self._seq[wheel] = seq + 1
        self.stream.append(encode_raw(type_, payload, self.hub, wheel, seq, tick_us & 0xFFFFFFFF))

    def send(self, type_: MessageType, message: Message, wheel: int = 0, tick_us: int = 0) -> None:
        """Append a message."""
        self.add(type_, encode_payload(message), wheel, tick_us)

    def hello(self, wheel: int = 0, tick_us: int = 0, **changes: object) -> None:
        """Append a hello."""
        self.send(MessageType.HELLO, HELLO._replace(**changes), wheel, tick_us)

    def samples(
        self,
        seconds: float,
        *,
        wheel: int = 0,
        first: int = 0,
        start_us: float = 0.0,
        rate_hz: float = RATE_HZ,
        axes: int = 7,
        change: Callable[[NDArray[np.int16]], NDArray[np.int16]] = lambda counts: counts,
    ) -> tuple[int, float]:
        """Append sample blocks, with changed words; return the next sample number and its hub time in us."""
        counts = change(_COUNTS[:, : axes.bit_count()])
        for _ in range(round(seconds * rate_hz) // BLOCK):
            block = SampleBlock(first & 0xFFFFFFFF, axes, counts)
            self.send(MessageType.SAMPLES, block, wheel, round(start_us))
            first, start_us = first + BLOCK, start_us + BLOCK / rate_hz * 1e6
        return first, start_us

    def environment(self, pressure_pa: float = 2.3e5, temperature_degc: float = 30.0, wheel: int = 0) -> None:
        """Append a reading of the inner liner."""
        self.send(MessageType.ENVIRONMENT, Environment(pressure_pa, temperature_degc, 3.0), wheel)
