"""Blind test of `treadlink diagnose` on undeclared effects.

Seeds draw tires, sensors and undeclared effects. The exact ring makes the recordings. Labels stay sealed until the
diagnosis is made. Run: python tools/bench_closure.py [--quick] [--seeds N] [--only EFFECT] [--jobs N] [--figure FILE]
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

import numpy as np
from closure_rig.causes import CAUSES, SIZES
from closure_rig.draw import Kind, Order, pair
from closure_rig.figure import draw_confusion
from closure_rig.judge import CANNOT_TELL
from closure_rig.outside import STRANGERS
from closure_rig.run import default_jobs, kept, run_all
from closure_rig.score import ENOUGH, by_effect, summary


def main() -> None:
    options = _options()
    faults: Counter[str] = Counter()
    if options.kept:
        judgements = [judgement for folder in options.kept for judgement in kept(folder)]
        print(f"{len(judgements)} cases kept")
    else:
        if options.keep is not None:
            options.keep.mkdir(parents=True, exist_ok=True)
        trials = run_all(_orders(options), options.jobs, options.model, options.keep)
        judgements = [trial.judgement for trial in trials]
        faults.update(trial.fault for trial in trials if trial.fault)
        seconds = sum(trial.seconds for trial in trials) / len(trials)
        print(f"baseline model {options.model}, {len(trials)} cases, {seconds:.1f} s each")
    print("\n".join(summary(judgements)))
    print("\nshare correct at " + ", ".join(SIZES) + f"; the smallest size found in {100 * ENOUGH:.0f} % of the cases")
    print("\n".join(by_effect(judgements)))
    pairs = [judgement for judgement in judgements if len(judgement.truth) > 1]
    for judgement in pairs:
        if not judgement.outcome.right:
            named = " + ".join(judgement.named) or "nothing named"
            print(f"pair {' + '.join(judgement.truth)} (seed {judgement.seed}): {judgement.outcome}; named {named}")
    for fault, count in faults.most_common():
        print(f"failed {count} times: {fault}")
    print("\ncounted as correct when left open between:")
    for names, reason in CANNOT_TELL.items():
        print(f"  {' / '.join(sorted(names))}: {reason}")
    if options.figure is not None:
        draw_confusion(judgements, options.figure)


def _orders(options: argparse.Namespace) -> list[Order]:
    seeds = range(options.first, options.first + options.seeds)
    sizes = range(1, len(SIZES)) if options.quick else range(len(SIZES))
    known = [entry.name for entry in CAUSES]
    strange = [entry.name for entry in STRANGERS]
    if options.only:
        kinds = {name: Kind.EFFECT if name in known else Kind.OUTSIDE for name in options.only}
        return [Order(kind, seed, (name,), size) for name, kind in kinds.items() for size in sizes for seed in seeds]
    orders: list[Order] = []
    parts = {part for part in ("effects", "pairs", "outside", "nothing") if getattr(options, part) is not None}
    everything = not parts
    if everything or "effects" in parts:
        orders += [Order(Kind.EFFECT, seed, (name,), size) for name in known for size in sizes for seed in seeds]
    if everything or "pairs" in parts:
        rng = np.random.default_rng(options.first)
        count = options.pairs or len(known) * options.seeds // 2
        orders += [Order(Kind.PAIR, options.first + i, pair(rng)) for i in range(count)]
    if everything or "outside" in parts:
        orders += [Order(Kind.OUTSIDE, seed, (name,), size) for name in strange for size in sizes for seed in seeds]
    if everything or "nothing" in parts:
        count = options.nothing or 10 * options.seeds
        orders += [Order(Kind.NOTHING, options.first + i) for i in range(count)]
    return orders


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    names = sorted(entry.name for entry in (*CAUSES, *STRANGERS))
    parser.add_argument("--seeds", type=int, default=None, help="cases of each effect and size; 10, quick 1")
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--only", action="append", choices=names, metavar="EFFECT", help="only this effect; repeatable")
    parser.add_argument("--quick", action="store_true", help="one seed, middle and large sizes")
    parser.add_argument("--effects", action="store_const", const=0, help="single effects")
    parser.add_argument("--pairs", type=int, nargs="?", const=0, help="pairs of effects, and their number")
    parser.add_argument("--outside", action="store_const", const=0, help="effects outside the catalogue")
    parser.add_argument("--nothing", type=int, nargs="?", const=0, help="cases without effects, and their number")
    parser.add_argument("--model", choices=("paper", "series", "exact"), default="exact", help="baseline model")
    parser.add_argument("--jobs", type=int, default=default_jobs())
    parser.add_argument("--keep", type=Path, help="folder for diagnoses and opened labels")
    parser.add_argument(
        "--kept",
        type=Path,
        action="append",
        metavar="DIR",
        help="only judge the cases kept there by --keep; repeatable",
    )
    parser.add_argument("--figure", type=Path, help="draw the confusion matrix, as docs/figures/closure-confusion.svg")
    options = parser.parse_args()
    options.seeds = options.seeds or (1 if options.quick else 10)
    return options


if __name__ == "__main__":
    main()
