"""Test cases: tires, loads, speeds, sensors, disturbances, and tires with properties unknown to the estimators."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.rolling_ring import RingParameters
from gateway.ring.tread_pattern import EdgeWaves

RADIUS_M = 0.32
REFERENCE_PA = 2.1e5
RING_THICKNESS_MM = 15.0
BASE_RING = RingParameters.from_numbers(*TABLE_3_NUMBERS, radius_m=RADIUS_M, pressure_pa=REFERENCE_PA)

LOADS_N = (2000.0, 5000.0, 8000.0)
PRESSURES_PA = (1.7e5, 2.1e5, 2.5e5)
WEAR_MM = (0.0, 2.9, 6.4)
# ADXL1004, ADXL375, H3LIS331DL class, and four times worse.
NOISE_MG_RTHZ = (0.125, 5.0, 15.0, 70.0)

# What the forward fit finds on the measured inner-liner recording (docs/evidence/accuracy.md):
# the packet after the contact.
MEASURED_WAVES = EdgeWaves(amplitude=0.12, order_before=30.0, order_after=52.0, decay_rad=0.9, phase_rad=-1.5)
# A second pair, which the forward estimator does not model.
MORE_WAVES = EdgeWaves(amplitude=0.06, order_before=22.0, order_after=37.0, decay_rad=0.6, phase_rad=0.8)


@dataclass(frozen=True, slots=True)
class Case:
    """One condition.

    Attributes:
        group: table that it belongs to.
        name: row.
        ring: true ring at `pressure_pa`.
        load_n: true and stated load.
        pressure_pa: true and stated pressure.
        speed_kmh: at the start.
        rate_hz: sampling rate.
        noise_mg_rthz: density of the sensor's noise.
        wear_mm: off the ring's thickness.
        acceleration_mps2: of the vehicle.
        road_rms_mps2: shaking of the sensor below 500 Hz.
        hub_rms_mps2: vertical shaking of the hub between 8 and 16 Hz.
        waves: locked to the tire.
        jitter_m: standard deviation of the leading edge from revolution to revolution.
        offset_m: of the sensor below the neutral layer; the estimators assume none.
        torque_nm: driving torque; the road's friction carries it as shear in the contact.
        drum_m: radius of the drum that the tire rolls on, not stated; infinite for a road.
    """

    group: str
    name: str
    ring: RingParameters = BASE_RING
    load_n: float = 5000.0
    pressure_pa: float = REFERENCE_PA
    speed_kmh: float = 65.0
    rate_hz: float = 9600.0
    noise_mg_rthz: float = 5.0
    wear_mm: float = 0.0
    acceleration_mps2: float = 0.0
    road_rms_mps2: float = 0.0
    hub_rms_mps2: float = 0.0
    waves: tuple[EdgeWaves, ...] = ()
    jitter_m: float = 0.0
    offset_m: float = 0.0
    torque_nm: float | None = None
    drum_m: float = math.inf

    @property
    def omega_radps(self) -> float:
        """Angular speed at the start."""
        return self.speed_kmh / 3.6 / RADIUS_M


def ring_at(wear_mm: float, pressure_pa: float) -> RingParameters:
    """A 15 mm ring worn down: EI with its cube; sidewall half proportional to the pressure."""
    sidewall = 0.5 + 0.5 * pressure_pa / REFERENCE_PA
    return replace(
        BASE_RING,
        bending_stiffness_nm2=BASE_RING.bending_stiffness_nm2 * (1.0 - wear_mm / RING_THICKNESS_MM) ** 3,
        radial_stiffness_npm2=BASE_RING.radial_stiffness_npm2 * sidewall,
        tangential_stiffness_npm2=BASE_RING.tangential_stiffness_npm2 * sidewall,
    )


def grid_cases() -> Iterator[Case]:
    """Table 1 of the ring paper."""
    for wear, pressure, load in itertools.product(WEAR_MM, PRESSURES_PA, LOADS_N):
        name = f"{wear:.1f} mm, {pressure * 1e-5:.1f} bar, {load:.0f} N"
        yield Case("grid", name, ring_at(wear, pressure), load, pressure, wear_mm=wear)


def sampling_cases() -> Iterator[Case]:
    """Speeds and rates."""
    for rate, speed in itertools.product((2000.0, 9600.0), (30.0, 65.0, 120.0)):
        yield Case("sampling", f"{speed:.0f} km/h, {rate:.0f} Hz", speed_kmh=speed, rate_hz=rate)


def noise_cases() -> Iterator[Case]:
    """Noise densities of the sensor, and disturbances by road and hub."""
    for noise in NOISE_MG_RTHZ:
        yield Case("noise", f"{noise:g} mg/rtHz", noise_mg_rthz=noise)
    yield Case("noise", "road 2 m/s2", road_rms_mps2=2.0)
    yield Case("noise", "road 5 m/s2", road_rms_mps2=5.0)
    shaken = Case("noise", "road 2, hub 1 m/s2", road_rms_mps2=2.0, hub_rms_mps2=1.0)
    yield shaken
    yield replace(shaken, name="road 2, hub 1, 0.2 m/s2 up", acceleration_mps2=0.2)


def variant_cases() -> Iterator[Case]:
    """Tires with properties unknown to the estimators."""
    base = Case("variants", "none")
    yield base
    for name, change in (
        ("sidewall +10 % at 20 mm", {"sidewall_stiffening_pm": 5.0}),
        ("sidewall -10 % at 20 mm", {"sidewall_stiffening_pm": -5.0}),
        ("belt extension EA 2 MN", {"extension_stiffness_n": 2e6}),
        ("belt extension EA 50 MN", {"extension_stiffness_n": 5e7}),
        ("tread half as stiff", {"tread_stiffness_npm2": 3.5e7}),
        ("shear-flexible belt 0.2 MN", {"shear_stiffness_n": 2e5, "rotary_inertia_kgm": 1e-4}),
        ("sidewall damping 200 N s/m2", {"foundation_damping_nspm2": 200.0}),
        ("tread damping 50 kN s/m2", {"tread_damping_nspm2": 5e4}),
        ("bending damping 0.002 N m2 s", {"bending_damping_nm2s": 2e-3}),
    ):
        yield replace(base, name=name, ring=replace(BASE_RING, **change))
    yield replace(base, name="contact shear, drive 300 N m", torque_nm=300.0)
    yield replace(base, name="drum of 0.85 m, not stated", drum_m=0.85)
    yield replace(base, name="edge waves as measured", waves=(MEASURED_WAVES,))
    yield replace(base, name="edge waves, two pairs", waves=(MEASURED_WAVES, MORE_WAVES))
    yield replace(base, name="leading edge jitters 2 mm", jitter_m=0.002)
    yield replace(base, name="sensor offset wrong by 5 mm", offset_m=0.005)


def all_cases() -> list[Case]:
    """Every case, in the order of the tables."""
    return [*grid_cases(), *sampling_cases(), *noise_cases(), *variant_cases()]


def quick_cases() -> list[Case]:
    """A selection of all cases that runs within a minute."""
    grid = [case for case in grid_cases() if case.pressure_pa == REFERENCE_PA and case.wear_mm in (0.0, 6.4)]
    sampling = [case for case in sampling_cases() if case.name == "65 km/h, 2000 Hz"]
    noise = [case for case in noise_cases() if case.name in ("5 mg/rtHz", "road 2, hub 1 m/s2")]
    names = ("sidewall +10 % at 20 mm", "tread half as stiff", "shear-flexible belt 0.2 MN", "edge waves as measured")
    return [*grid, *sampling, *noise, *(case for case in variant_cases() if case.name in names)]
