"""The reference collector as a program of this computer."""

import subprocess
from pathlib import Path

from gateway.errors import SourceError


class HostCollector:
    """A collector that runs from power-on through the records that it is given, and ends.

    The same records give the same bytes.
    """

    def __init__(self, program: Path) -> None:
        """Take the program of `firmware_build.build_host`."""
        self._program = program

    def run(self, records: bytes) -> bytes:
        """Return the bytes of the link.

        Raises:
            SourceError: the program failed, for example because a sanitizer found an error.
        """
        done = subprocess.run([self._program], input=records, capture_output=True, check=False)
        if done.returncode != 0:
            raise SourceError(
                f"the collector failed: {done.stderr.decode(errors='replace')}", "Report this as a defect."
            )
        return done.stdout
