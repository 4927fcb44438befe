"""CPU of the views: the live console on a pseudo-terminal, the waveform, a plain line.

The console shows four wheels at 65 km/h on 120 x 40; every one of its ten drawings a second has a new revolution of
every wheel. Its figure is the whole process's CPU time over wall time after two seconds, so it holds the toolkit's
drawing and output, but neither decoding nor estimating.
"""

import fcntl
import math
import os
import pty
import struct
import sys
import termios
import time
import timeit
from dataclasses import replace

import numpy as np

from gateway.core.estimates.estimator import Estimate, Revolution, Status, TireConditions
from gateway.core.estimates.results import LinkSnapshot, RevolutionResult, SessionSnapshot, WheelSnapshot, WheelState
from gateway.core.links.reasons import LinkCode
from gateway.core.reasons import Notice, Reason
from gateway.papers.reasons import PaperCode

RADIUS_M = 0.32
SAMPLES = 1024
WARM_UP_S = 2.0
MEASURE_S = 10.0
DISTINCT = 50
POSITIONS = ("FL", "FR", "RL", "RR")


def radial(omega_radps: float, rng: np.random.Generator, noise_mps2: float) -> np.ndarray:
    theta = -math.pi + 2.0 * math.pi * np.arange(SAMPLES) / SAMPLES
    dip = 0.5 * (np.tanh((theta + 0.24) / 0.03) - np.tanh((theta - 0.24) / 0.03))
    return RADIUS_M * omega_radps**2 * (1.0 - dip) + rng.normal(0.0, noise_mps2, SAMPLES)


def make_result(position: str, index: int, rng: np.random.Generator) -> RevolutionResult:
    omega = 65.0 / 3.6 / RADIUS_M * (1.0 + 0.002 * rng.standard_normal())
    revolution = Revolution(
        index=index,
        start_s=index * 2.0 * math.pi / omega,
        period_s=2.0 * math.pi / omega,
        omega_radps=omega,
        omega_dot_radps2=0.0,
        radial_mps2=radial(omega, rng, 20.0),
        axes_mps2=np.zeros((3, SAMPLES)),
        orders_mps2=np.zeros(61, dtype=complex),
        order_max=60,
        leading_edge_rad=-0.24,
        trailing_edge_rad=0.24,
        leading_edge_std_rad=0.0017,
        trailing_edge_std_rad=0.0017,
        noise_mps2=20.0,
        missing_fraction=0.0,
        saturated=False,
        ac_coupled=False,
    )
    values = (
        ("speed_mps", omega * RADIUS_M, 0.006),
        ("leading_edge_rad", -0.24, 0.0017),
        ("trailing_edge_rad", 0.24, 0.0017),
        ("contact_length_m", 0.153, 0.001),
        ("Bs", 3.083e-3, 1.2e-5),
        ("Cw", 0.1953, 0.0012),
        ("Rs", 2.974, 0.031),
        ("Ts", 2.529, 0.099),
        ("Bs/Cw", 0.0158, 0.0002),
        ("Rs/Cw", 15.23, 0.2),
        ("Ts/Cw", 12.95, 0.6),
    )
    estimates = tuple(
        Estimate(name, value + std * rng.standard_normal(), std, Status.VALID, (Reason(PaperCode.LINEAR_RING),))
        for name, value, std in values
    )
    return RevolutionResult(position, 0, revolution, TireConditions(RADIUS_M, 5000.0, 210e3, 31.5), estimates)


