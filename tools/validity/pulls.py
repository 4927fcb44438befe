"""Pulls of every quantity: of what is stated and of what scatters; and how often it is valid in ordinary drives."""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from accuracy.tables import Table

import gateway
from gateway.core.estimates.estimator import Status
from gateway.core.text.wording import text
from validity.judging import Judged

# Pulls between these are those of errors that are as large as they say.
SOUND: Final = (0.7, 1.1)
_TRUCK: Final[dict[str, Any]] = {
    "scenario": {"name": "truck", "seed": 1},
    "motion": {"speed_kmh": 80.0},
    "road": {"rms_mps2": 2.0, "bandwidth_hz": 400.0},
    "tire": {
        "radius_mm": 490.0,
        "ring_thickness_mm": 26.0,
        "reference_pressure_kpa": 850.0,
        "tread_stiffness_mpa": 280.0,
        "extension_stiffness_mn": 60.0,
        "foundation_damping_nspm2": 120.0,
    },
    "sensor": {"rate_hz": 9600.0, "range_g": 500.0, "noise_mg_rthz": 5.0},
    "wheel": [{"position": "W1", "wheel": 0, "load_n": 30000.0, "pressure_kpa": 850.0, "temperature_degc": 35.0}],
}
_CAR: Final[dict[str, Any]] = {
    "scenario": {"name": "car", "seed": 1},
    "motion": {"speed_kmh": 65.0},
    "wheel": [{"position": "W1", "wheel": 0, "load_n": 5000.0, "pressure_kpa": 210.0, "temperature_degc": 30.0}],
}
# Name, scenario, and faults of the link.
DRIVES: Final[tuple[tuple[str, Any, tuple[str, ...]], ...]] = (
    ("lab", "lab", ()),
    ("demo", "demo", ()),
    ("truck", _TRUCK, ()),
    ("drum", {**_CAR, "tire": {"drum_radius_mm": 1000.0}}, ()),
    ("AC sensor", {**_CAR, "sensor": {"coupling": "ac", "highpass_hz": 0.5}}, ()),
    ("10 % loss", "demo", ("drop:rate=0.1",)),
)
_WITHOUT: Final = ("ring-modal", "ring-paper", "forward")


@dataclass(slots=True)
class Pulls:
    """Of one quantity.

    Attributes:
        drawn: pulls where every statement is drawn, one of each tire.
        exact: pulls where all is exactly true, one of each tire.
        scattering: squares of the pulls of the scattering part, one of each tire.
        share: scattering part over the whole error where every statement is drawn, one of each tire.
        judged: tires of which it was judged.
    """

    drawn: list[float] = field(default_factory=list)
    exact: list[float] = field(default_factory=list)
    scattering: list[float] = field(default_factory=list)
    share: list[float] = field(default_factory=list)
    judged: int = 0


def pulls_of(judged: Iterable[Judged]) -> dict[str, Pulls]:
    """Return the pulls of every quantity in the last revolution of each run; `known` may have several drives."""
    result: dict[str, Pulls] = defaultdict(Pulls)
    drives: dict[tuple[str, int], list[Judged]] = defaultdict(list)
    for entry in judged:
        if not entry.last:
            continue
        of = result[entry.quantity]
        if entry.case == "drawn":
            of.judged += 1
            if entry.valid:
                of.drawn.append(entry.pull)
                of.share.append(entry.scatter / entry.std if entry.std else 0.0)
        elif entry.valid:
            drives[entry.quantity, entry.tire].append(entry)
    for (quantity, _), entries in drives.items():
        result[quantity].exact.append(entries[0].pull)
        errors = np.array([entry.value - entry.truth for entry in entries])
        stated = float(np.mean([entry.scatter**2 for entry in entries]))
        if len(entries) > 2 and stated > 0.0:
            result[quantity].scattering.append(float(errors.var(ddof=1)) / stated)
    return dict(result)


