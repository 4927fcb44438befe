"""Options of the exact ring other than its four numbers and its tread."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass


@dataclass(frozen=True, slots=True)
class RingOptions:
    """Options of one solve, SI; the defaults are the baseline model's.

    Attributes:
        extension_stiffness_n: EA; the default is inextensible to 1e-6.
        shear_length_m: sqrt(EI / GA) of the belt; 0 is an Euler belt.
        rotary_inertia_kgm: rho I.
        damping_time_s: c / kw of the sidewall; its loss angle at angular speed omega is omega times this.
        tread_damping_time_s: ct / kt of the tread.
        bending_damping_time_s: c_b / EI of the belt.
        stiffening_pm: relative growth of the sidewall's stiffnesses per metre.
        drum_curvature_pm: 1 / drum radius; 0 is flat, negative an inner drum.
        traction: axle torque beyond that of the losses over load and belt radius; friction along the belt carries it.
        sensor_offset_m: of the sensor below the neutral layer.
        runout_cosine_m: height of the tire's first harmonic at the sensor; the exact ring only, like the next.
        runout_sine_m: its height on the road a quarter of a turn after the sensor was at the bottom.
        kinematics: series only: 0 reads n^2 as Eq. 25 prints it, 1 reads n^2 - 1, in proportion in between.
        pressure_p2: series only: Legendre coefficient a_2 of the contact pressure, 0 is uniform.
        pressure_p4: series only: a_4.
        pressure_p6: series only: a_6.
        tension_loss: series only: share of what the belt's finite turning changes (the exact ring's waveform less that
            of the linear ring under the exact ring's own contact pressure); 1 is all of it.
    """

    extension_stiffness_n: float = 2e10
    shear_length_m: float = 0.0
    rotary_inertia_kgm: float = 0.0
    damping_time_s: float = 0.0
    tread_damping_time_s: float = 0.0
    bending_damping_time_s: float = 0.0
    stiffening_pm: float = 0.0
    drum_curvature_pm: float = 0.0
    traction: float = 0.0
    sensor_offset_m: float = 0.0
    runout_cosine_m: float = 0.0
    runout_sine_m: float = 0.0
    kinematics: float = 0.0
    pressure_p2: float = 0.0
    pressure_p4: float = 0.0
    pressure_p6: float = 0.0
    tension_loss: float = 0.0

    def rounded(self) -> RingOptions:
        """Return the same options rounded to two digits."""
        return RingOptions(*(float(f"{value:.1e}") for value in astuple(self)))

    @property
    def depends_on_speed(self) -> bool:
        """Whether the shape changes with speed."""
        damping = self.damping_time_s or self.tread_damping_time_s or self.bending_damping_time_s
        return bool(damping or self.rotary_inertia_kgm)

    @property
    def drum_radius_m(self) -> float:
        """Radius of the drum, infinite when flat."""
        return 1.0 / self.drum_curvature_pm if self.drum_curvature_pm else math.inf
