"""Tables for terminals of any width: nothing is cut off, and no line is too wide where words allow it."""

import pytest

from gateway.core.text.aligned_table import table_lines, wrapped
from gateway.core.text.text import width

ROWS = [
    ["FL", "before the change.mcap", "after.mcap", "difference", "in errors"],
    ["speed, mean and span", "40.9 mph, 18.6 to 62.1", "40.9 mph, 18.6 to 62.1", "", ""],
    ["belt radius", "320.0 ± 3.2 mm (stated)", "320.0 ± 3.2 mm (stated)", "", ""],
    ["tangential sidewall stiffness number (Ts)", "(2.837 ± 0.062)e-3", "2.60 ± 0.20", "(500 ± 41)e-6", "12.1 *"],
]


def words(text: str) -> list[str]:
    return sorted(text.split())


@pytest.mark.parametrize("columns", [80, 100, 120, 200])
def test_table_fits_the_terminal_and_keeps_every_word(columns):
    lines = list(table_lines(ROWS, columns))
    assert max(map(width, lines)) <= columns
    assert words(" ".join(lines)) == words(" ".join(cell for row in ROWS for cell in row))
    assert (len(lines) == len(ROWS)) == (columns >= 117)


def test_label_without_room_stands_above_its_cells():
    lines = list(table_lines([["tire", *["loss, kPa/month"] * 4], ["van 7 FL a1", *["-0.035 ± 0.045"] * 4]], 72))
    assert "van 7 FL a1" in lines
    assert lines[-1].split("  ")[1:] == ["-0.035 ± 0.045"] * 4


def test_long_line_is_broken_between_words_and_hangs():
    line = "  FR: no samples for 15 s, only other messages of its sensor"
    parts = wrapped(line, 30)
    assert parts[0] == "  FR: no samples for 15 s,"
    assert all(part.startswith("    ") for part in parts[1:])
    assert " ".join(part.strip() for part in parts) == line.strip()
