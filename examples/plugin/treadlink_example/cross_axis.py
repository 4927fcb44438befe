"""Effect "cross-axis sensitivity": the circumferential axis picks up a share of the lateral one."""

from __future__ import annotations

from gateway.core.types import FloatArray
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    LATERAL,
    Confounder,
    LinearSignalEffect,
    ModelledBlock,
    Parameter,
    Stage,
)


class CrossAxisSensitivity(LinearSignalEffect):
    """Share of the lateral acceleration in the output of the circumferential axis."""

    name = "cross-axis sensitivity"
    # Places 1000 and up are free for plug-ins.
    rank = 1000
    summary = "The circumferential axis picks up a share of the lateral acceleration."
    equation = "a_circumferential + s a_lateral"
    source = "data sheets of MEMS accelerometers: cross-axis sensitivity, typically 1 to 2 %"
    parameters = (Parameter("lateral_share", "", -0.05, 0.05, 0.01, 1e-4),)
    axes = (CIRCUMFERENTIAL,)
    observed_in = "the lateral waveform on the circumferential axis; in proportion at every speed"
    confounders = (Confounder(("yaw tilt",), "a tilt also puts the circumferential acceleration on the lateral axis"),)
    start_values = ((0.01,),)
    stage = Stage.ELEMENT

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the lateral waveform on the circumferential axis, (1, 3, FIELD_SIZE)."""
        rows = block.zeros()
        rows[CIRCUMFERENTIAL] = block.signal_mps2[LATERAL]
        return rows[None]


EFFECTS = (CrossAxisSensitivity(),)
