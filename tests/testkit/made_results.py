"""Results and snapshots as views see them, made without a pipeline."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.core.estimates.estimator import Estimate, Status, TireConditions
from gateway.core.estimates.results import (
    Alarm,
    LinkSnapshot,
    RevolutionResult,
    SessionSnapshot,
    WheelCounters,
    WheelSnapshot,
    WheelState,
)
from gateway.core.links.reasons import LinkCode
from gateway.core.reasons import Notice, Reason
from gateway.ring.reasons import RingCode
from tests.testkit.revolution_data import plain_revolution

RADIUS_M = 0.32
NUMBERS = {"Bs": (3.0833e-3, 1.2e-5), "Cw": (0.1953, 0.0012), "Rs": (2.974, 0.031), "Ts": (2.529, 0.099)}
NEEDS_LOAD = Reason(RingCode.NEEDS_LOAD)


def _curve(omega_radps: float, n: int = 512) -> np.ndarray:
    theta = -math.pi + 2.0 * math.pi * np.arange(n) / n
    baseline = RADIUS_M * omega_radps**2
    dip = 0.5 * (np.tanh((theta + 0.24) / 0.03) - np.tanh((theta - 0.24) / 0.03))
    return baseline * (1.0 - dip)


def _result(position="FL", index=12, speed_kmh=65.0, status=Status.VALID, reasons=(), load_n=5000.0, faults=(), **kw):
    omega = speed_kmh / 3.6 / RADIUS_M
    revolution = plain_revolution(
        index=index,
        start_s=100.0 + 0.1 * index,
        period_s=2.0 * math.pi / omega,
        omega_radps=omega,
        radial_mps2=_curve(omega),
        axes_mps2=np.full((3, 512), np.nan),
        leading_edge_rad=-0.2398,
        trailing_edge_rad=0.2358,
        leading_edge_std_rad=0.0017,
        trailing_edge_std_rad=0.0018,
        noise_mps2=20.0,
        faults=faults,
    )
    kinematic = (
        Estimate("speed_mps", speed_kmh / 3.6, 0.006, Status.VALID),
        Estimate("leading_edge_rad", -0.2398, 0.0017, Status.VALID),
        Estimate("trailing_edge_rad", 0.2358, 0.0018, Status.VALID),
        Estimate("contact_length_m", 0.1522, 0.0011, Status.VALID),
    )
    if load_n is None:
        numbers = [Estimate.invalid(name, NEEDS_LOAD) for name in NUMBERS]
    elif status is Status.INVALID:
        numbers = [Estimate.invalid(name, *reasons) for name in NUMBERS]
    else:
        numbers = [Estimate(name, value, std, status, reasons) for name, (value, std) in NUMBERS.items()]
    for name in ("Bs", "Rs", "Ts"):
        ratio = NUMBERS[name][0] / NUMBERS["Cw"][0]
        reference = status is not Status.INVALID
        numbers.append(
            Estimate(f"{name}/Cw", ratio if reference else math.nan, 0.01 * ratio, status, () if reference else reasons)
        )
    estimates = kw.get("estimates", (*kinematic, *numbers))
    return RevolutionResult(position, 0, revolution, TireConditions(RADIUS_M, load_n, 210e3, 31.5), estimates)


def _wheel(position="FL", load_n=5000.0, **changes):
    result = changes.pop("last", None) or _result(position, load_n=load_n, **changes.pop("result", {}))
    wheel = WheelSnapshot(
        position=position,
        sensor_id="0000a001",
        rate_hz=9600.0,
        state=WheelState.ROLLING,
        last=result,
        average_mps2=_curve(result.revolution.omega_radps),
        pressure_pa=210e3,
        temperature_degc=31.5,
        load_n=load_n,
        counters=WheelCounters(samples=99_000, samples_lost=1_000, revolutions=13),
    )
    return dataclasses.replace(wheel, **changes)


def _link(name="sim:demo", **changes):
    link = LinkSnapshot(
        link=name,
        connected=True,
        note=Reason(LinkCode.LINK_CONNECTED),
        bytes_received=12_345_678,
        frames=9_900,
        crc_errors=12,
        noise_bytes=0,
        frames_lost=100,
        duplicates=0,
        reordered=0,
        skipped=0,
        latency_s=0.0123,
        queue_dropped={"ring": 4, "writer": 3},
        battery_percent=87,
        rssi_dbm=-61,
        supply_w=0.43,
    )
    return dataclasses.replace(link, **changes)


def _snapshot(wheels=("FL", "FR", "RL", "RR"), **changes):
    made = tuple(_wheel(w) if isinstance(w, str) else w for w in wheels)
    snapshot = SessionSnapshot(
        elapsed_s=83.2,
        wheels=made,
        links=(_link(),),
        alarms=(),
        notices=(Notice("sim:demo", Reason(LinkCode.LINK_CONNECTED)),),
        recording="recordings/drive.mcap",
        recorded_bytes=12_345_678,
        ended=False,
    )
    return dataclasses.replace(snapshot, **changes)


def _alarm(position="FR", name="pressure", text="171.0 kPa is below 180.0 kPa"):
    return Alarm(position, name, Reason(LinkCode.QUOTED_TEXT, text=text))


@pytest.fixture(scope="session")
def made() -> SimpleNamespace:
    """Makers of results, wheels, links, snapshots and alarms with sensible defaults."""
    return SimpleNamespace(
        result=_result, wheel=_wheel, link=_link, snapshot=_snapshot, alarm=_alarm, needs_load=NEEDS_LOAD
    )
