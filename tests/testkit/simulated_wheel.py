"""One simulated wheel run through the whole pipeline, from bytes to results."""

from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import groupby

import numpy as np

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.frame_blocks import FrameList
from firmware_protocol.messages import Hello, SampleBlock
from gateway.core.config.validation import parse_document
from gateway.core.estimates.results import RevolutionResult, WheelSnapshot
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.links.source import Chunk
from gateway.core.wheels.timebase import HostClock
from gateway.core.wheels.wheel_pipeline import WheelPipeline
from gateway.core.wheels.wheels import Pipeline
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import simulate
from gateway.simulator.truth import WheelTruth


@lru_cache(maxsize=8)
def _drive(tables: str, duration_s: float, wheel: str, seed: int) -> tuple[tuple[Chunk, ...], WheelTruth]:
    """Return the bytes and the truth of a drive, which several setups and statements share."""
    text = f"[scenario]\nseed = {seed}\n{tables}\n[[wheel]]\nposition = 'FL'\nwheel = 0\n{wheel}\n"
    simulation = simulate(parse_document(Scenario, text, "test"), duration_s=duration_s)
    return tuple(simulation.chunks("link", 10**18)), simulation.truth["FL"]


@lru_cache(maxsize=32)
def simulated(
    tables: str, duration_s: float, setup: WheelSetup, estimators: tuple[str, ...], wheel: str = "", seed: int = 4
) -> tuple[tuple[RevolutionResult, ...], WheelTruth]:
    """Return the results and the truth of a scenario's `tables` with one wheel; `wheel` holds its further keys."""
    chunks, truth = _drive(tables, duration_s, wheel, seed)
    return tuple(results_of(chunks, setup, estimators)), truth


def results_of(chunks: Iterable[Chunk], setup: WheelSetup, estimators: Sequence[str]) -> list[RevolutionResult]:
    """Return the results of the bytes of a wheel, whose frames are taken together as those of a file."""
    pipeline, decoder = Pipeline((setup,), setup, estimators), FrameDecoder()
    frames = [(chunk.host_ns, frame) for chunk in chunks for frame in decoder.feed(chunk.data)]
    hosts_ns = np.array([host_ns for host_ns, _ in frames])
    results = pipeline.take("link", FrameList([frame for _, frame in frames]), hosts_ns)
    return results + pipeline.finish()


def last(results: tuple[RevolutionResult, ...]) -> dict[str, object]:
    """Return the last result's estimates by name."""
    return {estimate.name: estimate for estimate in results[-1].estimates}


@lru_cache(maxsize=32)
def restated(
    tables: str,
    duration_s: float,
    setup: WheelSetup,
    estimators: tuple[str, ...],
    *,
    rate_factor: float = 1.0,
    unit_factor: float = 1.0,
    lost: tuple[tuple[int, int], ...] = (),
    repeated: tuple[tuple[int, int], ...] = (),
    dropped: frozenset[int] = frozenset(),
    gaps: tuple[tuple[int, int], ...] = (),
    channels: tuple[int, int, int] = (0, 1, 2),
    late: tuple[int, int, int] = (0, 0, 0),
    seed: int = 4,
) -> tuple[tuple[RevolutionResult, ...], WheelSnapshot]:
    """Return the results of the same samples with another sampling rate and unit stated, as an import may state them.

    The time stamps follow the stated rate. Ranges of samples (first, end) of the result may be lost or repeated without
    a mark, the last one first; blocks of samples, by their index, or ranges of them in order are dropped with one. Each
    axis is taken from one of the `channels`, and is late by so many samples.
    """
    decoder = FrameDecoder()
    hello, blocks = None, []
    for chunk in _drive(tables, duration_s, "", seed)[0]:
        for frame in decoder.feed(chunk.data):
            if isinstance(frame.message, Hello):
                hello = hello or frame.message
            elif isinstance(frame.message, SampleBlock):
                blocks.append(np.asarray(frame.message.counts))
    assert hello is not None
    scale = tuple(unit_factor * value for value in hello.scale_mps2)
    stated = hello._replace(rate_hz=rate_factor * hello.rate_hz, scale_mps2=scale)
    size = len(blocks[0])
    whole = [block for block in blocks if len(block) == size]
    samples = np.concatenate(whole)
    if channels != (0, 1, 2) or any(late):
        samples = samples[:, channels]
        samples = np.stack([np.roll(samples[:, axis], lag) for axis, lag in enumerate(late)], axis=1)[max(late) :]
    for first, end in lost:
        samples = np.delete(samples, slice(first, end), axis=0)
    for first, end in repeated:
        samples = np.insert(samples, end, samples[first:end], axis=0)
    samples = samples[: len(samples) // size * size]
    ticks = [round(index * size * 1e6 / stated.rate_hz) for index in range(len(samples) // size)]
    wheel, host = WheelPipeline(setup, estimators), HostClock()
    wheel.hello(stated)
    received = [index for index in range(len(ticks)) if index not in dropped]
    results: list[RevolutionResult] = []
    for _, run in groupby(enumerate(received), key=lambda numbered: numbered[1] - numbered[0]):
        stretch = [index for _, index in run]
        first, end = stretch[0], stretch[-1] + 1
        if not gaps:
            results += wheel.samples(
                first * size, ticks[first:end], stated.axes, samples[first * size : end * size], host
            )
            continue
        bounds = [first * size, *(bound for gap in gaps for bound in gap), end * size]
        for begin, until in zip(bounds[::2], bounds[1::2], strict=True):
            tick = round(begin * 1e6 / stated.rate_hz)
            results += wheel.samples(begin, [tick], stated.axes, samples[begin:until], host)
    return tuple(results + wheel.finish(host)), wheel.snapshot()
