"""The clock that speeds are measured with runs fast or slow."""

from __future__ import annotations

from gateway.closure.effects.base import (
    CIRCUMFERENTIAL,
    NOWHERE,
    RADIAL,
    Conditions,
    Here,
    Parameter,
    Stage,
    StartModel,
)
from gateway.closure.effects.belt_inertia import belt_inertia
from gateway.types import FloatArray


class ClockError:
    """Share by which the sampling clock, as taken, runs fast against true time.

    A fast clock counts more time for a revolution, so omega as measured is too small by (1 + share), and domega/dt by
    its square. Nothing in the waveforms tells this from a wrong rolling radius; `Campaign.clock_error`, the clock
    against the host's, does.
    """

    name = "sample clock error"
    summary = "The clock that timed the samples runs fast, so the wheel turns faster than measured."
    equation = "adds ((1 + share)^2 - 1) (a - gravity): the true omega is (1 + share) times the measured one"
    # Crystals 1e-4, ceramic resonators 5e-3, a sensor's own oscillator that nobody measured, or a rate that was
    # noted wrongly, 2 %.
    parameters: tuple[Parameter, ...] = (
        Parameter("share", "", -0.02, 0.02, 0.005, 1e-5, factor=1e6, display_unit="ppm"),
    )
    seen_by = "the hub's clock against the host's; radial axis at any speed, there together with the rolling radius"
    confused_with = (
        "rolling radius: the same to every waveform, only a second clock or the stated speed tells; gain, which scales "
        "gravity too (slow recordings tell)"
    )
    already_in: frozenset[StartModel] = NOWHERE
    stage = Stage.BELT
    axes: tuple[int, ...] = (CIRCUMFERENTIAL, RADIAL)
    linear = False

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return a thousand ppm: to that it is linear."""
        return ((1e-3,),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return what the true speed adds."""
        share = float(parameters[0])
        return (share * (2.0 + share)) * belt_inertia(here)

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return its derivative by the share."""
        return 2.0 * (1.0 + float(parameters[0])) * belt_inertia(here)[None]


EFFECT = ClockError()
