"""Diagnosis of stored cases by one version of the gateway, and the judgement of each as a line of JSON."""

import json
import math
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Container, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from pathlib import Path
from time import perf_counter
from typing import Any, Final

from closure_rig.draw import Case
from closure_rig.judge import Outcome, judge
from closure_rig.outside import stranger
from closure_rig.plan import Planned, remake
from closure_rig.rivals import Rivals
from closure_rig.store import Store, Stored
from closure_rig.truth import State, numbers_of, parameters_of

_TOOLS: Final = Path(__file__).parents[1]
# A diagnosis that waits this many times its limit of CPU time hangs, also on a busy machine.
_HANGS: Final = 40.0
# Of a fault's text, in a line of results.
_MOST_TEXT: Final = 2000
_INERTIA: Final = "rotary inertia"


def run(
    store: Store, cases: Sequence[Planned], gateway: Path, results: Path, *, jobs: int, timeout_s: float
) -> Iterator[dict[str, Any]]:
    """Diagnose cases that are not yet in the results; yield each new line after it is written.

    Args:
        store: cases.
        cases: which of them.
        gateway: folder that holds the package `gateway` of the version to run.
        results: JSON lines, continued if they exist.
        jobs: cases at a time, each on one core.
        timeout_s: CPU time after which a diagnosis has failed.
    """
    done = {line["number"] for line in _repaired(results)}
    waiting = [case for case in cases if case.number not in done]
    with ThreadPoolExecutor(jobs) as pool, results.open("a", encoding="utf-8") as file:
        futures: list[Future[dict[str, Any]]] = [
            pool.submit(_line, store, planned, gateway, timeout_s) for planned in waiting
        ]
        try:
            for future in as_completed(futures):
                line = future.result()
                file.write(json.dumps(line) + "\n")
                file.flush()
                yield line
        except BaseException:
            pool.shutdown(cancel_futures=True, wait=False)
            raise


def read(results: Path) -> list[dict[str, Any]]:
    """Return the lines of a file of results, none where there is no file; an unfinished last line is left out."""
    if not results.is_file():
        return []
    lines = []
    for text in results.read_text(encoding="utf-8").splitlines():
        try:
            lines.append(json.loads(text))
        except json.JSONDecodeError:
            continue
    return lines


def _repaired(results: Path) -> list[dict[str, Any]]:
    """Return the lines of a file of results; an unfinished last line is removed from the file."""
    lines = read(results)
    if lines and not results.read_text(encoding="utf-8").endswith("\n"):
        whole = results.with_name(f".{results.name}.whole")
        whole.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
        whole.replace(results)
    return lines


def _line(store: Store, planned: Planned, gateway: Path, timeout_s: float) -> dict[str, Any]:
    stored = store.get(planned)
    with tempfile.TemporaryDirectory(prefix="closure-rig-") as made:
        result = Path(made) / "diagnosis.json"
        began = perf_counter()
        fault = _diagnose(stored, gateway, result, timeout_s)
        if fault:
            result.write_text(json.dumps({"fault": fault, "wall_s": perf_counter() - began}), encoding="utf-8")
        label = store.open_label(planned, result)
        return line_of(json.loads(result.read_text(encoding="utf-8")), label, remake(planned, label["sizes"]))


