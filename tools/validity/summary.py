"""Tables of the judgement."""

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
from accuracy.tables import Table

from validity.cases import AIM_OF_A_QUANTITY_PERCENT, AIMS_PERCENT, CASES
from validity.judging import BEYOND, Judged

# Limits of what counts as false, in the errors of the estimate: a widening that meets one shows at another.
LIMITS: Final = (2.5, BEYOND, 5.0)
# Share within one standard error of a normal distribution.
_ONE_SIGMA: Final = 0.6827


@dataclass(frozen=True, slots=True)
class Share:
    """Statistics of one quantity from one estimator.

    Attributes:
        judged: how many were.
        valid: called valid.
        falsely_valid: called valid and beyond 3.5 errors.
        able: judged last, where the data determine the quantity.
        falsely_invalid: of these, not called valid.
        rms: of the pulls of the valid.
        largest: pull.
    """

    judged: int
    valid: int
    falsely_valid: int
    able: int
    falsely_invalid: int
    rms: float
    largest: float


def share(result: Iterable[Judged]) -> Share:
    """Return the statistics of some judgements."""
    entries = list(result)
    valid = [entry for entry in entries if entry.valid]
    # Before the averages settle, nothing has to be valid.
    able = [entry for entry in entries if entry.last and entry.determinable]
    pulls = np.array([entry.pull for entry in valid if math.isfinite(entry.pull)])
    return Share(
        judged=len(entries),
        valid=len(valid),
        falsely_valid=sum(entry.falsely_valid for entry in valid),
        able=len(able),
        falsely_invalid=sum(not entry.valid for entry in able),
        rms=float(np.sqrt(np.mean(np.square(pulls)))) if len(pulls) else math.nan,
        largest=float(pulls[np.argmax(np.abs(pulls))]) if len(pulls) else math.nan,
    )


def _grouped(judged: Iterable[Judged], key: Callable[[Judged], tuple[str, ...]]) -> dict[tuple[str, ...], list[Judged]]:
    groups: dict[tuple[str, ...], list[Judged]] = defaultdict(list)
    for entry in judged:
        groups[key(entry)].append(entry)
    return groups


def kind_table(judged: Sequence[Judged]) -> Table:
    """Return the falsely valid shares of each kind of case beside its aim, the share valid, and the pulls."""
    rows = []
    for (kind,), entries in _grouped(judged, lambda entry: (entry.table,)).items():
        valid = [entry for entry in entries if entry.valid]
        pulls = np.array([abs(entry.pull) for entry in valid])
        aim = AIMS_PERCENT.get(kind)  # type: ignore[call-overload]
        rows.append(
            (kind, str(len({(entry.case, entry.tire) for entry in entries})), str(len(valid)),
             _percent(len(valid), len(entries)),
             *(_share(sum(entry.is_false(limit) for entry in valid), len(valid)) for limit in LIMITS),
             "-" if aim is None else f"{aim:g} %",
             _number(float(np.quantile(pulls, _ONE_SIGMA))) if len(pulls) else "-")
        )  # fmt: skip
    heads = ("cases", "runs", "valid", "share valid", *(f"false at {limit:g}" for limit in LIMITS), "aim", "pull")
    about = (
        f"from the fourth revolution on; false: valid, but off by more than so many of its errors, aim at {BEYOND:g}; "
        "pull: 68 % are below"
    )
    return Table("By kind of case", about, heads, tuple(rows))


def quantity_table(judged: Sequence[Judged]) -> Table:
    """Return the falsely valid share of each quantity in each kind of case, the worst first."""
    kinds = tuple(dict.fromkeys(entry.table for entry in judged))
    rows = []
    for (estimator, quantity), entries in _grouped(judged, lambda entry: (entry.estimator, entry.quantity)).items():
        cells = []
        for kind in kinds:
            valid = [entry for entry in entries if entry.table == kind and entry.valid]
            false = sum(entry.falsely_valid for entry in valid)
            cells.append(f"{_share(false, len(valid))} of {len(valid)}" if valid else "-")
        counted = share(entry for entry in entries if entry.table != "hidden")
        pulls = [abs(entry.pull) for entry in entries if entry.valid and entry.table != "hidden"]
        rows.append(
            (estimator, quantity, *cells, _share(counted.falsely_valid, counted.valid),
             _percent(counted.valid, counted.judged), _number(float(np.quantile(pulls, _ONE_SIGMA))) if pulls else "-")
        )  # fmt: skip
    rows.sort(key=lambda row: -float(row[-3].split()[0].replace("-", "0")))
    heads = ("estimator", "quantity", *kinds, "all but hidden", "share valid", "pull")
    about = f"falsely valid of the valid; aim: {AIM_OF_A_QUANTITY_PERCENT:g} % of all but hidden; pull: 68 % are below"
    return Table("By quantity", about, heads, tuple(rows))


def _share(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.2f} %" if whole else "-"


def well_table(judged: Sequence[Judged]) -> Table:
    """Return all quantities where everything stated is true, within stated errors and exactly."""
    kinds = {
        "within errors": {case.name for case in CASES if case.well and case.name != "known"},
        "exactly": {"known"},
    }
    kinds = {kind: names for kind, names in kinds.items() if any(entry.case in names for entry in judged)}
    groups = _grouped(judged, lambda entry: (entry.estimator, entry.quantity))
    rows = []
    for (estimator, quantity), result in groups.items():
        row = [estimator, quantity]
        for names in kinds.values():
            row += _cells(share(entry for entry in result if entry.case in names))
        rows.append(tuple(row))
    heads = ["estimator", "quantity"]
    for kind in kinds:
        heads += [f"{kind}: valid", "rms", "largest", "false"]
    return Table(
        "Where all that is stated is true",
        "valid: share valid at the end where the data determine the quantity; rms and largest pull of the valid; "
        "false: share of the valid beyond 3.5 errors",
        tuple(heads),
        tuple(rows),
    )


