"""Fields of a revolution's message: conditions, and the estimates of every estimator with their parts."""

from collections.abc import Iterable, Iterator
from typing import Final

from gateway.core.quantity_catalogue import CATALOGUE, given_by

CONDITIONS: Final = {
    "index": ("i", "running number of the wheel's revolutions"),
    "start_s": ("n", "hub time of the first contact centre"),
    "period_s": ("n", "duration of the revolution"),
    "omega_radps": ("n", "mean angular speed"),
    "omega_dot_radps2": ("n", "angular acceleration"),
    "noise_mps2": ("n", "noise of one sample in the angle domain"),
    "missing_fraction": ("n", "share of samples lost on the link"),
    "load_n": ("n", "stated vertical load"),
    "pressure_pa": ("n", "inflation pressure (gauge)"),
    "temperature_degc": ("n", "temperature of the inner liner"),
    "fault_reasons": ("[o]", "why the revolution is not averaged"),
}
"""Type, as in `gateway.core.recording.schemas`, and description of the fields that are no estimates."""

PARTS: Final = {
    "": ("n", ""),
    "_std": ("n", "standard error"),
    "_scatter_std": ("n", "scattering part of it, where known"),
    "_status": ("s", "validity"),
    "_reasons": ("[o]", "reasons"),
}
"""Parts of an estimate: suffix of the name, type and description."""


def estimate_descriptions(estimators: Iterable[str] = CATALOGUE) -> dict[str, str]:
    """Return the description of every estimate of estimators by its field: its column with `_over_` for `/`."""
    return {
        (name.removesuffix(quantity.name) + quantity.column).replace("/", "_over_"): quantity.description
        for name, quantity in given_by(estimators).items()
    }


def fields() -> Iterator[tuple[str, str, str]]:
    """Yield name, type and description of every field of a revolution's message.

    Descriptions of the parts are short, since a recording contains the text twice.
    """
    for name, (kind, description) in CONDITIONS.items():
        yield name, kind, description
    for name, description in estimate_descriptions().items():
        for part, (kind, meaning) in PARTS.items():
            yield name + part, kind, meaning or description
