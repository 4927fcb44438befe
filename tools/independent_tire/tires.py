"""The tires that are kept: two sizes, three speeds and loads each, with damping and friction."""

from dataclasses import replace
from typing import Any, Final

import numpy as np

from independent_tire.rolling import Belt, LocalPart

# Numbers of the ring paper's tire: bending, tension, radial and tangential stiffness.
_NUMBERS: Final = (3.0833e-3, 0.1953, 2.9740, 2.5289)


def _belt(
    name: str, radius_m: float, pressure_pa: float, factors: tuple[float, float, float, float], **drive: Any
) -> Belt:
    bs, cw, rs, ts = (number * factor for number, factor in zip(_NUMBERS, factors, strict=True))
    size = pressure_pa / 2.1e5
    return Belt(
        name=name,
        radius_m=radius_m,
        pressure_pa=pressure_pa,
        tension_width_m=cw * radius_m,
        bending_nm2=bs * radius_m**4 * pressure_pa,
        extension_n=2e7 * size,
        radial_npm2=rs * pressure_pa,
        tangential_npm2=ts * pressure_pa,
        mass_kgpm=3.5 * size,
        tread_npm2=7e7 * size,
        **drive,
    )


_CAR: Final = (0.32, 2.1e5, (1.0, 1.0, 1.0, 1.0))
_VAN: Final = (0.38, 3.8e5, (1.25, 0.88, 1.15, 0.8))
# Without damping of the belt its waves go round the tire; with these numbers they are a few percent of the centripetal
# acceleration. The tread has no damping: the belt rings on its stiffness at 710 Hz, where 67 blocks come by at 77 km/h.
_BLOCKS: Final[dict[str, Any]] = {
    "sinking_m": 0.022,
    "sidewall_damping_nspm2": 60.0,
    "bending_damping_nm2s": 1e-4,
    "blocks": 67,
    "block_share": 0.05,
    # With 2048 the waves are 1 % too slow: the integration errs by the square of the step.
    "steps": 4096,
}

TIRES: Final[tuple[Belt, ...]] = (
    _belt("car-45", *_CAR, speed_mps=45 / 3.6, sinking_m=0.017, sidewall_damping_nspm2=60.0),
    _belt("car-65", *_CAR, speed_mps=65 / 3.6, sinking_m=0.024, sidewall_damping_nspm2=60.0,
          bending_damping_nm2s=2e-3, friction=0.6),
    _belt("car-120", *_CAR, speed_mps=120 / 3.6, sinking_m=0.028, sidewall_damping_nspm2=60.0,
          tread_damping_nspm2=1e4),
    _belt("van-40", *_VAN, speed_mps=40 / 3.6, sinking_m=0.026, sidewall_damping_nspm2=110.0),
    _belt("van-80", *_VAN, speed_mps=80 / 3.6, sinking_m=0.020, sidewall_damping_nspm2=110.0, friction=0.6),
    _belt("drum-65", *_CAR, speed_mps=65 / 3.6, sinking_m=0.022, sidewall_damping_nspm2=60.0, drum_radius_m=0.85),
    # Tread blocks make edge waves: the same tire at three speeds.
    _belt("blocks-45", *_CAR, speed_mps=45 / 3.6, **_BLOCKS),
    _belt("blocks-60", *_CAR, speed_mps=60 / 3.6, **_BLOCKS),
    _belt("blocks-75", *_CAR, speed_mps=75 / 3.6, **_BLOCKS),
)  # fmt: skip

# One or two of 120 elements differ; two speeds, each at its own load. A splice doubles EI over 34 mm, a weight of 40 g
# is as long, a patch stands 1.5 mm proud over 17 mm, and a rim is bent by 0.4 mm. With 2048 steps the waves that such a
# piece sends along the belt are 1 % too slow, and arrive out of phase.
_PIECE_RAD: Final = 2.0 * np.pi / 120
_PARTS: Final[dict[str, LocalPart]] = {
    "splice": LocalPart(20.0 * _PIECE_RAD, 2.0 * _PIECE_RAD, bending_share=1.0),
    "weight": LocalPart(50.0 * _PIECE_RAD, 2.0 * _PIECE_RAD, mass_share=0.34),
    "patch": LocalPart(79.5 * _PIECE_RAD, _PIECE_RAD, proud_m=1.5e-3),
    "rim": LocalPart(30.0 * _PIECE_RAD, 0.26, axle_m=4e-4),
}
LOCAL: Final[tuple[Belt, ...]] = tuple(
    _belt(f"{name}-{speed_kmh}", *_CAR, speed_mps=speed_kmh / 3.6, sinking_m=sinking_m, sidewall_damping_nspm2=60.0,
          bending_damping_nm2s=3e-4, local=part, elements=120, steps=4096, recorded=1, settling=1.5)
    for name, part in _PARTS.items()
    for speed_kmh, sinking_m in ((45, 0.022), (70, 0.019))
)  # fmt: skip

