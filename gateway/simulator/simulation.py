"""Simulation of a whole scenario: chunks of link bytes on a simulated clock."""

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gateway.core.errors import ConfigError, SourceError
from gateway.core.links.source import Chunk
from gateway.forces.brush_tread import BrushNotConvergedError
from gateway.ring.rolling_ring import RingNotConvergedError
from gateway.security.key_file import open_signer
from gateway.simulator.hub import HubSimulator, TimedFrame
from gateway.simulator.link_faults import Fault, apply_faults, parse_faults
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulated_wheel import WheelSimulator
from gateway.simulator.truth import WheelTruth
from gateway.simulator.wheel_plan import WheelPlan, wheel_plans

BLOCK_S = 0.25
"""Block length of the simulation; the result for a seed depends on it."""


@dataclass(slots=True)
class Simulation:
    """A scenario being simulated; `chunks` runs it once.

    Attributes:
        scenario: what is simulated.
        duration_s: length, None for endless.
        faults: on the link, with their counts.
        truth: true values of the estimates, by position.
        wheels: in the scenario's order.
    """

    scenario: Scenario
    duration_s: float | None
    faults: tuple[Fault, ...]
    truth: dict[str, WheelTruth]
    wheels: tuple[WheelSimulator, ...]
    _hubs: tuple[HubSimulator, ...]
    _link_rng: np.random.Generator

    def chunks(self, link: str, start_ns: int) -> Iterator[Chunk]:
        """Yield the link's bytes, faults included; chunks carry simulated arrival times counted from `start_ns`."""
        return apply_faults(self.faults, self._clean_chunks(link, start_ns))

    def timed_chunks(self, link: str, start_ns: int) -> Iterator[Chunk]:
        """Yield the same chunks, and those of which faults have left no byte: the time goes on in silence."""
        return apply_faults(self.faults, self._clean_chunks(link, start_ns), tells_time=True)

    def _clean_chunks(self, link: str, start_ns: int) -> Iterator[Chunk]:
        interval_s, jitter_s = self.scenario.link.chunk_ms * 1e-3, self.scenario.link.jitter_ms * 1e-3
        parts: list[bytes] = []
        slot, last_ns = 0, start_ns
        for frame in self._frames():
            frame_slot = int(frame.time_s / interval_s)
            if frame_slot != slot:
                if parts:
                    last_ns = max(last_ns, self._arrival_ns(start_ns, (slot + 1) * interval_s, jitter_s))
                    yield Chunk(link, last_ns, b"".join(parts))
                slot, parts = frame_slot, []
            parts.append(frame.data)
        if parts:
            last_ns = max(last_ns, self._arrival_ns(start_ns, (slot + 1) * interval_s, jitter_s))
            yield Chunk(link, last_ns, b"".join(parts))

    def _arrival_ns(self, start_ns: int, time_s: float, jitter_s: float) -> int:
        return start_ns + round((time_s + self._link_rng.exponential(jitter_s)) * 1e9)

    def _frames(self) -> Iterator[TimedFrame]:
        block = 0
        while self.duration_s is None or block * BLOCK_S < self.duration_s:
            block += 1
            until_s = block * BLOCK_S if self.duration_s is None else min(block * BLOCK_S, self.duration_s)
            yield from heapq.merge(*(hub.advance(until_s) for hub in self._hubs), key=lambda frame: frame.time_s)


def simulate(
    scenario: Scenario,
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    faults: tuple[Fault, ...] = (),
    key_file: Path | None = None,
) -> Simulation:
    """Return a scenario ready to run. Solves the tires.

    Args:
        scenario: what to simulate.
        seed: replaces the scenario's.
        duration_s: replaces the scenario's.
        faults: on the link; the scenario's own come first.
        key_file: keys with which sensors and hubs sign; None for unsigned frames.

    Raises:
        ConfigError: a tire has no equilibrium under its load.
        SecurityError: a key is missing.
        SourceError: a fault would have to sign.
    """
    seed = scenario.scenario.seed if seed is None else seed
    plans = wheel_plans(scenario)
    all_faults = (*parse_faults(scenario.scenario.faults, seed), *faults)
    if key_file is not None and any(fault.kind == "reboot" for fault in all_faults):
        raise SourceError(
            "the fault 'reboot' cannot sign the frames that it changes", "Leave out the fault or the keys."
        )
    signer = open_signer(key_file, _identities(scenario, plans)) if key_file is not None else None
    link_rng, *wheel_rngs = np.random.default_rng(seed).spawn(1 + len(plans))
    wheels = [_wheel(plan, rng) for plan, rng in zip(plans, wheel_rngs, strict=True)]
    title = f"treadlink simulator: {scenario.scenario.name or 'scenario'}, seed {seed}"
    hubs = tuple(
        HubSimulator(hub, [wheel for wheel in wheels if wheel.plan.hub.hub == hub.hub], title, signer)
        for hub in scenario.hubs()
    )
    return Simulation(
        scenario=scenario,
        duration_s=scenario.scenario.duration_s if duration_s is None else duration_s,
        faults=all_faults,
        truth={wheel.plan.position: WheelTruth(wheel.plan, wheel.phase_rad) for wheel in wheels},
        wheels=tuple(wheels),
        _hubs=hubs,
        _link_rng=link_rng,
    )


def _identities(scenario: Scenario, plans: Sequence[WheelPlan]) -> list[str]:
    return [
        identity
        for hub in scenario.hubs()
        for identity in HubSimulator.identities(hub, [plan.sensor_id for plan in plans if plan.hub.hub == hub.hub])
    ]


def _wheel(plan: WheelPlan, rng: np.random.Generator) -> WheelSimulator:
    try:
        return WheelSimulator(plan, rng)
    except (RingNotConvergedError, BrushNotConvergedError, ValueError) as error:
        raise ConfigError(
            f"wheel {plan.position}: its tire cannot be solved: {error}",
            "Lower the load or the slip angle, raise the pressure, or bring the tire's stiffnesses into proportion.",
        ) from error
