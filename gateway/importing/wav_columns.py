"""Reader of the channels in WAV files, by scipy, run by `gateway.importing.reader_process`."""

import io
import struct
from pathlib import Path
from typing import Final

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.waveform_columns import Waveform, WaveformColumns

_HEADER_BYTES: Final = 4096


class WavColumns(WaveformColumns):
    """Channels `channel 1`, ...: shares of the full range for whole numbers, else the values themselves."""

    def __init__(self, path: Path) -> None:
        """Map the samples into memory.

        Raises:
            ImportDataError: it is cut in the middle of a sample.
            Exception: of scipy, where it is no WAV file.
        """
        from scipy.io import wavfile

        super().__init__(path)
        try:
            rate_hz, samples = wavfile.read(_ended(path))
        except ValueError as error:
            if "reshape" not in str(error):
                raise
            raise ImportDataError(
                f"{path} is cut in the middle of a sample", "Copy it again, or cut it by whole samples with an editor."
            ) from error
        columns = samples.reshape(len(samples), -1)
        full = float(np.iinfo(samples.dtype).max) + 1.0 if samples.dtype.kind in "iu" else 1.0
        zero = 128.0 if samples.dtype == np.uint8 else 0.0
        for k in range(columns.shape[1]):
            self.waveforms[f"channel {k + 1}"] = _waveform(columns[:, k], full - zero, zero, rate_hz)


def _ended(path: Path) -> Path | io.BytesIO:
    """Return a file, with the size of its samples where it was written to a pipe, which leaves that open."""
    with path.open("rb") as file:
        start = file.read(_HEADER_BYTES)
    offset = start.find(b"data", 12) + 4
    if not start.startswith(b"RIFF") or start[offset : offset + 4] != b"\xff" * 4:
        return path
    content = path.read_bytes()
    return io.BytesIO(content[:offset] + struct.pack("<I", len(content) - offset - 4) + content[offset + 4 :])


def _waveform(values: FloatArray, full: float, zero: float, rate_hz: float) -> Waveform:
    return Waveform(len(values), lambda first, end: (values[first:end] - zero) / full, 1.0 / rate_hz)
