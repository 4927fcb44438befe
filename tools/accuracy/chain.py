"""Revolutions from samples by the gateway's own pipeline: segmentation, resampling, gravity, edges."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Coupling, Hello
from gateway.core.estimates.estimator import Revolution, TireConditions
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.wheels.timebase import HostClock
from gateway.core.wheels.wheel_pipeline import WheelPipeline

FULL_SCALE_COUNTS = 32767
_BLOCK = 36


class Turn(NamedTuple):
    """A revolution from the pipeline, with its conditions."""

    revolution: Revolution
    conditions: TireConditions


def hello_of(rate_hz: float, range_mps2: float, axes: int, coupling: Coupling = Coupling.DC) -> Hello:
    """Return the hello of a 16-bit sensor of +-range_mps2 on all axes of the mask."""
    present = tuple(range_mps2 if axes >> axis & 1 else 0.0 for axis in range(3))
    return Hello(
        protocol_major=1,
        protocol_minor=0,
        hub_id=0,
        sensor_id=1,
        firmware=(0, 0, 0),
        boot_count=1,
        rate_hz=rate_hz,
        axes=axes,
        coupling=coupling,
        highpass_hz=0.0,
        range_mps2=(present[0], present[1], present[2]),
        scale_mps2=(present[0] / FULL_SCALE_COUNTS, present[1] / FULL_SCALE_COUNTS, present[2] / FULL_SCALE_COUNTS),
        offset_counts=(0.0, 0.0, 0.0),
        saturation_counts=FULL_SCALE_COUNTS,
    )


def turns_of(
    counts: NDArray[np.int16],
    hello: Hello,
    setup: WheelSetup,
    limit: int | None = None,
    on_turn: Callable[[int], None] = lambda _: None,
) -> list[Turn]:
    """Return the revolutions of (n, channels) counts, `limit` at most.

    Args:
        counts: consecutive samples from sample 0 on, channels in ascending axis order.
        hello: how to read them.
        setup: the wheel.
        limit: how many revolutions are wanted.
        on_turn: called with the number of revolutions so far.
    """
    wheel, host = WheelPipeline(setup, ()), HostClock()
    wheel.hello(hello)
    turns: list[Turn] = []
    second = max(_BLOCK, round(hello.rate_hz) // _BLOCK * _BLOCK)
    for first in range(0, len(counts), second):
        blocks = len(counts[first : first + second]) // _BLOCK
        if not blocks:
            break
        ticks = [round((first + block * _BLOCK) * 1e6 / hello.rate_hz) for block in range(blocks)]
        part = counts[first : first + blocks * _BLOCK]
        turns += [Turn(r.revolution, r.conditions) for r in wheel.samples(first, ticks, hello.axes, part, host)]
        on_turn(len(turns))
        if limit is not None and len(turns) >= limit:
            return turns[:limit]
    turns += [Turn(r.revolution, r.conditions) for r in wheel.finish(host)]
    return turns[:limit]
