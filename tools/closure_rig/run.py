"""One case from the seed to the judgement, as a user would have it: recordings, `diagnose`, and only then the label."""

from __future__ import annotations

import json
import os
import sys
import tempfile
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter
from typing import Any, Final

from closure_rig.draw import Order, draw
from closure_rig.judge import Judgement, Outcome, judge
from closure_rig.record import SECONDS, Recorded, record
from closure_rig.seal import open_label, seal

# A diagnosis that grows without end must not take the others with it.
_CASES_A_PROCESS: Final = 8


@dataclass(frozen=True, slots=True)
class Trial:
    """A case that was run.

    Attributes:
        order: of the case.
        judgement: what the diagnosis was worth.
        seconds: that the diagnosis took.
        fault: what went wrong, empty when nothing did.
    """

    order: Order
    judgement: Judgement
    seconds: float
    fault: str = ""


def run(order: Order, model: str = "exact", keep: Path | None = None, seconds: float = SECONDS) -> Trial:
    """Run one case; what the diagnosis raises is a fault of the trial, not of the bench.

    Args:
        order: of the case.
        model: starting model.
        keep: folder in which to leave the diagnosis and the label.
        seconds: length of each recording.
    """
    case = draw(order)
    with tempfile.TemporaryDirectory(prefix="closure-rig-") as made:
        recordings, closed = Path(made) / "recordings", Path(made) / "closed"
        recordings.mkdir()
        closed.mkdir()
        digest = seal(case.label, closed / "label")
        given = record(case, recordings, seconds)
        began = perf_counter()
        try:
            text = _diagnose(given, model)
        except Exception as error:
            traceback.print_exc(file=sys.stderr)
            if keep is not None:
                (keep / f"{_stem(order)}.label.json").write_text(json.dumps(case.label, indent=1), encoding="utf-8")
            return Trial(order, _failed(case.label), perf_counter() - began, f"{type(error).__name__}: {error}")
        took = perf_counter() - began
        diagnosis = Path(made) / "diagnosis.json"
        diagnosis.write_text(text, encoding="utf-8")
        label = open_label(closed / "label", digest, diagnosis)
        if keep is not None:
            (keep / f"{_stem(order)}.json").write_text(text, encoding="utf-8")
            (keep / f"{_stem(order)}.label.json").write_text(json.dumps(label, indent=1), encoding="utf-8")
        return Trial(order, judge(json.loads(text), label), took)


def kept(folder: Path) -> list[Judgement]:
    """Return the judgements of the cases that runs have left in a folder; without a diagnosis, the run failed."""
    found = []
    for path in sorted(folder.glob("*.label.json")):
        label = json.loads(path.read_text(encoding="utf-8"))
        diagnosis = path.with_name(path.name.replace(".label.json", ".json"))
        if diagnosis.is_file():
            found.append(judge(json.loads(diagnosis.read_text(encoding="utf-8")), label))
        else:
            found.append(_failed(label))
    return found


def _stem(order: Order) -> str:
    return f"{order.kind}-{'-'.join(order.names) or 'none'}-{order.size}-{order.seed}".replace(" ", "_")


def run_all(orders: list[Order], jobs: int, model: str, keep: Path | None) -> list[Trial]:
    """Run cases on several processes, in the order given; progress goes to the terminal's error stream."""
    found: dict[int, Trial] = {}
    # Fresh interpreters: the diagnosis starts processes of its own, which forks of threads would not survive.
    with get_context("spawn").Pool(jobs, maxtasksperchild=_CASES_A_PROCESS) as pool:
        numbered = partial(_numbered, model=model, keep=keep)
        for place, trial in pool.imap_unordered(numbered, list(enumerate(orders))):
            found[place] = trial
            what = " + ".join(trial.order.names) or "nothing"
            said = " + ".join(trial.judgement.named) or "no name"
            line = f"{len(found)}/{len(orders)} {what} ({trial.judgement.size}, seed {trial.order.seed}): {said}"
            print(f"{line}: {trial.fault or trial.judgement.outcome}, {trial.seconds:.0f} s", file=sys.stderr)
    return [found[place] for place in range(len(orders))]


def _numbered(case: tuple[int, Order], model: str, keep: Path | None) -> tuple[int, Trial]:
    return case[0], run(case[1], model, keep)


def default_jobs() -> int:
    """Return as many processes as leave a core free."""
    return max(1, (os.cpu_count() or 2) - 1)


def _diagnose(given: Recorded, model: str) -> str:
    from gateway.closure.effects.base import StartModel
    from gateway.session.campaign_diagnosis import diagnose_recordings
    from gateway.views.report.diagnosis_json import diagnosis_json

    diagnosis = diagnose_recordings(given.paths, model=StartModel(model), jobs=1, reverse=given.reverse)
    return json.dumps(diagnosis_json(diagnosis), indent=1, allow_nan=False)


def _failed(label: Mapping[str, Any]) -> Judgement:
    sizes = [entry["size"] for entry in label["sizes"].values()]
    return Judgement(
        outcome=Outcome.FAILED,
        truth=(f"({label['outside']})",) if label["outside"] else tuple(label["truth"]),
        named=(),
        open=(),
        unexplained=False,
        ratio=float("nan"),
        kind=label["kind"],
        size=sizes[0] if sizes else "",
        seed=label["seed"],
    )
