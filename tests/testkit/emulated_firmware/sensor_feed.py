"""Records of a scenario's sensors in the order in which they were taken."""

import threading
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from gateway.core.clock import Clock
from gateway.core.errors import SourceError
from gateway.security.cmac import Key
from gateway.security.key_file import hub_identity, sensor_identity
from gateway.simulator.hub import HUB_ID, SENSOR_SUPPLY_V
from gateway.simulator.sensor import FULL_SCALE_COUNTS
from gateway.simulator.simulated_wheel import WheelSimulator
from gateway.simulator.simulation import BLOCK_S, Simulation
from tests.testkit.emulated_firmware import bench_records
from tests.testkit.emulated_firmware.bench_records import MOST_WHEELS, MOST_WORDS, HubData, WheelData
from tests.testkit.emulated_firmware.emulated_board import EmulatedBoard

_ENVIRONMENT_PERIOD_S: Final = 1.0


class TimedRecord(NamedTuple):
    """A record of one sensor.

    Attributes:
        time_s: true time at which the sensor hands it over.
        wheel_index: of the wheel in the provisioning, from 0.
        data: the record.
        samples: number of samples in it.
    """

    time_s: float
    wheel_index: int
    data: bytes
    samples: int


class SensorFeed:
    """The sensors of a simulation as they look from a collector.

    Attributes:
        hub: provisioning of the hub.
        wheels: provisioning of its wheels.
    """

    def __init__(self, simulation: Simulation, keys: dict[str, Key] | None = None) -> None:
        """Take the wheels of the simulation, and the keys with which the collector is to sign.

        Raises:
            SourceError: the scenario needs more than one collector.
        """
        hubs = simulation.scenario.hubs()
        if len(hubs) != 1 or len(simulation.wheels) > MOST_WHEELS:
            raise SourceError(
                f"the scenario has {len(hubs)} hubs and {len(simulation.wheels)} wheels",
                f"The emulated board is one hub with at most {MOST_WHEELS} wheels. Choose another scenario.",
            )
        self._simulation = simulation
        self._clock_rate = 1e6 * (1.0 + hubs[0].clock_ppm * 1e-6)
        keys = keys or {}
        hub_id = HUB_ID + hubs[0].hub
        battery = hubs[0].battery_percent
        self.hub = HubData(
            hubs[0].hub,
            hub_id,
            _secret(keys, hub_identity(hub_id)),
            None if battery is None else round(battery),
            hubs[0].supply_w,
            hubs[0].supply_v,
            hubs[0].rssi_dbm,
        )
        self.wheels = [_provisioned(wheel, keys) for wheel in simulation.wheels]

    def records(self) -> Iterator[TimedRecord]:
        """Yield the records of the whole scenario, endless if the scenario is; runs once."""
        duration_s = self._simulation.duration_s
        block = 0
        while duration_s is None or block * BLOCK_S < duration_s:
            begin_s = block * BLOCK_S
            block += 1
            until_s = block * BLOCK_S if duration_s is None else min(block * BLOCK_S, duration_s)
            records = [*self._environment(begin_s, until_s)]
            for wheel_index, wheel in enumerate(self._simulation.wheels):
                records += self._samples(wheel_index, wheel, until_s)
            yield from sorted(records, key=lambda record: record.time_s)

    def _tick(self, time_s: float) -> int:
        return round(time_s * self._clock_rate)

    def _samples(self, wheel_index: int, wheel: WheelSimulator, until_s: float) -> Iterator[TimedRecord]:
        fresh, rate = wheel.advance(until_s), wheel.plan.sample_rate_hz
        most = MOST_WORDS // wheel.chain.channels
        for offset in range(0, len(fresh.counts), most):
            counts = fresh.counts[offset : offset + most]
            first = fresh.first + offset
            data = bench_records.samples(wheel_index, self._tick(first / rate), counts)
            yield TimedRecord((first + len(counts)) / rate, wheel_index, data, len(counts))

    def _environment(self, begin_s: float, until_s: float) -> Iterator[TimedRecord]:
        for time_s in np.arange(np.ceil(begin_s), until_s, _ENVIRONMENT_PERIOD_S):
            for wheel_index, wheel in enumerate(self._simulation.wheels):
                pressure_pa = wheel.plan.told_pressure_pa(time_s)
                temperature_degc = wheel.plan.temperature_degc.at(time_s)
                data = bench_records.environment(
                    wheel_index, self._tick(time_s), pressure_pa, temperature_degc, SENSOR_SUPPLY_V
                )
                yield TimedRecord(float(time_s), wheel_index, data, 0)


class Played(NamedTuple):
    """Result of a play.

    Attributes:
        time_s: simulated time that was played.
        samples: samples handed over, of all wheels.
        late_s: greatest lag behind the schedule.
    """

    time_s: float
    samples: int
    late_s: float


def play(feed: SensorFeed, board: EmulatedBoard, speed: float, clock: Clock, stop: threading.Event) -> Played:
    """Hand the records of a feed to a board on an absolute schedule, until they end or `stop` is set.

    Args:
        feed: the sensors.
        board: where the collector runs.
        speed: multiple of real time.
        clock: paces the records.
        stop: ends the play.
    """
    start_ns, time_s, late_s, samples = clock.now_ns(), 0.0, 0.0, 0
    for record in feed.records():
        due_ns = start_ns + round(record.time_s / speed * 1e9)
        if clock.sleep_until_ns(due_ns, stop):
            break
        board.send(record.wheel_index, record.data)
        late_s = max(late_s, (clock.now_ns() - due_ns) * 1e-9)
        time_s = record.time_s
        samples += record.samples
    return Played(time_s, samples, late_s)


def _provisioned(wheel: WheelSimulator, keys: dict[str, Key]) -> WheelData:
    chain, rate_hz = wheel.chain, wheel.plan.sensor.rate_hz
    return WheelData(
        wheel=wheel.plan.wheel,
        sensor_id=wheel.plan.sensor_id,
        key=_secret(keys, sensor_identity(wheel.plan.sensor_id)),
        axes=chain.axes,
        coupling=chain.coupling,
        rate_hz=rate_hz,
        highpass_hz=chain.highpass_hz,
        range_mps2=chain.range_mps2,
        scale_mps2=chain.scale_mps2,
        saturation_counts=FULL_SCALE_COUNTS,
        rates_hz=(rate_hz,),
    )


def _secret(keys: dict[str, Key], identity: str) -> bytes | None:
    key = keys.get(identity)
    return None if key is None else key.secret
