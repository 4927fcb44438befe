"""Effects of an effects file, checked against the catalogue."""

import math
from typing import Final

import numpy as np

from gateway.core.errors import TreadlinkError
from gateway.core.revolutions.effect_correction import CorrectionTable, EffectParameter
from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.effects.catalogue import candidates
from gateway.diagnosis.effects.effect import BaselineModel, Parameter
from gateway.diagnosis.effects.local_effects import LocalChange
from gateway.diagnosis.model.baseline_registry import angle_effects
from gateway.diagnosis.model.closure_model import AngleEffect

_REMEDY: Final = "Create the file again with `treadlink diagnose --save-effects`."

# Files of before held laws, by other names.
_RENAMED: Final = {
    "law: delay of the circumferential axis": "circumferential delay",
    "law: delay of the lateral axis": "lateral delay",
    "law: hysteresis of the circumferential axis": "circumferential hysteresis",
    "law: hysteresis of the lateral axis": "lateral hysteresis",
    "law: hysteresis of the radial axis": "radial hysteresis",
    "law: mean over a length": "sensor length",
    "law: circumferential in the lateral axis": "yaw tilt",
    "law: radial in the circumferential axis": "pitch tilt",
}


def known_effects(
    table: CorrectionTable, origin: str, model: BaselineModel = BaselineModel.EXACT
) -> list[tuple[AngleEffect, FloatArray]]:
    """Return the effects of a table with their parameter vectors, SI.

    Args:
        table: the effects; their parameters are used, not their contributions.
        origin: where they come from, for messages.
        model: baseline model that they are to be added to; a file is made with the exact ring.

    Raises:
        TreadlinkError: an effect is not in the catalogue, or stands twice, or its parameters are not
            those of the catalogue, in another unit or outside of their ranges.
    """
    catalogue = angle_effects(candidates(model))
    effects: list[tuple[AngleEffect, FloatArray]] = []
    for corrected in table.effects:
        effect = catalogue.get(_RENAMED.get(corrected.name, corrected.name.removeprefix("law: ")))
        if effect is None:
            raise TreadlinkError(
                f"{origin}: the catalogue has no effect '{corrected.name}' for this baseline model",
                "Create the file again with `treadlink diagnose --save-effects`, or install the plug-in it came from.",
            )
        if any(effect.name == previous.name for previous, _ in effects):
            raise TreadlinkError(f"{origin}: effect '{corrected.name}' stands twice", _REMEDY)
        in_file = {parameter.name: parameter for parameter in corrected.parameters}
        if isinstance(effect, LocalChange):
            # Files of before hold changes of a belt of the baseline model's mass.
            in_file.setdefault("log_mass", EffectParameter("log_mass", 0.0, math.nan, ""))
        names = [parameter.name for parameter in effect.parameters]
        for name in names:
            if name not in in_file:
                raise TreadlinkError(f"{origin}: effect '{corrected.name}' lacks the parameter '{name}'", _REMEDY)
        for name in in_file:
            if name not in names or sum(parameter.name == name for parameter in corrected.parameters) > 1:
                raise TreadlinkError(
                    f"{origin}: effect '{corrected.name}' has no parameter '{name}', or has it twice", _REMEDY
                )
        for parameter in effect.parameters:
            _check_range(effect, parameter, in_file[parameter.name], origin)
        used = effect.held() if isinstance(effect, LocalChange) else effect
        effects.append((used, np.array([in_file[name].value for name in names])))
    return effects


def _check_range(effect: AngleEffect, parameter: Parameter, file_parameter: EffectParameter, origin: str) -> None:
    """Check a value by the range that a diagnosis allows.

    Raises:
        TreadlinkError: it is outside by more than its standard error allows, or in another unit.
    """
    label = f"{origin}: effect '{effect.name}': parameter '{parameter.name}'"
    if file_parameter.unit != parameter.unit:
        expected_unit, file_unit = parameter.unit or "no unit", file_parameter.unit or "no unit"
        raise TreadlinkError(f"{label} is in {file_unit}, not in {expected_unit}", _REMEDY)
    slack = criteria.BEYOND_BOUND * file_parameter.std if math.isfinite(file_parameter.std) else 0.0
    # A wide error does not make an impossible value possible.
    slack = min(slack, parameter.high - parameter.low)
    if not parameter.low - slack <= file_parameter.value <= parameter.high + slack:
        unit = f" {parameter.unit}" if parameter.unit else ""
        raise TreadlinkError(
            f"{label} is {file_parameter.value:g}{unit}, outside its plausible range of {parameter.low:g} to "
            f"{parameter.high:g}{unit}",
            _REMEDY,
        )
