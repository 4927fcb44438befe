"""Estimation of a whole recording in one pass, in constant memory, with the same results as live."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.block_decoder import FrameBatch
from firmware_protocol.counters import LinkCounters
from gateway.config.effects_file import with_effects
from gateway.config.vehicle import UNKNOWN_WHEEL, VehicleConfig
from gateway.estimators.registry import DEFAULT_ESTIMATORS
from gateway.io.bus_frames import has_frames
from gateway.io.source import BusFrames, LinkEvent, LinkItem
from gateway.pipeline.results import RevolutionResult, WheelSnapshot
from gateway.pipeline.vehicle_witness import VehicleJoin
from gateway.pipeline.wheel_setup import CorrectionTable
from gateway.pipeline.wheels import Pipeline
from gateway.recording.decoder_blocks import LinkBlocks
from gateway.security.guard import Guard
from gateway.session.batch_alarms import BatchAlarms
from gateway.session.signal_decoding import SignalDecoder


class Items(Protocol):
    """Source of link items, such as a recording."""

    def items(self) -> Iterator[LinkItem]:
        """Yield items in the order of arrival."""
        ...


def estimated_results(
    source: Items,
    vehicle: VehicleConfig | None,
    *,
    estimators: Sequence[str] = DEFAULT_ESTIMATORS,
    on_bytes: Callable[[int], None] | None = None,
    guard: Guard | None = None,
    on_batch: Callable[[str, FrameBatch, NDArray[np.int64]], None] | None = None,
    on_wheels: Callable[[tuple[WheelSnapshot, ...]], None] | None = None,
    effects: Sequence[CorrectionTable] = (),
    alarms: BatchAlarms | None = None,
    signals: SignalDecoder | None = None,
) -> Generator[RevolutionResult, None, dict[str, LinkCounters]]:
    """Run the estimators on all items of a source, and yield the results as they are asked for.

    Args:
        source: a recording.
        vehicle: configuration, None for an assumed belt radius.
        estimators: names from the registry.
        guard: verifies every frame first; None when signatures are not checked.
        on_bytes: called with the number of link bytes of each chunk, for a progress bar.
        on_batch: called with the link, a block of its frames and their arrival times, before its revolutions.
        on_wheels: called once with the last state of every wheel.
        effects: known effects to subtract, one table per wheel.
        alarms: takes frames, events of links and results; every result then has its alarms.
        signals: decodes the vehicle's bus; every result then has its signals.

    Yields:
        the result of every completed revolution, in order per wheel, wheels interleaved by block.

    Returns:
        the decoder's counters per link.
    """
    setups = with_effects(vehicle.wheel_setups() if vehicle is not None else (), effects)
    pipeline = Pipeline(setups, UNKNOWN_WHEEL, estimators)
    links: dict[str, LinkBlocks] = {}
    if alarms is not None:
        alarms.begin(pipeline)
    join = VehicleJoin(signals.history) if signals is not None else None
    if join is not None and alarms is not None:
        alarms.witnesses = join.alarms

    def with_alarms(result: RevolutionResult) -> RevolutionResult:
        result = join.joined(result) if join is not None else result
        return alarms.result(result) if alarms is not None else result

    def delivered(
        link: str, batches: Iterator[tuple[FrameBatch, NDArray[np.int64]]]
    ) -> Generator[RevolutionResult, None, None]:
        for batch, arrivals_ns in batches:
            if on_batch is not None:
                on_batch(link, batch, arrivals_ns)
            if alarms is not None:
                alarms.batch(link, batch, arrivals_ns)
            yield from map(with_alarms, pipeline.batch(link, batch, arrivals_ns))
            if alarms is not None:
                alarms.end_of_block()

    for item in source.items():
        if isinstance(item, BusFrames):
            if alarms is not None and has_frames(item.data):
                alarms.bus(item.link, item.host_ns)
            if signals is not None:
                signals.take(item)
            continue
        if isinstance(item, LinkEvent):
            if alarms is not None:
                alarms.event(item)
            continue
        blocks = links.get(item.link)
        if blocks is None:
            gate = guard.gate(item.link) if guard is not None else None
            blocks = links[item.link] = LinkBlocks(item.link, gate)
        if on_bytes is not None:
            on_bytes(len(item.data))
        yield from delivered(item.link, blocks.add(item))
    for name, blocks in links.items():
        yield from delivered(name, blocks.finish())
    yield from map(with_alarms, pipeline.finish())
    if on_wheels is not None:
        on_wheels(pipeline.wheels())
    return {name: blocks.counters for name, blocks in links.items()}


def estimate_items(
    source: Items,
    vehicle: VehicleConfig | None,
    on_result: Callable[[RevolutionResult], None],
    *,
    estimators: Sequence[str] = DEFAULT_ESTIMATORS,
    on_bytes: Callable[[int], None] | None = None,
    guard: Guard | None = None,
    on_batch: Callable[[str, FrameBatch, NDArray[np.int64]], None] | None = None,
    on_wheels: Callable[[tuple[WheelSnapshot, ...]], None] | None = None,
    effects: Sequence[CorrectionTable] = (),
    alarms: BatchAlarms | None = None,
    signals: SignalDecoder | None = None,
) -> dict[str, LinkCounters]:
    """Hand every result of `estimated_results` to `on_result`; return the decoder's counters per link."""
    results = estimated_results(
        source,
        vehicle,
        estimators=estimators,
        on_bytes=on_bytes,
        guard=guard,
        on_batch=on_batch,
        on_wheels=on_wheels,
        effects=effects,
        alarms=alarms,
        signals=signals,
    )
    counters: dict[str, LinkCounters] = {}

    def counted() -> Iterator[RevolutionResult]:
        nonlocal counters
        counters = yield from results

    for result in counted():
        on_result(result)
    return counters
