"""The simulator as a source: `sim:SCENARIO?speed=1&duration=30&seed=1&fault=flip:rate=0.01`."""

import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from gateway.core.clock import Clock
from gateway.core.errors import SourceError
from gateway.core.links.playback import Playback
from gateway.core.links.source import (
    Chunk,
    LinkEvent,
    LinkEventKind,
    LinkItem,
    Sentences,
    Source,
    SourceAddress,
    number_option,
    positive_option,
)
from gateway.simulator import receiver
from gateway.simulator.link_faults import parse_faults
from gateway.simulator.receiver import SimulatedReceiver
from gateway.simulator.scenario import load_scenario, vehicle_toml
from gateway.simulator.simulation import Simulation, simulate

OPTIONS = (
    "speed=1|10|max, duration=SECONDS, seed=NUMBER, fault=KIND:OPTION=VALUE (several parted by ';' or '+'), keys=FILE, "
    "receiver=HZ"
)

# The receiver's errors are apart from the wheels', which are the same with and without it.
_RECEIVER_STREAM: Final = 0x4E4D4541
# Between chunks that only tell the time.
_SILENCE_NS: Final = 100_000_000
_OPTION_NAMES: Final = ("speed", "duration", "seed", "fault", "keys", "receiver")


class SimulatorSource:
    """Source that plays a simulation on an absolute schedule of the injected clock.

    At speed 1 a chunk carries the time at which it was handed over, as from a real link; at any other speed the
    simulated time of its arrival, so that the hub's clock and the host's run alike.
    """

    def __init__(
        self,
        simulation: Simulation,
        link: str,
        toml: str,
        speed: float,
        clock: Clock,
        receiver: SimulatedReceiver | None = None,
    ) -> None:
        """Play `simulation` at `speed` times real time, with a positioning receiver or without.

        Infinite speed does not wait.
        """
        self.simulation = simulation
        self._link = link
        self._toml = toml
        self._speed = speed
        self._clock = clock
        self._playback = Playback(clock, speed)
        self._closed = threading.Event()
        self._receiver = receiver

    @property
    def link(self) -> str:
        """Name of the link."""
        return self._link

    @property
    def vehicle_toml(self) -> str | None:
        """Vehicle configuration that matches the scenario."""
        return self._toml

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield the connection, the chunks, and the end when the scenario has one. A simulation runs once.

        In silence, chunks without bytes tell the time.
        """
        start_ns = last_ns = told_ns = self._clock.now_ns()
        yield LinkEvent(self._link, start_ns, LinkEventKind.CONNECTED)
        self._playback.begin(start_ns)
        if self._receiver is not None:
            yield LinkEvent(receiver.LINK, start_ns, LinkEventKind.CONNECTED)
        for item in self._in_order(start_ns):
            if not self._playback.wait_until(item.host_ns, stop, self._closed):
                return
            if not item.data and item.host_ns - told_ns < _SILENCE_NS:
                continue
            told_ns = item.host_ns
            last_ns = self._clock.now_ns() if self._speed == 1.0 else item.host_ns
            yield replace(item, host_ns=last_ns)
        yield LinkEvent(self._link, last_ns, LinkEventKind.ENDED)
        if self._receiver is not None:
            yield LinkEvent(receiver.LINK, last_ns, LinkEventKind.ENDED)

    def _in_order(self, start_ns: int) -> Iterator[Chunk | Sentences]:
        """Yield chunks and sentences by time, up to the last chunk."""
        sentences = self._receiver.sentences(start_ns) if self._receiver is not None else iter(())
        waiting = next(sentences, None)
        for chunk in self.simulation.timed_chunks(self._link, start_ns):
            while waiting is not None and waiting.host_ns <= chunk.host_ns:
                yield waiting
                waiting = next(sentences, None)
            yield chunk

    def close(self) -> None:
        """End `items`."""
        self._closed.set()


def open_simulator(address: SourceAddress, clock: Clock) -> Source:
    """Open `sim:SCENARIO` with the options of OPTIONS. Solves the tires.

    Raises:
        SourceError: no such scenario, or a wrong option.
        ConfigError: the scenario has faults.
    """
    address.check_options(_OPTION_NAMES, OPTIONS)
    options = dict(address.options)
    speed = parse_speed(options.pop("speed", "1"))
    seed_text, duration_text = options.pop("seed", None), options.pop("duration", None)
    fault_texts = split_faults(options.pop("fault", ""))
    key_file = options.pop("keys", None)
    scenario = load_scenario(address.target)
    seed = None if seed_text is None else _seed(seed_text)
    simulation = simulate(
        scenario,
        seed=seed,
        duration_s=None if duration_text is None else positive_option("duration", duration_text),
        faults=tuple(parse_faults(fault_texts, scenario.scenario.seed if seed is None else seed)),
        key_file=None if key_file is None else Path(key_file),
    )
    toml = vehicle_toml(scenario, signed=key_file is not None)
    mounted = None
    receiver_hz = number_option(address.options, "receiver", 0.0, *receiver.RATES_HZ)
    if receiver_hz:
        plan = simulation.wheels[0].plan
        rng = np.random.default_rng([scenario.scenario.seed if seed is None else seed, _RECEIVER_STREAM])
        mounted = SimulatedReceiver(plan.motion, receiver_hz, rng, plan.path.yaw_radps)
    return SimulatorSource(simulation, link_name(address.target), toml, speed, clock, mounted)


def link_name(target: str) -> str:
    """Return the name of the link of a scenario."""
    return f"sim:{Path(target).stem}"


def split_faults(text: str) -> list[str]:
    """Return the faults of a text, separated by `;`, `+` or a space."""
    for mark in "+ ":
        text = text.replace(mark, ";")
    return [item for item in text.split(";") if item]


def parse_speed(text: str) -> float:
    """Return the playback speed as a multiple of real time, infinity for `max`.

    Raises:
        SourceError: neither a positive number nor `max`.
    """
    return positive_option("speed", text, or_max=True)


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise SourceError(f"invalid option seed={text}", "Give a whole number of at least 0.")
    return int(text)
