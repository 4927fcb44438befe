"""Data rate of a planned sensor, its time on the radio and the life of its battery, by a stated power model."""

import math
from typing import Final, NamedTuple

from pydantic import Field

from firmware_protocol.declaration import SAMPLES
from firmware_protocol.wire import OVERHEAD_BYTES
from gateway.core.config.validation import Section

BLOCK_SAMPLES: Final = 36
"""Samples of a frame."""
_SAMPLE_BYTES: Final = 2


class PowerModel(Section):
    """`[power]`: currents that are constant, and a radio that is on for its share of the time."""

    radio_kbps: float = Field(gt=0, le=1e6, description="net data rate of the radio in kbit/s")
    radio_ma: float = Field(
        gt=0, le=1e4, description="current of the radio while it sends, beside the controller, in mA"
    )
    controller_ma: float = Field(ge=0, le=1e4, description="mean current of everything but radio and sensor in mA")
    battery_mah: float = Field(gt=0, le=1e6, description="usable charge of the battery in mAh")


class LinkLoad(NamedTuple):
    """What one axis asks of link and battery.

    Attributes:
        data_kbps: sample frames with their overhead; NaN for an unknown rate.
        radio_share: of the time that the radio sends; above 1 it cannot carry the data. NaN without a power model.
        battery_h: life of the battery; NaN without a power model or the sensor's current, or if the radio cannot.
    """

    data_kbps: float
    radio_share: float = math.nan
    battery_h: float = math.nan


def link_load(rate_hz: float, sensor_ma: float | None, power: PowerModel | None) -> LinkLoad:
    """Return the load of a sensor whose radial axis is sampled at a rate, in frames of `BLOCK_SAMPLES`."""
    frame_bytes = OVERHEAD_BYTES + SAMPLES.size + _SAMPLE_BYTES * BLOCK_SAMPLES
    data_kbps = 8e-3 * frame_bytes * rate_hz / BLOCK_SAMPLES
    if power is None:
        return LinkLoad(data_kbps)
    share = data_kbps / power.radio_kbps
    if sensor_ma is None or not share <= 1.0:
        return LinkLoad(data_kbps, share)
    return LinkLoad(data_kbps, share, power.battery_mah / (sensor_ma + power.controller_ma + share * power.radio_ma))
