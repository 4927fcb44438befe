"""Effects that a case's data cannot separate, computed from the contributions of both."""

from functools import cached_property
from typing import Final

import numpy as np

from closure_rig.causes import CAUSES, Locked, cause
from closure_rig.draw import Case, Kind, Order, Parts
from closure_rig.judge import CANNOT_TELL
from closure_rig.limit import DETECTION_CHI2, Strength
from gateway.core.types import FloatArray

# Draws of a rival's phases, signs and shapes; they span a harmonic of any phase.
_DRAWS: Final = 4
_SEED: Final = 7


class Rivals:
    """Whether one effect can stand for another in a case."""

    def __init__(self, case: Case) -> None:
        """Take the case; nothing is computed before it is asked for."""
        self._case = case

    def alike(self, true: str, other: str) -> bool:
        """Return whether `other` can take the place of the true effect.

        It can where the table of the seven-run campaign says so, and where the tire's parameters and the other effect
        leave less of the true one's contribution than the detection limit.
        """
        if frozenset((true, other)) in CANNOT_TELL:
            return True
        names = {entry.name for entry in CAUSES if entry.locked is Locked.MEAN}
        if not {true, other} <= names:
            return False
        contribution = self._contribution(true)
        columns = np.stack([column for column in self._columns(other) if column.any()], axis=1)
        basis = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))[0]
        remainder = contribution - basis @ (basis.T @ contribution)
        return float(remainder @ remainder) < DETECTION_CHI2

    @cached_property
    def _strength(self) -> Strength:
        bench = self._case.bench
        return Strength(bench, Parts(bench, outside=False).case(Order(Kind.NOTHING, 0), {}))

    def _contribution(self, name: str) -> FloatArray:
        """Return the contribution of one of the case's effects by itself."""
        entry = self._case.label["sizes"][name]
        return self._alone(name, float(entry["value"]), int(entry["seed"]))

    def _columns(self, name: str) -> list[FloatArray]:
        return [self._alone(name, cause(name).sizes[1], _SEED + draw) for draw in range(_DRAWS)]

    def _alone(self, name: str, size: float, seed: int) -> FloatArray:
        parts = Parts(self._case.bench, outside=False)
        parts.add(name, size, np.random.default_rng(seed))
        return self._strength.contribution(parts.case(Order(Kind.EFFECT, seed, (name,)), {}))
