"""BlueZ emulation in its own thread, for programs without an event loop."""

import asyncio
import threading
from collections.abc import Coroutine
from typing import Any, Final, Self, TypeVar

from tests.testkit.bluetooth.bluez_service import BluezService
from tests.testkit.bluetooth.peripheral import Peripheral

_T = TypeVar("_T")
_TIMEOUT_S: Final = 30.0


class BluezStandIn:
    """A `BluezService` and its thread; every method may be called from any other thread.

    Attributes:
        service: the service, to be used through `run` only.
    """

    def __init__(self, address: str, *, adapter: str | None = "hci0", advertising_interval_s: float = 0.1) -> None:
        """Start the service on the bus at `address`; the arguments are those of `BluezService`.

        Raises:
            SourceError: a real BlueZ is there.
        """
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="bluez stand-in", daemon=True)
        self._thread.start()
        self.service = BluezService(address, adapter=adapter, advertising_interval_s=advertising_interval_s)
        self._closed = False
        self.run(self.service.start())

    def run(self, work: Coroutine[Any, Any, _T]) -> _T:
        """Run a coroutine of the service and return its result."""
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(_TIMEOUT_S)

    def add(self, peripheral: Peripheral) -> Peripheral:
        """Bring a peripheral into range and return it."""

        async def add() -> Peripheral:
            self.service.add(peripheral)
            return peripheral

        return self.run(add())

    def close(self, *, crash: bool = False) -> None:
        """Leave the bus, in a crash without notice. May be called twice."""
        if self._closed:
            return
        self._closed = True
        self.run(self.service.stop(crash=crash))
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(_TIMEOUT_S)
        self._loop.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
