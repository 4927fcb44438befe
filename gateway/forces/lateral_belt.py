"""Lateral model of the belt: a shear-flexible beam under tension on the sidewall, sheared by its own bending.

A steel belt of plies at +delta / -delta that is bent flat in the contact shears in its plane by
gamma0 = -g (kappa - 1/R), g = B16 / A66 (ply steer paper, Eq. 13; `laminate`). This is the excitation. Beam, tension
and sidewall determine the lateral shape, and the brush tread (`brush_tread`) adds the road when the tire rolls. Derived
in docs/explanation/ply-steer.md.

Directions: theta is 0 at the contact centre and increases with rotation; y is positive to the vehicle's left.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import BoolArray, FloatArray
from gateway.forces.brush_tread import solve_brush_on_belt
from gateway.ring.rolling_ring import RingSolution
from gateway.ring.rolling_ring.sensor_waveform import angle_derivatives


@dataclass(frozen=True, slots=True)
class LateralBelt:
    """Lateral properties of a belt and its tread, SI units; the defaults are a 205/55R16 car tire.

    Attributes:
        coupling_length_m: g = B16 / A66; its sign depends on the order of the plies and the direction of rotation.
        shear_stiffness_n: Ks, in-plane shear stiffness of the belt.
        bending_stiffness_nm2: EIz, in-plane bending stiffness.
        sidewall_stiffness_npm2: ky, lateral sidewall stiffness per length of belt.
        tread_stiffness_npm2: cy, lateral tread stiffness per length of belt.
        friction: mu between tread and road.
        conicity_rad: half angle of the cone of which the belt is part; flattened, it curves in its plane by
            conicity / R.
    """

    coupling_length_m: float = 1.2e-3
    shear_stiffness_n: float = 1.6e6
    bending_stiffness_nm2: float = 1e3
    sidewall_stiffness_npm2: float = 2.5e5
    tread_stiffness_npm2: float = 8e6
    friction: float = 1.0
    conicity_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class LateralSolution:
    """Steady lateral shape of a belt. Arrays run over the radial solution's angles, (N,).

    The lateral axis of a sensor reads `specific_force`: omega^2 lateral_m + g gravity_lateral.

    Attributes:
        theta_rad: material angles.
        y_m: lateral displacement.
        slope_rad: dy/ds, s = R theta: slope of the streamline.
        lateral_m: d2y/dtheta2, lateral acceleration per omega^2 (paper, Eq. 8).
        gravity_lateral: projection of minus gravity on the lateral axis, sin(camber).
        deflection_m: deflection of the tread, 0 outside the contact.
        sliding: True where the tread slides.
        side_force_n: of the road on the tire.
        aligning_moment_nm: of the tread's force about the vertical axis at theta = 0, positive turns the tire left.
        omega_radps: angular speed of the radial solution.
        slip_angle_rad: slip angle.
    """

    theta_rad: FloatArray
    y_m: FloatArray
    slope_rad: FloatArray
    lateral_m: FloatArray
    gravity_lateral: FloatArray
    deflection_m: FloatArray
    sliding: BoolArray
    side_force_n: float
    aligning_moment_nm: float
    omega_radps: float
    slip_angle_rad: float

    @property
    def lateral_mps2(self) -> FloatArray:
        """Lateral acceleration at the radial solution's speed, without gravity."""
        return self.omega_radps**2 * self.lateral_m

    def specific_force(self, omega_radps: float, gravity_mps2: float = STANDARD_GRAVITY_MPS2) -> FloatArray:
        """Return the lateral specific force, (N,) m/s^2; the shape does not depend on the speed."""
        return omega_radps**2 * self.lateral_m + gravity_mps2 * self.gravity_lateral


