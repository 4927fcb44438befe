"""What the site adds to pages of docs/: tables from the code, and the command above the numbers that it prints.

`<!-- table: NAME -->` on a line stands for a table. A mark of figures (`tools.docs_outputs`) becomes its command.
"""

import re
from collections.abc import Callable
from typing import Final

from gateway.core.table_columns import (
    AVERAGE_COLUMNS,
    DIAGNOSIS_COLUMNS,
    FAILURE_COLUMNS,
    RECORDING_PARTS,
    SAMPLE_COLUMNS,
    Column,
    recording_columns,
    revolution_columns,
)
from tools.docs_outputs import all_marks, table_of_commands
from tools.docs_site.markdown import code, escaped, table

_MARK: Final = re.compile(r"^<!-- table: (.+) -->$", re.MULTILINE)
# A fenced block behind the mark shows its command itself.
_FIGURES: Final = re.compile(r"^<!-- figures(?:\(slow\))?: (.+) -->\n(?!```)", re.MULTILINE)


def _columns(columns: dict[str, Column]) -> str:
    rows = ((code(name), column.unit, escaped(column.description)) for name, column in columns.items())
    return "\n".join(table(("column", "unit", "content"), rows))


def _parts() -> str:
    rows = ((code(f"NAME{part}"), escaped(column.description)) for part, column in RECORDING_PARTS.items())
    return "\n".join(table(("column", "content"), rows))


TABLES: Final[dict[str, Callable[[], str]]] = {
    "recordings": lambda: _columns(recording_columns(())),
    "estimates of a recording": _parts,
    "revolutions": lambda: _columns(revolution_columns(())),
    "failures": lambda: _columns(FAILURE_COLUMNS),
    "diagnoses": lambda: _columns(DIAGNOSIS_COLUMNS),
    "samples": lambda: _columns(SAMPLE_COLUMNS),
    "average": lambda: _columns(AVERAGE_COLUMNS),
    "commands of figures": lambda: table_of_commands(all_marks()),
}


def filled(text: str) -> str:
    """Return a page with its tables and commands; KeyError for a name that is not in `TABLES`."""
    with_commands = _FIGURES.sub(lambda match: f"Printed by `{match[1]}`.\n\n", text)
    return _MARK.sub(lambda match: TABLES[match[1]](), with_commands)
