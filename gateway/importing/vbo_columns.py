"""Reader of VBO files of RaceLogic, by the public description of their sections; run by `reader_process`."""

import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.column_names import unit_of
from gateway.importing.columns import number_table
from gateway.importing.waveform_columns import Waveform, WaveformColumns

_SECTION: Final = re.compile(r"\[(.+)\]\s*")
_CREATED: Final = re.compile(r"File created on (\d{1,2})/(\d{1,2})/(\d{4})", re.IGNORECASE)
_VELOCITY: Final = re.compile(r"velocity\s+(kmh|km/h|knots|mph|m/s)", re.IGNORECASE)
_KNOT_KMH: Final = 1.852
_DAY_S: Final = 86400.0


class VboColumns(WaveformColumns):
    """Columns of the section `data` by their short names; `time` counts from midnight UTC."""

    def __init__(self, path: Path) -> None:
        """Read the file.

        Raises:
            ImportDataError: it lacks names or data, or a line is no row of numbers.
        """
        super().__init__(path)
        sections: dict[str, list[tuple[int, str]]] = {"": []}
        section = ""
        content = path.read_text(encoding="utf-8", errors="replace")
        for number, line in enumerate(content.splitlines(), 1):
            match = _SECTION.fullmatch(line.strip())
            if match is not None:
                section = match[1].strip().lower()
                sections[section] = []
            elif line.strip() or section == "channel units":
                sections[section].append((number, line.strip()))
        if not sections.get("column names") or not sections.get("data"):
            raise ImportDataError(f"{path} has no [column names] with [data]", "Save it again with VBOX Tools.")
        names = sections["column names"][0][1].split()
        rows = sections["data"]
        if len(rows) > 1 and (len(rows[-1][1].split()) < len(names) or not content.endswith("\n")):
            self.warnings.append(f"the file is cut in line {rows[-1][0]}, which is left out")
            rows = rows[:-1]
        table = number_table(path, rows, len(names))
        titles = [text for _, text in sections.get("header", [])]
        units = [text for _, text in sections.get("channel units", [])]
        # A blank line parts the sections.
        units = units[:-1] if units and not units[-1] else units
        self._date = next((match for _, line in sections[""] if (match := _CREATED.search(line))), None)
        # Units are listed for the last channels only: the first are the standard ones.
        unit_map = dict(zip(names[len(names) - len(units) :], units, strict=False)) if len(units) <= len(names) else {}
        for k, name in enumerate(names):
            self._add(name, titles[k] if k < len(titles) else name, table[:, k], unit_map.get(name, ""))

    def _add(self, name: str, title: str, values: FloatArray, unit: str) -> None:
        if name.lower() == "time":
            hours, minutes, seconds = values // 10000, values // 100 % 100, values % 100
            values, unit = hours * 3600 + minutes * 60 + seconds, "s"
            # The clock starts again at midnight.
            values = values + _DAY_S * np.cumsum(np.diff(values, prepend=values[0]) < -0.5 * _DAY_S)
            if self._date is not None and np.isfinite(values[0]):
                day, month, year = (int(part) for part in self._date.groups())
                midnight_ns = int(datetime(year, month, day, tzinfo=UTC).timestamp()) * 1_000_000_000
                self.start_ns = midnight_ns + round(float(values[0]) * 1e9)
        elif match := _VELOCITY.fullmatch(title):
            unit = {"kmh": "km/h", "knots": "km/h"}.get(match[1].lower(), match[1].lower())
            values = values * _KNOT_KMH if match[1].lower() == "knots" else values
        self.waveforms[name] = Waveform.of(values, unit or unit_of(title, ""))
