"""A UART line in bits: output of a receiver for bytes sent at another baud rate."""

import numpy as np


def received(data: bytes, sent_baud: float, received_baud: float) -> bytes:
    """Return the bytes that a receiver (8N1) reads; bytes with a wrong stop bit are delivered unchanged."""
    bits = np.unpackbits(np.frombuffer(data, np.uint8), bitorder="little").reshape(-1, 8)
    line = np.concatenate([np.zeros((len(bits), 1), np.uint8), bits, np.ones((len(bits), 1), np.uint8)], 1).ravel()
    line = np.concatenate(([1, 1], line, np.ones(20, np.uint8)))
    step = sent_baud / received_baud
    out = bytearray()
    position = 0.0
    last = len(line) - 11 * step - 2
    while position < last:
        if line[int(position)] == 1:
            position = np.floor(position) + 1.0  # waits for the start bit's edge
            continue
        position = float(int(position))
        places = position + step * (np.arange(1, 9) + 0.5)
        out.append(int(np.packbits(line[places.astype(int)], bitorder="little")[0]))
        position += 9.5 * step
    return bytes(out)
