"""Validity of what the gateway states: random tires with known truth, stated rightly and wrongly.

Every tire goes through the whole chain: ring, sensor, hub, link, frames, pipeline, estimators. Each estimate from the
fourth revolution on is compared with the truth. Falsely valid is one called valid that is more than 3.5 of its errors
from the truth. The cases are every parameter of the simulator, the vehicle file and the messages by itself, with sizes
that people meet (tools/validity/ranges.tsv), random pairs, conditions, and kinds that a stranger invented.

Run: python tools/bench_validity.py [--count 8] [--minutes 5] [--case NAME] [--json FILE]

As it is, each case runs on one of eight tires, which takes 5 minutes. The same file of --json goes on where it ended.
"""

import argparse
import functools
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import TypeVar

from validity.bench import Order, judge_tire
from validity.cases import CASES, named
from validity.independent import agreement_table
from validity.judging import QUANTITIES, Judged
from validity.left_out import add_counts, count_tire, left_out_table
from validity.summary import (
    case_table,
    each_table,
    from_rows,
    invalid_reasons,
    kind_table,
    quantity_table,
    to_rows,
    well_table,
    worst,
)

from gateway.core.estimates.registry import ESTIMATORS

T = TypeVar("T")

# The models of `ring-modal` and `ring-paper` are biased, as they say, and `forward` takes a tenth of a second for each
# revolution: they are judged on request.
DEFAULT = (
    "kinematic", "distance", "self-calibration", "weak-form", "wear", "load", "longitudinal-force", "ply-steer",
    "turning", "grade",
)  # fmt: skip
# The independent tire is flat: no lateral axis.
ROLLED_WITHOUT = ("ply-steer", "turning")


def main(arguments: Sequence[str] | None = None) -> None:
    options = _options(arguments)
    if options.agreement:
        print(agreement_table(options.rolled).text(markdown=options.markdown))
        return
    orders = _orders(options)
    if options.left_out:
        counts = functools.reduce(add_counts, (count for _, count in _all(count_tire, orders, options)))
        print(left_out_table(counts).text(markdown=options.markdown))
        return
    judged = [entry for entry in _judged(orders, options) if not options.quantity or entry.quantity in options.quantity]
    valid = [entry for entry in judged if entry.valid]
    runs = {(entry.kind, entry.tire, entry.case) for entry in judged}
    print(
        f"{len({(entry.kind, entry.tire) for entry in judged})} tires, {len(runs)} runs, {len(judged)} estimates: "
        f"{len(valid)} valid, {sum(entry.falsely_valid for entry in valid)} of them falsely.\n"
    )
    tables = [
        kind_table(judged),
        quantity_table(judged),
        well_table([entry for entry in judged if entry.table == "true"]),
        case_table(judged),
        worst(judged, options.worst),
        invalid_reasons(judged, options.worst),
    ]
    if options.each:
        tables = [each_table(judged)]
    for table in tables:
        if table.rows:
            print(table.text(markdown=options.markdown))


def _orders(options: argparse.Namespace) -> list[Order]:
    """Return the orders of the tires; of all cases each tire gets its share, cases that are named run on every tire."""
    rolled = options.rolled if options.source == "fe" else None
    usual = DEFAULT if rolled is None else tuple(name for name in DEFAULT if name not in ROLLED_WITHOUT)
    tires = options.tire if options.tire else range(options.first, options.first + options.count)
    names = {
        tire: tuple(
            case.name
            for number, case in enumerate(named(options.case))
            if options.case or (number + tire) % options.share == 0
        )
        for tire in tires
    }
    return [
        Order(options.seed, tire, names[tire], tuple(options.estimator or usual), options.cache, options.pairs,
              rolled, options.source == "steady")
        for tire in tires
    ]  # fmt: skip


