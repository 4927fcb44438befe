"""The loaded ring of finite elements, with friction, in place of the rig's chain."""

from typing import Final

import numpy as np
from independent_tire.rolling import Belt
from independent_tire.steady import roll_steadily

from blind_rig.ring import GRAVITY_MPS2, NODES, Array, Ring, Shape

_ELEMENTS: Final = 480
_FRICTION: Final = 0.6


def rolled_by_elements(ring: Ring, load_n: float, omega_radps: float, depth_m: float) -> Shape:
    """Return what a sensor reads over a revolution, angle -pi first; the ring rolls freely on a flat road."""
    steady = roll_steadily(
        Belt(
            name="blind",
            radius_m=ring.radius_m,
            pressure_pa=ring.pressure_pa,
            tension_width_m=ring.cw * ring.radius_m,
            bending_nm2=ring.bs * ring.pressure_pa * ring.radius_m**4,
            extension_n=ring.extension_n,
            radial_npm2=ring.rs * ring.pressure_pa,
            tangential_npm2=ring.ts * ring.pressure_pa,
            mass_kgpm=ring.mass_kgpm,
            tread_npm2=ring.tread_npm2,
            speed_mps=ring.radius_m * omega_radps,
            sinking_m=0.03 * ring.radius_m,
            sidewall_damping_nspm2=ring.sidewall_damping_nspm2,
            friction=_FRICTION,
            elements=_ELEMENTS,
        ),
        load_n,
    )
    parts = steady.signals(depth_m)
    inertia = np.stack([parts.radial_m, parts.circumferential_m])
    gravity = GRAVITY_MPS2 * np.stack([parts.gravity_radial, parts.gravity_circumferential])
    return Shape(_finer(inertia), _finer(gravity))


def _finer(curves: Array) -> Array:
    """Return periodic curves (k, n) at as many nodes as the chain has."""
    spectrum = np.fft.rfft(curves, axis=1)
    spectrum[:, -1] *= 0.5
    finer: Array = np.fft.irfft(spectrum, n=NODES, axis=1) * (NODES / curves.shape[1])
    return finer
