"""Soak test: hours of four wheels through a whole session at full speed, with memory, time and revolutions checked."""

import argparse
import gc
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gateway.core.clock import SystemClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.estimates.results import RevolutionResult
from gateway.core.links.source import Chunk, LinkItem
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.live import LiveSession
from gateway.core.text.session_summary import ResultSummary
from gateway.simulator.scenario import load_scenario, vehicle_toml
from gateway.simulator.simulation import Simulation, simulate
from gateway.simulator.truth import WheelTruth

START_NS = 1_700_000_000_000_000_000

_BIN_S = 5e-6
_BINS = 40_000


@dataclass(slots=True)
class Soak:
    """Result of the soak.

    Attributes:
        simulated_s: length of the data.
        took_s: how long that took.
        recorded_bytes: size of the recording.
        memory_mb: resident memory at equal steps of simulated time.
        turns: contacts that the simulated wheels passed, by wheel, less those of the first seconds (search).
        revolutions: revolutions found, by wheel.
        gaps: how often a revolution did not begin where the one before it ended.
        time_s: median and central 98 % of host time of contacts less truth, by tenth of the run.
        lost_items: what a stage dropped.
    """

    simulated_s: float = 0.0
    took_s: float = 0.0
    recorded_bytes: int = 0
    memory_mb: list[float] = field(default_factory=list)
    turns: dict[str, int] = field(default_factory=dict)
    revolutions: dict[str, int] = field(default_factory=dict)
    gaps: int = 0
    time_s: list[tuple[float, float]] = field(default_factory=list)
    lost_items: int = 0