def _diagnose(stored: Stored, gateway: Path, result: Path, timeout_s: float) -> str:
    """Run the diagnosis in a process of its own; return its fault, "" when there is none."""
    path = os.pathsep.join((str(gateway.resolve()), str(_TOOLS)))
    command = [sys.executable, "-m", "closure_rig.worker", str(stored.folder.resolve()), str(stored.planned.model)]
    process = subprocess.Popen(
        [*command, str(result), str(gateway.resolve()), str(math.ceil(timeout_s))],
        env={**os.environ, "PYTHONPATH": path},
        # Away from any folder that has a package of that name.
        cwd=result.parent,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        _, error = process.communicate(timeout=_HANGS * timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return f"hangs: not done after {_HANGS * timeout_s:.0f} s"
    if process.returncode == -signal.SIGXCPU:
        return f"not done after {timeout_s:.0f} s of CPU"
    return error.strip()[-_MOST_TEXT:] or f"exit status {process.returncode}" if process.returncode else ""


def line_of(result: Mapping[str, Any], label: Mapping[str, Any], case: Case) -> dict[str, Any]:
    """Return the line of results of a diagnosis.

    Args:
        result: what the worker wrote.
        label: opened.
        case: as planned, for true values.
    """
    about = {
        "number": label["number"],
        "stratum": label["stratum"],
        "kind": label["kind"],
        "model": label["model"],
        "seed": label["seed"],
        "truth": label["truth"],
        "outside": label["outside"],
        "strengths": {name: entry["strength"] for name, entry in label["sizes"].items()},
        "sizes": {name: [entry["value"], entry["unit"]] for name, entry in label["sizes"].items()},
        "runs": len(case.bench.runs),
    }
    if "fault" in result:
        return {**about, "outcome": str(Outcome.FAILED), "fault": result["fault"], "wall_s": result["wall_s"]}
    also = stranger(label["outside"]).also if label["outside"] else ()
    judgement = judge(result, label, Rivals(case).alike, also)
    probability = dict(result["probabilities"])
    for effect in result["effects"]:
        if effect["probability"] is not None:
            probability[effect["name"]] = effect["probability"]
    return {
        **about,
        "outcome": str(judgement.outcome),
        "named": list(judgement.named),
        "open": [sorted(group) for group in judgement.open],
        "probability": probability,
        "effects": result["effects"],
        "unexplained": result["unexplained"],
        "held_out": result["held_out"],
        "numbers": _numbers(
            result["estimates"],
            case,
            {effect["name"] for effect in result["effects"] if effect["verdict"] != "refused"},
        ),
        "parameters": _parameters(result["effects"], case),
        "revolutions": result["revolutions"],
        "rejected": result["rejected"],
        "gateway": result["gateway"],
        "cpu_s": result["cpu_s"],
        "wall_s": result["wall_s"],
    }


def _numbers(
    estimates: Mapping[str, Sequence[Mapping[str, Any]]], case: Case, effects: Container[str]
) -> list[dict[str, Any]]:
    """Return every estimate of the tire beside its true value; effects are those named or open."""
    # Without rotary inertia in the model, bending stands for it.
    truths = {"before": numbers_of(case, rolling=True), "after": numbers_of(case, rolling=_INERTIA not in effects)}
    truth = truths["after"]
    stated = [State(*entry["state"]) for entry in estimates["after"] if entry["state"] is not None]
    others = {_nearest(state, list(truth)) for state in stated}
    # The state of the most revolutions goes without a name. Several are left where revolutions were rejected.
    unstated = [state for state in truth if state not in others]
    unnamed = unstated[0] if len(unstated) == 1 else None
    lines = []
    for when, entries in estimates.items():
        for entry in entries:
            state = unnamed if entry["state"] is None else _nearest(State(*entry["state"]), list(truth))
            true = None if state is None else truths[when][state].get(entry["quantity"])
            if true is not None:
                lines.append({**entry, "when": when, "true": true, "state": list(state or ())})
    return lines


def _nearest(state: State, states: Sequence[State]) -> State:
    return min(
        states,
        key=lambda other: abs(other.load_n / state.load_n - 1.0) + abs(other.pressure_pa / state.pressure_pa - 1.0),
    )


def _parameters(effects: Sequence[Mapping[str, Any]], case: Case) -> list[dict[str, Any]]:
    """Return the parameters of true effects that were named or left open, beside their true values."""
    truth = parameters_of(case)
    return [
        {
            "effect": effect["name"],
            "parameter": name,
            "verdict": effect["verdict"],
            "value": value,
            "std": std,
            "true": truth[effect["name"]][name],
        }
        for effect in effects
        if effect["verdict"] != "refused" and effect["name"] in truth
        for name, (value, std) in effect["parameters"].items()
        if name in truth[effect["name"]]
    ]
