"""A vehicle's bus beside simulated wheels: a DBC file as a car maker writes it, and its frames during the drive."""

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import can
import cantools

from gateway.core.config.vehicle import VehicleConfig, parse_vehicle
from gateway.core.links.bus_frames import BusFrame, pack
from gateway.core.links.source import BusFrames, LinkItem

DBC = Path(__file__).parent / "data" / "car.dbc"
LINK = "can:virtual:car"
MAPPING = (Path(__file__).parent / "data" / "vehicle_signals.toml").read_text()


def database() -> Any:
    return cantools.database.load_file(DBC)


def with_signals(toml: str, wheel: str, quantities: Collection[str] | None = None) -> VehicleConfig:
    """Return a simulated vehicle whose file maps the signals of the bus: of some quantities, or all."""
    head, *signals = MAPPING.format(wheel=wheel).split("\n[[")
    mapped = [text for text in signals if quantities is None or text.split('"', 2)[1] in quantities]
    return parse_vehicle(toml + "\n[[".join((head, *mapped)), "car")


def angle_rad(at_s: float) -> float:
    """Steering angle during the drive."""
    return 0.5 * math.sin(2.0 * math.pi * 0.4 * at_s)


def frames(
    begin_ns: int, end_ns: int, omega_radps: float, speed_mps: float, *, rotation: float = 1.0, speed: float = 1.0
) -> Iterator[BusFrame]:
    """Yield the frames of a drive at constant speed; `rotation` and `speed` falsify those of the car."""
    dbc = database()
    rpm = omega_radps * rotation * 30.0 / math.pi
    for step in range((end_ns - begin_ns) // 10_000_000):
        host_ns, at_s = begin_ns + step * 10_000_000, step * 0.01
        wheels = dict.fromkeys(("WheelSpeed_FL", "WheelSpeed_FR", "WheelSpeed_RL", "WheelSpeed_RR"), rpm)
        sent = [("ESP_Wheels", wheels)]
        if step % 2 == 0:
            angle = {"SteeringWheelAngle": -math.degrees(angle_rad(at_s)), "SteeringWheelRate": 0.0}
            sent.append(("SAS_Angle", {**angle, "Quality": 1, "Counter": step // 2 % 16}))
            brake, acceleration = (
                {"BrakePressure": 12.5, "BrakeSwitch": 1},
                {"AccelerationX": -0.25, "AccelerationY": 0.0},
            )
            page = brake if step % 4 == 0 else acceleration
            sent.append(("ESP_Dynamics", {"Page": 0 if step % 4 == 0 else 1, **page}))
            sent.append(("HubAccelerometers", {"AccelZ_FL": 1.5, "AccelZ_FR": 0.0}))
        if step % 10 == 0:
            sent.append(("CCVS1", {"WheelBasedVehicleSpeed": speed_mps * speed * 3.6}))
        for name, values in sent:
            message = dbc.get_message_by_name(name)
            yield BusFrame(host_ns, message.frame_id, message.is_extended_frame, message.encode(values, strict=False))


def blocks(result: Iterable[BusFrame], link: str = LINK) -> Iterator[BusFrames]:
    """Yield one item for each time."""
    block: list[BusFrame] = []
    for frame in result:
        if block and frame.host_ns != block[0].host_ns:
            yield BusFrames(link, block[0].host_ns, pack(block, block[0].host_ns))
            block = []
        block.append(frame)
    if block:
        yield BusFrames(link, block[0].host_ns, pack(block, block[0].host_ns))


def merged(wheels: Sequence[LinkItem], bus: Iterable[LinkItem]) -> list[LinkItem]:
    """Return the items of wheels and bus in the order of their times."""
    return sorted([*wheels, *bus], key=lambda item: item.host_ns)


def messages(result: Iterable[BusFrame]) -> Iterator[can.Message]:
    """Yield frames as python-can has them."""
    for frame in result:
        yield can.Message(
            timestamp=frame.host_ns * 1e-9,
            arbitration_id=frame.can_id,
            is_extended_id=frame.is_extended,
            data=frame.data,
            channel=0,
        )
