"""Samples of the simulated sensor, and blocks of the same tire for tests of effects."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    FIELD_SIZE,
    LATERAL,
    RADIAL,
    GroupConditions,
    ModelledBlock,
    SignalEffect,
)
from gateway.ring.rolling_ring.sensor_waveform import SensorWaveform
from gateway.simulator.scenario import parse_scenario
from gateway.simulator.simulated_wheel import WheelSimulator
from gateway.simulator.tire_table import LATERAL as LATERAL_COLUMN
from gateway.simulator.tire_table import look_up
from gateway.simulator.wheel_plan import WheelPlan, wheel_plans

G = STANDARD_GRAVITY_MPS2
# High, so that the simulated digital filters are close to analogue ones.
RATE = 25600.0
THETA = -math.pi + 2.0 * math.pi / FIELD_SIZE * np.arange(FIELD_SIZE)
OMEGA = 65.0 / 3.6 / 0.32
CONDITIONS = GroupConditions(OMEGA, 0.0, 0.32, 5000.0, 2.1e5, 25.0, 25.0, RATE, 0.0)


def plan_of(wheel: str = "", sensor: str = "", speed_kmh: float = 65.0, hub: str = "") -> WheelPlan:
    text = f"""
[motion]
speed_kmh = {speed_kmh}
[sensor]
rate_hz = {RATE}
noise_mg_rthz = 0.0
range_g = 250.0
{sensor}
[[hub]]
hub = 0
{hub}
[[wheel]]
position = "W"
wheel = 0
phase_deg = 0.0
{wheel}
"""
    return wheel_plans(parse_scenario(text, "test"))[0]


def samples(plan: WheelPlan, until_s: float = 0.5) -> np.ndarray:
    """Return the samples of the simulated sensor, (n, 3) m/s^2."""
    simulator = WheelSimulator(plan, np.random.default_rng(1))
    blocks = [simulator.advance(end).counts for end in np.arange(0.25, until_s + 1e-9, 0.25)]
    return np.concatenate(blocks) * np.array(simulator.chain.scale_mps2)


@lru_cache(maxsize=8)
def block_of(speed_kmh: float = 65.0, omega_dot_radps2: float = 0.0, wheel: str = "") -> ModelledBlock:
    """Return a block of the simulator's tire without any effect."""
    plan = plan_of(wheel)
    omega = speed_kmh / 3.6 / plan.radius_m
    columns = look_up(plan.table().waveform(5000.0, 2.1e5, OMEGA), THETA).astype(np.float64)
    shape = SensorWaveform(*(columns[:, i] for i in range(6)))
    signal = np.zeros((3, FIELD_SIZE))
    signal[RADIAL], signal[CIRCUMFERENTIAL] = shape.specific_force(omega, omega_dot_radps2)
    signal[LATERAL] = omega**2 * columns[:, LATERAL_COLUMN]
    conditions = replace(CONDITIONS, omega_radps=omega, omega_dot_radps2=omega_dot_radps2)
    return ModelledBlock(conditions, THETA, signal, shape, *plan.table().edges_rad(5000.0, 2.1e5, OMEGA))


def at_angles(field: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
    """Return a curve on the grid interpolated at angles, (n, 3)."""
    spectrum = np.fft.rfft(field) / FIELD_SIZE
    spectrum[:, 1:] *= 2.0
    order = np.arange(230)
    turn = np.exp(1j * np.outer(angle_rad + math.pi, order))
    return (turn @ spectrum[:, :230].T).real


def tail(values: np.ndarray, omega_radps: float = OMEGA, rate_hz: float = RATE) -> tuple[np.ndarray, np.ndarray]:
    """Return the last 4000 samples and their angles."""
    position = np.arange(len(values) - 4000, len(values))
    return values[-4000:], omega_radps * position / rate_hz


def effect_of(name: str) -> SignalEffect:
    effect = catalogue()[name]
    assert isinstance(effect, SignalEffect)
    return effect


def applied(block: ModelledBlock, **parameters: tuple[float, ...]) -> ModelledBlock:
    """Return the block with effects, applied by stage and then in the catalogue's order."""
    by_name = {name.replace("_", " "): np.array(values) for name, values in parameters.items()}
    effects = sorted((e for e in catalogue().values() if isinstance(e, SignalEffect)), key=lambda e: e.stage)
    for effect in effects:
        key = effect.name.replace("-", " ")
        if key in by_name:
            block = replace(block, signal_mps2=block.signal_mps2 + effect.contribution(block, by_name.pop(key)))
    assert not by_name
    return block


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