def solve_lateral_belt(
    ring: RingSolution,
    belt: LateralBelt,
    *,
    slip_angle_rad: float = 0.0,
    camber_rad: float = 0.0,
    rolling: bool = True,
) -> LateralSolution:
    """Return the lateral shape of `belt` on a radial solution.

    Per length of belt: (Ks (y' - psi - gamma0) + T y')' - ky y + cy delta = 0 and
    (EIz (psi' - kappa0))' + Ks (y' - psi - gamma0) = 0, psi the rotation of the belt's section, T the belt's tension
    without its centrifugal part (which the lateral inertia of the passing belt cancels), gamma0 = -g (kappa - 1/R),
    kappa0 = -conicity (kappa - 1/R). Curvature, tension, contact and pressure are those of the radial solution.

    Args:
        ring: radial solution; its grid is used.
        belt: lateral properties.
        slip_angle_rad: positive pulls the tire to the left (`brush_tread`).
        camber_rad: affects the lateral axis as g sin(camber) only; positive for a positive reading.
        rolling: False gives the standing tire on a road without lateral friction.

    Raises:
        ValueError: a stiffness that is not positive; the message names it.
        BrushNotConvergedError: stick and slip of the tread did not converge.
    """
    for name in ("shear_stiffness_n", "bending_stiffness_nm2", "sidewall_stiffness_npm2", "tread_stiffness_npm2"):
        if not getattr(belt, name) > 0.0:
            raise ValueError(f"{name} must be positive, not {getattr(belt, name):g}")
    if not belt.friction >= 0.0:
        raise ValueError(f"friction must not be negative, not {belt.friction:g}")
    nodes = len(ring.theta_rad)
    radius = ring.ring.radius_m
    step = radius * 2.0 * math.pi / nodes
    stiffness, load = _assemble(ring, belt, step)
    deflection = np.zeros(nodes)
    sliding = np.zeros(nodes, dtype=np.bool_)
    if rolling:
        touching = np.flatnonzero(ring.in_contact)
        contact = np.arange(touching[0], touching[-1] + 1)
        unknowns, brush = solve_brush_on_belt(
            stiffness,
            load,
            np.arange(contact[0] - 1, contact[-1] + 1),
            belt.tread_stiffness_npm2 * step,
            belt.friction * ring.contact_pressure_npm[contact] / belt.tread_stiffness_npm2,
            slip_angle_rad=slip_angle_rad,
            step_m=step,
            first_fraction=float((ring.theta_rad[contact[0]] - ring.leading_edge_rad) * radius / step),
        )
        deflection[contact] = brush.deflection_m
        sliding[contact] = brush.sliding
    else:
        unknowns = splu(stiffness).solve(load)
    shape = unknowns[:nodes]
    first_derivative, second_derivative = angle_derivatives(shape.astype(np.complex128))
    force = belt.tread_stiffness_npm2 * step * deflection
    return LateralSolution(
        theta_rad=ring.theta_rad,
        y_m=shape,
        slope_rad=first_derivative.real / radius,
        lateral_m=second_derivative.real,
        gravity_lateral=np.full(nodes, math.sin(camber_rad)),
        deflection_m=deflection,
        sliding=sliding,
        side_force_n=float(force.sum()),
        # The belt moves rearward through the contact, so a lateral force behind the centre turns the tire to the right.
        aligning_moment_nm=-float(force @ ring.theta_rad) * radius,
        omega_radps=ring.omega_radps,
        slip_angle_rad=slip_angle_rad,
    )


def ring_tension(ring: RingSolution) -> FloatArray:
    """Return the belt's axial force without its centrifugal part, N, (N,), of the segment after each node."""
    law = ring.ring
    step_rad = 2.0 * math.pi / len(ring.theta_rad)
    span = np.roll(ring.position_m, -1, axis=0) - ring.position_m
    strain = np.hypot(span[:, 0], span[:, 1]) / (2.0 * law.radius_m * math.sin(0.5 * step_rad)) - 1.0
    result: FloatArray = ring.pressure_pa * law.tension_width_m * law.radius_m + law.extension_stiffness_n * strain
    return result


def _assemble(ring: RingSolution, belt: LateralBelt, step: float) -> tuple[csc_array, FloatArray]:
    """Return the stiffness of (y, psi) at the nodes and the load of the bending-shear coupling.

    Linear elements with the shear evaluated at their middle, which avoids shear locking.
    """
    nodes = len(ring.theta_rad)
    node = np.arange(nodes)
    next_node = np.roll(node, -1)
    change = 0.5 * (ring.curvature_pm + ring.curvature_pm[next_node]) - 1.0 / ring.ring.radius_m
    shear, tension = belt.shear_stiffness_n, ring_tension(ring)
    # Derivatives of each element's strains y' - psi, psi' and y' by its four unknowns.
    unknowns = np.stack([node, next_node, nodes + node, nodes + next_node])
    sheared = np.array([-1.0 / step, 1.0 / step, -0.5, -0.5])
    bent = np.array([0.0, 0.0, -1.0 / step, 1.0 / step])
    pulled = np.array([-1.0 / step, 1.0 / step, 0.0, 0.0])
    element = shear * np.outer(sheared, sheared) + belt.bending_stiffness_nm2 * np.outer(bent, bent)
    blocks = step * (element[:, :, None] + np.outer(pulled, pulled)[:, :, None] * tension)
    rows = np.broadcast_to(unknowns[:, None, :], blocks.shape)
    columns = np.broadcast_to(unknowns[None, :, :], blocks.shape)
    ground = np.full(nodes, belt.sidewall_stiffness_npm2 * step)
    matrix = coo_array(
        (
            np.concatenate([blocks.ravel(), ground]),
            (np.concatenate([rows.ravel(), node]), np.concatenate([columns.ravel(), node])),
        ),
        shape=(2 * nodes, 2 * nodes),
    ).tocsc()
    load = np.zeros(2 * nodes)
    for weight, strain in (
        (shear * belt.coupling_length_m, sheared),
        (belt.bending_stiffness_nm2 * belt.conicity_rad, bent),
    ):
        for unknown, coefficient in zip(unknowns, strain, strict=True):
            np.add.at(load, unknown, -weight * coefficient * step * change)
    return matrix, load
