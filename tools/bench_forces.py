"""Accuracy of the forces of driven, braked and freely rolling tires, with pulls and the Cramer-Rao bound.

Random tires of the exact ring with losses, extension and a drifting speed go through the whole chain: ring, sensor,
hub, frames, pipeline, estimators. With --rolled DIR, the tires of finite elements that
`python -m independent_tire` made are judged instead.

Run: python tools/bench_forces.py [--bound | --linearity | --cornering MODEL | --rolled DIR] [--count 28] [--markdown]
"""

import argparse
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import TypeVar

from accuracy.tables import Table
from forces.bounds import bound_table
from forces.lateral import MODELS, cornering, linearity_table
from forces.runs import TRACTIONS, Measured, pulls, rolled, simulated

from gateway.core.estimates.estimator import Status

T = TypeVar("T")
CASES = ("free", "driven", "braked")

UNITS = {
    "longitudinal_force_n": ("N", 1.0, 0),
    "axle_torque_nm": ("N m", 1.0, 1),
    "rolling_resistance": ("%", 1e2, 2),
    "load_by_width_n": ("N", 1.0, 0),
    "side_force_n": ("N", 1.0, 0),
    "aligning_moment_nm": ("N m", 1.0, 1),
    "friction_used": ("", 1.0, 3),
    "sliding_share": ("", 1.0, 2),
}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bound", action="store_true", help="print the Cramer-Rao bound only")
    parser.add_argument("--linearity", action="store_true", help="print how linear side force and moment are only")
    parser.add_argument("--cornering", choices=MODELS, help="judge side force and moment on a lateral model")
    parser.add_argument("--count", type=int, default=28, help="random tires of the exact ring")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--rolled", type=Path, help="folder of kept tires of finite elements, judged instead")
    parser.add_argument("--known", action="store_true", help="of them: everything stated exactly, a perfect sensor")
    parser.add_argument("--each", action="store_true", help="print every tire")
    parser.add_argument("--markdown", action="store_true")
    options = parser.parse_args(arguments)
    if options.bound:
        tables = [bound_table()]
    elif options.linearity:
        tables = [linearity_table()]
    elif options.cornering:
        measured = _spread(partial(_corner, options.cornering, options.seed), range(options.count), options.jobs)
        tables = _tables(measured, options.each)
    elif options.rolled:
        measured = list(rolled(options.rolled, options.seed, options.known))
        tables = [each_table(measured), summary_table(measured)]
    else:
        orders = [(index, TRACTIONS[index % len(TRACTIONS)]) for index in range(options.count)]
        measured = _spread(partial(_single, options.seed), orders, options.jobs)
        tables = _tables(measured, options.each)
    for table in tables:
        print(table.text(markdown=options.markdown))


def _tables(measured: Sequence[Measured], each: bool) -> list[Table]:
    return [each_table(measured), summary_table(measured)] if each else [summary_table(measured)]


def _spread(judge: Callable[[T], list[Measured]], orders: Sequence[T], jobs: int) -> list[Measured]:
    if jobs == 1:
        return [measurement for order in orders for measurement in judge(order)]
    with ProcessPoolExecutor(jobs) as pool:
        return [measurement for result in pool.map(judge, orders) for measurement in result]


def _single(seed: int, order: tuple[int, float]) -> list[Measured]:
    return list(simulated(*order, seed))


def _corner(model: str, seed: int, index: int) -> list[Measured]:
    return list(cornering(model, index, seed))


def each_table(measured: Sequence[Measured]) -> Table:
    """Return every tire: truth and estimates."""
    rows = []
    names = list(dict.fromkeys(measurement.quantity for measurement in measured))
    for (tire, case), members in groupby(measured, key=lambda measurement: (measurement.tire, measurement.case)):
        group = {measurement.quantity: measurement for measurement in members}
        cells = []
        for name in names:
            measurement = group.get(name)
            if measurement is None:
                cells += ["-", "-"]
                continue
            _, factor, digits = UNITS[name]
            truth, value, std = (
                f"{factor * v:.{digits}f}"
                for v in (measurement.truth, measurement.estimate.value, measurement.estimate.std)
            )
            text = f"{value} ± {std}"
            cells += [truth, text if measurement.estimate.status is Status.VALID else f"({text})"]
        rows.append((tire, case, *cells))
    heads = [
        head
        for name in names
        for head in (", ".join(filter(None, (f"true {_words(name)}", UNITS[name][0]))), "estimated")
    ]
    return Table("Forces of each tire", "in brackets what is not valid", ("tire", "", *heads), tuple(rows))


def summary_table(measured: Sequence[Measured]) -> Table:
    """Return errors and pulls by quantity and case."""
    rows = []
    for name in dict.fromkeys(measurement.quantity for measurement in measured):
        cases = [case for case in CASES if any(measurement.case == case for measurement in measured)]
        for case in (*cases, "all"):
            chosen = [
                measurement
                for measurement in measured
                if measurement.quantity == name and case in (measurement.case, "all")
            ]
            if not chosen:
                continue
            rms, largest, share, false = pulls(chosen)
            valid = [measurement for measurement in chosen if measurement.estimate.status is Status.VALID]
            errors = sorted(
                abs(measurement.estimate.value - measurement.truth) / measurement.unit for measurement in valid
            )
            middle = f"{100.0 * errors[len(errors) // 2]:.2g}" if errors else "-"
            worst = f"{100.0 * errors[-1]:.2g}" if errors else "-"
            row = (_words(name), case, str(len(chosen)), f"{100.0 * share:.0f}", middle, worst, f"{rms:.2f}",
                   f"{largest:.1f}", str(false))  # fmt: skip
            rows.append(row)
    return Table(
        "Accuracy of forces",
        "errors of valid estimates over the load (torque: load times radius; resistance as it is); a pull is an error "
        "over its standard error; falsely valid is a pull above 3",
        (
            "quantity",
            "case",
            "runs",
            "valid, %",
            "median error, %",
            "largest, %",
            "pull rms",
            "largest",
            "falsely valid",
        ),
        tuple(rows),
    )


def _words(name: str) -> str:
    return {"axle_torque_nm": "torque"}.get(name, name.removesuffix("_nm").removesuffix("_n").replace("_", " "))


if __name__ == "__main__":
    main()
