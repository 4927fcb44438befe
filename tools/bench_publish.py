"""Live publishing to an MQTT broker that stalls again and again.

One simulated wheel is published to a real mosquitto, which SIGSTOP freezes for growing times. The table shows each
stall; the lines below compare the revolutions of the session with those that a subscriber has received, and state how
late the session itself was. With `--speed` the same data run faster, and the stalls are as much shorter.
"""

import argparse
import json
import os
import platform
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from gateway.core.clock import SystemClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.links.source import open_source
from gateway.core.session.core import SessionCore
from gateway.core.session.live import LiveSession
from gateway.publishing.publisher import Publisher
from gateway.publishing.sink import SinkSetting, open_sink
from gateway.publishing.sink_worker import SinkWorker
from tools.mqtt_broker import Broker, Listener

_POLL_S = 0.05
_SHORTEST_S = 10.0
_KEEPALIVE_S = 10.0


@dataclass
class Stall:
    """A time for which the broker is frozen; times in s of the session; with `--speed`, as many times more."""

    at_s: float
    length_s: float
    states: str = ""
    alarms: str = ""
    most_waiting: int = 0
    dropped: int = 0
    revolutions: int = 0
    longest_gap_s: float = 0.0
    caught_up_s: float = 0.0


def resident_mb() -> float:
    """Memory of this process, MB."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def index_only(payload: bytes) -> bytes:
    """Return what the comparison needs of a message, so that an hour of them takes no memory."""
    if not payload.startswith(b"{"):
        return payload
    return json.dumps({"index": json.loads(payload).get("index")}).encode()


def plan(duration_s: float, stalls: int, longest_s: float) -> list[Stall]:
    """Return stalls at equal distances, their lengths a geometric series."""
    ratio = (longest_s / _SHORTEST_S) ** (1.0 / max(stalls - 1, 1))
    spacing_s = duration_s / (stalls + 0.5)
    return [Stall(spacing_s * (k + 0.25), min(_SHORTEST_S * ratio**k, 0.85 * spacing_s)) for k in range(stalls)]


class Bench:
    """A session that publishes, its broker, and the table of stalls."""

    def __init__(self, broker: Broker, duration_s: float, speed: float, buffer: int, seed: int) -> None:
        """Prepare the session."""
        clock = SystemClock()
        self.broker, self.speed = broker, speed
        # The simulation waits for a busy computer, so it may come to less of its data: the time of the clock counts.
        self.duration_s = duration_s
        source = open_source(f"sim:lab?speed={speed:g}&duration={duration_s:g}&seed={seed}", clock)
        keepalive = max(1, round(_KEEPALIVE_S / speed))
        name, sink = open_sink(f"mqtt://127.0.0.1:{broker.port}/bench?keepalive={keepalive}", SinkSetting())
        self.publisher = Publisher([SinkWorker(name, sink, clock, max_items=buffer)], clock)
        self.live = LiveSession(
            [source],
            SessionCore(parse_vehicle(source.vehicle_toml or "", "lab")),
            clock,
            patient=[True],
            publication=self.publisher,
        )
        self.revolutions = 0
        self.longest_gap_s = 0.0
        self._last = time.monotonic()

    def step(self) -> float:
        """Fetch results for a moment; return the longest time without one, as far as it is known by now."""
        self.live.wait(_POLL_S)
        taken = len(self.live.results())
        now = time.monotonic()
        gap_s = now - self._last
        if taken:
            self._last = now
            self.revolutions += taken
        self.longest_gap_s = max(self.longest_gap_s, gap_s)
        return gap_s

    def until(self, at_s: float) -> None:
        """Run until a time of the session."""
        while self.live.snapshot().elapsed_s * self.speed < at_s and not self.live.wait(0.0):
            self.step()

    def freeze(self, stall: Stall) -> None:
        """Stop the broker, watch the session, and let the broker go on until it has caught up."""
        before, dropped = self.revolutions, self.publisher.sinks()[0].dropped
        states: dict[str, None] = {}
        alarms: dict[str, None] = {}
        self.broker.signal(signal.SIGSTOP)
        end = time.monotonic() + stall.length_s / self.speed
        while time.monotonic() < end:
            stall.longest_gap_s = max(stall.longest_gap_s, self.step())
            (sink,) = self.publisher.sinks()
            states[str(sink.state)] = None
            present = [alarm for alarm in self.live.snapshot().alarms if alarm.name == "publishing"]
            alarms |= {str(alarm.reason.code): None for alarm in present}
            stall.most_waiting = max(stall.most_waiting, sink.waiting)
        stall.revolutions = self.revolutions - before
        self.broker.signal(signal.SIGCONT)
        began = time.monotonic()
        while self.publisher.sinks()[0].waiting > 2 and not self.live.wait(0.0):
            self.step()
        stall.caught_up_s = time.monotonic() - began
        stall.dropped = self.publisher.sinks()[0].dropped - dropped
        stall.states, stall.alarms = ", ".join(states), ", ".join(alarms) or "-"


def main() -> None:
    """Run the bench and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=3600.0, metavar="S", help="of the session (default: 3600 s)")
    parser.add_argument("--speed", type=float, default=1.0, help="times as fast as real (default: 1)")
    parser.add_argument("--stalls", type=int, default=10, help="number of stalls (default: 10)")
    parser.add_argument("--longest", type=float, default=280.0, metavar="S", help="longest stall (default: 280 s)")
    parser.add_argument("--buffer", type=int, default=1024, help="items that may wait (default: 1024; live has 8192)")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    stalls = plan(options.duration, options.stalls, options.longest)
    print(
        f"{options.duration:g} s of sim:lab at speed {options.speed:g}, {options.stalls} stalls, "
        f"buffer {options.buffer}; Python {platform.python_version()}, {os.cpu_count()} cores",
        flush=True,
    )
    print(
        f"{'at s':>6} {'stalled s':>10}  {'states':<22} {'alarm':<22} waiting  dropped  revolutions  gap s  caught up s"
    )
    with tempfile.TemporaryDirectory() as folder:
        broker = Broker(Path(folder)).start()
        listener = Listener(broker.port, "bench/#", keep=index_only)
        try:
            bench = Bench(broker, options.duration, options.speed, options.buffer, options.seed)
            is_complete = run(bench, stalls, listener)
        finally:
            listener.close()
            broker.kill()
    sys.exit(0 if is_complete else 1)


