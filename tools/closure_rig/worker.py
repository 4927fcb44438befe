"""Diagnosis of one stored case by the version of the gateway that is on the path.

Run: python -m closure_rig.worker FOLDER MODEL RESULT SOURCE CPU_SECONDS
"""

import inspect
import json
import math
import resource
import sys
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import Any


def main() -> None:
    """Diagnose, and write what was found and what it cost.

    Raises:
        SystemExit: another version of the gateway than that of the source tree would be run.
    """
    limit_s = int(sys.argv[5])
    # Beyond the soft limit the signal tells why it ended; the hard one ends it for sure.
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s + 5))
    folder, model, result = Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3])
    import gateway

    if Path(str(gateway.__file__)).parents[1] != Path(sys.argv[4]):
        raise SystemExit(f"'{gateway.__file__}' is not of the version in '{sys.argv[4]}'")
    from gateway.diagnosis.campaign_diagnosis import diagnose_recordings
    from gateway.diagnosis.effects.effect import BaselineModel

    names = json.loads((folder / "declared.json").read_text(encoding="utf-8"))
    began, used = perf_counter(), _cpu_s()
    recordings, reverse = ([folder / name for name in names[key]] for key in ("recordings", "reverse"))
    parameters = inspect.signature(diagnose_recordings).parameters
    if "orders" in parameters:
        from gateway.diagnosis.campaign import reading_orders

        diagnosis = diagnose_recordings(reading_orders(recordings, reverse=reverse), model=BaselineModel(model))
    else:
        # One process, as without the option.
        alone = {"jobs": 1} if "jobs" in parameters else {}
        diagnosis = diagnose_recordings(recordings, model=BaselineModel(model), reverse=reverse, **alone)
    results = {
        "gateway": gateway.__version__,
        "cpu_s": _cpu_s() - used,
        "wall_s": perf_counter() - began,
        **_found(diagnosis),
    }
    result.write_text(json.dumps(results), encoding="utf-8")


def _cpu_s() -> float:
    """Return the CPU time of this process and its ended children, s."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in both)


def _found(diagnosis: Any) -> dict[str, Any]:
    determined = diagnosis.determined
    before = getattr(diagnosis, "determined_before", None) or determined
    held_out = diagnosis.held_out
    return {
        "effects": [_effect(finding) for finding in diagnosis.findings],
        # Versions without probabilities have none.
        "probabilities": {
            name: _number(value) for name, value in (getattr(diagnosis, "probabilities", None) or {}).items()
        },
        "unexplained": [
            {"axis": item.axis, "lock": item.lock, "rms_mps2": _number(item.rms_mps2)} for item in diagnosis.unexplained
        ],
        "held_out": {
            "before_mps2": _number(held_out.rms_before_mps2),
            "after_mps2": _number(held_out.rms_after_mps2),
            "floor_mps2": _number(diagnosis.noise_floor_mps2),
        },
        "estimates": {
            "before": _estimates(diagnosis.estimates_before, before),
            "after": _estimates(diagnosis.estimates_after, determined),
        },
        "revolutions": int(diagnosis.revolutions),
        "rejected": int(diagnosis.rejected),
    }


def _effect(finding: Any) -> dict[str, Any]:
    return {
        "name": finding.name,
        "verdict": str(finding.verdict),
        "probability": _number(getattr(finding, "probability", None)),
        "rivals": list(finding.rivals),
        "chi2": _number(finding.chi2),
        "parameters": {
            name: [_number(fitted.value), _number(fitted.std)] for name, fitted in finding.parameters.items()
        },
    }


def _estimates(estimates: Mapping[str, Any], determined: Mapping[str, bool]) -> list[dict[str, Any]]:
    return [
        {
            "quantity": fitted.quantity or name,
            "state": None if fitted.state is None else list(fitted.state),
            "value": _number(fitted.value),
            "std": _number(fitted.std),
            "determined": bool(determined.get(name, True)),
        }
        for name, fitted in estimates.items()
    ]


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


if __name__ == "__main__":
    main()