class _TimeErrors:
    """Errors of contact times, counted in bins by tenth of the run: the measurement itself must not grow."""

    def __init__(self, truth: dict[str, WheelTruth], seconds: float) -> None:
        self._truth = truth
        self._seconds = seconds
        self._counts = np.zeros((10, _BINS), np.int32)

    def add(self, position: str, found_s: np.ndarray) -> None:
        """Count the distance of each time from the nearest true one, limited to 0.1 s."""
        begin_s = max(0.0, float(found_s.min()) - 2.0)
        bottoms_s = self._truth[position].bottom_times_s(begin_s, float(found_s.max()) + 2.0)
        nearest = np.clip(np.searchsorted(bottoms_s, found_s), 1, len(bottoms_s) - 1)
        before_s, after_s = found_s - bottoms_s[nearest - 1], found_s - bottoms_s[nearest]
        errors_s = np.where(before_s < -after_s, before_s, after_s)
        bins = np.clip(np.floor(errors_s / _BIN_S).astype(int) + _BINS // 2, 0, _BINS - 1)
        tenths = np.clip((found_s / self._seconds * 10).astype(int), 0, 9)
        np.add.at(self._counts, (tenths, bins), 1)

    def by_tenth(self) -> list[tuple[float, float]]:
        """Return median and central 98 % of each tenth with data."""
        rows = []
        for counts in self._counts[self._counts.any(axis=1)]:
            below = np.cumsum(counts)
            low, middle, high = np.searchsorted(below, np.array([0.01, 0.5, 0.99]) * below[-1])
            rows.append((float(middle - _BINS // 2 + 0.5) * _BIN_S, float(high - low) * _BIN_S))
        return rows


class _Fast:
    """Simulation as a source that samples memory."""

    vehicle_toml: str | None = None

    def __init__(self, simulation: Simulation, marks_s: np.ndarray, memory_mb: list[float]) -> None:
        self.link = "sim:soak"
        self._simulation = simulation
        self._marks = (START_NS + marks_s * 1e9).tolist()
        self._memory_mb = memory_mb
        self.reached_s = 0.0

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        for chunk in self._simulation.chunks(self.link, START_NS):
            if stop.is_set():
                return
            if self._marks and chunk.host_ns >= self._marks[0]:
                self._marks.pop(0)
                self._memory_mb.append(resident_mb())
                print(
                    f"{self.reached_s / 60:.0f} min of data, {self._memory_mb[-1]:.0f} MB", file=sys.stderr, flush=True
                )
            self.reached_s = (chunk.host_ns - START_NS) * 1e-9
            yield Chunk(self.link, chunk.host_ns, chunk.data)

    def close(self) -> None:
        """Nothing to release."""


def resident_mb() -> float:
    """Return the resident memory of this process."""
    gc.collect()
    return int(Path("/proc/self/status").read_text().split("VmRSS:")[1].split()[0]) / 1024


def run_soak(scenario: str, seconds: float, folder: Path, *, steps: int = 20, estimators: tuple[str, ...] = ()) -> Soak:
    """Run `seconds` of a scenario through a live session with recording.

    Args:
        scenario: a simulator scenario.
        seconds: simulated time.
        folder: for the recording, which is deleted again.
        steps: how often memory is looked at.
        estimators: names, none for the default ones.
    """
    loaded = load_scenario(scenario)
    simulation = simulate(loaded, duration_s=seconds)
    soak = Soak(simulated_s=seconds)
    source = _Fast(simulation, np.linspace(seconds / steps, seconds, steps, endpoint=False), soak.memory_mb)
    vehicle = parse_vehicle(vehicle_toml(loaded), scenario)
    writer = RecordingWriter(folder / "soak.mcap", start_ns=START_NS)
    options = {"estimators": estimators} if estimators else {}
    live = LiveSession(
        [source], vehicle, SystemClock(), patient=[True], summary=ResultSummary(), recorder=writer, **options
    )
    last_end_s: dict[str, float] = {}
    errors = _TimeErrors(simulation.truth, seconds)

    def look(results: list[RevolutionResult]) -> None:
        ends_s: dict[str, list[float]] = {}
        for result in results:
            revolution = result.revolution
            begin = last_end_s.get(result.position)
            # Ends and beginnings are the same contact; a period more or less is 20 ms at the least.
            if begin is not None and abs(revolution.start_s - begin) > 0.01:
                soak.gaps += 1
            last_end_s[result.position] = revolution.start_s + revolution.period_s
            ends_s.setdefault(result.position, []).append((result.host_ns - START_NS) * 1e-9)
        for position, found_s in ends_s.items():
            soak.revolutions[position] = soak.revolutions.get(position, 0) + len(found_s)
            errors.add(position, np.array(found_s))

    begin = time.perf_counter()
    live.start()
    try:
        while not live.wait(0.02):
            look(live.results())
    except KeyboardInterrupt:
        # Report the part that was run.
        print("stopped", file=sys.stderr)
    snapshot = live.close()
    look(live.results())
    soak.took_s = time.perf_counter() - begin
    seconds = soak.simulated_s = source.reached_s
    soak.recorded_bytes = snapshot.recorded_bytes
    soak.lost_items = sum(sum(link.queue_dropped.values()) for link in snapshot.links)
    (folder / "soak.mcap").unlink()
    for position, truth in simulation.truth.items():
        soak.turns[position] = max(0, len(truth.bottom_times_s(0.0, seconds)) - 1)
        soak.revolutions.setdefault(position, 0)
    soak.time_s = errors.by_tenth()
    return soak


def report(soak: Soak) -> Iterator[str]:
    """Yield the lines of the report."""
    yield (
        f"{soak.simulated_s / 3600:.2f} h of data in {soak.took_s / 60:.1f} min "
        f"({soak.simulated_s / soak.took_s:.1f} x real time), recording {soak.recorded_bytes / 1e9:.2f} GB"
    )
    settled = soak.memory_mb[len(soak.memory_mb) // 10 :]
    slope = np.polyfit(np.arange(len(settled)), settled, 1)[0] * len(settled) if len(settled) > 1 else float("nan")
    yield f"memory {min(settled):.0f} to {max(settled):.0f} MB, trend over the run {slope:+.1f} MB: " + " ".join(
        f"{value:.0f}" for value in soak.memory_mb
    )
    for position, turns in soak.turns.items():
        yield f"{position}: {turns} turns passed, {soak.revolutions[position]} revolutions"
    yield f"revolutions that do not follow on: {soak.gaps}; dropped by a stage: {soak.lost_items}"
    yield "host time of contacts less truth by tenth of the run, median (range of 98 %) in ms: " + " ".join(
        f"{middle * 1e3:.2f} ({spread * 1e3:.1f})" for middle, spread in soak.time_s
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="demo")
    parser.add_argument("--minutes", type=float, default=600.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for line in report(run_soak(arguments.scenario, arguments.minutes * 60, Path(folder))):
            print(line, flush=True)


if __name__ == "__main__":
    main()
