"""Tables of the judgement."""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Final

import numpy as np
from accuracy.tables import Table

from validity.cases import CASES
from validity.judging import BEYOND, REFERENCES, Judged

# Limits of what counts as false, in the errors of the estimate: a widening that meets one shows at another.
LIMITS: Final = (2.5, BEYOND, 5.0)


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


def share(found: Iterable[Judged]) -> Share:
    """Return the statistics of some judgements."""
    entries = list(found)
    valid = [one for one in entries if one.valid]
    # Before the averages settle, nothing has to be valid.
    able = [one for one in entries if one.last and one.determinable]
    pulls = np.array([one.pull for one in valid if math.isfinite(one.pull)])
    return Share(
        judged=len(entries),
        valid=len(valid),
        falsely_valid=sum(one.falsely_valid for one in valid),
        able=len(able),
        falsely_invalid=sum(not one.valid for one in able),
        rms=float(np.sqrt(np.mean(np.square(pulls)))) if len(pulls) else math.nan,
        largest=float(pulls[np.argmax(np.abs(pulls))]) if len(pulls) else math.nan,
    )


def _grouped(judged: Iterable[Judged], key: Callable[[Judged], tuple[str, ...]]) -> dict[tuple[str, ...], list[Judged]]:
    groups: dict[tuple[str, ...], list[Judged]] = defaultdict(list)
    for one in judged:
        groups[key(one)].append(one)
    return groups


def kind_table(judged: Sequence[Judged]) -> Table:
    """Return the falsely valid shares of each kind of case, by the limit of what counts as false."""
    rows = []
    for (kind,), entries in _grouped(judged, lambda one: (one.table,)).items():
        valid = [one for one in entries if one.valid]
        pulls = np.array([one.pull for one in valid])
        rows.append(
            (kind, str(len({(one.case, one.tire) for one in entries})), str(len(entries)), str(len(valid)),
             *(_share(sum(one.is_false(limit) for one in valid), len(valid)) for limit in LIMITS),
             _number(float(np.sqrt(np.mean(np.square(pulls)))) if len(pulls) else math.nan))
        )  # fmt: skip
    heads = ("cases", "runs", "judged", "valid", *(f"false at {limit:g}" for limit in LIMITS), "rms pull")
    return Table(
        "By kind of case",
        "all revolutions; false: valid, but off by more than so many of its standard errors",
        heads,
        tuple(rows),
    )


def quantity_table(judged: Sequence[Judged]) -> Table:
    """Return the falsely valid share of each quantity in each kind of case."""
    kinds = tuple(dict.fromkeys(one.table for one in judged))
    rows = []
    for (estimator, quantity), entries in _grouped(judged, lambda one: (one.estimator, one.quantity)).items():
        cells = []
        for kind in kinds:
            valid = [one for one in entries if one.table == kind and one.valid]
            false = sum(one.falsely_valid for one in valid)
            cells.append(f"{_share(false, len(valid))} of {len(valid)}" if valid else "-")
        rows.append((estimator, quantity, *cells))
    heads = ("estimator", "quantity", *kinds)
    return Table("By quantity", "falsely valid of the valid", heads, tuple(rows))


def _share(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.2f} %" if whole else "-"


def well_table(judged: Sequence[Judged]) -> Table:
    """Return all quantities where everything stated is true, within stated errors and exactly."""
    kinds = {
        "within errors": {case.name for case in CASES if case.well and case.name != "known"},
        "exactly": {"known"},
    }
    kinds = {kind: names for kind, names in kinds.items() if any(one.case in names for one in judged)}
    groups = _grouped(judged, lambda one: (one.estimator, one.quantity))
    rows = []
    for (estimator, quantity), found in groups.items():
        row = [estimator, quantity]
        for names in kinds.values():
            row += _cells(share(one for one in found if one.case in names))
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


