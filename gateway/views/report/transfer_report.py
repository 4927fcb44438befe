"""The error with effects found before, as text and as JSON."""

from collections.abc import Iterator
from typing import Any, Final

from gateway import __version__
from gateway.closure.result import HeldOut
from gateway.closure.transfer import Transfer
from gateway.views.numbers import finite_or_none, fixed
from gateway.views.report.phrases import effects_listed, listed, model_words, remark
from gateway.views.report.quantities import ratio
from gateway.views.text import clean, counted, pad
from gateway.views.wording import as_json

_LABEL_WIDTH: Final = 13
_AXES: Final = {"circumferential": "  circumf.", "lateral": "  lateral", "radial": "  radial"}


def transfer_lines(result: Transfer, source: str) -> Iterator[str]:
    """Yield the comparison as plain lines.

    Args:
        result: the comparison.
        source: name of the effects file.
    """
    used = f"{result.revolutions} revolutions of {counted(len(result.recordings), 'recording')}"
    yield f"{clean(result.wheel)}: {model_words(result.model)} against {used}"
    yield _row("effects", f"{effects_listed(list(result.effects))}, as found in {clean(source)}")
    yield _row("refitted", f"{listed([name.removesuffix('_npm2').replace('_', ' ') for name in result.refitted])}")
    held_out = result.held_out
    yield _row(
        "held-out rms",
        f"{fixed(held_out.rms_before_mps2, 2)} m/s² without the effects, {fixed(held_out.rms_after_mps2, 2)} m/s² with",
    )
    yield from axis_lines(held_out)
    share = fixed(ratio(held_out.rms_after_mps2, result.noise_floor_mps2), 2)
    yield _row("noise floor", f"{fixed(result.noise_floor_mps2, 2)} m/s²; after / noise floor {share}")
    for note in result.notes:
        yield _row("note", remark(note))


def axis_lines(held_out: HeldOut) -> Iterator[str]:
    """Yield a line for each axis: error before, after and with the discrepancy, and the noise floor."""
    for axis in held_out.axes:
        yield _row(
            _AXES.get(axis.axis, axis.axis),
            f"{fixed(axis.before_mps2, 2)} -> {fixed(axis.after_mps2, 2)} m/s², floor {fixed(axis.noise_mps2, 2)}; "
            f"in noise {fixed(axis.before_weighted, 2)} -> {fixed(axis.after_weighted, 2)}",
        )


def transfer_json(result: Transfer) -> dict[str, Any]:
    """Return the comparison as plain dicts, lists, strings and finite numbers; null where a value is not known."""
    return {
        "format": "treadlink transfer",
        "version": 1,
        "treadlink": __version__,
        "wheel": result.wheel,
        "model": result.model,
        "recordings": list(result.recordings),
        "revolutions": result.revolutions,
        "effects": {name: dict(values) for name, values in result.effects.items()},
        "refitted": list(result.refitted),
        "held_out": held_out_json(result.held_out),
        "noise_floor_mps2": finite_or_none(result.noise_floor_mps2),
        "notes": [clean(remark(note)) for note in result.notes],
        "reasons": {"notes": [as_json(note) for note in result.notes]},
    }


def held_out_json(held_out: HeldOut) -> dict[str, Any]:
    """Return held-out errors, by axis too."""
    return {
        "rms_before_mps2": finite_or_none(held_out.rms_before_mps2),
        "rms_after_mps2": finite_or_none(held_out.rms_after_mps2),
        "revolutions": int(held_out.revolutions),
        "folds": int(held_out.folds),
        "std_before_mps2": finite_or_none(held_out.std_before_mps2),
        "std_after_mps2": finite_or_none(held_out.std_after_mps2),
        "std_after_over_before": finite_or_none(held_out.std_ratio),
        "as_recorded": None
        if held_out.as_recorded is None
        else {
            "rms_before_mps2": finite_or_none(held_out.as_recorded.rms_before_mps2),
            "rms_after_mps2": finite_or_none(held_out.as_recorded.rms_after_mps2),
            "aligned_revolutions": int(held_out.as_recorded.revolutions),
            "parameters": int(held_out.as_recorded.parameters),
        },
        "blocks": [
            {
                "group": encodable(block.group),
                "revolutions": int(block.revolutions),
                "time_s": finite_or_none(block.time_s),
                "rms_before_mps2": finite_or_none(block.before_mps2),
                "rms_after_mps2": finite_or_none(block.after_mps2),
            }
            for block in held_out.blocks
        ],
        "axes": {
            axis.axis: {
                "rms_before_mps2": finite_or_none(axis.before_mps2),
                "rms_after_mps2": finite_or_none(axis.after_mps2),
                "rms_with_discrepancy_mps2": finite_or_none(axis.with_discrepancy_mps2),
                "noise_floor_mps2": finite_or_none(axis.noise_mps2),
                "weighted_before": finite_or_none(axis.before_weighted),
                "weighted_after": finite_or_none(axis.after_weighted),
            }
            for axis in held_out.axes
        },
    }


def encodable(text: str) -> str:
    """Return text that UTF-8 can encode: a path may hold bytes that it cannot."""
    return str(text).encode("utf-8", "backslashreplace").decode()


def _row(label: str, text: str) -> str:
    return f"  {pad(label, _LABEL_WIDTH)}{text}"
