"""Tire model: ring and lateral belt as functions of pressure, with the conditions of road and sensor."""

import math
from dataclasses import dataclass, field, replace

from gateway.forces.lateral_belt import LateralBelt, LateralSolution, solve_lateral_belt
from gateway.ring.rolling_ring import RingNumbers, RingParameters, RingSolution, solve_rolling_ring
from gateway.ring.tread_pattern import EdgeWaves, TreadPitch

RING_NODES = 2880


@dataclass(frozen=True, slots=True)
class TireModel:
    """Parameters that determine the shape of a tire under given conditions.

    Attributes:
        ring: at the reference pressure.
        reference_pa: pressure at which `ring` and `lateral` hold.
        lateral: the lateral belt, with signs as mounted and rolling.
        pressure_share: share of the sidewall's stiffness that grows with pressure.
        sensor_offset_m: sensor below the neutral layer.
        drum_radius_m: of the road; infinite when flat.
        axle_torque_nm: driving torque, balanced by the road's friction; None for a frictionless road.
        waves: from the tread pattern, None for a smooth tread.
        pitch: of the tread pattern's blocks, likewise.
        runout_m: height of the tire's high spot.
        runout_rad: material angle from the sensor to the high spot.
        linear_half_angle_rad: contact half angle of Eq. 27 as printed in the ring's place, None for the exact ring.
        nodes: of the ring.
    """

    ring: RingParameters
    reference_pa: float
    lateral: LateralBelt = field(default_factory=LateralBelt)
    pressure_share: float = 0.5
    sensor_offset_m: float = 0.0
    drum_radius_m: float = math.inf
    axle_torque_nm: float | None = None
    waves: EdgeWaves | None = None
    pitch: TreadPitch | None = None
    runout_m: float = 0.0
    runout_rad: float = 0.0
    linear_half_angle_rad: float | None = None
    nodes: int = RING_NODES

    def ring_at(self, pressure_pa: float) -> RingParameters:
        """Return the ring at a pressure."""
        growth = self._growth(pressure_pa)
        return replace(
            self.ring,
            radial_stiffness_npm2=self.ring.radial_stiffness_npm2 * growth,
            tangential_stiffness_npm2=self.ring.tangential_stiffness_npm2 * growth,
        )

    def lateral_at(self, pressure_pa: float) -> LateralBelt:
        """Return the lateral belt at a pressure."""
        stiffness = self.lateral.sidewall_stiffness_npm2 * self._growth(pressure_pa)
        return replace(self.lateral, sidewall_stiffness_npm2=stiffness)

    def numbers(self, pressure_pa: float) -> RingNumbers:
        """Return the true dimensionless numbers at a pressure."""
        return self.ring_at(pressure_pa).numbers(pressure_pa)

    def solve(
        self, load_n: float, pressure_pa: float, omega_radps: float, start: RingSolution | None = None
    ) -> RingSolution:
        """Return the ring under given conditions, without run-out and tread pattern.

        Raises:
            ValueError: a condition is out of range.
            RingNotConvergedError: there is no equilibrium.
        """
        return solve_rolling_ring(
            self.ring_at(pressure_pa),
            load_n,
            pressure_pa,
            omega_radps,
            nodes=self.nodes,
            sensor_offset_m=self.sensor_offset_m,
            drum_radius_m=self.drum_radius_m,
            axle_torque_nm=self.axle_torque_nm,
            start=start,
        )

    def solve_lateral(self, ring: RingSolution, slip_angle_rad: float) -> LateralSolution:
        """Return the lateral shape on a solution of `solve`.

        Raises:
            BrushNotConvergedError: sticking and sliding of the tread did not settle.
        """
        return solve_lateral_belt(ring, self.lateral_at(ring.pressure_pa), slip_angle_rad=slip_angle_rad)

    @property
    def depends_on_speed(self) -> bool:
        """Whether the shape changes with speed."""
        ring = self.ring
        damping = ring.foundation_damping_nspm2, ring.tread_damping_nspm2, ring.bending_damping_nm2s
        return any(value > 0.0 for value in (*damping, ring.rotary_inertia_kgm))

    def _growth(self, pressure_pa: float) -> float:
        return 1.0 + self.pressure_share * (pressure_pa / self.reference_pa - 1.0)
