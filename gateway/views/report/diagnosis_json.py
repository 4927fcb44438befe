"""A diagnosis as JSON with stable keys."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gateway import __version__
from gateway.closure.data.campaign_data import Remark
from gateway.closure.result import Diagnosis, Finding, Fitted, Law, Origin, SelfTest, Unexplained
from gateway.reasons import Reason
from gateway.views import wording
from gateway.views.output_file import write_whole
from gateway.views.report.next_steps import next_steps
from gateway.views.report.phrases import residual_sentence, scaling_text
from gateway.views.report.quantities import residuals
from gateway.views.report.transfer_report import encodable as _text
from gateway.views.report.transfer_report import held_out_json
from gateway.views.text import json_text

FORMAT: Final = "treadlink diagnosis"
FORMAT_VERSION: Final = 1
"""Incremented when a key changes its meaning or is removed, not for new keys."""


def diagnosis_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis as plain dicts, lists, strings and finite numbers; null where a value is not known."""
    held_out = diagnosis.held_out
    return {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "treadlink": __version__,
        "wheel": _text(diagnosis.wheel),
        "model": _text(diagnosis.model),
        "recordings": _texts(diagnosis.recordings),
        "left_out": [_reason(remark) for remark in diagnosis.left_out],
        "origin": _origin(diagnosis.origin),
        "stated": _remarks(diagnosis.stated),
        "assumed": _remarks(diagnosis.assumed),
        "notes": _remarks(diagnosis.notes),
        "reasons": {
            name: [_reason(remark) for remark in remarks if isinstance(remark, Reason)]
            for name, remarks in (
                ("stated", diagnosis.stated),
                ("assumed", diagnosis.assumed),
                ("notes", diagnosis.notes),
            )
        },
        "revolutions": {"used": int(diagnosis.revolutions), "rejected": int(diagnosis.rejected)},
        "held_out": {
            **held_out_json(held_out),
            "rms_empirical_mps2": _number(diagnosis.empirical_rms_mps2),
            "folds_of": _text(diagnosis.folds_of),
        },
        "complete": bool(diagnosis.complete),
        "noise_floor_mps2": _number(diagnosis.noise_floor_mps2),
        "effects": [_finding(finding) for finding in diagnosis.findings],
        "unexplained": [_unexplained(residual) for residual in diagnosis.unexplained],
        "laws": [_law(law) for law in diagnosis.laws],
        "self_test": _self_test(diagnosis.self_test),
        "next_steps": [{"about": _text(about), "step": _text(step)} for about, step in next_steps(diagnosis)],
        "estimates": {
            "before": _estimates(diagnosis.estimates_before, diagnosis.determined_before),
            "after": _estimates(diagnosis.estimates_after, diagnosis.determined),
        },
        "groups": [
            {
                "label": _text(curves.label),
                "residual": {
                    axis.axis: {
                        "rms_before_mps2": _number(axis.before_mps2),
                        "rms_after_mps2": _number(axis.after_mps2),
                        "noise_mps2": _number(axis.noise_mps2),
                    }
                    for axis in residuals(curves)
                },
            }
            for curves in diagnosis.curves
        ],
        "trends": [
            {
                "axis": _text(trend.axis),
                "against": _text(trend.against),
                "at": _numbers(trend.at),
                "rms_before_mps2": _numbers(trend.before_mps2),
                "rms_after_mps2": _numbers(trend.after_mps2),
                "noise_mps2": _numbers(trend.noise_mps2),
            }
            for trend in diagnosis.trends
        ],
    }


def write_json(diagnosis: Diagnosis, path: Path, *, force: bool = False, plan: Mapping[str, Any] | None = None) -> None:
    """Write a diagnosis as JSON, whole or not at all.

    Args:
        diagnosis: the result.
        path: of the file.
        force: replace a file that exists.
        plan: of the next recording, as plain values; None for no key `plan`.

    Raises:
        OutputError: the file exists and `force` is not set, or it cannot be written.
    """
    document = diagnosis_json(diagnosis) | ({} if plan is None else {"plan": plan})
    text = json_text(document, indent=2)
    write_whole(path, text + "\n", force=force)


def _origin(origin: Origin | None) -> dict[str, Any] | None:
    if origin is None:
        return None
    return {
        "command": _text(origin.command),
        "commit": _text(origin.commit),
        "sensor_id": None if origin.sensor_id is None else f"{origin.sensor_id:08x}",
        "vehicle": _text(origin.vehicle),
        "tire": _text(origin.tire),
        "recordings": [
            {
                "path": _text(recording.path),
                "sha256": recording.sha256,
                "first_s": recording.first_s,
                "last_s": recording.last_s,
            }
            for recording in origin.recordings
        ],
    }


