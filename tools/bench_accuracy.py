"""Bias and spread of every registered estimator, with the Cramer-Rao bound.

Samples in time of the exact ring, with noise, 16 bit and disturbances, go through the gateway's own segmentation,
resampling and averaging. Run: python tools/bench_accuracy.py [--quick] [--markdown] [--only GROUP]
"""

import argparse
import os
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed

from accuracy.cases import Case, all_cases, quick_cases
from accuracy.measure import LONG, Effort, Outcome, measure
from accuracy.tables import bound_table, case_tables, grid_tables, use_tables

from gateway.core.estimates.registry import ESTIMATORS

# These live on the lateral axis, which the ring does not have: tools/bench_ply_steer.py measures them.
ELSEWHERE = ("ply-steer", "slip-angle")
QUICK = Effort(clean=10, single=12, single_slow=4, runs=2)
FULL = Effort(clean=20, single=40, single_slow=8, runs=4)
# Of 27 conditions shown together.
FULL_GRID = Effort(clean=20, single=12, single_slow=3, runs=3)


def main() -> None:
    options = _options()
    cases = quick_cases() if options.quick else all_cases()
    if options.only:
        cases = [case for case in cases if case.group in options.only]
    estimators = options.estimator or [name for name in ESTIMATORS if name not in ELSEWHERE]
    efforts = [QUICK if options.quick else FULL_GRID if case.group == "grid" else FULL for case in cases]
    outcomes = _measure_all(cases, estimators, efforts, options.jobs)
    for effort in dict.fromkeys(efforts):
        print(
            f"{efforts.count(effort)} conditions: per revolution {effort.single} revolutions "
            f"(forward {effort.single_slow}), after {LONG} {effort.runs} runs."
        )
    print()
    tables = [
        bound_table(outcomes),
        *grid_tables(outcomes, estimators),
        *(table for group in ("sampling", "noise", "variants") for table in case_tables(outcomes, estimators, group)),
        *use_tables(outcomes),
    ]
    for table in tables:
        if table.rows:
            print(table.text(markdown=options.markdown))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="some cases, few runs: within a minute")
    parser.add_argument("--markdown", action="store_true", help="tables to paste into docs")
    parser.add_argument("--only", action="append", choices=("grid", "sampling", "noise", "variants"))
    parser.add_argument("--estimator", action="append", choices=tuple(ESTIMATORS), help="instead of all")
    parser.add_argument("--jobs", type=int, default=max(1, (os.cpu_count() or 2) - 1))
    return parser.parse_args()


def _measure_all(cases: list[Case], estimators: list[str], efforts: list[Effort], jobs: int) -> list[Outcome]:
    """Measure on several processes; progress goes to the terminal's error stream."""
    results: dict[int, Outcome] = {}
    with ProcessPoolExecutor(jobs) as pool:
        waiting = {
            pool.submit(measure, case, estimators, effort): index
            for index, (case, effort) in enumerate(zip(cases, efforts, strict=True))
        }
        for done in as_completed(waiting):
            results[waiting[done]] = done.result()
            print(f"\r{len(results)} of {len(cases)} cases", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return [results[index] for index in range(len(cases))]


if __name__ == "__main__":
    main()
