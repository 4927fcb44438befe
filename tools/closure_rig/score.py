"""Scores of one or several versions over the same cases, from their lines of results."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.stats import beta

from closure_rig.causes import CAUSES
from closure_rig.draw import Kind
from closure_rig.judge import ALWAYS, Outcome
from closure_rig.outside import STRANGERS, stranger

Line = Mapping[str, Any]
"""One case of the results."""
Versions = Mapping[str, Sequence[Line]]

ENOUGH: Final = 0.9
"""Share of cases in which an effect must be found for its size to count as found."""
STRENGTHS: Final = (0.0, 0.6, 1.0, 1.7, 3.0, 6.0, 11.0, math.inf)
"""Edges of the bins of strength, in detection limits."""
PROBABILITIES: Final = (0.0, 0.02, 0.1, 0.3, 0.7, 0.9, 0.98, 0.999, 1.0)
"""Edges of the bins of probability, on either side of what stays open."""
NUMBERS: Final = ("Bs", "Cw", "Rs", "Ts", "tread_stiffness_npm2")
# A pull beyond this many errors is a wrong number.
_FAR: Final = 3.0


class Share(NamedTuple):
    """Count of successes with its binomial bounds, 95 %.

    Attributes:
        hits: number of successes.
        trials: how many.
    """

    hits: int
    trials: int

    @property
    def value(self) -> float:
        """Share, NaN without trials."""
        return self.hits / self.trials if self.trials else math.nan

    @property
    def below(self) -> float:
        """Upper bound of the share, Clopper and Pearson, one-sided."""
        return 1.0 if self.hits == self.trials else float(beta.ppf(0.95, self.hits + 1, self.trials - self.hits))

    @property
    def interval(self) -> tuple[float, float]:
        """Interval of the share, Clopper and Pearson, two-sided."""
        low = 0.0 if self.hits == 0 else float(beta.ppf(0.025, self.hits, self.trials - self.hits + 1))
        high = 1.0 if self.hits == self.trials else float(beta.ppf(0.975, self.hits + 1, self.trials - self.hits))
        return low, high

    def text(self) -> str:
        """Return successes, trials and percent."""
        return f"{self.hits}/{self.trials} ({100 * self.value:.1f} %)" if self.trials else "-"

    def bounded(self) -> str:
        """Return the same with the upper bound."""
        return f"{self.text()}, below {100 * self.below:.1f} %" if self.trials else "-"


class Bin(NamedTuple):
    """Effects that were given similar probabilities.

    Attributes:
        low: least probability.
        high: greatest.
        mean: probability.
        share: that was there.
    """

    low: float
    high: float
    mean: float
    share: Share


def there(line: Line) -> set[str]:
    """Return the effects that are in a case: drawn, brought along by a stranger, or lacking in the baseline model."""
    also = stranger(line["outside"]).also if line["outside"] else ()
    return {*line["truth"], *also, *ALWAYS[line["model"]]}


def false_names(line: Line) -> set[str]:
    """Return the names that a diagnosis gives to what is not there."""
    return set(line.get("named", ())) - there(line)


def is_right(line: Line) -> bool:
    """Return whether all undeclared effects were found as far as the data allow, and nothing else."""
    return Outcome(line["outcome"]).right


def reliability(lines: Iterable[Line]) -> list[Bin]:
    """Return, for bins of the probability that an effect was given, the share that was there."""
    pairs = [
        (probability, name in there(line))
        for line in lines
        for name, probability in line.get("probability", {}).items()
        if probability is not None
    ]
    bins = []
    for low, high in pairwise(PROBABILITIES):
        # The last bin holds 1.
        selected = [(p, true) for p, true in pairs if low <= p < high or (high == p == PROBABILITIES[-1])]
        mean = float(np.mean([p for p, _ in selected])) if selected else math.nan
        bins.append(Bin(low, high, mean, Share(sum(true for _, true in selected), len(selected))))
    return bins


def report(versions: Versions) -> list[str]:
    """Return all tables, a column for each version."""
    tables = (
        _cases,
        _outcomes,
        _names,
        _by_strength,
        _reliability,
        _residual,
        _number_pulls,
        _parameter_pulls,
        _cost,
        _by_effect,
        _wrong,
    )
    lines: list[str] = []
    for table in tables:
        lines += [*table(versions), ""]
    return lines[:-1]


def _table(title: str, versions: Versions, rows: Iterable[tuple[str, Callable[[Sequence[Line]], str]]]) -> list[str]:
    """Return a table of one row per label and one column per version; rows that are empty everywhere are left out."""
    cells = [(label, [cell(lines) for lines in versions.values()]) for label, cell in rows]
    cells = [(label, texts) for label, texts in cells if any(text != "-" for text in texts)]
    width = max([len(label) for label, _ in cells], default=0)
    columns = [max([len(name), *(len(texts[index]) for _, texts in cells)]) for index, name in enumerate(versions)]
    head = "  ".join([" " * width, *(f"{name:<{size}s}" for name, size in zip(versions, columns, strict=True))])
    body = [
        "  ".join([f"{label:<{width}s}", *(f"{text:<{size}s}" for text, size in zip(texts, columns, strict=True))])
        for label, texts in cells
    ]
    return [title, *(line.rstrip() for line in (head, *body))]


def _strata(versions: Versions) -> list[str]:
    met = {line["stratum"] for lines in versions.values() for line in lines}
    return [stratum for stratum in ("effect", "large effect", "pair", "outside", "nothing") if stratum in met]


def _of(lines: Sequence[Line], stratum: str) -> list[Line]:
    return [line for line in lines if line["stratum"] == stratum]


def _cases(versions: Versions) -> list[str]:
    def rows() -> Iterator[tuple[str, Callable[[Sequence[Line]], str]]]:
        for stratum in _strata(versions):
            yield stratum, lambda lines, stratum=stratum: str(len(_of(lines, stratum)))
        for model in ALWAYS:
            yield f"from {model}", lambda lines, model=model: str(sum(line["model"] == model for line in lines))

    return _table("Cases", versions, rows())


def _outcomes(versions: Versions) -> list[str]:
    def rows() -> Iterator[tuple[str, Callable[[Sequence[Line]], str]]]:
        for stratum in _strata(versions):
            for outcome in Outcome:

                def cell(lines: Sequence[Line], stratum: str = stratum, outcome: Outcome = outcome) -> str:
                    selected = _of(lines, stratum)
                    hits = sum(line["outcome"] == outcome for line in selected)
                    return Share(hits, len(selected)).text() if hits else "-"

                yield f"{stratum}: {outcome}", cell

    return _table("Outcomes", versions, rows())


def _names(versions: Versions) -> list[str]:
    def rate(kinds: Sequence[str]) -> Callable[[Sequence[Line]], str]:
        def cell(lines: Sequence[Line]) -> str:
            selected = [line for line in lines if line["kind"] in kinds and line["outcome"] != Outcome.FAILED]
            return Share(sum(bool(false_names(line)) for line in selected), len(selected)).bounded()

        return cell

    def precise(lines: Sequence[Line]) -> str:
        are_true = [name in there(line) for line in lines for name in line.get("named", ())]
        return Share(sum(are_true), len(are_true)).text()

    rows = [
        ("cases with a false name, nothing there", rate([Kind.NOTHING])),
        ("cases with a false name, stranger there", rate([Kind.OUTSIDE])),
        ("cases with a false name beside an effect", rate([Kind.EFFECT, Kind.PAIR])),
        ("names given that are true", precise),
    ]
    return _table("Names (95 % bounds: Clopper and Pearson, one-sided)", versions, rows)


def _by_strength(versions: Versions) -> list[str]:
    def rows() -> Iterator[tuple[str, Callable[[Sequence[Line]], str]]]:
        for low, high in pairwise(STRENGTHS):

            def cell(lines: Sequence[Line], low: float = low, high: float = high) -> str:
                selected = [
                    line
                    for line in lines
                    if line["kind"] == Kind.EFFECT and low <= next(iter(line["strengths"].values())) < high
                ]
                if not selected:
                    return "-"
                counts = Counter(line["outcome"] for line in selected)
                parts = [f"found {Share(sum(map(is_right, selected)), len(selected)).text()}"]
                parts += [
                    f"{word} {counts[outcome]}"
                    for outcome, word in (
                        (Outcome.CANNOT_TELL, "of them rightly open"),
                        (Outcome.MISSED, "missed"),
                        (Outcome.UNSURE, "needlessly open"),
                        (Outcome.WRONG, "wrong"),
                        (Outcome.FAILED, "failed"),
                    )
                    if counts[outcome]
                ]
                return ", ".join(parts)

            yield (f"{low:g} to {high:g}" if math.isfinite(high) else f"above {low:g}"), cell

    return _table("Single effects by strength, in detection limits", versions, rows())


def _reliability(versions: Versions) -> list[str]:
    def rows() -> Iterator[tuple[str, Callable[[Sequence[Line]], str]]]:
        for index, (low, high) in enumerate(pairwise(PROBABILITIES)):

            def cell(lines: Sequence[Line], index: int = index) -> str:
                _, _, mean, share = reliability(lines)[index]
                if not share.trials:
                    return "-"
                least, most = share.interval
                return f"mean {mean:.3f}: there {share.text()}, {100 * least:.1f} to {100 * most:.1f} %"

            yield f"{low:g} to {high:g}", cell

    return _table("Reliability: probability given, share that is there (95 % interval)", versions, rows())


def _residual(versions: Versions) -> list[str]:
    def ratios(lines: Sequence[Line]) -> str:
        errors = (line["held_out"] for line in lines if "held_out" in line)
        values = [e["after_mps2"] / e["floor_mps2"] for e in errors if e["floor_mps2"] and e["after_mps2"] is not None]
        if not values:
            return "-"
        low, middle, high = np.percentile(values, (5, 50, 95))
        within = Share(sum(value <= 1.1 for value in values), len(values))
        return f"median {middle:.3f}, 5 to 95 %: {low:.3f} to {high:.3f}; within 1.1: {within.text()}"

    def worse(lines: Sequence[Line]) -> str:
        errors = [line["held_out"] for line in lines if "held_out" in line]
        complete = [e for e in errors if e["after_mps2"] is not None and e["before_mps2"] is not None]
        return Share(sum(e["after_mps2"] > 1.02 * e["before_mps2"] for e in complete), len(complete)).text()

    rows = [(stratum, lambda lines, stratum=stratum: ratios(_of(lines, stratum))) for stratum in _strata(versions)]
    title = "Held-out error after, over the noise floor"
    return _table(title, versions, [*rows, ("ends more than 2 % worse than it began", worse)])


def _number_pulls(versions: Versions) -> list[str]:
    def pulls(keep: Callable[[Line, Mapping[str, Any]], bool]) -> Callable[[Sequence[Line]], str]:
        return lambda lines: _pulls(
            (entry["value"], entry["std"], entry["true"], entry["determined"])
            for line in lines
            for entry in line.get("numbers", ())
            if entry["quantity"] in NUMBERS and keep(line, entry)
        )

    def by_model(when: str, model: str) -> Callable[[Line, Mapping[str, Any]], bool]:
        return lambda line, entry: entry["when"] == when and line["model"] == model and line["kind"] != Kind.OUTSIDE

    def strange(when: str) -> Callable[[Line, Mapping[str, Any]], bool]:
        return lambda line, entry: entry["when"] == when and line["kind"] == Kind.OUTSIDE

    def single(name: str) -> Callable[[Line, Mapping[str, Any]], bool]:
        return lambda line, entry: entry["quantity"] == name and by_model("after", "exact")(line, entry)

    rows = [
        *((f"{when}, from {model}", pulls(by_model(when, model))) for when in ("before", "after") for model in ALWAYS),
        *((f"{when}, strangers", pulls(strange(when))) for when in ("before", "after")),
        *((f"after, from exact, {name}", pulls(single(name))) for name in NUMBERS),
    ]
    title = "Numbers (Bs, Cw, Rs, Ts, tread) that are called determined, strangers apart: error over standard error"
    return _table(title, versions, rows)


def _parameter_pulls(versions: Versions) -> list[str]:
    def pulls(name: str | None) -> Callable[[Sequence[Line]], str]:
        return lambda lines: _pulls(
            (entry["value"], entry["std"], entry["true"], True)
            for line in lines
            for entry in line.get("parameters", ())
            if entry["verdict"] == "named" and name in (None, entry["effect"])
        )

    rows = [("all", pulls(None)), *((entry.name, pulls(entry.name)) for entry in CAUSES)]
    return _table("Parameters of effects that are rightly named: error over standard error", versions, rows)


def _pulls(entries: Iterable[tuple[float | None, float | None, float, bool]]) -> str:
    """Return rms, mean, share beyond three errors and share determined of (value, std, true, determined)."""
    total, pulls = 0, []
    for value, std, true, determined in entries:
        total += 1
        if determined and value is not None and std:
            pulls.append((value - true) / std)
    if not total:
        return "-"
    if not pulls:
        return f"none of {total} determined"
    values = np.array(pulls)
    far = Share(int(np.sum(np.abs(values) > _FAR)), len(values))
    rms = math.sqrt(float(np.mean(np.square(values))))
    # A few that are far off hide how the others are.
    typical = float(np.median(np.abs(values))) / 0.6745
    return (
        f"rms {rms:.2f}, by the median {typical:.2f}, mean {values.mean():+.2f}, "
        f"beyond 3: {far.text()}, most {np.abs(values).max():.1f}, "
        f"determined {100 * len(values) / total:.0f} % of {total}"
    )


def _cost(versions: Versions) -> list[str]:
    def cost(lines: Sequence[Line]) -> str:
        values = [line["cpu_s"] for line in lines if "cpu_s" in line]
        if not values:
            return "-"
        return f"mean {np.mean(values):.1f}, median {np.median(values):.1f}, most {max(values):.1f}"

    rows = [(stratum, lambda lines, stratum=stratum: cost(_of(lines, stratum))) for stratum in _strata(versions)]
    return _table("CPU of a diagnosis, s", versions, [("all", cost), *rows])


def _by_effect(versions: Versions) -> list[str]:
    """Return for every effect how often it was found, and from which strength on in nine of ten cases."""
    names = [entry.name for entry in CAUSES] + [entry.name for entry in STRANGERS]

    def rows() -> Iterator[tuple[str, Callable[[Sequence[Line]], str]]]:
        for name in names:

            def cell(lines: Sequence[Line], name: str = name) -> str:
                selected = sorted(
                    (line["strengths"][name], is_right(line), line["sizes"][name][0])
                    for line in lines
                    if list(line["strengths"]) == [name]
                )
                if not selected:
                    return "-"
                parts = []
                for word, low, high in (("below 1", 0.0, 1.0), ("1 to 3", 1.0, 3.0), ("above", 3.0, math.inf)):
                    some = [hit for strength, hit, _ in selected if low <= strength < high]
                    if some:
                        parts.append(f"{word} {sum(some)}/{len(some)}")
                return ", ".join([*parts, _smallest(selected)])

            yield name, cell

    title = f"Found, by strength in detection limits; smallest strength from which on {100 * ENOUGH:.0f} % are found"
    return _table(title, versions, rows())


def _smallest(cases: Sequence[tuple[float, bool, float]]) -> str:
    """Return the smallest strength from which on enough cases are found; `cases` are sorted (strength, hit, size)."""
    for index, (strength, hit, size) in enumerate(cases):
        rest = [other for _, other, _ in cases[index:]]
        if hit and sum(rest) >= ENOUGH * len(rest):
            return f"from {strength:.2g} ({size:.3g})"
    return "never"


def _wrong(versions: Versions) -> list[str]:
    """Return the cases with wrong names, needlessly open sets and failures."""
    lines = ["Wrong, needlessly open and failed cases"]
    for version, cases in versions.items():
        for line in sorted(cases, key=lambda line: int(line["number"])):
            if line["outcome"] in (Outcome.WRONG, Outcome.FALSE_ALARM, Outcome.UNSURE, Outcome.FAILED):
                what = [f"{name} ({strength:.2g})" for name, strength in line["strengths"].items()] or ["nothing"]
                named = " + ".join(line.get("named", ())) or "nothing named"
                open_groups = "".join(f"; open: {' / '.join(group)}" for group in line.get("open", ()))
                fault = f"; {line['fault'].splitlines()[-1]}" if line.get("fault") else ""
                about = f"{version} {line['number']}, from {line['model']}, {' + '.join(what)}"
                lines.append(f"{about}: {line['outcome']}: {named}{open_groups}{fault}")
    return lines if len(lines) > 1 else [*lines, "none"]


def confusion(lines: Iterable[Line]) -> tuple[list[str], list[str], np.ndarray]:
    """Return the confusion matrix (truth, diagnosis, share of the truth's cases) of cases with at most one truth."""
    truths = [entry.name for entry in CAUSES] + [f"({entry.name})" for entry in STRANGERS] + ["nothing"]
    says = [entry.name for entry in CAUSES] + ["left open", "unexplained", "no name"]
    count = np.zeros((len(truths), len(says)))
    cases = np.zeros(len(truths))
    for line in lines:
        # What a series lacks whatever the case would hide what was drawn.
        if len(line["truth"]) > 1 or line["outcome"] == Outcome.FAILED or line["model"] != "exact":
            continue
        row = truths.index(f"({line['outside']})" if line["outside"] else next(iter(line["truth"]), "nothing"))
        cases[row] += 1
        for name in line["named"]:
            if name not in says:
                # Effects that the rig does not draw may be named all the same.
                says.append(name)
                count = np.pad(count, ((0, 0), (0, 1)))
            count[row, says.index(name)] += 1
        if not line["named"]:
            said = "left open" if line["open"] else "unexplained" if line["unexplained"] else "no name"
            count[row, says.index(said)] += 1
    return truths, says, count / np.maximum(cases, 1)[:, None]
