"""Records on the lines of the collector's test bench: samples, provisioning and faults on request.

The other end is `firmware_protocol/collector/ports/bench/bench.c`.
"""

import struct
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_protocol import wire
from firmware_protocol.messages import Coupling

SYNC: Final = 0xC3
MOST_WORDS: Final = 120
"""Raw words of one record, all axes."""

MOST_WHEELS: Final = 4
RATES: Final = 4
KEY_BYTES: Final = 16
_MASK: Final = 0xFFFF_FFFF
_TICK: Final = struct.Struct("<I")
_ENVIRONMENT: Final = struct.Struct("<IihH")
_HUB: Final = struct.Struct("<BBBBQIHbx16s")
_WHEEL: Final = struct.Struct("<BBBBIHxx15f16s")


class Kind(IntEnum):
    """Kind of a record."""

    SAMPLES = 1
    ENVIRONMENT = 2
    TIME = 3
    HUB = 4
    WHEEL = 5
    START = 6
    LISTEN = 16
    STALL = 17
    RESET_AT = 18
    CUT = 19
    COUNTERS = 20
    HANG = 21
    LINK = 22
    FLASH = 23


class HubData(NamedTuple):
    """Provisioning of the hub.

    Attributes:
        hub: number on its link.
        hub_id: serial number.
        key: of 16 bytes, None for unsigned frames.
        battery_percent: None without a battery.
        supply_w: supply power.
        supply_v: supply voltage.
        rssi_dbm: of the sensor link, None when wired.
    """

    hub: int = 0
    hub_id: int = 0x0123_4567_89AB_CDEF
    key: bytes | None = None
    battery_percent: int | None = None
    supply_w: float = 0.08
    supply_v: float = 3.7
    rssi_dbm: int | None = None


class WheelData(NamedTuple):
    """Provisioning of a wheel; units are those of HELLO.

    Attributes:
        wheel: number at the hub.
        sensor_id: serial number.
        key: of 16 bytes, None for unsigned frames.
        axes: axis mask.
        coupling: of the sensor.
        rate_hz: sampling rate at the start.
        highpass_hz: corner of the AC coupling.
        range_mps2: (3,) full scale.
        scale_mps2: (3,) m/s^2 per count.
        offset_counts: (3,) counts at zero.
        saturation_counts: least saturated count.
        rates_hz: at most 4 rates that the sensor supports.
    """

    wheel: int = 0
    sensor_id: int = 0x0000_A001
    key: bytes | None = None
    axes: int = 0b111
    coupling: Coupling = Coupling.DC
    rate_hz: float = 9600.0
    highpass_hz: float = 0.0
    range_mps2: tuple[float, float, float] = (4000.0, 4000.0, 4000.0)
    scale_mps2: tuple[float, float, float] = (0.125, 0.125, 0.125)
    offset_counts: tuple[float, float, float] = (0.0, 0.0, 0.0)
    saturation_counts: int = 32767
    rates_hz: tuple[float, ...] = (9600.0,)


def record(kind: Kind, payload: bytes = b"", wheel_index: int = 0) -> bytes:
    """Return a record; `wheel_index` counts the wheels of the provisioning from 0."""
    body = bytes((kind, wheel_index, len(payload))) + payload
    return bytes((SYNC,)) + body + bytes((sum(body) & 0xFF,))


def samples(wheel_index: int, tick_us: int, counts: NDArray[np.int16]) -> bytes:
    """Return the record of at most MOST_WORDS raw words: (n, channels) `counts` from `tick_us` on."""
    if counts.size > MOST_WORDS:
        raise ValueError(f"a record has at most {MOST_WORDS} words, not {counts.size}")
    return record(Kind.SAMPLES, _TICK.pack(tick_us & _MASK) + counts.astype("<i2").tobytes(), wheel_index)


def environment(
    wheel_index: int, tick_us: int, pressure_pa: float | None, temperature_degc: float | None, supply_v: float | None
) -> bytes:
    """Return the record of a wheel's slow quantities."""
    values = (
        wire.NONE_I32 if pressure_pa is None else round(pressure_pa),
        wire.NONE_I16 if temperature_degc is None else round(temperature_degc * 100.0),
        wire.NONE_U16 if supply_v is None else round(supply_v * 1000.0),
    )
    return record(Kind.ENVIRONMENT, _ENVIRONMENT.pack(tick_us & _MASK, *values), wheel_index)


def provisioning(hub: HubData, wheels: list[WheelData]) -> bytes:
    """Return the records that provision a collector and restart it."""
    if not 1 <= len(wheels) <= MOST_WHEELS:
        raise ValueError(f"a collector has 1 to {MOST_WHEELS} wheels, not {len(wheels)}")
    return (
        record(Kind.HUB, _hub(hub, len(wheels)))
        + b"".join(record(Kind.WHEEL, _wheel(wheel), wheel_index) for wheel_index, wheel in enumerate(wheels))
        + record(Kind.START)
    )


def _hub(hub: HubData, wheels: int) -> bytes:
    return _HUB.pack(
        hub.hub,
        wheels,
        hub.key is not None,
        wire.NONE_U8 if hub.battery_percent is None else hub.battery_percent,
        hub.hub_id,
        round(hub.supply_w * 1e6),
        round(hub.supply_v * 1e3),
        wire.NONE_I8 if hub.rssi_dbm is None else hub.rssi_dbm,
        hub.key or bytes(KEY_BYTES),
    )


def _wheel(wheel: WheelData) -> bytes:
    return _WHEEL.pack(
        wheel.wheel,
        wheel.axes,
        wheel.coupling,
        wheel.key is not None,
        wheel.sensor_id,
        wheel.saturation_counts,
        wheel.rate_hz,
        wheel.highpass_hz,
        *wheel.range_mps2,
        *wheel.scale_mps2,
        *wheel.offset_counts,
        *(wheel.rates_hz + (0.0,) * RATES)[:RATES],
        wheel.key or bytes(KEY_BYTES),
    )
