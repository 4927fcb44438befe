"""A law that was found as an effect of the catalogue: a package of a plug-in, with range, start values and a test."""

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from gateway.diagnosis.effects.effect import SignalEffect
from gateway.diagnosis.laws.library import library
from gateway.diagnosis.result import Law as ProposedLaw

FIRST_RANK: Final = 1000
"""First place in the catalogue that is free for plug-ins."""

# The range of an effect: values of this ratio to the one that was found are as plausible.
_RANGE: Final = 4.0
_ERRORS: Final = 5.0


def law_effect(
    law: str, *, name: str, rank: int, start: Sequence[float], ranges: Mapping[str, tuple[float, float]]
) -> SignalEffect:
    """Return a law of the library as an effect of the catalogue.

    Args:
        law: name in the library.
        name: of the effect.
        rank: place in the catalogue, from `FIRST_RANK` on.
        start: parameters from which a fit begins, (p,), SI.
        ranges: by parameter the lowest and highest plausible value, SI.

    Raises:
        KeyError: the library has no law of that name.
    """
    effect = copy.copy(library()[law])
    effect.name, effect.title, effect.rank = name, "", rank
    effect.start_values = (tuple(start),)
    effect.parameters = tuple(
        replace(parameter, low=ranges[parameter.name][0], high=ranges[parameter.name][1])
        if parameter.name in ranges
        else parameter
        for parameter in effect.parameters
    )
    return effect


def plugin_files(law: ProposedLaw, name: str, rank: int = FIRST_RANK) -> dict[str, str]:
    """Return the files of a package that adds a law to the catalogue, by path.

    Args:
        law: that was found.
        name: of the effect, in lower case, as an identifier: `splice_of_tire_7`.
        rank: place in the catalogue.
    """
    parameters = {parameter.name: parameter for parameter in library()[law.name].parameters}
    ranges = {
        key: _range(fitted.value, fitted.std, parameters[key].low, parameters[key].high)
        for key, fitted in law.parameters.items()
    }
    start = tuple(fitted.value for fitted in law.parameters.values())
    module = f"treadlink_{name}"
    return {
        "pyproject.toml": _PROJECT.format(name=name.replace("_", "-"), module=module),
        f"{module}/__init__.py": _MODULE.format(
            law=law.name,
            effect=name.replace("_", " "),
            rank=rank,
            start=start,
            ranges=ranges,
            summary=law.summary,
            equation=law.equation,
            scaling=law.scaling,
        ),
        f"test_{name}.py": _TEST.format(module=module),
    }


def _range(value: float, std: float, low: float, high: float) -> tuple[float, float]:
    """Return a range around a value, within that of the law."""
    spread = _ERRORS * std if math.isfinite(std) else 0.0
    ends = sorted((value / _RANGE, value * _RANGE))
    return max(low, ends[0] - spread), min(high, ends[1] + spread)


_PROJECT: Final = """[build-system]
requires = ["hatchling>=1.27"]
build-backend = "hatchling.build"

[project]
name = "treadlink-{name}"
version = "0.1.0"
description = "An effect that treadlink proposed as a law"
requires-python = ">=3.11"
dependencies = ["treadlink"]

[project.entry-points."treadlink.effects"]
{name} = "{module}:EFFECTS"

[tool.hatch.build.targets.wheel]
packages = ["{module}"]
"""

_MODULE: Final = '''"""An effect of the catalogue, proposed as a law by `treadlink diagnose`.

{summary}

Equation: {equation}.

Scaling: {scaling}.
"""

from gateway.diagnosis.laws.law_plugin import law_effect

EFFECT = law_effect(
    {law!r},
    name={effect!r},
    rank={rank!r},
    start={start!r},
    ranges={ranges!r},
)
EFFECTS = (EFFECT,)
'''

_TEST: Final = '''"""Contract of the effect: its range, its zero, its derivative."""

import numpy as np
from {module} import EFFECT

from gateway.diagnosis.effects.effect import BaselineModel, GroupConditions
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.diagnosis.model.baseline_registry import make_core
from gateway.diagnosis.model.sensor_signal import base_signal


def block():
    conditions = GroupConditions(50.0, 0.0, 0.32, 4000.0, 2.2e5, 25.0, 25.0, 9600.0, 0.0)
    core = make_core(BaselineModel.EXACT)
    options = RingOptions(sensor_offset_m=0.004)
    return base_signal(core, core.shape(core.prior_mean, conditions, options, 0.0), conditions)


def test_starts_within_its_range():
    for value, parameter in zip(EFFECT.start_values[0], EFFECT.parameters, strict=True):
        assert parameter.low <= value <= parameter.high


def test_zero_size_adds_nothing():
    start = np.array(EFFECT.start_values[0])
    start[: EFFECT.sizes] = 0.0
    assert not EFFECT.contribution(block(), start).any()


def test_derivative_is_that_of_the_contribution():
    signal, start = block(), np.array(EFFECT.start_values[0])
    rows = EFFECT.derivative(signal, start)
    for index, parameter in enumerate(EFFECT.parameters):
        step = np.zeros(len(start))
        step[index] = parameter.step
        change = EFFECT.contribution(signal, start + step) - EFFECT.contribution(signal, start - step)
        slope = change / (2.0 * parameter.step)
        assert np.abs(slope - rows[index]).max() <= 1e-3 * max(np.abs(slope).max(), 1e-9)
'''