def _cells(found: Share) -> list[str]:
    able = f"{100.0 * (1.0 - found.falsely_invalid / found.able):.0f} %" if found.able else "-"
    if not found.valid:
        return [able, "-", "-", "-"]
    return [able, _number(found.rms), _number(found.largest), f"{100.0 * found.falsely_valid / found.valid:.1f} %"]


def _number(value: float) -> str:
    if not math.isfinite(value):
        return "-"
    return f"{value:.2f}" if abs(value) < 10.0 else f"{value:.0f}"


def misstatement_table(judged: Sequence[Judged]) -> Table:
    """Return the falsely valid share of every quantity in every case."""
    present = dict.fromkeys(one.case for one in judged)
    names = [case.name for case in CASES if case.name in present and case.kind == "one"]
    groups = _grouped(judged, lambda one: (one.estimator, one.quantity))
    rows = []
    for (estimator, quantity), found in groups.items():
        cells = []
        for name in names:
            here = share(one for one in found if one.case == name)
            cells.append(f"{here.falsely_valid}/{here.valid}" if here.valid else ("." if here.judged else ""))
        rows.append((estimator, quantity, *cells))
    return Table(
        "Where one thing is not as stated",
        "falsely valid / valid; a point where nothing was valid",
        ("estimator", "quantity", *names),
        tuple(rows),
    )


def case_table(judged: Sequence[Judged]) -> Table:
    """Return the falsely valid by case over all quantities: at which sizes, and the quantities that are hit most."""
    rows = []
    by_case = _grouped(judged, lambda one: (one.case,))
    for case in CASES:
        found = by_case.get((case.name,), [])
        if not found:
            continue
        here = share(found)
        false = [one for one in found if one.falsely_valid]
        sizes = (f"{size:+g}: {n}" for size in case.sizes if (n := sum(one.size == size for one in false)))
        hit = _grouped(false, lambda one: (one.estimator, one.quantity))
        most = sorted(hit, key=lambda key: -len(hit[key]))[:3]
        unit = f" ({case.unit})" if case.unit else ""
        rows.append(
            (case.name + unit, case.about, str(here.valid), str(here.falsely_valid), ", ".join(sizes),
             ", ".join(f"{quantity} {len(hit[estimator, quantity])}" for estimator, quantity in most))
        )  # fmt: skip
    heads = ("case", "what is not as stated", "valid", "falsely", "at size: falsely", "most often")
    return Table("By case", "over all quantities", heads, tuple(rows))


def estimator_table(judged: Sequence[Judged]) -> Table:
    """Return each estimator's shares: all that is stated true, misstated, and against the aims."""
    well = {case.name for case in CASES if case.well}
    rows = []
    for (estimator,), found in _grouped(judged, lambda one: (one.estimator,)).items():
        good = share(one for one in found if one.case in well)
        bad = share(one for one in found if one.case not in well)
        rows.append(
            (
                estimator,
                _percent(good.able - good.falsely_invalid, good.able),
                _percent(good.falsely_valid, good.valid),
                _percent(bad.falsely_valid, bad.valid),
                _percent(bad.valid, bad.judged),
            )
        )
    heads = ("estimator", "well: valid", "well: falsely valid", "misstated: falsely valid", "misstated: valid")
    return Table("By estimator", "aims: at least 95 % valid where all is well, at most 1 % falsely valid", heads,
                 tuple(rows))  # fmt: skip


def _percent(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.1f} %" if whole else "-"


def worst(judged: Sequence[Judged], count: int) -> Table:
    """Return the falsely valid with the largest pulls, one for each case and quantity."""
    groups = _grouped((one for one in judged if one.falsely_valid), lambda one: (one.case, one.estimator, one.quantity))
    most = sorted(groups.values(), key=lambda found: -len(found))[:count]
    rows = []
    for found in most:
        one = max(found, key=lambda entry: abs(entry.pull))
        rows.append(
            (one.case, f"{one.size:g}", str(one.tire), one.estimator, one.quantity, str(len(found)),
             f"{one.value:.5g}", f"{one.std:.2g}", f"{one.truth:.5g}", _number(one.pull))
        )  # fmt: skip
    heads = ("case", "size", "tire", "estimator", "quantity", "times", "value", "std", "truth", "pull")
    return Table("Most often falsely valid", "the largest of each; --tire N --case NAME repeats it", heads, tuple(rows))


