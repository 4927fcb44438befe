"""Scores over many judgements: share correct, and smallest size found."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from closure_rig.causes import CAUSES, SIZES
from closure_rig.draw import Kind
from closure_rig.judge import Judgement, Outcome
from closure_rig.outside import STRANGERS

ENOUGH = 0.9
"""Share of cases in which an effect must be found for its size to count as found."""


def summary(judgements: Sequence[Judgement]) -> list[str]:
    """Return the summary lines."""
    lines = []
    for kind in Kind:
        of_kind = [entry for entry in judgements if entry.kind == kind]
        if not of_kind:
            continue
        for size in (*SIZES, ""):
            some = [entry for entry in of_kind if entry.size == size]
            if kind is Kind.PAIR:
                some = of_kind if size == "middle" else []
            if some:
                lines.append(_line(f"{kind} {'' if kind is Kind.PAIR else size}".strip(), some))
    ratios = np.array([entry.ratio for entry in judgements])
    ratios = ratios[np.isfinite(ratios)]
    if len(ratios):
        within = float(np.mean(ratios <= 1.1))
        low, middle, high = np.percentile(ratios, (5, 50, 95))
        lines.append(
            f"held-out error after / noise floor: median {middle:.3f}, 5 to 95 %: {low:.3f} to {high:.3f}; "
            f"within 1.1 in {100 * within:.1f} % of {len(ratios)}"
        )
    return lines


def by_effect(judgements: Sequence[Judgement]) -> list[str]:
    """Return one line per effect: share correct at each size, and the smallest size found."""
    units = {entry.name: entry for entry in (*CAUSES, *STRANGERS)}
    lines = []
    for name in sorted({_plain(entry.truth[0]) for entry in judgements if len(entry.truth) == 1}):
        of_name = [e for e in judgements if len(e.truth) == 1 and _plain(e.truth[0]) == name]
        shares, smallest = [], None
        for index, size in enumerate(SIZES):
            some = [entry for entry in of_name if entry.size == size]
            share = sum(entry.outcome.right for entry in some) / len(some) if some else math.nan
            shares.append(f"{sum(entry.outcome.right for entry in some)}/{len(some)}")
            if smallest is None and share >= ENOUGH:
                smallest = f"{units[name].sizes[index]:g} {units[name].unit}"
        said = Counter(wrong for entry in of_name for wrong in set(entry.named) - set(entry.truth))
        wrong = ", ".join(f"{other} {count}" for other, count in said.most_common(3))
        tail = f"  also named: {wrong}" if wrong else ""
        lines.append(f"{name:34s} {' '.join(f'{s:>5s}' for s in shares)}  from {smallest or '-'}{tail}")
    return lines


def _plain(truth: str) -> str:
    """Return the name of a truth, in parentheses when outside the catalogue."""
    return truth[1:-1] if truth.startswith("(") else truth


def confusion(judgements: Iterable[Judgement]) -> tuple[list[str], list[str], np.ndarray]:
    """Return the confusion matrix (truth, diagnosis, share of the truth's cases) of cases with at most one truth."""
    truths = [entry.name for entry in CAUSES] + [f"({entry.name})" for entry in STRANGERS] + ["nothing"]
    says = [entry.name for entry in CAUSES] + ["left open", "unexplained", "no name"]
    count = np.zeros((len(truths), len(says)))
    cases = np.zeros(len(truths))
    extra: dict[str, int] = {}
    for entry in judgements:
        if len(entry.truth) > 1 or entry.outcome is Outcome.FAILED:
            continue
        row = truths.index(entry.truth[0] if entry.truth else "nothing")
        cases[row] += 1
        for name in entry.named:
            if name not in says:
                # Effects that the rig does not draw may be named all the same.
                extra.setdefault(name, len(says))
                says.append(name)
                count = np.pad(count, ((0, 0), (0, 1)))
            count[row, says.index(name)] += 1
        if not entry.named:
            said = "left open" if entry.open else "unexplained" if entry.unexplained else "no name"
            count[row, says.index(said)] += 1
    return truths, says, count / np.maximum(cases, 1)[:, None]


def _line(what: str, some: Sequence[Judgement]) -> str:
    counts = Counter(entry.outcome for entry in some)
    right = sum(entry.outcome.right for entry in some)
    parts = ", ".join(f"{outcome} {counts[outcome]}" for outcome in Outcome if counts[outcome])
    return f"{what:16s} {right}/{len(some)} right ({100 * right / len(some):.1f} %): {parts}"
