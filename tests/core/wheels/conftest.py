"""Signals of a rolling wheel for pipeline tests, made from the geometrically exact ring."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_protocol.messages import Environment, Frame, MessageType, SampleBlock
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from tests.core.wheels.rolling_signals import PRESSURE_PA, RADIUS_M, SCALE_MPS2, Rolling, hello, ring_solution


@pytest.fixture(scope="session")
def roll() -> Callable[..., Rolling]:
    def make(
        speed_kmh: Callable[[NDArray[np.float64]], NDArray[np.float64]] | float,
        duration_s: float,
        rate_hz: float = 9600.0,
        *,
        noise_mps2: float = 3.4,
        sign: int = 1,
        ac: bool = False,
        start_rad: float = 2.0,
        seed: int = 1,
    ) -> Rolling:
        solution = ring_solution()
        t = np.arange(round(duration_s * rate_hz)) / rate_hz
        kmh = speed_kmh(t) if callable(speed_kmh) else np.full_like(t, speed_kmh)
        speed = kmh / 3.6
        theta = start_rad + np.concatenate(([0.0], np.cumsum(speed[:-1]))) / rate_hz / RADIUS_M
        wrapped = (theta + np.pi) % (2.0 * np.pi) - np.pi
        grid = solution.theta_rad

        def at_angle(values: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.interp(wrapped, grid, values, period=2.0 * np.pi)

        omega = speed / RADIUS_M
        radial = omega**2 * at_angle(solution.sensor.radial_m)
        radial += STANDARD_GRAVITY_MPS2 * at_angle(solution.sensor.gravity_radial)
        if ac:
            radial = radial - radial.mean()
        radial = sign * (radial + noise_mps2 * np.random.default_rng(seed).standard_normal(len(t)))
        turns = np.arange(np.ceil(theta[0] / (2 * np.pi)), np.floor(theta[-1] / (2 * np.pi)) + 1)
        moving = np.concatenate(([True], np.diff(theta) > 0))
        contacts = np.interp(turns * 2 * np.pi, theta[moving], np.flatnonzero(moving).astype(float))
        return Rolling(rate_hz, speed, theta, radial, contacts)

    return make


@pytest.fixture(scope="session")
def to_frames() -> Callable[..., list[Frame]]:
    """Convert a radial signal into the frames that a hub sends for one wheel."""

    def make(
        radial_mps2: NDArray[np.float64],
        rate_hz: float = 9600.0,
        *,
        wheel: int = 0,
        block: int = 36,
        first_sample: int = 0,
        pressure_pa: float | None = PRESSURE_PA,
        start_us: int = 0,
        **changes: object,
    ) -> list[Frame]:
        counts = np.clip(np.rint(radial_mps2 / SCALE_MPS2), -32768, 32767).astype(np.int16)[:, None]
        frames: list[Frame] = []

        def add(kind: MessageType, tick_us: int, message: object) -> None:
            frames.append(Frame(kind, 0, wheel, len(frames), tick_us & 0xFFFFFFFF, message))  # type: ignore[arg-type]

        add(MessageType.HELLO, start_us, hello(rate_hz, **changes))
        add(MessageType.ENVIRONMENT, start_us, Environment(pressure_pa, 35.0, 3.0))
        for index in range(0, len(counts) - block + 1, block):
            tick_us = start_us + round(index / rate_hz * 1e6)
            number = (first_sample + index) & 0xFFFFFFFF
            add(MessageType.SAMPLES, tick_us, SampleBlock(number, 0b100, counts[index : index + block]))
        return frames

    return make
