"""Reader of numeric channels in TDMS files of LabVIEW; needs the package npTDMS."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.storable_text import storable
from gateway.core.types import FloatArray
from gateway.importing.column_names import rate_of
from gateway.importing.header_conditions import conditions_in
from gateway.importing.waveform_columns import Waveform, WaveformColumns

_UNIT_KEYS: Final = ("unit_string", "Unit", "unit", "NI_UnitDescription")


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
        channels = [(group, channel) for group in self._file.groups() for channel in group.channels()]
        starts_ns = {id(channel): _start_ns(channel) for _, channel in channels}
        self.start_ns = min((start_ns for start_ns in starts_ns.values() if start_ns is not None), default=None)
        self.stated += conditions_in(self._file.properties, "file")
        for group in {group.name: group for group, _ in channels}.values():
            self.stated += conditions_in(group.properties, group.name)
        for group, channel in channels:
            start_ns = starts_ns[id(channel)]
            delay_s = 0.0 if start_ns is None or self.start_ns is None else (start_ns - self.start_ns) * 1e-9
            self._add(group.name, channel, delay_s)
            if not channel.properties.get("wf_increment"):
                self._note_rates(f"{group.name}/{channel.name}", channel.properties)
                self._note_rates(group.name, group.properties)
                self._note_rates("file", self._file.properties)

    def close(self) -> None:
        """Close the file."""
        self.waveforms.clear()
        self._file.close()

    def _add(self, group: str, channel: Any, delay_s: float) -> None:
        name, kind = f"{group}/{channel.name}", np.dtype(channel.dtype).kind
        if not len(channel):
            return
        if kind not in "iufb":
            content = {"M": "dates", "O": "text", "U": "text", "c": "complex numbers"}.get(
                kind, f"values of {channel.dtype}"
            )
            self.unusable[name] = (f"contains {content}", "Save its values as a channel of numbers.")
            return
        properties = channel.properties
        self.waveforms[name] = Waveform(
            rows=len(channel),
            read=lambda first, end: self._values(name, channel, first, end),
            step_s=float(properties.get("wf_increment", 0.0)),
            unit=str(next((properties[key] for key in _UNIT_KEYS if properties.get(key)), "")),
            start_s=delay_s + float(properties.get("wf_start_offset", 0.0)),
            group=group,
            name=channel.name,
        )

    def _note_rates(self, name: str, properties: Mapping[str, Any]) -> None:
        for key, value in properties.items():
            rate_hz = rate_of(key, value)
            if rate_hz is not None:
                self.rates_hz[f"{name}@{storable(key)}"] = rate_hz

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


def _start_ns(channel: Any) -> int | None:
    """Return the start of a channel in ns since 1970; a waveform without a clock has the zero of LabVIEW, 1904."""
    start = channel.properties.get("wf_start_time")
    if not isinstance(start, np.datetime64):
        return None
    start_ns = int(start.astype("datetime64[ns]").astype(np.int64))
    return start_ns if start_ns > 0 else None
