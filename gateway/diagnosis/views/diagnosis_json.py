"""A diagnosis as JSON with stable keys."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gateway import __version__
from gateway.core.reasons import Reason
from gateway.core.text import wording
from gateway.core.text.output_file import write_whole
from gateway.core.text.plain_values import plain, record
from gateway.core.text.text import json_text
from gateway.diagnosis.data.campaign_data import Remark
from gateway.diagnosis.result import Diagnosis, Finding, Fitted, Origin, Unexplained
from gateway.diagnosis.views.next_steps import next_steps
from gateway.diagnosis.views.phrases import residual_sentence, said, scaling_text
from gateway.diagnosis.views.quantities import residuals
from gateway.diagnosis.views.transfer_report import held_out_json

FORMAT: Final = "treadlink diagnosis"
FORMAT_VERSION: Final = 1
"""Incremented when a key changes its meaning or is removed, not for new keys."""


def diagnosis_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis as plain dicts, lists, strings and finite numbers; null where a value is not known."""
    tested = diagnosis.self_test
    document = {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "treadlink": __version__,
        "wheel": diagnosis.wheel,
        "model": diagnosis.model,
        "recordings": diagnosis.recordings,
        "left_out": diagnosis.left_out,
        "origin": _origin(diagnosis.origin),
        "stated": _remarks(diagnosis.stated),
        "assumed": _remarks(diagnosis.assumed),
        "notes": _remarks(diagnosis.notes),
        "reasons": {
            name: [remark for remark in remarks if isinstance(remark, Reason)]
            for name, remarks in (
                ("stated", diagnosis.stated),
                ("assumed", diagnosis.assumed),
                ("notes", diagnosis.notes),
            )
        },
        "revolutions": {"used": diagnosis.revolutions, "rejected": diagnosis.rejected},
        "held_out": {
            **held_out_json(diagnosis.held_out),
            "rms_empirical_mps2": diagnosis.empirical_rms_mps2,
            "folds_of": diagnosis.folds_of,
        },
        "complete": diagnosis.complete,
        "noise_floor_mps2": diagnosis.noise_floor_mps2,
        "effects": [_finding(finding) for finding in diagnosis.findings],
        "unexplained": [_unexplained(residual) for residual in diagnosis.unexplained],
        "self_test": None if tested is None else {**plain(tested), "pull_rms": tested.pull_rms},
        "next_steps": [{"about": subject, "step": step} for subject, step in next_steps(diagnosis)],
        "estimates": {
            "before": _estimates(diagnosis.estimates_before, diagnosis.determined_before),
            "after": _estimates(diagnosis.estimates_after, diagnosis.determined),
        },
        "groups": [
            {
                "label": said(curves.label),
                "residual": {
                    axis.axis: {
                        "rms_before_mps2": axis.before_mps2,
                        "rms_after_mps2": axis.after_mps2,
                        "noise_mps2": axis.noise_mps2,
                    }
                    for axis in residuals(curves)
                },
            }
            for curves in diagnosis.curves
        ],
        "trends": [
            {
                "axis": trend.axis,
                "against": trend.against,
                "at": trend.at,
                "rms_before_mps2": trend.before_mps2,
                "rms_after_mps2": trend.after_mps2,
                "noise_mps2": trend.noise_mps2,
            }
            for trend in diagnosis.trends
        ],
    }
    return dict(plain(document))


def write_json(diagnosis: Diagnosis, path: Path, *, force: bool = False) -> None:
    """Write a diagnosis as JSON, whole or not at all.

    Args:
        diagnosis: the result.
        path: of the file.
        force: replace a file that exists.

    Raises:
        OutputError: the file exists and `force` is not set, or it cannot be written.
    """
    text = json_text(diagnosis_json(diagnosis), indent=2)
    write_whole(path, text + "\n", force=force)


def _origin(origin: Origin | None) -> dict[str, Any] | None:
    if origin is None:
        return None
    return record(origin, sensor_id=None if origin.sensor_id is None else f"{origin.sensor_id:08x}")


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "name": finding.name,
        "verdict": str(finding.verdict),
        "lock": finding.lock,
        "parameters": {name: fitted.value for name, fitted in finding.parameters.items()},
        "std": {name: fitted.std for name, fitted in finding.parameters.items()},
        "units": {name: fitted.unit for name, fitted in finding.parameters.items()},
        "probability": finding.probability,
        "single_sizes": [record(size, label=said(size.label)) for size in finding.single_sizes],
        "evidence": {
            "log_odds": finding.log_odds,
            "chi2": finding.chi2,
            "rms_mps2": finding.rms_mps2,
            "held_out_rms_before_mps2": finding.rms_before_mps2,
            "held_out_rms_after_mps2": finding.rms_after_mps2,
        },
        "estimates": {
            "before": {name: _fitted(before) for name, (before, _) in finding.estimates.items()},
            "after": {name: _fitted(after) for name, (_, after) in finding.estimates.items()},
        },
        "rivals": finding.rivals,
        "decide_with": _reason_text(finding.decide_with),
        "reason": _reason_text(finding.reason),
        "reasons": list(filter(None, (finding.reason,))),
        "deciding_recordings": list(filter(None, (finding.decide_with,))),
        "summary": finding.summary,
        "equation": finding.equation,
    }


def _unexplained(residual: Unexplained) -> dict[str, Any]:
    return {
        "axis": residual.axis,
        "lock": residual.lock,
        "lock_known": residual.lock_known,
        "changes": residual.changes,
        "orders": residual.orders,
        "hz": residual.hz,
        "angle_rad": residual.angle_rad,
        "scaling": scaling_text(residual.scaling),
        "scaling_exponent": residual.scaling.exponent,
        "rms_mps2": residual.rms_mps2,
        "std_mps2": residual.std_mps2,
        "road_m": residual.road_m,
        "timing_s": residual.timing_s,
        "drifts": [
            {
                "name": drift.name,
                "parameter": drift.parameter,
                "group": said(drift.label),
                "per_minute": _fitted(drift.per_minute),
                "begin": _fitted(drift.begin),
                "end": _fitted(drift.end),
                "rivals": drift.rivals,
            }
            for drift in residual.drifts
        ],
        "text": residual_sentence(residual),
    }


def _estimates(estimates: Mapping[str, Fitted], determined: Mapping[str, bool]) -> dict[str, Any]:
    return {name: {**_fitted(fitted), "determined": determined.get(name, True)} for name, fitted in estimates.items()}


def _fitted(fitted: Fitted) -> dict[str, Any]:
    return {"value": fitted.value, "std": fitted.std, "unit": fitted.unit}


def _reason_text(reason: Reason | None) -> str:
    return "" if reason is None else wording.text(reason)


def _remarks(remarks: Sequence[Remark]) -> list[str]:
    return list(map(said, remarks))
