"""BLE peripheral as BlueZ presents it: its properties on the bus and its reaction to writes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from dbus_fast import Variant

UART_SERVICE: Final = "6e400001-b5a3-f393-e0a9-e50e24dcca9e"
UART_TO_HUB: Final = "6e400002-b5a3-f393-e0a9-e50e24dcca9e"
UART_FROM_HUB: Final = "6e400003-b5a3-f393-e0a9-e50e24dcca9e"
BATTERY_SERVICE: Final = "0000180f-0000-1000-8000-00805f9b34fb"
CONFIGURATION_DESCRIPTOR: Final = "00002902-0000-1000-8000-00805f9b34fb"

DEVICE: Final = "org.bluez.Device1"
SERVICE: Final = "org.bluez.GattService1"
CHARACTERISTIC: Final = "org.bluez.GattCharacteristic1"
DESCRIPTOR: Final = "org.bluez.GattDescriptor1"
_ATT_HEADER_BYTES: Final = 3

Interfaces = dict[str, dict[str, Variant]]


@dataclass(slots=True, eq=False)
class Peripheral:
    """A device with the UART service.

    Attributes:
        address: six bytes in hex.
        name: as advertised.
        rssi_dbm: signal strength of its advertisements.
        battery_percent: in its advertisements, None to leave it out.
        mtu: ATT MTU that a connection gets; None for a BlueZ too old to report it.
        service: UUID of its service, which it also advertises.
        characteristics: UUID and flags of each characteristic.
        failures: errors of BlueZ for the next attempts to connect, as (name, text).
        demands_pairing: whether it notifies only clients that are paired with it.
        paired: whether this computer has a key of it.
        has_key: whether it has kept its key of this computer.
        agent_pairs: whether the user of this computer agrees when asked.
        on_write: called with the bytes that a client writes.
        on_notifying: called when clients subscribe or unsubscribe.
        advertising: whether it can be found.
        discovered: whether BlueZ has an object for it.
        connected: whether a client is connected.
        resolved: whether its services are known in this connection.
        explored: whether BlueZ has objects for its services; they outlast a connection.
        notifying: whether a client has subscribed.
    """

    address: str
    name: str
    rssi_dbm: int = -60
    battery_percent: int | None = None
    mtu: int | None = 247
    service: str = UART_SERVICE
    characteristics: tuple[tuple[str, tuple[str, ...]], ...] = (
        (UART_TO_HUB, ("write-without-response", "write")),
        (UART_FROM_HUB, ("notify",)),
    )
    failures: list[tuple[str, str]] = field(default_factory=list)
    demands_pairing: bool = False
    paired: bool = False
    has_key: bool = True
    agent_pairs: bool = False
    on_write: Callable[[bytes], None] | None = None
    on_notifying: Callable[[bool], None] | None = None
    advertising: bool = True
    discovered: bool = False
    connected: bool = False
    resolved: bool = False
    explored: bool = False
    notifying: bool = False

    def path(self, adapter: str) -> str:
        """Return the object path below an adapter's."""
        return f"{adapter}/dev_{self.address.replace(':', '_')}"

    def notify_path(self, adapter: str) -> str:
        """Return the path of the characteristic that notifies, empty when none does."""
        numbers = [i for i, (_, flags) in enumerate(self.characteristics) if "notify" in flags]
        return self._characteristic_path(adapter, numbers[0]) if numbers else ""

    def device(self, adapter: str) -> Interfaces:
        """Return the properties of the device."""
        properties = {
            "Address": Variant("s", self.address),
            "AddressType": Variant("s", "public"),
            "Name": Variant("s", self.name),
            "Alias": Variant("s", self.name),
            "Adapter": Variant("o", adapter),
            "Paired": Variant("b", self.paired),
            "Connected": Variant("b", self.connected),
            "ServicesResolved": Variant("b", self.resolved),
            "UUIDs": Variant("as", [self.service]),
            "RSSI": Variant("n", self.rssi_dbm),
        }
        if self.battery_percent is not None:
            data = {BATTERY_SERVICE: Variant("ay", bytes([self.battery_percent]))}
            properties["ServiceData"] = Variant("a{sv}", data)
        return {DEVICE: properties}

    def attributes(self, adapter: str) -> Mapping[str, Interfaces]:
        """Return the objects of its GATT database, parents first."""
        service = f"{self.path(adapter)}/service0010"
        objects: dict[str, Interfaces] = {
            service: {
                SERVICE: {
                    "UUID": Variant("s", self.service),
                    "Device": Variant("o", self.path(adapter)),
                    "Primary": Variant("b", True),
                }
            }
        }
        for number, (uuid, flags) in enumerate(self.characteristics):
            path = self._characteristic_path(adapter, number)
            properties: dict[str, Any] = {
                "UUID": Variant("s", uuid),
                "Service": Variant("o", service),
                "Flags": Variant("as", list(flags)),
            }
            if self.mtu is not None:
                properties["MTU"] = Variant("q", self.mtu)
            objects[path] = {CHARACTERISTIC: properties}
            if "notify" in flags:
                properties |= {"Notifying": Variant("b", self.notifying), "NotifyAcquired": Variant("b", False)}
                objects[f"{path}/desc{0x13 + 4 * number:04x}"] = {
                    DESCRIPTOR: {
                        "UUID": Variant("s", CONFIGURATION_DESCRIPTOR),
                        "Characteristic": Variant("o", path),
                    }
                }
        return objects

    @property
    def room_bytes(self) -> int:
        """Largest payload of one notification, bytes."""
        return (self.mtu or 517) - _ATT_HEADER_BYTES

    def _characteristic_path(self, adapter: str, number: int) -> str:
        return f"{self.path(adapter)}/service0010/char{0x11 + 4 * number:04x}"
