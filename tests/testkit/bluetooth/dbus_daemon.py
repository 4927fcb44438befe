"""A private, empty D-Bus run by the system's `dbus-daemon`, without root and without a system service."""

import contextlib
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final, Self

from gateway.core.errors import SourceError
from tests.testkit.child_process import HELPER

PROGRAM: Final = "dbus-daemon"
_STOP_TIMEOUT_S: Final = 5.0
# The limits of a system bus stay in force, so that overflows show here too.
_CONFIGURATION: Final = """\
<!DOCTYPE busconfig PUBLIC "-//freedesktop//DTD D-Bus Bus Configuration 1.0//EN"
 "http://www.freedesktop.org/standards/dbus/1.0/busconfig.dtd">
<busconfig>
  <type>system</type>
  <listen>unix:path={socket}</listen>
  <auth>EXTERNAL</auth>
  <policy context="default">
    <allow send_destination="*" eavesdrop="false"/>
    <allow receive_sender="*"/>
    <allow own="*"/>
    <allow user="*"/>
  </policy>
</busconfig>
"""


class PrivateBus:
    """A running `dbus-daemon`; it ends with `close`, or with the thread that started it.

    Attributes:
        address: for DBUS_SYSTEM_BUS_ADDRESS, the variable by which programs find the system's bus.
    """

    def __init__(self) -> None:
        """Start the daemon and wait until it listens.

        Raises:
            SourceError: the program is missing, or it does not start.
        """
        program = shutil.which(PROGRAM)
        if program is None:
            raise SourceError(f"{PROGRAM} is not installed", f"Run: sudo apt-get install {PROGRAM} (or your system's).")
        # The path of a socket is limited to 107 characters, so it cannot lie in a deep test directory.
        self._folder = Path(tempfile.mkdtemp(prefix="treadlink-bus-"))
        configuration = self._folder / "bus.conf"
        configuration.write_text(_CONFIGURATION.format(socket=self._folder / "bus"), "utf-8")
        self._process = subprocess.Popen(
            [program, f"--config-file={configuration}", "--nofork", "--nopidfile", "--nosyslog", "--print-address=1"],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            **HELPER,
        )
        assert self._process.stdout is not None
        self.address = self._process.stdout.readline().strip()
        if not self.address:
            self.close()
            raise SourceError(f"{PROGRAM} does not start", "To see the error, run: dbus-daemon --session --nofork")

    def close(self) -> None:
        """End the daemon and remove its files. May be called twice."""
        if self._process.poll() is None:
            self._process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_STOP_TIMEOUT_S)
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
