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
    """Return the falsely valid shares of each kind of case, by the limit of what counts as false."""
    rows = []
    for (kind,), entries in _grouped(judged, lambda entry: (entry.table,)).items():
        valid = [entry for entry in entries if entry.valid]
        pulls = np.array([entry.pull for entry in valid])
        rows.append(
            (kind, str(len({(entry.case, entry.tire) for entry in entries})), str(len(entries)), str(len(valid)),
             *(_share(sum(entry.is_false(limit) for entry in valid), len(valid)) for limit in LIMITS),
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
    kinds = tuple(dict.fromkeys(entry.table for entry in judged))
    rows = []
    for (estimator, quantity), entries in _grouped(judged, lambda entry: (entry.estimator, entry.quantity)).items():
        cells = []
        for kind in kinds:
            valid = [entry for entry in entries if entry.table == kind and entry.valid]
            false = sum(entry.falsely_valid for entry in valid)
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


def misstatement_table(judged: Sequence[Judged]) -> Table:
    """Return the falsely valid share of every quantity in every case."""
    present = dict.fromkeys(entry.case for entry in judged)
    names = [case.name for case in CASES if case.name in present and case.kind == "one"]
    groups = _grouped(judged, lambda entry: (entry.estimator, entry.quantity))
    rows = []
    for (estimator, quantity), result in groups.items():
        cells = []
        for name in names:
            counts = share(entry for entry in result if entry.case == name)
            cells.append(f"{counts.falsely_valid}/{counts.valid}" if counts.valid else ("." if counts.judged else ""))
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
    by_case = _grouped(judged, lambda entry: (entry.case,))
    for case in CASES:
        result = by_case.get((case.name,), [])
        if not result:
            continue
        counts = share(result)
        false = [entry for entry in result if entry.falsely_valid]
        sizes = (f"{size:+g}: {n}" for size in case.sizes if (n := sum(entry.size == size for entry in false)))
        hit = _grouped(false, lambda entry: (entry.estimator, entry.quantity))
        most = sorted(hit, key=lambda key: -len(hit[key]))[:3]
        unit = f" ({case.unit})" if case.unit else ""
        rows.append(
            (case.name + unit, case.about, str(counts.valid), str(counts.falsely_valid), ", ".join(sizes),
             ", ".join(f"{quantity} {len(hit[estimator, quantity])}" for estimator, quantity in most))
        )  # fmt: skip
    heads = ("case", "what is not as stated", "valid", "falsely", "at size: falsely", "most often")
    return Table("By case", "over all quantities", heads, tuple(rows))


def estimator_table(judged: Sequence[Judged]) -> Table:
    """Return each estimator's shares: all that is stated true, misstated, and against the aims."""
    well = {case.name for case in CASES if case.well}
    rows = []
    for (estimator,), result in _grouped(judged, lambda entry: (entry.estimator,)).items():
        good = share(entry for entry in result if entry.case in well)
        bad = share(entry for entry in result if entry.case not in well)
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
    return Table("Most often falsely valid", "the largest of each; --tire N --case NAME repeats it", heads, tuple(rows))


def reference_table(judged: Sequence[Judged]) -> Table:
    """Return the errors of the estimators whose models are known to be biased, where all that is stated is true."""
    well = {case.name for case in CASES if case.well}
    rows = []
    groups = _grouped(
        (entry for entry in judged if entry.estimator in REFERENCES),
        lambda entry: (entry.estimator, entry.quantity),
    )
    for (estimator, quantity), result in groups.items():
        last = [entry for entry in result if entry.case in well and entry.last]
        errors = np.array([entry.value / entry.truth - 1.0 for entry in last if math.isfinite(entry.value)])
        every = share(result)
        if len(errors):
            rows.append(
                (estimator, quantity, f"{100.0 * math.sqrt(float(np.mean(errors**2))):.0f}",
                 f"{100.0 * float(errors.mean()):+.0f}", f"{sum(entry.valid for entry in last)} of {len(last)}",
                 f"{every.falsely_valid} of {every.valid}")
            )  # fmt: skip
    heads = ("estimator", "quantity", "rms error, %", "mean error, %", "valid", "falsely valid, all cases")
    return Table("Reference estimators", "errors at the end, where all is well", heads, tuple(rows))


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


def from_json(entries: Iterable[dict[str, Any]]) -> list[Judged]:
    """Return the judgements that `as_json` wrote."""
    names = {field.name for field in fields(Judged)}
    results = []
    for entry in entries:
        values = {key: math.nan if value is None else value for key, value in entry.items() if key in names}
        results.append(Judged(**{**values, "reasons": tuple(entry["reasons"])}))
    return results


def as_json(judged: Sequence[Judged]) -> list[dict[str, Any]]:
    """Return the judgements as plain values."""
    return [
        {key: (None if isinstance(value, float) and not math.isfinite(value) else value) for key, value in d.items()}
        for d in ({**asdict(entry), "pull": entry.pull, "falsely_valid": entry.falsely_valid} for entry in judged)
    ]