def _judged(orders: Sequence[Order], options: argparse.Namespace) -> Iterator[Judged]:
    """Yield what is in the files, and of the other tires what runs now; --json keeps it, tire by tire."""
    paths = [*(options.stored or ()), *([options.json] if options.json and options.json.is_file() else [])]
    done = set()
    for path in paths:
        with path.open(encoding="utf-8") as lines:
            for line in lines:
                entry = json.loads(line)
                done.add(entry["order"])
                yield from from_rows(entry["judged"])
    if options.stored:
        return
    waiting = [order for order in orders if repr(order) not in done]
    for order, judged in _all(judge_tire, waiting, options):
        if options.json:
            with options.json.open("a", encoding="utf-8") as lines:
                lines.write(json.dumps({"order": repr(order), "judged": to_rows(judged)}) + "\n")
        yield from judged


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quantity", action="append", choices=QUANTITIES, help="judge these instead of all")
    parser.add_argument(
        "--case", action="append", metavar="NAME", help="instead of all; a pair as 'NAME + NAME'; ? lists them"
    )
    parser.add_argument("--estimator", action="append", choices=tuple(ESTIMATORS), help="run these instead")
    parser.add_argument("--count", type=int, default=8, help="number of tires")
    parser.add_argument("--share", type=int, default=8, help="each tire gets one case of so many, in turn")
    parser.add_argument(
        "--pairs", type=int, default=0, help="random pairs of each tire, and as many beside normal errors"
    )
    parser.add_argument("--minutes", type=float, default=1e6, help="begin no tire after this time")
    parser.add_argument("--first", type=int, default=0, help="number of the first tire")
    parser.add_argument("--tire", type=int, action="append", help="this tire only; repeat for several")
    parser.add_argument("--seed", type=int, default=1, help="of everything")
    parser.add_argument(
        "--source",
        choices=("exact", "steady", "fe"),
        default="exact",
        help="ring, or independent tire: rolling steadily, stored",
    )
    parser.add_argument("--rolled", type=Path, help="with --source fe: folder that tools/independent_tire wrote")
    parser.add_argument("--agreement", action="store_true", help="with --rolled: compare these tires with the ring")
    parser.add_argument("--worst", type=int, default=20, help="rows of the tables of offenders")
    parser.add_argument("--left-out", action="store_true", help="without each rule of doubt in turn, 18 times as long")
    parser.add_argument("--each", action="store_true", help="print every estimate instead of the tables")
    parser.add_argument("--json", type=Path, help="keep every judged estimate in this file, and go on where it ended")
    parser.add_argument("--stored", type=Path, action="append", help="tables of such files; runs nothing")
    parser.add_argument("--markdown", action="store_true", help="tables to paste into docs")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--cache", type=Path, help="folder that keeps ring solutions between runs; trust its files")
    options = parser.parse_args(arguments)
    if options.case == ["?"]:
        parser.exit(0, "".join(f"{case.kind:11}{case.name:46}{case.about}\n" for case in CASES))
    if (options.source == "fe" or options.agreement) and options.rolled is None:
        parser.error("--source fe and --agreement need --rolled DIR; see tools/independent_tire")
    try:
        named(options.case)
    except ValueError as error:
        parser.error(str(error))
    return options


def _all(work: Callable[[Order], T], orders: Sequence[Order], options: argparse.Namespace) -> Iterator[tuple[Order, T]]:
    """Yield the results of the tires as they end; progress goes to the terminal's error stream."""
    end_s = time.monotonic() + 60.0 * options.minutes
    if options.jobs == 1:
        for number, order in enumerate(orders, 1):
            if time.monotonic() > end_s:
                break
            yield order, work(order)
            print(f"\r{number} of {len(orders)} tires", end="", file=sys.stderr, flush=True)
    else:
        with ProcessPoolExecutor(options.jobs) as pool:
            waiting = {pool.submit(work, order): order for order in orders}
            for number, done in enumerate(as_completed(waiting), 1):
                if time.monotonic() > end_s:
                    pool.shutdown(wait=False, cancel_futures=True)
                if not done.cancelled():
                    yield waiting[done], done.result()
                print(f"\r{number} of {len(orders)} tires", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)


if __name__ == "__main__":
    main()
