"""Tread pitch, an undeclared AC coupling, and an inextensible belt."""

import math

import numpy as np
import pytest

from firmware_protocol.messages import Coupling
from gateway.physics.tread_pattern import TreadPitch
from gateway.simulator.scenario import parse_scenario
from gateway.simulator.simulated_wheel import WheelSimulator
from gateway.simulator.wheel_plan import wheel_plans

OMEGA = 65.0 / 3.6 / 0.32
PATTERN = "[wheel.tread_pitch]\namplitude_percent = 5.0\nblocks = 60.0\nreach_rad = 0.2\nphase_deg = 40.0\n"


def wheel_of(wheel: str = "", sensor: str = "", tire: str = "", direction: str = "forward") -> WheelSimulator:
    text = (
        f'[motion]\ndirection = "{direction}"\n[sensor]\nnoise_mg_rthz = 0.0\nrange_g = 1000.0\n{sensor}\n'
        f'[tire]\n{tire}\n[[wheel]]\nposition = "W"\nwheel = 0\nphase_deg = -180.0\n{wheel}'
    )
    return WheelSimulator(wheel_plans(parse_scenario(text, "test"))[0], np.random.default_rng(1))


def read(wheel: WheelSimulator, until_s: float = 0.5) -> np.ndarray:
    return wheel.advance(until_s).counts * np.array(wheel.chain.scale_mps2)


def test_blocks_fill_the_contact_and_fade_beyond_it() -> None:
    theta = -math.pi + 2 * math.pi * np.arange(2048) / 2048
    wave = TreadPitch(0.05, blocks=70.0, reach_rad=0.1).radial(theta, -0.24, 0.22)
    inside = (theta > -0.24) & (theta < 0.22)
    assert np.sqrt(np.mean(wave[inside] ** 2)) == pytest.approx(0.05 / math.sqrt(2.0), rel=0.05)
    assert np.abs(wave[np.abs(theta) > 0.8]).max() < 1e-6
    at_reach = np.abs(theta - 0.32) < 0.05
    assert np.abs(wave[at_reach]).max() == pytest.approx(0.05 * math.exp(-0.5 * 0.5**2), rel=0.1)


@pytest.mark.parametrize(("direction", "sign"), [("forward", 1.0), ("reverse", -1.0)])
def test_scenario_tread_blocks_change_samples(direction: str, sign: float) -> None:
    wheel = wheel_of(PATTERN, direction=direction)
    added = read(wheel)[:, 2] - read(wheel_of(direction=direction))[:, 2]
    theta = np.mod(OMEGA * np.arange(len(added)) / 9600.0, 2 * math.pi) - math.pi
    edges = wheel.plan.table().edges_rad(5000.0, 2.1e5, OMEGA)
    expected = 0.32 * OMEGA**2 * TreadPitch(0.05, 60.0, 0.2, sign * math.radians(40.0)).radial(theta, *edges)
    assert added == pytest.approx(expected, abs=1.0)
    assert np.abs(added).max() > 40.0


def test_blocks_tilt_an_offset_sensor() -> None:
    sensor = "offset_mm = 5.0"
    along = read(wheel_of(PATTERN, sensor))[:, 0] - read(wheel_of("", sensor))[:, 0]
    assert np.abs(along).max() == pytest.approx(0.005 / 0.32 * 60.0 * 0.05 * 0.32 * OMEGA**2, rel=0.1)


def test_undeclared_ac_coupling_is_simulated() -> None:
    hidden = wheel_of(sensor='coupling = "ac"\nhighpass_hz = 2.0\ncoupling_declared = false')
    assert hidden.chain.coupling == Coupling.DC
    assert hidden.chain.highpass_hz == 0.0
    stated = wheel_of(sensor='coupling = "ac"\nhighpass_hz = 2.0')
    assert stated.chain.coupling == Coupling.AC
    coupled = read(hidden, 3.0)
    assert coupled == pytest.approx(read(stated, 3.0))
    assert abs(coupled[-4800:, 2].mean()) < 15.0


def test_inextensible_belt_closes_to_its_mean() -> None:
    radial = read(wheel_of(tire="extension_stiffness_mn = 20000.0"), 0.11138)[:, 2]
    per_turn = 2 * math.pi / OMEGA * 9600.0
    assert len(radial) == math.ceil(per_turn)
    mean = (radial.sum() - (len(radial) - per_turn) * radial[-1]) / per_turn
    assert mean == pytest.approx(0.32 * OMEGA**2, rel=5e-5)
