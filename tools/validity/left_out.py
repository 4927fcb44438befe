"""What each rule of doubt brings: the same runs estimated anew with one of them left out at a time."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from accuracy.tables import Table

from gateway.core.estimates.doubt_rules import EVERY_RULE, DoubtRule
from validity.bench import Order, ToldRun, told_runs
from validity.judging import Judged

_NONE: Final = "none"
_DEFAULTS: Final = "errors of load and pressure where none is stated"
_ALL: Final = "all"
_KEPT: Final = ("true", "one", "conditions")
# Of its value: a load or pressure that is stated without an error, were it taken as exact.
_EXACT: Final = 1e-6


@dataclass(slots=True)
class Counts:
    """Estimates by kind of case: valid, falsely so, and valid as well with every rule."""

    valid: Counter[str] = field(default_factory=Counter)
    false: Counter[str] = field(default_factory=Counter)
    still_valid: Counter[str] = field(default_factory=Counter)

    def add(self, judged: Iterable[Judged], with_all: Iterable[Judged]) -> None:
        """Add the estimates of a run, beside those of the same run with every rule."""
        for item, before in zip(judged, with_all, strict=True):
            if item.valid:
                self.valid[item.table] += 1
                self.false[item.table] += item.falsely_valid
                self.still_valid[item.table] += before.valid


def add_counts(first: dict[str, Counts], second: dict[str, Counts]) -> dict[str, Counts]:
    """Return the sums of the counts of two tires."""
    return {
        way: Counts(
            item.valid + second[way].valid, item.false + second[way].false, item.still_valid + second[way].still_valid
        )
        for way, item in first.items()
    }


def count_left_out(runs: Iterable[ToldRun], rules: Sequence[DoubtRule] = tuple(DoubtRule)) -> dict[str, Counts]:
    """Return the counts of some runs by the rule that is left out, `none` first and all rules last."""
    counts: dict[str, Counts] = {}
    for told in runs:
        with_all = told.judged()
        ways = {
            _NONE: with_all,
            **{str(rule): told.judged(EVERY_RULE - {rule}) for rule in rules},
            _DEFAULTS: _without_defaults(told).judged(),
            _ALL: _without_defaults(told).judged(frozenset()),
        }
        for way, judged in ways.items():
            counts.setdefault(way, Counts()).add(judged, with_all)
    return counts


def count_tire(order: Order) -> dict[str, Counts]:
    """Return the counts of one tire in all cases."""
    return count_left_out(told_runs(order))


def _without_defaults(told: ToldRun) -> ToldRun:
    """Return a run of which load and pressure count as exact where no error of them is stated."""
    statement, world = told.statement, told.run.world
    load_std_n = _EXACT * world.load_n if statement.load_std_n is None else statement.load_std_n
    std_kpa = 1e-3 * _EXACT * world.pressure_pa if statement.pressure_std_kpa is None else statement.pressure_std_kpa
    return replace(told, statement=replace(statement, load_std_n=load_std_n, pressure_std_kpa=std_kpa))


def left_out_table(counts: dict[str, Counts]) -> Table:
    """Return falsely valid of the valid by kind, and what share of what is valid without a rule stays so with it."""
    kinds = tuple(counts[_NONE].valid)
    rows = []
    for way, count in counts.items():
        cells = [f"{100.0 * count.false[kind] / max(count.valid[kind], 1):.2f}" for kind in kinds]
        shares = [f"{100.0 * count.still_valid[kind] / count.valid[kind]:.1f}" for kind in _KEPT if count.valid[kind]]
        rows.append((way, *cells, " / ".join(shares)))
    heads = ("left out", *kinds, "kept")
    about = (
        "falsely valid in % of the valid, by kind; kept: % of what is valid without the rule that is so with it, "
        "true / one / conditions"
    )
    return Table("Each rule left out", about, heads, tuple(rows))
