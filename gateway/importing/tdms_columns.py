"""Reader of numeric channels in TDMS files of LabVIEW; needs the package npTDMS."""

from pathlib import Path
from typing import Any

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.waveform_columns import Waveform, WaveformColumns


class TdmsColumns(WaveformColumns):
    """TDMS file. Columns are channels as `group/channel`; scalings of the file are applied."""

    def __init__(self, path: Path) -> None:
        """List the channels.

        Raises:
            Exception: of npTDMS, where it is no TDMS file or damaged.
        """
        from nptdms import TdmsFile

        super().__init__(path)
        self._file: Any = TdmsFile.open(path)
        for group in self._file.groups():
            for channel in group.channels():
                self._add(f"{group.name}/{channel.name}", channel)

    def close(self) -> None:
        """Close the file."""
        self.waveforms.clear()
        self._file.close()

    def _add(self, name: str, channel: Any) -> None:
        kind = np.dtype(channel.dtype).kind
        if not len(channel):
            return
        if kind not in "iufb":
            what = {"M": "dates", "O": "text", "U": "text", "c": "complex numbers"}.get(
                kind, f"values of {channel.dtype}"
            )
            self.unusable[name] = (f"contains {what}", "Save its values as a channel of numbers.")
            return
        start = channel.properties.get("wf_start_time")
        if self.start_ns is None and isinstance(start, np.datetime64):
            # A waveform without a clock has the zero of LabVIEW, 1904.
            start_ns = int(start.astype("datetime64[ns]").astype(np.int64))
            self.start_ns = start_ns if start_ns > 0 else None
        self.waveforms[name] = Waveform(
            rows=len(channel),
            read=lambda first, end: self._values(name, channel, first, end),
            step_s=float(channel.properties.get("wf_increment", 0.0)),
            unit=str(channel.properties.get("unit_string", "")),
        )

    def _values(self, name: str, channel: Any, first: int, end: int) -> FloatArray:
        try:
            values: FloatArray = np.asarray(channel.read_data(first, end - first), dtype=np.float64)
        except (MemoryError, OSError):
            raise
        except Exception as error:  # npTDMS raises whatever a damaged file makes it stumble over
            raise ImportDataError(
                f"{self.path}: channel '{name}' is damaged: {error or type(error).__name__}", "Copy or write it again."
            ) from error
        return values