def pull_table(pulls: Mapping[str, Pulls]) -> Table:
    """Return the pulls of every quantity that is ever valid."""
    rows = []
    for name, of in pulls.items():
        if of.drawn:
            drawn = _rms(of.drawn)
            doubt = "" if SOUND[0] <= drawn <= SOUND[1] else "wide" if drawn < SOUND[0] else "narrow"
            rows.append(
                (name, f"{len(of.drawn)} of {of.judged}", _shown(drawn), doubt, _shown(_rms(of.exact)),
                 _shown(math.sqrt(float(np.mean(of.scattering))) if of.scattering else math.nan),
                 f"{100.0 * float(np.median(of.share)):.0f} %")
            )  # fmt: skip
    heads = ("quantity", "valid", "drawn", "doubt", "exact", "scatter", "scatter of error")
    about = (
        "rms of the pulls in the last revolution, one of each tire. Drawn: every statement is off by a random error of "
        "the size that is stated of it; exact: everything is true and said to be, so that models are left; scatter: "
        f"between drives that differ in noise; the last: its median part. Sound: {SOUND[0]} to {SOUND[1]}"
    )
    return Table("Pulls", about, heads, tuple(rows))


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values else math.nan


def _shown(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "-"


@dataclass(slots=True)
class Ordinary:
    """Of one quantity in one drive: revolutions, those valid, their errors over the scatter, and why others are not."""

    judged: int = 0
    valid: int = 0
    over_scatter: list[float] = field(default_factory=list)
    reasons: Counter[str] = field(default_factory=Counter)


def ordinary_drives(seconds: float) -> Iterator[tuple[str, dict[str, Ordinary]]]:
    """Yield every quantity of ordinary drives with what the simulator states of each."""
    from gateway.core.estimates.registry import ESTIMATORS

    names = [name for name in ESTIMATORS if name not in _WITHOUT]
    for drive, scenario, faults in DRIVES:
        counts: dict[str, Ordinary] = defaultdict(Ordinary)
        for revolution in gateway.simulate(scenario, duration_s=seconds, faults=faults).stream(names):
            for name, estimate in revolution.estimates.items():
                of = counts[name]
                of.judged += 1
                if estimate.status is not Status.VALID:
                    of.reasons.update(text(reason) for reason in estimate.reasons[-1:])
                    continue
                of.valid += 1
                if estimate.scatter_std > 0.0:
                    of.over_scatter.append(estimate.std / estimate.scatter_std)
        yield drive, dict(counts)


def ordinary_table(drives: Mapping[str, Mapping[str, Ordinary]]) -> Table:
    """Return how often each quantity is valid in each drive, and its error over its scatter."""
    quantities = dict.fromkeys(name for counts in drives.values() for name in counts)
    rows = tuple((name, *(_cell(counts.get(name)) for counts in drives.values())) for name in quantities)
    about = "share of the revolutions in % that are valid; in brackets the median of the error over its scattering part"
    return Table("Valid in ordinary drives", about, ("quantity", *drives), rows)


def never_table(drives: Mapping[str, Mapping[str, Ordinary]]) -> Table:
    """Return the quantities that are valid in no drive, and what the program says that each needs."""
    quantities = dict.fromkeys(name for counts in drives.values() for name in counts)
    rows = []
    for name in quantities:
        of = [counts[name] for counts in drives.values() if name in counts]
        if not any(entry.valid for entry in of):
            reasons = sum((entry.reasons for entry in of), Counter[str]())
            rows.append((name, "; ".join(reason for reason, _ in reasons.most_common(1))))
    about = "the last reason that is given most often"
    return Table("Valid in none of these drives", about, ("quantity", "because"), tuple(rows))


def _cell(of: Ordinary | None) -> str:
    if of is None:
        return "-"
    share = f"{100.0 * of.valid / of.judged:.0f}"
    return f"{share} ({float(np.median(of.over_scatter)):.2g})" if of.over_scatter else share
