"""Tables of the results, as text for a terminal or as Markdown."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from accuracy.cases import REFERENCE_PA, Case
from accuracy.measure import ABSOLUTE, LONG, Outcome
from gateway.core.ring_quantities import RING_NUMBERS

QUANTITIES = ("speed_mps", "half_angle_rad", "Bs", "Cw", "Rs", "Ts")
HEADS = ("speed", "half angle", "Bs", "Cw", "Rs", "Ts")
# What the numbers are used for, one estimator each; the last two in mm.
USES = (("load", "load_by_width_n"), ("wear", "wear_mm"), ("self-calibration", "sensor_offset_m"))
USE_HEADS = ("load by belt width, %", "wear, mm", "sensor offset, mm")
RATIOS = ("Bs/Cw", "Rs/Cw", "Ts/Cw")
CONTACT, CONTACT_HEADS = QUANTITIES[:2], HEADS[:2]


@dataclass(frozen=True, slots=True)
class Table:
    """A table of text: title, column heads and rows; `note` explains how to read it."""

    title: str
    note: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def text(self, *, markdown: bool) -> str:
        """Return the table as text."""
        lines = [self.heads, *self.rows]
        widths = [max(len(line[i]) for line in lines) for i in range(len(self.heads))]
        if not markdown:
            body = ["  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in lines]
            return "\n".join([self.title, self.note, "", *(line.rstrip() for line in body), ""])
        padded = ["| " + " | ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)) + " |" for line in lines]
        rule = "|" + "|".join("-" * (width + 2) for width in widths) + "|"
        return "\n".join([f"**{self.title}.** {self.note}", "", padded[0], rule, *padded[1:], ""])


def percent(value: float, digits: int = 3) -> str:
    """Return a share in percent with `digits` significant digits; a dash when it is not finite."""
    if not math.isfinite(value):
        return "-"
    size = abs(100.0 * value)
    if size >= 99.5:
        return f"{100.0 * value:.0f}"
    return f"{100.0 * value:.{digits}g}" if size >= 1e-3 else ("0" if size == 0.0 else f"{100.0 * value:.0e}")


def grid_tables(outcomes: Sequence[Outcome], estimators: Sequence[str]) -> Iterable[Table]:
    """Yield statistics over all conditions of the ring paper's Table 1."""
    grid = [outcome for outcome in outcomes if outcome.case.group == "grid"]
    if not grid:
        return

    def over(key: tuple[str, str], value: Callable[[Outcome], float]) -> list[float]:
        return [value(o) for o in grid if key in o.clean and math.isfinite(value(o))]

    def of_all(values: list[float]) -> str:
        return "" if len(values) == len(grid) else f" [{len(values)} of {len(grid)}]"

    bias, spread, long = [], [], []
    for name in estimators:
        biases, ratios, lasting = [name], [name], [name]
        for quantity in QUANTITIES:
            key = (name, quantity)
            clean = over(key, lambda o, key=key: o.clean[key].bias)
            biases.append(f"{percent(_rms(clean))} / {percent(_largest(clean))}{of_all(clean)}" if clean else "-")
            single = over(key, lambda o, key=key: o.single[key].std if key in o.single else math.nan)
            times = over(key, lambda o, key=key: o.single[key].std / o.bound[key[1]] if key in o.single else math.nan)
            ratios.append(f"{percent(_rms(single))} ({_median(times):.2g}x){of_all(single)}" if single else "-")
            late = over(key, lambda o, key=key: o.long[key].rms if key in o.long else math.nan)
            worth = over(key, lambda o, key=key: o.long[key].worth if key in o.long else math.nan)
            lasting.append(f"{percent(_rms(late))} ({_rms(worth):.2g}){of_all(late)}" if late else "-")
        for rows, row in ((bias, biases), (spread, ratios), (long, lasting)):
            if any(cell != "-" for cell in row[1:]):
                rows.append(tuple(row))
    heads = ("estimator", *HEADS)
    count = f"{len(grid)} conditions of Table 1"
    yield Table(f"Bias, {count}", "rms / largest, %, no noise", heads, tuple(bias))
    yield Table(f"Per revolution, {count}", "rms standard deviation, % (median times the bound)", heads, tuple(spread))
    yield Table(
        f"After {LONG} revolutions, {count}",
        "rms error, % (rms of the error over the stated standard error: 1 is honest)",
        heads,
        tuple(long),
    )