# Slope of force over slip: 25 times the load, as of a car tire (Pacejka, Tire and Vehicle Dynamics, 2012: 10 to 30).
_SLIP_SCALE: Final = 0.04
# Driven and braked by the road's friction: the truth of the force estimators.
PULLED: Final[tuple[Belt, ...]] = (
    _belt("free-65", *_CAR, speed_mps=65 / 3.6, sinking_m=0.024, sidewall_damping_nspm2=60.0, friction=1.0,
          slip_scale=_SLIP_SCALE),
    _belt("driven-65", *_CAR, speed_mps=65 / 3.6, sinking_m=0.024, sidewall_damping_nspm2=60.0, friction=1.0,
          traction=0.08, slip_scale=_SLIP_SCALE),
    _belt("braked-65", *_CAR, speed_mps=65 / 3.6, sinking_m=0.024, sidewall_damping_nspm2=60.0, friction=1.0,
          traction=-0.3, slip_scale=_SLIP_SCALE),
    _belt("lossy-65", *_CAR, speed_mps=65 / 3.6, sinking_m=0.024, sidewall_damping_nspm2=120.0,
          bending_damping_nm2s=2e-3, tread_damping_nspm2=5e3, friction=1.0, traction=0.08, slip_scale=_SLIP_SCALE),
    _belt("driven-100", *_CAR, speed_mps=100 / 3.6, sinking_m=0.026, sidewall_damping_nspm2=60.0, friction=1.0,
          traction=0.15, slip_scale=_SLIP_SCALE),
    _belt("braked-40", *_CAR, speed_mps=40 / 3.6, sinking_m=0.020, sidewall_damping_nspm2=60.0, friction=1.0,
          traction=-0.1, slip_scale=_SLIP_SCALE),
    _belt("van-driven-80", *_VAN, speed_mps=80 / 3.6, sinking_m=0.020, sidewall_damping_nspm2=110.0, friction=1.0,
          traction=0.15, slip_scale=_SLIP_SCALE),
    _belt("pulling-65", *_CAR, speed_mps=65 / 3.6, sinking_m=0.024, sidewall_damping_nspm2=60.0, friction=1.0,
          traction=0.3, slip_scale=_SLIP_SCALE),
)  # fmt: skip


def drawn(seed: int, count: int = 3) -> tuple[Belt, ...]:
    """Return tires of random size, numbers, losses, tread and road, each at a low and a high speed."""
    rng = np.random.default_rng(seed)
    tires = []
    for index in range(count):
        radius_m = float(rng.uniform(0.28, 0.45))
        pressure_pa = float(rng.uniform(1.8e5, 6e5)) * (1.0 if radius_m < 0.36 else 1.4)
        bs, cw, rs, ts = np.exp(rng.normal(0.0, 0.25, 4)).tolist()
        size = pressure_pa / 2.1e5
        more: dict[str, Any] = {
            "sinking_m": radius_m * float(rng.uniform(0.05, 0.075)),
            "sidewall_damping_nspm2": 60.0 * size * float(np.exp(rng.normal(0.0, 0.5))),
        }
        if rng.random() < 0.6:
            more |= {"blocks": int(rng.integers(52, 80)), "block_share": float(rng.uniform(0.01, 0.05)), "steps": 4096}
            more["bending_damping_nm2s"] = 10.0 ** float(rng.uniform(-4.0, -3.0)) * size * (radius_m / 0.32) ** 4
        else:
            more["bending_damping_nm2s"] = 10.0 ** float(rng.uniform(-3.5, -2.5))
        if rng.random() < 0.4:
            more["friction"] = float(rng.uniform(0.3, 0.8))
        if rng.random() < 0.3:
            more["drum_radius_m"] = float(rng.uniform(0.7, 1.5))
        for name, speed_kmh in (("slow", rng.uniform(40.0, 60.0)), ("fast", rng.uniform(70.0, 100.0))):
            belt = _belt(f"drawn-{seed}-{index}-{name}", radius_m, pressure_pa, (bs, cw, rs, ts),
                         speed_mps=float(speed_kmh) / 3.6, **more)  # fmt: skip
            tires.append(replace(belt, elements=120))
    return tuple(tires)