def _cells(result: Share) -> list[str]:
    able = f"{100.0 * (1.0 - result.falsely_invalid / result.able):.0f} %" if result.able else "-"
    if not result.valid:
        return [able, "-", "-", "-"]
    return [able, _number(result.rms), _number(result.largest), f"{100.0 * result.falsely_valid / result.valid:.1f} %"]


def _number(value: float) -> str:
    if not math.isfinite(value):
        return "-"
    return f"{value:.2f}" if abs(value) < 10.0 else f"{value:.0f}"


def case_table(judged: Sequence[Judged]) -> Table:
    """Return the cases with falsely valid estimates, most first: at which sizes, and the quantities hit most."""
    about = {case.name: case for case in CASES}
    rows = []
    for (name,), result in _grouped(judged, lambda entry: (entry.case,)).items():
        counts = share(result)
        false = [entry for entry in result if entry.falsely_valid]
        if not false or name not in about:
            continue
        runs = {(entry.tire, entry.size) for entry in result}
        hit = sorted({(entry.tire, entry.size) for entry in false}, key=lambda run: run[1])
        most = Counter(entry.quantity for entry in false).most_common(3)
        rows.append(
            (name, about[name].kind, str(counts.valid), str(counts.falsely_valid), f"{len(hit)} of {len(runs)}",
             ", ".join(f"{size:.3g}" for _, size in hit[:4]),
             ", ".join(f"{quantity} {count}" for quantity, count in most))
        )  # fmt: skip
    rows.sort(key=lambda row: -int(row[3]))
    heads = ("case", "kind", "valid", "falsely", "runs", "at sizes", "most often")
    return Table("By case", "over all quantities; the others have none falsely valid", heads, tuple(rows))


def _percent(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.1f} %" if whole else "-"


def worst(judged: Sequence[Judged], count: int) -> Table:
    """Return the falsely valid with the largest pulls, one for each case and quantity."""
    groups = _grouped(
        (entry for entry in judged if entry.falsely_valid),
        lambda entry: (entry.case, entry.estimator, entry.quantity),
    )
    most = sorted(groups.values(), key=lambda result: -len(result))[:count]
    rows = []
    for result in most:
        entry = max(result, key=lambda entry: abs(entry.pull))
        rows.append(
            (entry.case, f"{entry.size:g}", str(entry.tire), entry.estimator, entry.quantity, str(len(result)),
             f"{entry.value:.5g}", f"{entry.std:.2g}", f"{entry.truth:.5g}", _number(entry.pull))
        )  # fmt: skip
    heads = ("case", "size", "tire", "estimator", "quantity", "times", "value", "std", "truth", "pull")
    about = "the largest of each; --seed S --tire N --case NAME repeats it"
    return Table("Most often falsely valid", about, heads, tuple(rows))


def each_table(judged: Sequence[Judged]) -> Table:
    """Return every estimate at the end of its run."""
    rows = []
    for entry in judged:
        if entry.last:
            relative = f"{100.0 * (entry.value / entry.truth - 1.0):+.2f}" if entry.truth else f"{entry.value:.2g}"
            error = f"{100.0 * entry.std / abs(entry.truth):.2f}" if entry.truth else f"{entry.std:.2g}"
            rows.append(
                (entry.case, f"{entry.size:g}", str(entry.tire), entry.kind, entry.estimator, entry.quantity,
                 relative, error, _number(entry.pull), entry.status)
            )  # fmt: skip
    heads = ("case", "size", "tire", "kind", "estimator", "quantity", "error", "stated", "pull", "status")
    return Table("Every estimate", "at the end; error and stated error in % of the truth", heads, tuple(rows))


def invalid_reasons(judged: Sequence[Judged], count: int) -> Table:
    """Return why estimates are not valid although all is well and the data determine them."""
    well = {case.name for case in CASES if case.well}
    groups: dict[tuple[str, ...], int] = defaultdict(int)
    for entry in judged:
        if entry.case in well and entry.last and entry.determinable and not entry.valid:
            groups[entry.case, entry.estimator, entry.quantity, " ".join(entry.reasons) or "no result"] += 1
    most = sorted(groups.items(), key=lambda item: -item[1])[:count]
    return Table(
        "Most often falsely invalid",
        "where all is well and the data determine the quantity",
        ("case", "estimator", "quantity", "reasons", "times"),
        tuple((*key, str(times)) for key, times in most),
    )


_FIELDS: Final = tuple(field.name for field in fields(Judged))


def from_rows(rows: Iterable[Sequence[Any]]) -> list[Judged]:
    """Return the judgements that `to_rows` wrote."""
    results = []
    for row in rows:
        values = {name: math.nan if value is None else value for name, value in zip(_FIELDS, row, strict=True)}
        results.append(Judged(**{**values, "reasons": tuple(values["reasons"])}))
    return results


def to_rows(judged: Sequence[Judged]) -> list[list[Any]]:
    """Return the judgements as plain values; reasons only of those that `invalid_reasons` lists."""
    rows = []
    for entry in judged:
        row = [getattr(entry, name) for name in _FIELDS]
        row[-1] = list(entry.reasons) if entry.last and not entry.valid else []
        rows.append([None if isinstance(value, float) and not math.isfinite(value) else value for value in row])
    return rows
