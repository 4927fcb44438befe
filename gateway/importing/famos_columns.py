"""Reader of equidistant channels in imc FAMOS files of version 2 (.raw, .dat), by the public description of their keys.

A file is a row of keys `|XX,version,length,content;`. Those of a channel follow each other: `CD` has the step, `CP`
the number format, `Cb` the place in the data, `CR` factor, offset and unit, `CN` the name; `CS` holds data.
"""

import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.waveform_columns import Waveform, WaveformColumns

_KEY: Final = re.compile(rb"\|(C[A-Za-z]|N[A-Z]),(\d+),(\d+),")
_FORMATS: Final = {1: "u1", 2: "i1", 3: "u2", 4: "i2", 5: "u4", 6: "i4", 7: "f4", 8: "f8"}


class FamosColumns(WaveformColumns):
    """FAMOS file, loaded as a whole. Columns are channels by their names."""

    def __init__(self, path: Path) -> None:
        """Read the keys.

        Raises:
            ImportDataError: it is no FAMOS file or has no channel of equidistant values.
        """
        super().__init__(path)
        content = path.read_bytes()
        if not content.startswith(b"|CF,2"):
            raise ImportDataError(
                f"{path} is no FAMOS file of version 2", "Save it as FAMOS file, or export it as CSV."
            )
        order = ">" if re.match(rb"\|CF,2,1,2;", content) else "<"
        data: list[tuple[int, int, int]] = []
        channels: list[tuple[int, dict[str, list[str]]]] = []
        keys: dict[str, list[str]] = {}
        for name, begin, length in _keys(content):
            if name == "CS":
                comma = content.index(b",", begin)
                data.append((int(content[begin:comma]), comma + 1, begin + length))
                continue
            fields = content[begin : begin + length].decode("latin-1").split(",")
            if name == "CG":
                keys = {}
            keys[name] = fields
            if name == "NT" and self.start_ns is None:
                self.start_ns = _start_ns(fields)
            if name == "CN":
                channels.append((begin, dict(keys)))
        for position, channel in channels:
            # Data of one number may occur again behind each channel.
            closest = {number: (begin, end) for number, begin, end in reversed(data) if begin > position}
            self._add(channel, content, {number: (begin, end) for number, begin, end in data} | closest, order)
        if not self.waveforms and not self.unusable:
            raise ImportDataError(f"{path} has no channels", "Export the channels as CSV.")

    def _add(self, keys: dict[str, list[str]], content: bytes, data: dict[int, tuple[int, int]], order: str) -> None:
        name = _text(keys["CN"], 3) or f"channel {len(self.waveforms) + 1}"
        if name in self.waveforms:
            name = f"{name} (channel {len(self.waveforms) + 1})"
        try:
            components = int(keys.get("CG", ["1"])[0])
            size, kind = int(keys["CP"][1]), int(keys["CP"][2])
            index, offset, length = int(keys["Cb"][3]), int(keys["Cb"][4]), int(keys["Cb"][7])
            step_s = float(keys["CD"][0]) if keys["CD"][3].strip() in ("s", "") else 0.0
            begin, end = data[index]
            # Version 2 says whose start counts: 0 none, 1 that of the data, 2 that of the axis.
            usage = int(keys["CD"][8]) if len(keys["CD"]) > 8 else 1
            starts = keys["Cb"][9:10] if usage == 1 else keys["CD"][7:8] if usage == 2 else []
            start_s = float(starts[0]) if starts else 0.0
            scale = keys.get("CR", ["0", "1", "0", "0", "0", ""])
            factor, zero = (float(scale[1]), float(scale[2])) if scale[0].strip() == "1" else (1.0, 0.0)
        except (KeyError, IndexError, ValueError):
            self.unusable[name] = ("is described by keys that are not read", "Export it as CSV.")
            return
        format_code = _FORMATS.get(kind)
        if components != 1 or format_code is None or np.dtype(format_code).itemsize != size or not step_s > 0.0:
            self.unusable[name] = ("has no equidistant numbers", "Export it as CSV with its times.")
            return
        present = max(min(end, begin + offset + length) - begin - offset, 0) // size
        values = np.frombuffer(content, np.dtype(order + format_code), present, begin + offset)
        self.waveforms[name] = Waveform(
            rows=present,
            read=lambda first, last: _scaled(values[first:last], factor, zero),
            step_s=step_s,
            unit=_text(scale, 4),
            start_s=start_s,
            stated_rows=length // size,
        )


def _scaled(values: FloatArray, factor: float, zero: float) -> FloatArray:
    scaled: FloatArray = values.astype(np.float64) * factor + zero
    return scaled


def _keys(content: bytes) -> Iterator[tuple[str, int, int]]:
    """Yield name, position and length of the content of each key; a last one may be cut off."""
    position = 0
    while match := _KEY.search(content, position):
        begin, length = match.end(), int(match[3])
        yield match[1].decode(), begin, min(length, len(content) - begin)
        position = begin + length


def _text(fields: list[str], number: int) -> str:
    """Return a text whose length stands in a field before it."""
    try:
        length = int(fields[number])
    except (IndexError, ValueError):
        return ""
    return ",".join(fields[number + 1 :])[:length].strip()


def _start_ns(fields: list[str]) -> int | None:
    """Return day, month, year, hour, minute and second as ns since 1970, None where they are no date."""
    try:
        day, month, year, hour, minute = (int(text) for text in fields[:5])
        second = float(fields[5])
        start = datetime(year, month, day, hour, minute, tzinfo=UTC)
    except (ValueError, IndexError):
        return None
    return int(start.timestamp()) * 1_000_000_000 + round(second * 1e9) if year > 1980 else None