class FakeSession:
    """Ready-made snapshots on the real clock; notes CPU and wall time as they pass."""

    def __init__(self) -> None:
        rng = np.random.default_rng(7)
        connected = Reason(LinkCode.LINK_CONNECTED)
        notice = Notice("sim:demo", connected)
        link = LinkSnapshot("sim:demo", True, connected, 0, 1, 2, 0, 3, 0, 0, 0, 0.012, {"ring": 0}, 87, -61, 0.43)
        self.snapshots = []
        for index in range(DISTINCT):
            wheels = []
            for position in POSITIONS:
                last = make_result(position, index, rng)
                average = radial(last.revolution.omega_radps, rng, 2.0)
                wheels.append(
                    WheelSnapshot(position, "a001", 9600.0, WheelState.ROLLING, last, average, 210e3, 31.5, 5000.0)
                )
            self.snapshots.append(SessionSnapshot(0.0, tuple(wheels), (link,), (), (notice,), "drive.mcap", 0, False))
        self.start_s = time.monotonic()
        self.calls: list[tuple[float, float]] = []

    def snapshot(self) -> SessionSnapshot:
        """The next ready-made state."""
        now_s = time.monotonic() - self.start_s
        self.calls.append((now_s, time.process_time()))
        count = len(self.calls)
        link = replace(self.snapshots[0].links[0], frames=80 * count, bytes_received=19_000 * count)
        drawn = self.snapshots[count % DISTINCT]
        return replace(drawn, elapsed_s=now_s, links=(link,), recorded_bytes=19_000 * count)

    def mark(self, text: str) -> None:
        """Fail: the measurement sets no marks."""
        raise AssertionError(text)

    def request_stop(self) -> None:
        """Do nothing."""

    def report(self) -> str:
        """CPU share and drawing rate after the warm-up."""
        steady = [call for call in self.calls if call[0] >= WARM_UP_S]
        (wall_0, cpu_0), (wall_1, cpu_1) = steady[0], steady[-1]
        drawings = (len(steady) - 1) / (wall_1 - wall_0)
        return f"{100.0 * (cpu_1 - cpu_0) / (wall_1 - wall_0):.1f} % of a core, {drawings:.1f} drawings a second"


def bench_console(columns: int, rows: int) -> None:
    read_end, write_end = os.pipe()
    pid, terminal = pty.fork()
    if pid == 0:
        os.close(read_end)
        fcntl.ioctl(sys.stdout.fileno(), termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        os.environ["TERM"] = "xterm-256color"
        from gateway.console.screen import run_console

        session = FakeSession()
        run_console(session)
        os.write(write_end, session.report().encode())
        os._exit(0)
    os.close(write_end)
    start_s = time.monotonic()
    received, quit_s = 0, 0.0
    while True:
        try:
            piece = os.read(terminal, 1 << 16)
        except OSError:  # how Linux reports the end of a pseudo-terminal
            break
        if not piece:
            break
        received += len(piece)
        if not quit_s and time.monotonic() - start_s > WARM_UP_S + MEASURE_S:
            os.write(terminal, b"q")
            quit_s = time.monotonic()
    os.waitpid(pid, 0)
    ended_s = time.monotonic()
    with os.fdopen(read_end) as pipe:
        report = pipe.read()
    rate = received / (quit_s - start_s) / 1e3
    print(f"console {columns} x {rows}, 4 wheels: {report}, {rate:.0f} kB/s, quits in {ended_s - quit_s:.2f} s")


def best_us(function: object, number: int) -> float:
    return min(timeit.repeat(function, number=number, repeat=7)) / number * 1e6  # type: ignore[call-overload]


def bench_parts() -> None:
    from gateway.console.page import ViewState, compose
    from gateway.console.waveform import draw_waveform
    from gateway.core.text.plain import PlainView

    session = FakeSession()
    wheel = session.snapshots[0].wheels[0]
    assert wheel.last is not None
    last, average = wheel.last.revolution.radial_mps2, wheel.average_mps2
    lines: list[str] = []
    plain = PlainView(lines.append)
    result = wheel.last
    pages = session.snapshots[:2] * 10
    view = ViewState()
    us = best_us(lambda: plain.result(result), 500)
    print(f"plain line: {us:.1f} us")
    for columns, rows in ((52, 9), (110, 20)):
        us = best_us(lambda c=columns, r=rows: draw_waveform(last, average, c, r), 100)
        print(f"waveform {columns} x {rows}: {us / 1e3:.3f} ms")
    us = best_us(lambda: [compose(snapshot, view, 120, 40) for snapshot in pages], 2) / len(pages)
    print(f"page 120 x 40, 4 new revolutions: {us / 1e3:.2f} ms")


if __name__ == "__main__":
    bench_parts()
    for size in ((80, 24), (120, 40), (200, 60)):
        bench_console(*size)
