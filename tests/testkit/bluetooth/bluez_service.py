"""Emulation of BlueZ on a private D-Bus: BlueZ clients find simulated peripherals.

It follows what BlueZ 5.66 was seen to do: which signals come in which order, what stays when a link is lost, and what
vanishes with it.
"""

import asyncio
import socket
from collections.abc import Awaitable, Callable, Iterable
from contextlib import suppress
from typing import Any, Final

from dbus_fast import ErrorType, Message, MessageType, NameFlag, RequestNameReply, Variant
from dbus_fast.aio import MessageBus

from gateway.core.errors import SourceError
from tests.testkit.bluetooth.peripheral import CHARACTERISTIC, DEVICE, Interfaces, Peripheral

NAME: Final = "org.bluez"
ADAPTER: Final = "org.bluez.Adapter1"
PROPERTIES: Final = "org.freedesktop.DBus.Properties"
OBJECT_MANAGER: Final = "org.freedesktop.DBus.ObjectManager"
BUS: Final = "org.freedesktop.DBus"
# A D-Bus connection breaks when it runs 160 or more messages ahead of the daemon; a call after fewer waits for it.
_BURST: Final = 64


class BluezService:
    """The service, its adapter and its peripherals. Use it in one event loop only."""

    def __init__(self, address: str, *, adapter: str | None = "hci0", advertising_interval_s: float = 0.1) -> None:
        """Describe the service; `start` puts it on the bus.

        Args:
            address: of the bus.
            adapter: name of its only adapter, None for none.
            advertising_interval_s: between two advertisements of a peripheral.
        """
        self.adapter = f"/org/bluez/{adapter}" if adapter is not None else ""
        self.powered = True
        self._address = address
        self._interval_s = advertising_interval_s
        self._peripherals: dict[str, Peripheral] = {}
        self._discovering: set[str] = set()
        self._subscribers: dict[str, set[str]] = {}
        self._sockets: dict[str, socket.socket] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._advertiser: asyncio.Task[None] | None = None
        self._sent = 0
        self._bus: MessageBus | None = None

    # radio

    async def start(self) -> None:
        """Take BlueZ's name on the bus.

        Raises:
            SourceError: the name is taken: a real BlueZ is there.
        """
        self._bus = await MessageBus(bus_address=self._address, negotiate_unix_fd=True).connect()
        self._bus.add_message_handler(self._handle)
        await self._ask("AddMatch", "s", [f"type='signal',interface='{BUS}',member='NameOwnerChanged'"])
        reply = await self._bus.request_name(NAME, NameFlag.DO_NOT_QUEUE)
        if reply is not RequestNameReply.PRIMARY_OWNER:
            raise SourceError(f"{NAME} is taken on this bus", "The emulation needs a bus without a real BlueZ.")
        if self.adapter:
            await self._added(self.adapter, self._adapter_interfaces())

    async def stop(self, *, crash: bool = False) -> None:
        """Leave the bus; in a crash without notice, as a killed bluetoothd does."""
        if self._bus is None:
            return
        for task in [*self._tasks, *([self._advertiser] if self._advertiser else [])]:
            task.cancel()
        if not crash:
            for peripheral in list(self._peripherals.values()):
                await self.forget(peripheral)
            if self.adapter:
                await self._removed(self.adapter, self._adapter_interfaces())
        for end in self._sockets.values():
            end.close()
        self._bus.disconnect()
        self._bus = None

    def add(self, peripheral: Peripheral) -> None:
        """Bring a peripheral into range."""
        self._peripherals[peripheral.path(self.adapter)] = peripheral

    async def lose(self, peripheral: Peripheral, *, advertising: bool = False) -> None:
        """Break the link, as out of range or with an empty battery. BlueZ keeps its objects."""
        peripheral.advertising = advertising
        if peripheral.connected:
            await self._link_lost(peripheral)

    async def forget(self, peripheral: Peripheral) -> None:
        """Drop BlueZ's objects of a peripheral, as it does some time after the last advertisement."""
        if peripheral.connected:
            await self._link_lost(peripheral)
        if peripheral.discovered:
            peripheral.discovered = False
            path = peripheral.path(self.adapter)
            if peripheral.explored:
                peripheral.explored = False
                for below, interfaces in reversed([*peripheral.attributes(self.adapter).items()]):
                    await self._removed(below, interfaces)
            await self._removed(path, peripheral.device(self.adapter))

    async def power(self, on: bool) -> None:
        """Switch the adapter on or off; off breaks every link."""
        self.powered = on
        if not on:
            for peripheral in self._peripherals.values():
                if peripheral.connected:
                    await self._link_lost(peripheral)
        await self._changed(self.adapter, ADAPTER, {"Powered": Variant("b", on)})

    async def notify(self, peripheral: Peripheral, payloads: Iterable[bytes]) -> int:
        """Send notifications to subscribers; return their number."""
        path = peripheral.notify_path(self.adapter)
        sent = 0
        for payload in payloads:
            if not peripheral.notifying:
                break
            data = payload[: peripheral.room_bytes]
            end = self._sockets.get(path)
            if end is None:
                await self._changed(path, CHARACTERISTIC, {"Value": Variant("ay", data)})
            else:
                with suppress(BlockingIOError):  # a reader that is too slow misses it, as with BlueZ
                    end.send(data)
            sent += 1
        return sent

    # D-Bus

    def _handle(self, message: Message) -> Message | bool | None:
        if message.message_type is MessageType.SIGNAL:
            if message.member == "NameOwnerChanged" and message.body[2] == "":
                self._client_gone(message.body[0])
            return None
        if message.message_type is not MessageType.METHOD_CALL:
            return None
        call = f"{message.interface}.{message.member}"
        path = message.path or ""
        if call == f"{OBJECT_MANAGER}.GetManagedObjects":
            return Message.new_method_return(message, "a{oa{sa{sv}}}", [self._objects()])
        if path == self.adapter and message.interface == ADAPTER:
            return self._adapter_call(message)
        for device_path, peripheral in self._peripherals.items():
            if peripheral.discovered and path.startswith(device_path):
                handler = self._calls().get(call)
                if handler is not None:
                    self._spawn(handler(message, peripheral))
                    return True
        return Message.new_error(message, ErrorType.UNKNOWN_OBJECT, f"no {call} at {path}")

    def _calls(self) -> dict[str, Callable[[Message, Peripheral], Awaitable[None]]]:
        return {
            f"{DEVICE}.Connect": self._connect,
            f"{DEVICE}.Disconnect": self._disconnect,
            f"{CHARACTERISTIC}.StartNotify": self._start_notify,
            f"{CHARACTERISTIC}.StopNotify": self._stop_notify,
            f"{CHARACTERISTIC}.AcquireNotify": self._acquire_notify,
            f"{CHARACTERISTIC}.WriteValue": self._write,
        }

    def _adapter_call(self, message: Message) -> Message:
        client = message.sender or ""
        if not self.powered:
            return Message.new_error(message, "org.bluez.Error.NotReady", "Resource Not Ready")
        if message.member == "StartDiscovery":
            if client in self._discovering:
                return Message.new_error(message, "org.bluez.Error.InProgress", "Operation already in progress")
            self._discovering.add(client)
            if self._advertiser is None or self._advertiser.done():
                self._advertiser = asyncio.get_running_loop().create_task(self._advertise())
        elif message.member == "StopDiscovery":
            if client not in self._discovering:
                return Message.new_error(message, "org.bluez.Error.Failed", "No discovery started")
            self._discovering.discard(client)
        return Message.new_method_return(message)

    async def _advertise(self) -> None:
        while self._discovering and self.powered:
            for path, peripheral in list(self._peripherals.items()):
                if not peripheral.advertising or peripheral.connected:
                    continue
                if not peripheral.discovered:
                    peripheral.discovered = True
                    await self._added(path, peripheral.device(self.adapter))
                else:
                    await self._changed(path, DEVICE, {"RSSI": Variant("n", peripheral.rssi_dbm)})
            await asyncio.sleep(self._interval_s)

    async def _connect(self, message: Message, peripheral: Peripheral) -> None:
        if peripheral.failures:
            self._send(Message.new_error(message, *peripheral.failures.pop(0)))
            return
        if not peripheral.advertising:
            self._send(Message.new_error(message, "org.bluez.Error.Failed", "Connection Timeout"))
            return
        path = peripheral.path(self.adapter)
        peripheral.connected = True
        await self._changed(path, DEVICE, {"Connected": Variant("b", True)})
        self._send(Message.new_method_return(message))
        if peripheral.paired and not peripheral.has_key:  # encryption fails, and the link ends
            await self._link_lost(peripheral)
            return
        if not peripheral.explored:
            for below, interfaces in peripheral.attributes(self.adapter).items():
                await self._added(below, interfaces)
        elif peripheral.mtu is not None:
            for below, interfaces in peripheral.attributes(self.adapter).items():
                if CHARACTERISTIC in interfaces:
                    await self._changed(below, CHARACTERISTIC, {"MTU": Variant("q", peripheral.mtu)})
        peripheral.explored = peripheral.resolved = True
        await self._changed(path, DEVICE, {"ServicesResolved": Variant("b", True)})

    async def _disconnect(self, message: Message, peripheral: Peripheral) -> None:
        path = peripheral.path(self.adapter)
        was_connected, peripheral.connected, peripheral.resolved = peripheral.connected, False, False
        self._unsubscribe(peripheral)
        if was_connected:
            await self._changed(path, DEVICE, {"ServicesResolved": Variant("b", False)})
        self._send(Message.new_method_return(message))
        if was_connected:
            await self._changed(path, DEVICE, {"Connected": Variant("b", False)})

    async def _link_lost(self, peripheral: Peripheral) -> None:
        peripheral.connected = peripheral.resolved = False
        down = {"ServicesResolved": Variant("b", False), "Connected": Variant("b", False)}
        self._unsubscribe(peripheral)
        await self._changed(peripheral.path(self.adapter), DEVICE, down)
        if path := peripheral.notify_path(self.adapter):
            await self._changed(path, CHARACTERISTIC, {"Notifying": Variant("b", False)})

    async def _is_encrypted(self, message: Message, peripheral: Peripheral) -> bool:
        """Return whether the link is as secure as the peripheral demands; BlueZ asks its agent to pair for that."""
        if not peripheral.demands_pairing or peripheral.paired:
            return True
        if peripheral.agent_pairs:
            peripheral.paired = peripheral.has_key = True
            await self._changed(peripheral.path(self.adapter), DEVICE, {"Paired": Variant("b", True)})
            return True
        self._send(Message.new_error(message, "org.bluez.Error.NotPermitted", "Not paired"))
        return False

    async def _start_notify(self, message: Message, peripheral: Peripheral) -> None:
        if not await self._is_encrypted(message, peripheral):
            return
        self._subscribers.setdefault(message.path or "", set()).add(message.sender or "")
        await self._changed(message.path or "", CHARACTERISTIC, {"Notifying": Variant("b", True)})
        self._send(Message.new_method_return(message))
        self._set_notifying(peripheral, True)

    async def _stop_notify(self, message: Message, peripheral: Peripheral) -> None:
        self._unsubscribe(peripheral)
        self._send(Message.new_method_return(message))

    async def _acquire_notify(self, message: Message, peripheral: Peripheral) -> None:
        if not await self._is_encrypted(message, peripheral):
            return
        self._subscribers.setdefault(message.path or "", set()).add(message.sender or "")
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        self._sockets[message.path or ""] = ours
        with theirs:
            mtu = peripheral.mtu or 517
            reply = Message.new_method_return(message, "hq", [0, mtu], unix_fds=[theirs.fileno()])
            assert self._bus is not None
            await self._bus.send(reply)
        self._set_notifying(peripheral, True)

    async def _write(self, message: Message, peripheral: Peripheral) -> None:
        if peripheral.on_write is not None:
            peripheral.on_write(bytes(message.body[0]))
        self._send(Message.new_method_return(message))

    # bookkeeping

    def _set_notifying(self, peripheral: Peripheral, notifying: bool) -> None:
        if peripheral.notifying != notifying:
            peripheral.notifying = notifying
            if peripheral.on_notifying is not None:
                peripheral.on_notifying(notifying)

    def _unsubscribe(self, peripheral: Peripheral) -> None:
        path = peripheral.notify_path(self.adapter)
        self._subscribers.pop(path, None)
        end = self._sockets.pop(path, None)
        if end is not None:
            end.close()
        self._set_notifying(peripheral, False)

    def _client_gone(self, client: str) -> None:
        self._discovering.discard(client)
        for peripheral in self._peripherals.values():
            subscribers = self._subscribers.get(peripheral.notify_path(self.adapter), set())
            if client in subscribers:
                subscribers.discard(client)
                if not subscribers:
                    self._unsubscribe(peripheral)

    def _adapter_interfaces(self) -> Interfaces:
        powered, roles = Variant("b", self.powered), Variant("as", ["central", "peripheral"])
        address = Variant("s", "00:00:5E:00:53:00")
        return {ADAPTER: {"Address": address, "Powered": powered, "Roles": roles}}

    def _objects(self) -> dict[str, Interfaces]:
        objects = {self.adapter: self._adapter_interfaces()} if self.adapter else {}
        for path, peripheral in self._peripherals.items():
            if peripheral.discovered:
                objects[path] = peripheral.device(self.adapter)
                if peripheral.explored:
                    objects |= peripheral.attributes(self.adapter)
        return objects

    def _spawn(self, work: Any) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _added(self, path: str, interfaces: Interfaces) -> None:
        await self._signal("/", OBJECT_MANAGER, "InterfacesAdded", "oa{sa{sv}}", [path, interfaces])

    async def _removed(self, path: str, interfaces: Interfaces) -> None:
        await self._signal("/", OBJECT_MANAGER, "InterfacesRemoved", "oas", [path, list(interfaces)])

    async def _changed(self, path: str, interface: str, values: dict[str, Variant]) -> None:
        await self._signal(path, PROPERTIES, "PropertiesChanged", "sa{sv}as", [interface, values, []])

    async def _signal(self, path: str, interface: str, member: str, signature: str, body: list[Any]) -> None:
        self._send(Message.new_signal(path, interface, member, signature, body))
        self._sent += 1
        if self._sent % _BURST == 0:
            await self._ask("GetId")

    async def _ask(self, member: str, signature: str = "", body: list[Any] | None = None) -> None:
        """Call the daemon itself; its reply confirms that all earlier messages have arrived."""
        assert self._bus is not None
        await self._bus.call(Message(BUS, "/org/freedesktop/DBus", BUS, member, signature=signature, body=body or []))

    def _send(self, message: Message) -> None:
        if self._bus is not None and self._bus.connected:
            self._bus.send(message)
