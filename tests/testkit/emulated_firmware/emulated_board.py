"""The reference collector on a board that QEMU emulates, its link on a TCP port of this computer."""

from __future__ import annotations

import socket
import subprocess
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from gateway.core.errors import LinkLostError, SourceError
from tests.testkit.child_process import HELPER
from tests.testkit.emulated_firmware.bench_records import MOST_WHEELS, HubData, WheelData, provisioning

_READY: Final = b"R"
_TIMEOUT_S: Final = 20.0
# QEMU hands over the bytes of a line one at a time, unless the line is a "mux", which has a buffer. A mux takes this
# byte as the begin of a command to QEMU, and two of them as the byte itself.
_ESCAPE: Final = b"\x01"
# Small, so that a slow board holds up its sensors, and the lag is seen.
_BUFFER_BYTES: Final = 8192


class EmulatedBoard:
    """A running QEMU with the collector; use it as a context.

    Attributes:
        address: host and port of the link, for `tcp://`.
    """

    def __init__(self, image: Path) -> None:
        """Start QEMU with the image and wait until it runs.

        Raises:
            SourceError: it does not.
        """
        self._stack = ExitStack()
        try:
            self._start(image)
        except BaseException:
            self._stack.close()
            raise

    def _start(self, image: Path) -> None:
        self.address = f"127.0.0.1:{_free_port()}"
        command = ["qemu-system-arm", "-M", "mps2-an386", "-display", "none", "-monitor", "none", "-nodefaults"]
        command += ["-kernel", str(image)]
        command += ["-chardev", f"socket,id=link,host=127.0.0.1,port={self.address.split(':')[1]},server=on,wait=off"]
        command += ["-serial", "chardev:link"]
        self._sensors = []
        with ExitStack() as ends:
            descriptors = []
            for number in range(MOST_WHEELS):
                sensor_socket, board_socket = socket.socketpair()
                self._sensors.append(self._stack.enter_context(sensor_socket))
                sensor_socket.settimeout(_TIMEOUT_S)
                sensor_socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
                descriptors.append(ends.enter_context(board_socket).fileno())
                command += ["-chardev", f"socket,id=sensor{number},fd={descriptors[-1]},mux=on"]
                command += ["-serial", f"chardev:sensor{number}"]
            self._process = self._stack.enter_context(
                subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    pass_fds=descriptors,
                    **HELPER,
                )
            )
        self._stack.callback(self._process.kill)
        self.wait_for_starts(1)

    def __enter__(self) -> EmulatedBoard:
        """Return the board."""
        return self

    def __exit__(self, *_: object) -> None:
        """Stop QEMU."""
        self._stack.close()

    def provision(self, hub: HubData, wheels: list[WheelData]) -> None:
        """Give the collector its configuration and keys, and wait until it has restarted."""
        self.send(0, provisioning(hub, wheels))
        self.wait_for_starts(1)

    def send(self, wheel_index: int, data: bytes) -> None:
        """Send records on the line of a wheel's sensor.

        Raises:
            LinkLostError: QEMU has ended, or does not take them.
        """
        try:
            self._sensors[wheel_index].sendall(data.replace(_ESCAPE, _ESCAPE * 2))
        except OSError as error:
            raise LinkLostError("the emulated board has stopped") from error

    def wait_for_starts(self, number: int) -> None:
        """Wait until the collector has started that many times.

        Raises:
            SourceError: it does not.
        """
        for _ in range(number):
            try:
                heard = self._sensors[0].recv(1)
            except TimeoutError:
                heard = b""
            if heard != _READY:
                raise SourceError("the collector on the emulated board does not start", "Report this as a defect.")


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port: int = probe.getsockname()[1]
    return port
