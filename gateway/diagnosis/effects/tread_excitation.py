"""Excitation of the belt by the tread's blocks: vibration in the contact and waves from both its edges."""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.effects.belt_dispersion import BlockTread, belt_wave, mass_of_wave
from gateway.diagnosis.effects.belt_geometry import relative_offset
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    FIELD_SIZE,
    RADIAL,
    Confounder,
    GroupConditions,
    ModelledBlock,
    Parameter,
    SignalEffect,
    Stage,
)
from gateway.ring.reference_tire import TABLE_3_LOAD_NUMBER, TABLE_3_NUMBERS
from gateway.ring.rolling_ring import BlockResponse, LoadedBelt, TreadBlocks, block_response

# Numbers of blocks and masses that are tried, with so much loss that each answers its neighbours as well. Less loss
# makes the answer narrower: first in the mass, then along the numbers of blocks and masses whose waves are alike.
_START_COUNTS: Final = tuple(float(count) for count in range(40, 112, 3))
_START_MASSES_KGPM: Final = (3.5, 7.0)
_START_SHARE: Final = 0.03
_START_BENDING_S: Final = 1.5e-4
_MASS_FACTORS: Final = (0.6, 0.66, 0.73, 0.8, 0.88, 0.94, 1.0, 1.06, 1.13, 1.25, 1.37, 1.5, 1.65)
_COUNT_STEPS: Final = tuple(range(-8, 9))
_FINE_MASS_FACTORS: Final = (0.92, 1.0, 1.09)
_LOSSES_S: Final = (1e-4, 3e-5)
_SCAN_BENDING_S: Final = (1e-5, 1e-4)
_SCAN_TREAD_S: Final = (0.0, 1e-4)
_LEAST_REACH_S: Final = 5e-6
# A fit may pass through values that have no vibration.
_LEAST_COUNT: Final = 5.0
_LEAST_MASS_KGPM: Final = 0.5


def _share(name: str) -> Parameter:
    # Blocks and grooves of equal length would be 1; a tread whose blocks are bound together by ribs has a few percent.
    return Parameter(name, "", -0.6, 0.6, 0.1, 1e-5, factor=100.0, display_unit="% of the tread's stiffness")