def _self_test(tested: SelfTest | None) -> dict[str, Any] | None:
    if tested is None:
        return None
    return {
        "count": tested.count,
        "wrong": tested.wrong,
        "failed": tested.failed,
        "false": {_text(name): count for name, count in tested.false.items()},
        "missed": {_text(name): count for name, count in tested.missed.items()},
        "pulls": _numbers(tested.pulls),
        "pull_rms": _number(tested.pull_rms),
    }


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "name": _text(finding.name),
        "verdict": str(finding.verdict),
        "lock": _text(finding.lock),
        "parameters": {_text(name): _number(fitted.value) for name, fitted in finding.parameters.items()},
        "std": {_text(name): _number(fitted.std) for name, fitted in finding.parameters.items()},
        "units": {_text(name): _text(fitted.unit) for name, fitted in finding.parameters.items()},
        "probability": _number(finding.probability),
        "evidence": {
            "log_odds": _number(finding.log_odds),
            "chi2": _number(finding.chi2),
            "rms_mps2": _number(finding.rms_mps2),
            "held_out_rms_before_mps2": _number(finding.rms_before_mps2),
            "held_out_rms_after_mps2": _number(finding.rms_after_mps2),
        },
        "estimates": {
            "before": {_text(name): _fitted(before) for name, (before, _) in finding.estimates.items()},
            "after": {_text(name): _fitted(after) for name, (_, after) in finding.estimates.items()},
        },
        "rivals": _texts(finding.rivals),
        "decide_with": _reason_text(finding.decide_with),
        "reason": _reason_text(finding.reason),
        "reasons": [_reason(reason) for reason in (finding.reason,) if reason is not None],
        "deciding_recordings": [_reason(reason) for reason in (finding.decide_with,) if reason is not None],
        "summary": _text(finding.summary),
        "equation": _text(finding.equation),
    }


def _unexplained(residual: Unexplained) -> dict[str, Any]:
    return {
        "axis": _text(residual.axis),
        "lock": _text(residual.lock),
        "lock_known": bool(residual.lock_known),
        "changes": bool(residual.changes),
        "orders": None if residual.orders is None else [int(order) for order in residual.orders],
        "hz": None if residual.hz is None else _numbers(residual.hz),
        "angle_rad": None if residual.angle_rad is None else _numbers(residual.angle_rad),
        "scaling": scaling_text(residual.scaling),
        "scaling_exponent": _number(residual.scaling.exponent),
        "rms_mps2": _number(residual.rms_mps2),
        "std_mps2": _number(residual.std_mps2),
        "road_m": _number(residual.road_m),
        "timing_s": _number(residual.timing_s),
        "drifts": [
            {
                "name": _text(drift.name),
                "parameter": _text(drift.parameter),
                "group": _text(drift.label),
                "per_minute": _fitted(drift.per_minute),
                "begin": _fitted(drift.begin),
                "end": _fitted(drift.end),
                "rivals": _texts(drift.rivals),
            }
            for drift in residual.drifts
        ],
        "text": _text(residual_sentence(residual)),
    }


def _law(law: Law) -> dict[str, Any]:
    return {
        "name": _text(law.name),
        "certain": bool(law.certain),
        "equation": _text(law.equation),
        "summary": _text(law.summary),
        "scaling": _text(law.scaling),
        "source": _text(law.source),
        "axes": _texts(law.axes),
        "parameters": {_text(name): _fitted(fitted) for name, fitted in law.parameters.items()},
        "log_odds": _number(law.log_odds),
        "share": _number(law.share),
        "rms_mps2": _number(law.rms_mps2),
        "sizes": [
            {"recording": int(size.recording), "value": _number(size.value), "std": _number(size.std)}
            for size in law.sizes
        ],
        "unseen": [
            {
                "recording": int(check.recording),
                "axis": _text(check.axis),
                "rms_before_mps2": _number(check.before_mps2),
                "rms_after_mps2": _number(check.after_mps2),
                "noise_mps2": _number(check.noise_mps2),
            }
            for check in law.unseen
        ],
        "held_out": None if law.held_out is None else held_out_json(law.held_out),
        "rivals": _texts(law.rivals),
        "reasons": [_reason(reason) for reason in law.reasons],
    }


def _estimates(estimates: Mapping[str, Fitted], determined: Mapping[str, bool]) -> dict[str, Any]:
    return {
        _text(name): {**_fitted(fitted), "determined": bool(determined.get(name, True))}
        for name, fitted in estimates.items()
    }


def _fitted(fitted: Fitted) -> dict[str, Any]:
    return {"value": _number(fitted.value), "std": _number(fitted.std), "unit": _text(fitted.unit)}


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _numbers(values: Sequence[float] | Any) -> list[float | None]:
    return [_number(float(value)) for value in values]


def _reason_text(reason: Reason | None) -> str:
    return "" if reason is None else _text(wording.text(reason))


def _reason(reason: Reason) -> dict[str, Any]:
    """Return a reason with its strings in UTF-8."""
    encoded: dict[str, Any] = json.loads(_text(json.dumps(wording.as_json(reason), ensure_ascii=False)))
    return encoded


def _remarks(remarks: Sequence[Remark]) -> list[str]:
    return [_reason_text(remark) if isinstance(remark, Reason) else _text(remark) for remark in remarks]


def _texts(texts: Sequence[str]) -> list[str]:
    return [_text(text) for text in texts]
