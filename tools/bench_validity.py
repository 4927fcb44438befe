"""Validity of what the gateway states: random tires with known truth, stated rightly and wrongly.

Every tire goes through the whole chain: ring, sensor, hub, frames, pipeline, estimators. Each estimate is compared with
the truth. Falsely valid is an estimate called valid that is more than 3.5 of its errors from the truth. Falsely invalid
is one not called valid though everything stated is true and the data determine it.

Run: python tools/bench_validity.py [--count 40] [--case NAME] [--quantity NAME] [--estimator NAME] [--json FILE]
"""

import argparse
import functools
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import TypeVar

from validity.bench import Order, judge_tire
from validity.cases import CASES, named
from validity.independent import agreement_table
from validity.judging import QUANTITIES
from validity.left_out import add_counts, count_tire, left_out_table
from validity.summary import (
    as_json,
    case_table,
    each_table,
    estimator_table,
    from_json,
    invalid_reasons,
    kind_table,
    misstatement_table,
    quantity_table,
    reference_table,
    well_table,
    worst,
)

from gateway.core.estimates.registry import ESTIMATORS

T = TypeVar("T")

# The models of `ring-modal` and `ring-paper` are biased, as they say, and `forward` takes a tenth of a second for each
# revolution: they are judged on request.
DEFAULT = (
    "kinematic", "distance", "self-calibration", "weak-form", "wear", "load", "longitudinal-force", "ply-steer",
)  # fmt: skip
# The independent tire is flat: no lateral axis.
ROLLED_WITHOUT = ("ply-steer",)


def main(arguments: Sequence[str] | None = None) -> None:
    options = _options(arguments)
    if options.agreement:
        print(agreement_table(options.rolled).text(markdown=options.markdown))
        return
    count = 8 if options.quick else options.count
    tires = options.tire if options.tire else range(options.first, options.first + count)
    cases = tuple(case.name for case in named(options.case))
    rolled = options.rolled if options.source == "fe" else None
    usual = DEFAULT if rolled is None else tuple(name for name in DEFAULT if name not in ROLLED_WITHOUT)
    chosen = tuple(options.estimator or usual)
    orders = [
        Order(options.seed, tire, cases, chosen, options.cache, options.pairs, rolled, options.source == "steady")
        for tire in tires
    ]
    if options.left_out:
        counts = functools.reduce(add_counts, _all(count_tire, orders, options.jobs))
        print(left_out_table(counts).text(markdown=options.markdown))
        return
    if options.kept:
        judged = [entry for path in options.kept for entry in from_json(json.loads(path.read_text(encoding="utf-8")))]
    else:
        judged = [entry for result in _all(judge_tire, orders, options.jobs) for entry in result]
    judged = [entry for entry in judged if not options.quantity or entry.quantity in options.quantity]
    if options.json:
        options.json.write_text(json.dumps(as_json(judged)), encoding="utf-8")
    valid = [entry for entry in judged if entry.valid]
    print(
        f"{len({entry.tire for entry in judged})} tires, {len({entry.case for entry in judged})} cases, "
        f"{len(judged)} estimates: "
        f"{len(valid)} valid, {sum(entry.falsely_valid for entry in valid)} of them falsely.\n"
    )
    tables = [
        kind_table(judged),
        quantity_table(judged),
        well_table([entry for entry in judged if entry.table == "true"]),
        misstatement_table([entry for entry in judged if entry.table == "one"]),
        case_table(judged),
        estimator_table(judged),
        reference_table(judged),
        worst(judged, options.worst),
        invalid_reasons(judged, options.worst),
    ]
    if options.each:
        tables = [each_table(judged)]
    for table in tables:
        if table.rows:
            print(table.text(markdown=options.markdown))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quantity", action="append", choices=QUANTITIES, help="judge these instead of all")
    parser.add_argument("--case", action="append", choices=[case.name for case in CASES], help="instead of all")
    parser.add_argument("--estimator", action="append", choices=tuple(ESTIMATORS), help="run these instead")
    parser.add_argument("--count", type=int, default=40, help="number of tires")
    parser.add_argument("--pairs", type=int, default=0, help="random pairs of misstatements of each tire")
    parser.add_argument("--first", type=int, default=0, help="number of the first tire")
    parser.add_argument("--tire", type=int, action="append", help="this tire only; repeat for several")
    parser.add_argument("--seed", type=int, default=1, help="of everything")
    parser.add_argument(
        "--source",
        choices=("exact", "steady", "fe"),
        default="exact",
        help="ring, or independent tire: rolling steadily, kept",
    )
    parser.add_argument("--rolled", type=Path, help="with --source fe: folder that tools/independent_tire wrote")
    parser.add_argument("--agreement", action="store_true", help="with --rolled: compare these tires with the ring")
    parser.add_argument("--quick", action="store_true", help="8 tires")
    parser.add_argument("--worst", type=int, default=20, help="rows of the tables of offenders")
    parser.add_argument("--left-out", action="store_true", help="without each rule of doubt in turn, 18 times as long")
    parser.add_argument("--each", action="store_true", help="print every estimate instead of the tables")
    parser.add_argument("--json", type=Path, help="write every judged estimate to this file")
    parser.add_argument("--kept", type=Path, action="append", help="tables of what --json wrote; runs nothing")
    parser.add_argument("--markdown", action="store_true", help="tables to paste into docs")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--cache", type=Path, help="folder that keeps ring solutions between runs; trust its files")
    options = parser.parse_args(arguments)
    if (options.source == "fe" or options.agreement) and options.rolled is None:
        parser.error("--source fe and --agreement need --rolled DIR; see tools/independent_tire")
    return options


def _all(work: Callable[[Order], T], orders: Sequence[Order], jobs: int) -> Iterator[T]:
    """Yield the judgements of all tires in order; progress goes to the terminal's error stream."""
    if jobs == 1:
        for number, order in enumerate(orders, 1):
            yield work(order)
            print(f"\r{number} of {len(orders)} tires", end="", file=sys.stderr, flush=True)
    else:
        with ProcessPoolExecutor(jobs) as pool:
            waiting = {pool.submit(work, order): index for index, order in enumerate(orders)}
            results: dict[int, T] = {}
            for done in as_completed(waiting):
                results[waiting[done]] = done.result()
                print(f"\r{len(results)} of {len(orders)} tires", end="", file=sys.stderr, flush=True)
        yield from (results[index] for index in range(len(orders)))
    print(file=sys.stderr)


if __name__ == "__main__":
    main()
