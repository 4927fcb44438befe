"""The error with effects found before, as text and as JSON."""

from collections.abc import Iterator
from typing import Any, Final

from gateway import __version__
from gateway.core.text.numbers import fixed
from gateway.core.text.plain_values import plain
from gateway.core.text.text import clean, counted, pad
from gateway.diagnosis.result import HeldOut
from gateway.diagnosis.transfer import Transfer
from gateway.diagnosis.views.phrases import effects_listed, listed, model_words, remark, said
from gateway.diagnosis.views.quantities import ratio

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
    yield _row("refitted", listed([name.removesuffix("_npm2").replace("_", " ") for name in result.refitted]))
    held_out = result.held_out
    yield _row(
        "held-out rms",
        f"{fixed(held_out.rms_before_mps2, 2)} m/s² without the effects, {fixed(held_out.rms_after_mps2, 2)} m/s² with",
    )
    yield from axis_lines(held_out)
    noise_ratio = fixed(ratio(held_out.rms_after_mps2, result.noise_floor_mps2), 2)
    yield _row("noise floor", f"{fixed(result.noise_floor_mps2, 2)} m/s²; after / noise floor {noise_ratio}")
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
    document = {
        "format": "treadlink transfer",
        "version": 1,
        "treadlink": __version__,
        "wheel": result.wheel,
        "model": result.model,
        "recordings": result.recordings,
        "revolutions": result.revolutions,
        "effects": result.effects,
        "refitted": result.refitted,
        "held_out": held_out_json(result.held_out),
        "noise_floor_mps2": result.noise_floor_mps2,
        "notes": [clean(remark(note)) for note in result.notes],
        "reasons": {"notes": result.notes},
    }
    return dict(plain(document))


def held_out_json(held_out: HeldOut) -> dict[str, Any]:
    """Return held-out errors, by axis too, as `plain` takes them."""
    return {
        "rms_before_mps2": held_out.rms_before_mps2,
        "rms_after_mps2": held_out.rms_after_mps2,
        "revolutions": held_out.revolutions,
        "folds": held_out.folds,
        "std_before_mps2": held_out.std_before_mps2,
        "std_after_mps2": held_out.std_after_mps2,
        "std_after_over_before": held_out.std_ratio,
        "as_recorded": None
        if held_out.as_recorded is None
        else {
            "rms_before_mps2": held_out.as_recorded.rms_before_mps2,
            "rms_after_mps2": held_out.as_recorded.rms_after_mps2,
            "aligned_revolutions": held_out.as_recorded.revolutions,
            "parameters": held_out.as_recorded.parameters,
        },
        "blocks": [
            {
                "group": said(block.group),
                "revolutions": block.revolutions,
                "time_s": block.time_s,
                "rms_before_mps2": block.before_mps2,
                "rms_after_mps2": block.after_mps2,
            }
            for block in held_out.blocks
        ],
        "axes": {
            axis.axis: {
                "rms_before_mps2": axis.before_mps2,
                "rms_after_mps2": axis.after_mps2,
                "rms_with_discrepancy_mps2": axis.with_discrepancy_mps2,
                "noise_floor_mps2": axis.noise_mps2,
                "weighted_before": axis.before_weighted,
                "weighted_after": axis.after_weighted,
            }
            for axis in held_out.axes
        },
    }


def _row(label: str, text: str) -> str:
    return f"  {pad(label, _LABEL_WIDTH)}{text}"
