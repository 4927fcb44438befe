"""Run of one case: recordings, `diagnose` as a user runs it, then the label and the judgement."""

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

# Limits the memory that a leaking diagnosis can take.
_CASES_A_PROCESS: Final = 8


@dataclass(frozen=True, slots=True)
class Trial:
    """A case that was run.

    Attributes:
        order: of the case.
        judgement: of the diagnosis.
        seconds: duration of the diagnosis.
        fault: error of the run, empty when there was none.
    """

    order: Order
    judgement: Judgement
    seconds: float
    fault: str = ""


def run(order: Order, model: str = "exact", keep: Path | None = None, seconds: float = SECONDS) -> Trial:
    """Run one case. An exception of the diagnosis is recorded as a fault of the trial.

    Args:
        order: of the case.
        model: baseline model.
        keep: folder for the diagnosis and the label.
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
    """Return the judgements of the cases kept in a folder; a case without a diagnosis has failed."""
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
    # Fresh interpreters: the diagnosis starts its own processes, which do not survive a fork with threads.
    with get_context("spawn").Pool(jobs, maxtasksperchild=_CASES_A_PROCESS) as pool:
        numbered = partial(_numbered, model=model, keep=keep)
        for place, trial in pool.imap_unordered(numbered, list(enumerate(orders))):
            found[place] = trial
            what = " + ".join(trial.order.names) or "nothing"
            said = " + ".join(trial.judgement.named) or "nothing named"
            line = f"{len(found)}/{len(orders)} {what} ({trial.judgement.size}, seed {trial.order.seed}): {said}"
            print(f"{line}: {trial.fault or trial.judgement.outcome}, {trial.seconds:.0f} s", file=sys.stderr)
    return [found[place] for place in range(len(orders))]


def _numbered(case: tuple[int, Order], model: str, keep: Path | None) -> tuple[int, Trial]:
    return case[0], run(case[1], model, keep)


def default_jobs() -> int:
    """Return the number of processes that leaves one core free."""
    return max(1, (os.cpu_count() or 2) - 1)


def _diagnose(given: Recorded, model: str) -> str:
    from gateway.closure.effects.effect import BaselineModel
    from gateway.session.campaign_diagnosis import diagnose_recordings
    from gateway.views.report.diagnosis_json import diagnosis_json

    diagnosis = diagnose_recordings(given.paths, model=BaselineModel(model), jobs=1, reverse=given.reverse)
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
