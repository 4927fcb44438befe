"""Blocks of decoded frames, as whatever follows the decoders takes them: many at once or as few as a read brings."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Frame, Message, SampleBlock
from firmware_protocol.sequence import COUNTER_MASK

Indices = NDArray[np.int64]
Admits = Callable[[int, int], bool]


class SampleRun(NamedTuple):
    """Sample blocks of one wheel that follow each other without a gap and are alike.

    Attributes:
        hub: number of the hub.
        wheel: number of the wheel.
        axes: axis mask.
        first_sample: running number of the first sample, 32 bit, wraps.
        ticks_us: hub time of the first sample of each of the k blocks, 32 bit, wraps.
        counts: (k n, channels) samples.
        places: (k,) of the frames in their block.
    """

    hub: int
    wheel: int
    axes: int
    first_sample: int
    ticks_us: Sequence[int]
    counts: NDArray[np.int16]
    places: Sequence[int] | Indices

    @property
    def block(self) -> int:
        """Samples of each block, n."""
        return len(self.counts) // len(self.ticks_us)


class Stretch(NamedTuple):
    """Consecutive frames of samples of admitted sources, up to one without samples.

    Wheels are independent within it: each wheel's samples may be processed at once, and what the frame without samples
    says takes effect exactly where it does when frames are taken one by one.

    Attributes:
        begin: index of the first frame.
        end: index of the first frame behind it.
        hubs: number of each hub of the samples, with the places of its frames in the order of the stream.
        runs: the samples, those of each wheel in the order of the stream.
        last: index and frame without samples that ends it; None at the end, and where its source is not admitted.
    """

    begin: int
    end: int
    hubs: Sequence[tuple[int, Sequence[int] | Indices]]
    runs: Sequence[SampleRun]
    last: tuple[int, Frame] | None


class Heard(NamedTuple):
    """What matters of a frame as a sign of life: its source, its type, its message unless it has samples, their axes.

    Attributes:
        arrived_ns: arrival.
        hub: number of the hub.
        wheel: number of the wheel.
        type: of the frame.
        message: None for samples.
        axes: mask of the samples, 0 for others.
    """

    arrived_ns: int
    hub: int
    wheel: int
    type: int
    message: Message | None
    axes: int


class FrameBlock(Protocol):
    """Frames of one link, in the order of the stream."""

    @property
    def tick_us(self) -> NDArray[np.uint32]:
        """(k,) hub times, 32 bit, wrap."""
        ...

    def __len__(self) -> int: ...

    def stretches(self, admits: Admits) -> Iterator[Stretch]:
        """Yield the frames of admitted sources in the order of the stream.

        Args:
            admits: whether a hub and wheel is admitted; asked in the order of their first frames.
        """
        ...

    def heard(self, arrivals_ns: Indices, slot_ns: int) -> Iterator[Heard]:
        """Yield those frames that matter as signs of life: all but most of the samples.

        Args:
            arrivals_ns: (k,) of the frames.
            slot_ns: time within which only the first and the last samples of a source matter.
        """
        ...


class FrameList:
    """Few frames of one link, as the streaming decoder gives them."""

    def __init__(self, frames: Sequence[Frame]) -> None:
        """Take the frames."""
        self.frames = frames

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def tick_us(self) -> NDArray[np.uint32]:
        """(k,) hub times."""
        return np.array([frame.tick_us for frame in self.frames], np.uint32)

    def stretches(self, admits: Admits) -> Iterator[Stretch]:
        """Yield the frames of admitted sources, as `FrameBlock.stretches`."""
        begin = 0
        of_samples: list[tuple[int, Frame, SampleBlock]] = []
        for index, frame in enumerate(self.frames):
            if not admits(frame.hub, frame.wheel):
                continue
            if isinstance(frame.message, SampleBlock):
                of_samples.append((index, frame, frame.message))
                continue
            yield _stretch(begin, index, of_samples, (index, frame))
            begin, of_samples = index + 1, []
        if begin < len(self.frames):
            yield _stretch(begin, len(self.frames), of_samples, None)

    def heard(self, arrivals_ns: Indices, slot_ns: int) -> Iterator[Heard]:
        """Yield those frames that matter as signs of life, as `FrameBlock.heard`."""
        first: dict[tuple[int, int, int, int], int] = {}
        last: dict[tuple[int, int, int, int], int] = {}
        times_ns = arrivals_ns.tolist()
        wanted: set[int] = set()
        for index, frame in enumerate(self.frames):
            if isinstance(frame.message, SampleBlock):
                source = times_ns[index] // slot_ns, frame.hub, frame.wheel, frame.message.axes
                first.setdefault(source, index)
                last[source] = index
            else:
                wanted.add(index)
        for index in sorted(wanted.union(first.values(), last.values())):
            type_, hub, wheel, _, _, message = self.frames[index]
            of_samples = (None, message.axes) if isinstance(message, SampleBlock) else (message, 0)
            yield Heard(times_ns[index], hub, wheel, type_, *of_samples)


def _stretch(
    begin: int, end: int, of_samples: Sequence[tuple[int, Frame, SampleBlock]], last: tuple[int, Frame] | None
) -> Stretch:
    """Return a stretch of some frames of samples, which are given with their places."""
    hubs: dict[int, list[int]] = {}
    # Parts of each run; and the latest run of each wheel, with what a block has that goes on with it.
    runs: list[list[tuple[int, Frame, SampleBlock]]] = []
    latest: dict[tuple[int, int], tuple[int, tuple[int, int, int]]] = {}
    for part in of_samples:
        index, frame, (first_sample, axes, counts) = part
        hubs.setdefault(frame.hub, []).append(index)
        source = frame.hub, frame.wheel
        number, follows = latest.get(source, (-1, None))
        if follows != (first_sample, axes, len(counts)):
            number = len(runs)
            runs.append([])
        runs[number].append(part)
        latest[source] = number, ((first_sample + len(counts)) & COUNTER_MASK, axes, len(counts))
    return Stretch(begin, end, list(hubs.items()), [_run(parts) for parts in runs], last)


def _run(parts: Sequence[tuple[int, Frame, SampleBlock]]) -> SampleRun:
    _, frame, (first_sample, axes, counts) = parts[0]
    if len(parts) > 1:
        counts = np.concatenate([block.counts for _, _, block in parts])
    ticks_us = [each.tick_us for _, each, _ in parts]
    return SampleRun(frame.hub, frame.wheel, axes, first_sample, ticks_us, counts, [index for index, _, _ in parts])