def reference_table(judged: Sequence[Judged]) -> Table:
    """Return the errors of the estimators whose models are known to be biased, where all that is stated is true."""
    well = {case.name for case in CASES if case.well}
    rows = []
    groups = _grouped((one for one in judged if one.estimator in REFERENCES), lambda one: (one.estimator, one.quantity))
    for (estimator, quantity), found in groups.items():
        last = [one for one in found if one.case in well and one.last]
        errors = np.array([one.value / one.truth - 1.0 for one in last if math.isfinite(one.value)])
        every = share(found)
        if len(errors):
            rows.append(
                (estimator, quantity, f"{100.0 * math.sqrt(float(np.mean(errors**2))):.0f}",
                 f"{100.0 * float(errors.mean()):+.0f}", f"{sum(one.valid for one in last)} of {len(last)}",
                 f"{every.falsely_valid} of {every.valid}")
            )  # fmt: skip
    heads = ("estimator", "quantity", "rms error, %", "mean error, %", "valid", "falsely valid, all cases")
    return Table("Reference estimators", "errors at the end, where all is well", heads, tuple(rows))


def each_table(judged: Sequence[Judged]) -> Table:
    """Return every estimate at the end of its run."""
    rows = []
    for one in judged:
        if one.last:
            relative = f"{100.0 * (one.value / one.truth - 1.0):+.2f}" if one.truth else f"{one.value:.2g}"
            error = f"{100.0 * one.std / abs(one.truth):.2f}" if one.truth else f"{one.std:.2g}"
            rows.append(
                (one.case, f"{one.size:g}", str(one.tire), one.kind, one.estimator, one.quantity,
                 relative, error, _number(one.pull), one.status)
            )  # fmt: skip
    heads = ("case", "size", "tire", "kind", "estimator", "quantity", "error", "stated", "pull", "status")
    return Table("Every estimate", "at the end; error and stated error in % of the truth", heads, tuple(rows))


def invalid_reasons(judged: Sequence[Judged], count: int) -> Table:
    """Return why estimates are not valid although all is well and the data determine them."""
    well = {case.name for case in CASES if case.well}
    groups: dict[tuple[str, ...], int] = defaultdict(int)
    for one in judged:
        if one.case in well and one.last and one.determinable and not one.valid:
            groups[one.case, one.estimator, one.quantity, " ".join(one.reasons) or "no result"] += 1
    most = sorted(groups.items(), key=lambda item: -item[1])[:count]
    return Table(
        "Most often falsely invalid",
        "where all is well and the data determine the quantity",
        ("case", "estimator", "quantity", "reasons", "times"),
        tuple((*key, str(times)) for key, times in most),
    )


def from_json(entries: Iterable[dict[str, Any]]) -> list[Judged]:
    """Return the judgements that `as_json` wrote."""
    names = {field.name for field in fields(Judged)}
    found = []
    for entry in entries:
        kept = {key: math.nan if value is None else value for key, value in entry.items() if key in names}
        found.append(Judged(**{**kept, "reasons": tuple(entry["reasons"])}))
    return found


def as_json(judged: Sequence[Judged]) -> list[dict[str, Any]]:
    """Return the judgements as plain values."""
    return [
        {key: (None if isinstance(value, float) and not math.isfinite(value) else value) for key, value in d.items()}
        for d in ({**asdict(one), "pull": one.pull, "falsely_valid": one.falsely_valid} for one in judged)
    ]
