"""Attacks of 10^6 frames in all, of which none may be accepted, and what checking costs.

Run `python tools/bench_security.py [FRAMES]`; a million take about a minute.
"""

import os
import platform
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import cryptography

from firmware_protocol.block_decoder import BatchDecoder
from firmware_protocol.decoder import FrameDecoder
from tools.generators.security_attacks import Sender, attacks, guard

FRAMES = 1_000_000
KINDS = 8
COST_FRAMES = 20_000


def main() -> None:
    total = int(sys.argv[1]) if len(sys.argv) > 1 else FRAMES
    print(f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; ", end="")
    print(f"Python {platform.python_version()}, cryptography {cryptography.__version__}")
    sent = accepted = 0
    for name, before, frames in attacks(total // KINDS, seed=11):
        watching = guard()
        before(watching)
        gate = watching.gate("link")
        earlier = gate.counts.copy()
        start = time.perf_counter()
        through = sum(map(gate, frames))
        us = (time.perf_counter() - start) / len(frames) * 1e6
        counted = ", ".join(f"{count} {verdict}" for verdict, count in (gate.counts - earlier).items())
        print(f"{name:32s} {len(frames):8d} sent {through:4d} accepted  {us:6.2f} us/frame  {counted}", flush=True)
        sent, accepted = sent + len(frames), accepted + through
    print(f"{'in all':32s} {sent:8d} sent {accepted:4d} accepted")
    cost()
    sys.exit(accepted != 0)


def cost() -> None:
    """Time genuine frames of 242 bytes, 35 samples of three axes, one a call as over BLE."""
    sender = Sender()
    signed = [sender.hello(), *(sender.samples() for _ in range(COST_FRAMES))]
    other = Sender()
    unsigned = [other.hello(), *(other.samples(signed=False) for _ in range(COST_FRAMES))]
    for name, decoder, frames in (
        ("unsigned, no guard", lambda: FrameDecoder(), unsigned),
        ("signed, not looked at", lambda: FrameDecoder(), signed),
        ("signed and verified", lambda: FrameDecoder(guard().gate("link")), signed),
    ):
        best = min(_seconds(decoder().feed, frames) for _ in range(5))
        print(f"live, {name:30s} {best / len(frames) * 1e6:6.2f} us/frame")
    for name, decoder, frames in (
        ("unsigned, no guard", lambda: BatchDecoder(), unsigned),
        ("signed, not looked at", lambda: BatchDecoder(), signed),
        ("signed and verified", lambda: BatchDecoder(gate=guard().gate("link")), signed),
    ):
        data = [b"".join(frames)]
        best = min(_seconds(decoder().feed, data) for _ in range(5))
        print(f"batch, {name:29s} {best / len(frames) * 1e6:6.2f} us/frame")


def _seconds(feed, pieces) -> float:
    start = time.perf_counter()
    for piece in pieces:
        feed(piece)
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
