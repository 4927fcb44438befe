"""Rolls the kept tires and writes their signals: python -m independent_tire --cache DIR [--tire NAME] [--drawn SEED].

One .npz for each tire. `description` is JSON: the parameters, the numbers Bs, Cw, Rs, Ts, the measured load, contact
edges, rolling resistance and scatter. For each offset of the sensor e in mm: `shape_<e>`, (6, revolutions, angles),
the parts of `independent_tire.sensor.Signals`, and `samples_<e>`, (3, n), time, radial and circumferential specific
force at 9600 Hz.
"""

import argparse
import json
import math
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from independent_tire.rolling import Belt, History, roll
from independent_tire.sensor import sampled, signals
from independent_tire.tires import LOCAL, PULLED, TIRES, drawn

RATE_HZ = 9600.0
OFFSETS_MM = (0.0, 2.0, 4.0, 6.0, 8.0, 12.0)
_SAMPLED_REVOLUTIONS = 10


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, help="folder of the .npz files")
    parser.add_argument(
        "--tire", action="append", choices=[belt.name for belt in (*TIRES, *PULLED, *LOCAL)], help="instead of all"
    )
    parser.add_argument("--pulled", action="store_true", help="the driven and braked tires in place of the others")
    parser.add_argument("--drawn", type=int, metavar="SEED", help="three tires drawn at random in place of the others")
    parser.add_argument("--elements", type=int, help="of the belt, instead of each tire's own number")
    parser.add_argument("--force", action="store_true", help="roll tires again that are there already")
    options = parser.parse_args()
    options.cache.mkdir(parents=True, exist_ok=True)
    # The others are of benchmarks of their own, so they are made only by name or on request.
    usual = drawn(options.drawn) if options.drawn is not None else PULLED if options.pulled else TIRES
    for belt in [belt for belt in (*TIRES, *PULLED, *LOCAL) if belt.name in options.tire] if options.tire else usual:
        path = options.cache / f"{belt.name}.npz"
        if path.is_file() and not options.force:
            continue
        tire = replace(belt, elements=options.elements) if options.elements else belt
        begun = time.perf_counter()
        try:
            history = roll(tire)
        except RuntimeError as error:
            sys.exit(str(error))
        write(path, tire, history)
        print(f"{tire.name}: {time.perf_counter() - begun:.0f} s, load {history.load_n.mean():.0f} N", flush=True)


def write(path: Path, belt: Belt, history: History) -> None:
    """Write one tire."""
    arrays = {}
    scatter = 0.0
    for offset_mm in OFFSETS_MM:
        result = signals(belt, history, 1e-3 * offset_mm)
        arrays[f"shape_{offset_mm:g}"] = np.stack(result)
        arrays[f"samples_{offset_mm:g}"] = np.stack(sampled(belt, result, RATE_HZ, _SAMPLED_REVOLUTIONS))
        scatter = max(scatter, belt.omega_radps**2 * float(np.std(result.radial_m - result.radial_m.mean(axis=0))))
    drag, torque, load = history.drag_n.mean(), history.torque_nm.mean(), history.load_n.mean()
    description = {
        **{key: value for key, value in asdict(belt).items() if value != math.inf},
        "numbers": [
            belt.bending_nm2 / (belt.radius_m**4 * belt.pressure_pa),
            belt.tension_width_m / belt.radius_m,
            belt.radial_npm2 / belt.pressure_pa,
            belt.tangential_npm2 / belt.pressure_pa,
        ],
        "load_n": float(load),
        "load_scatter_n": float(history.load_n.std()),
        "edges_rad": np.nanmean(history.edges_rad, axis=0).tolist(),
        "longitudinal_force_n": float(-drag),
        "axle_torque_nm": float(-torque),
        # The torque of the road on the belt holds it back; its force is along the belt's motion.
        "rolling_resistance": float((drag - torque / belt.radius_m) / load),
        "scatter_mps2": scatter,
    }
    np.savez_compressed(path, description=json.dumps(description), **arrays)


if __name__ == "__main__":
    main()