def run(bench: Bench, stalls: list[Stall], listener: Listener) -> bool:
    """Run the session through its stalls and print what happened; return whether every item is accounted for."""
    began, cpu = time.monotonic(), time.process_time()
    bench.live.start()
    first_mb = 0.0
    for stall in stalls:
        bench.until(stall.at_s)
        first_mb = first_mb or resident_mb()
        bench.freeze(stall)
        print(
            f"{stall.at_s:6.0f} {stall.length_s:10.1f}  {stall.states:<22} {stall.alarms:<22} {stall.most_waiting:7d} "
            f"{stall.dropped:8d} {stall.revolutions:12d} {stall.longest_gap_s:6.2f} {stall.caught_up_s:12.2f}",
            flush=True,
        )
    bench.until(bench.duration_s)
    bench.live.request_stop()
    while not bench.live.wait(0.0):
        bench.step()
    bench.step()
    snapshot = bench.live.close()
    (sink,) = bench.publisher.close()
    took_s, cpu_s, last_mb = time.monotonic() - began, time.process_time() - cpu, resident_mb()
    for _ in range(200):
        if listener.of("bench/status")[-1:] == ["offline"]:
            break
        time.sleep(_POLL_S)
    received = [json.loads(payload) for topic, _, payload in listener.messages if topic.endswith("/revolution")]
    distinct = len({result["index"] for result in received})
    alarms = len(listener.of("bench/alarm"))
    total = snapshot.wheels[0].counters.revolutions
    print(f"revolutions of the session       {total}, {bench.revolutions} fetched by the view")
    print(f"published, dropped               {sink.published}, {sink.dropped} (alarms included)")
    print(f"received by the subscriber       {distinct} revolutions, {len(received) - distinct} twice, {alarms} alarms")
    print(f"longest time without a result    {bench.longest_gap_s:.2f} s")
    print(f"dropped before the outputs       {dict(snapshot.links[0].queue_dropped) or 0}")
    print(f"memory at first stall, at end    {first_mb:.0f} MB, {last_mb:.0f} MB (subscriber included)")
    print(f"time, CPU of the whole bench     {took_s:.0f} s, {cpu_s:.0f} s ({100 * cpu_s / took_s:.1f} % of a core)")
    is_complete = distinct + alarms + sink.dropped == sink.published + sink.dropped >= total == bench.revolutions
    print("every item is accounted for" if is_complete else "ITEMS ARE NOT ACCOUNTED FOR")
    return is_complete


if __name__ == "__main__":
    main()
