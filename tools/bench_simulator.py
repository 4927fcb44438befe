"""CPU of the simulator: one ring solution, start of the demo, and per simulated second."""

import threading
import time
from statistics import median

from gateway.core.clock import ManualClock
from gateway.core.links.source import Chunk, open_source
from gateway.ring.rolling_ring import RingParameters, solve_rolling_ring


def main() -> None:
    ring = RingParameters.from_numbers(3.0833e-3, 0.1953, 2.974, 2.5289, radius_m=0.32, pressure_pa=2.1e5)
    for nodes in (720, 3600):
        spent = []
        for _ in range(9):
            begin = time.perf_counter()
            solution = solve_rolling_ring(ring, 5000.0, 2.1e5, 56.42, nodes=nodes)
            spent.append(time.perf_counter() - begin)
        print(f"ring solve, {nodes} nodes: {median(spent) * 1e3:.1f} ms, {solution.iterations} iterations")

    begin = time.perf_counter()
    source = open_source("sim:demo?speed=max&duration=30", ManualClock())
    print(f"opening sim:demo: {time.perf_counter() - begin:.2f} s")
    begin_cpu = time.process_time()
    size = sum(len(item.data) for item in source.items(threading.Event()) if isinstance(item, Chunk))
    cpu_s = time.process_time() - begin_cpu
    share = 100 * cpu_s / 30
    print(f"4 wheels x 3 axes x 9600 Hz, encoder included: {share:.1f} % of a core ({size / 3e7:.3f} MB/s)")


if __name__ == "__main__":
    main()