class TreadExcitation(SignalEffect):
    """Linear vibration of the exact ring whose tread's stiffness varies from block to block."""

    name = "tread block excitation"
    rank = 165
    summary = "The tread is stiffer under a block than beside it, which makes the belt vibrate in the contact and "
    summary += "sends waves out of both its edges, alike in every revolution."
    equation = (
        "kt (1 + c cos(N phi) + s sin(N phi)), phi = angle from the sensor; linear vibration of the ring in its "
        "contact at N times the speed: its mass, bending, tension, sidewall and tread, and their losses"
    )
    source = "linearised exact ring (gateway.ring.rolling_ring.block_vibration)"
    parameters = (
        _share("share_cosine"),
        _share("share_sine"),
        # Passenger car tires have 50 to 80 pitches, truck and winter patterns from 40, fine ones up to 110.
        Parameter("blocks", "per revolution", 36.0, 120.0, 25.0, 1e-4, prior_mean=70.0),
        # Belt and tread of a car tire have 3 to 8 kg/m, of a truck tire twice that.
        Parameter("belt_mass_kgpm", "kg/m", 1.0, 20.0, 2.5, 1e-4, prior_mean=5.0),
        # Loss factors are 0.1 to 0.5 at the 300 to 1000 Hz at which blocks pass; 0.02 is the error of a viscous law.
        Parameter("belt_loss_s", "s", -5e-6, 6e-4, 5e-5, 1e-9, prior_mean=3e-5, factor=1e3, display_unit="ms"),
        Parameter("tread_loss_s", "s", -5e-6, 6e-4, 5e-5, 1e-9, prior_mean=3e-5, factor=1e3, display_unit="ms"),
    )
    axes = (CIRCUMFERENTIAL, RADIAL)
    observed_in = (
        "radial axis, orders around N: in the contact, and above N ahead of it, below N behind it, as the belt's "
        "dispersion says at every speed; largest where the blocks come by at the belt's frequency on its tread"
    )
    confounders = (
        Confounder(
            ("travelling edge waves", "tire-locked edge waves"),
            "they are outside the contact only, and the sizes at both edges are free of each other",
        ),
        Confounder(("tread pitch",), "it keeps its order and has no waves"),
        Confounder(("torsional ripple",), "it is all around the tire"),
    )
    start_values = tuple(
        (_START_SHARE, _START_SHARE, count, mass, _START_BENDING_S, 0.0)
        for mass in _START_MASSES_KGPM
        for count in _START_COUNTS
    )
    needs_exact = True
    form_of = "edge waves"
    refinements = 2
    scan = ((4, _SCAN_BENDING_S), (5, _SCAN_TREAD_S))
    stage = Stage.BELT

    def reach(self, start: Sequence[float]) -> tuple[float, ...]:
        """Return changes of a block, a tenth of the mass and half of the losses; the answer is linear in the shares."""
        _, _, _, mass, *losses = start
        return (math.inf, math.inf, 1.0, 0.1 * mass, *(0.5 * loss + _LEAST_REACH_S for loss in losses))

    def nearer(
        self, stage: int, start: Sequence[float], conditions: Sequence[GroupConditions]
    ) -> tuple[tuple[float, ...], ...]:
        """Return starts with other masses, then with other numbers of blocks and the mass that suits them.

        At one speed the wave ahead of the contact has most of the signal, and its order depends on both. It needs the
        belt's stiffness too, for which a tire of common proportions is near enough.
        """
        count, mass = start[2:4]
        if stage == 0:
            pairs = [(count, factor * mass) for factor in _MASS_FACTORS]
        else:
            condition = conditions[0]
            radius, omega = condition.radius_m, condition.omega_radps
            numbers = np.array(TABLE_3_NUMBERS[:3]) * condition.load_n / TABLE_3_LOAD_NUMBER
            belt: tuple[float, float, float] = tuple((numbers * [radius**2, 1.0, radius**-2]).tolist())
            wave = belt_wave(BlockTread(count, belt[0] / mass, belt[1] / mass, 0.0, 0.0), 0, omega, radius)
            block_counts = [float(round(count) + step) for step in _COUNT_STEPS]
            trials = [(blocks, mass_of_wave(wave.order, blocks, *belt, omega, radius)) for blocks in block_counts]
            pairs = [(blocks, factor * trial_mass) for blocks, trial_mass in trials for factor in _FINE_MASS_FACTORS]
        lowest, highest = np.array([(parameter.low, parameter.high) for parameter in self.parameters[2:4]]).T
        loss = _LOSSES_S[stage], 0.5 * _LOSSES_S[stage]
        return tuple((*start[:2], *pair, *loss) for pair in pairs if (lowest <= pair).all() and (pair <= highest).all())

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return what the sensor reads of the vibration; nothing without amplitude, whatever the blocks."""
        result = block.zeros()
        if block.belt is not None and parameters[:2].any():
            signal, _ = _curves(block, block.belt, parameters)
            result[[RADIAL, CIRCUMFERENTIAL]] = (_amplitude(block, parameters) * signal).real
        return result

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by both shares, the blocks, the mass and both losses."""
        rows = np.zeros((len(parameters), *block.signal_mps2.shape))
        if block.belt is None:
            return rows
        signal, by = _curves(block, block.belt, parameters)
        side = -1j if not block.conditions.reverse else 1j
        curves = np.stack([signal, side * signal, *(_amplitude(block, parameters) * by)])
        rows[:, [RADIAL, CIRCUMFERENTIAL]] = curves.real
        # At the limits of what can be solved the answer no longer changes.
        rows[2] *= parameters[2] > _LEAST_COUNT
        rows[3] *= parameters[3] > _LEAST_MASS_KGPM
        return rows


def _amplitude(block: ModelledBlock, parameters: FloatArray) -> complex:
    """Return c - i s; in reverse the pattern is the mirror image."""
    sine = -float(parameters[1]) if block.conditions.reverse else float(parameters[1])
    return complex(float(parameters[0]), -sine)


def _curves(block: ModelledBlock, belt: LoadedBelt, parameters: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the reading at unit share on the model's grid, (2, FIELD_SIZE), and its four derivatives."""
    count, mass, bending_s, tread_s = (float(value) for value in parameters[2:])
    blocks = TreadBlocks(max(count, _LEAST_COUNT), max(mass, _LEAST_MASS_KGPM), bending_s, tread_s)
    conditions = block.conditions
    offset_m = relative_offset(block) * conditions.radius_m
    response = _response(belt, blocks, conditions.omega_radps, offset_m)
    carrier = conditions.omega_radps**2 * np.exp(-1j * blocks.count * block.theta_rad)
    signal, by = carrier * response.signal, carrier * response.by
    by[0] -= 1j * block.theta_rad * signal
    return signal, by


@lru_cache(maxsize=32)
def _response(belt: LoadedBelt, blocks: TreadBlocks, omega_radps: float, offset_m: float) -> BlockResponse:
    """Return the response on the model's grid, by trigonometric interpolation."""
    response = block_response(belt, blocks, omega_radps, offset_m)
    return BlockResponse(_on_field(response.signal), _on_field(response.by))


def _on_field(curves: ComplexArray) -> ComplexArray:
    spectrum = np.fft.fft(curves, axis=-1)
    nodes, half = curves.shape[-1], min(curves.shape[-1], FIELD_SIZE) // 2
    resampled = np.zeros((*curves.shape[:-1], FIELD_SIZE), dtype=np.complex128)
    resampled[..., :half] = spectrum[..., :half]
    resampled[..., 1 - half :] = spectrum[..., 1 - half :]
    result: ComplexArray = np.fft.ifft(resampled, axis=-1) * (FIELD_SIZE / nodes)
    return result


EFFECTS: Final = (TreadExcitation(),)