def case_tables(outcomes: Sequence[Outcome], estimators: Sequence[str], group: str) -> Iterable[Table]:
    """Yield the tables of one group: a row for each condition, estimators side by side in the columns."""
    chosen = [outcome for outcome in outcomes if outcome.case.group == group]
    if not chosen:
        return
    pairs = [(q, head, name) for q, head in zip(CONTACT, CONTACT_HEADS, strict=True) for name in estimators]
    pairs = [(q, head, name) for q, head, name in pairs if any((name, q) in outcome.clean for outcome in chosen)]
    if pairs:
        yield Table(
            f"Speed and contact, {group}",
            f"standard deviation per revolution, % (times the bound); after {LONG} revolutions mean error +- spread",
            ("condition", *(f"{head}, {name}" for _, head, name in pairs)),
            tuple((o.case.name, *(_contact_cell(o, name, q) for q, _, name in pairs)) for o in chosen),
        )
    fitters = [name for name in estimators if any((name, "Bs") in outcome.clean for outcome in chosen)]
    if not fitters:
        return
    heads = ("condition", *fitters)
    yield Table(
        f"Per revolution, {group}",
        "standard deviation of Bs, Cw, Rs, Ts, % (times the bound)",
        heads,
        tuple((o.case.name, *(_single_cell(o, name) for name in fitters)) for o in chosen),
    )
    yield Table(
        f"After {LONG} revolutions, {group}",
        "mean error +- spread of Bs, Cw, Rs, Ts, %; in brackets what the estimator itself does not call valid",
        heads,
        tuple((o.case.name, *(_long_cell(o, name, RING_NUMBERS) for name in fitters)) for o in chosen),
    )
    if group == "variants":
        yield Table(
            f"Ratios after {LONG} revolutions, {group}",
            "mean error +- spread of Bs/Cw, Rs/Cw, Ts/Cw, %",
            heads,
            tuple((o.case.name, *(_long_cell(o, name, RATIOS) for name in fitters)) for o in chosen),
        )


def _contact_cell(outcome: Outcome, name: str, quantity: str) -> str:
    single, long = outcome.single.get((name, quantity)), outcome.long.get((name, quantity))
    if single is None or long is None or not single.errors:
        return "-"
    times = single.std / outcome.bound[quantity]
    return f"{percent(single.std)} ({times:.2g}x); {percent(long.bias)} +- {percent(long.std)}"


def _single_cell(outcome: Outcome, name: str) -> str:
    samples = {number: outcome.single.get((name, number)) for number in RING_NUMBERS}
    stds = {number: sample.std if sample is not None else math.nan for number, sample in samples.items()}
    if not any(map(math.isfinite, stds.values())):
        return "-"
    times = " ".join(f"{stds[number] / outcome.bound[number]:.2g}" for number in RING_NUMBERS)
    return f"{' '.join(percent(std, 2) for std in stds.values())} ({times}x)"


def _long_cell(outcome: Outcome, name: str, quantities: Sequence[str]) -> str:
    texts = []
    for quantity in quantities:
        sample = outcome.long.get((name, quantity))
        if sample is None or not sample.errors:
            texts.append("none")
            continue
        spread = f"+-{percent(sample.std, 1)}" if math.isfinite(sample.std) else ""
        text = f"{percent(sample.bias, 2)}{spread}"
        texts.append(text if 2 * sample.valid > sample.asked else f"({text})")
    return " ".join(texts)


def use_tables(outcomes: Sequence[Outcome]) -> Iterable[Table]:
    """Yield load, wear and sensor offset in every condition."""
    if not any(key in outcome.long for outcome in outcomes for key in USES):
        return
    yield Table(
        f"Load, wear and sensor offset after {LONG} revolutions",
        "mean error +- its standard deviation; in brackets the standard deviation of one revolution (times the bound)",
        ("condition", *USE_HEADS),
        tuple((outcome.case.name, *(_use_cell(outcome, key) for key in USES)) for outcome in outcomes),
    )


def _use_cell(outcome: Outcome, key: tuple[str, str]) -> str:
    sample, single = outcome.long.get(key), outcome.single.get(key)
    if sample is None or not sample.errors:
        return "-"
    shown = plain if key[1] in ABSOLUTE else percent
    text = f"{shown(sample.bias)} +- {shown(sample.std)}"
    if single is None or not math.isfinite(single.std) or key[1] not in outcome.bound:
        return text
    return f"{text} ({shown(single.std)}, {single.std / outcome.bound[key[1]]:.2g}x)"


def plain(value: float) -> str:
    """Return a value with three digits; a dash when it is not finite."""
    return f"{value:.3g}" if math.isfinite(value) else "-"


def bound_table(outcomes: Sequence[Outcome]) -> Table:
    """Return the Cramer-Rao bounds of one revolution."""

    def shown(case: Case) -> bool:
        return case.group in ("sampling", "noise") or (
            case.group == "grid" and not case.wear_mm and case.pressure_pa == REFERENCE_PA
        )

    rows = [(o.case.name, *(percent(o.bound[quantity]) for quantity in QUANTITIES)) for o in outcomes if shown(o.case)]
    return Table(
        "Cramer-Rao bound of one revolution",
        "%, tread stiffness and contact centre estimated too, load known",
        ("condition", *HEADS),
        tuple(rows),
    )


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values else math.nan


def _largest(values: Sequence[float]) -> float:
    return max(values, key=abs)


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else math.nan
