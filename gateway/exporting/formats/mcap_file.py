"""MCAP with a topic for every wheel and content, one JSON message a row, for Foxglove and PlotJuggler."""

import json
import math
from collections.abc import Iterator, Sequence
from typing import IO, Any, Final

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from gateway import __version__
from gateway.core.table_columns import Column
from gateway.core.text.recording_topics import wheel_topic
from gateway.exporting.export_table import Block, ExportWriter, Target, WheelTable, described, length

HOST_NS: Final = "host_ns"
"""Column with the time of a row, ns since the epoch."""
CONDITIONS_METADATA: Final = "treadlink.conditions"

_JSON_TYPES: Final = {float: "number", int: "integer", bool: "boolean", str: "string"}
_PATTERNS: Final = {float: "%.9g", int: "%d", bool: "%s", str: "%s"}
# Of no use in a plot against the log time; a message for every sample is large enough.
_LEFT_OUT: Final = frozenset({HOST_NS, "time_s", "device_s", "number", "segment"})
_TOPICS: Final = {"estimates": "revolution"}
# Foxglove reads chunk by chunk.
_CHUNK_BYTES: Final = 4 << 20


class _Counted:
    """Stream that counts what is written, since a pipe does not know its position."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._written = 0

    def write(self, data: bytes) -> int:
        self._written += len(data)
        return self._file.write(data)

    def tell(self) -> int:
        return self._written

    def flush(self) -> None:
        self._file.flush()


def topic(table: WheelTable) -> str:
    """Return the topic of a table, `/wheel/FL/samples`.

    That of estimates is the topic of a recording, so that one layout shows both.
    """
    return wheel_topic(table.wheel, _TOPICS.get(table.what, table.what))


def json_schema(table: WheelTable) -> dict[str, Any]:
    """Return the JSON schema of a table's messages; only plain types, as Foxglove demands."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"treadlink.export.{table.what}",
        "type": "object",
        "properties": {
            column.name: {
                "type": _JSON_TYPES[column.kind],
                "description": f"{column.description} [{column.unit}]" if column.unit else column.description,
            }
            for column in table.columns
            if column.name not in _LEFT_OUT
        },
    }


class McapExport(ExportWriter):
    """Topics `/wheel/FL/samples`, compressed; the log time of a message is the time of its row on the host's clock.

    Unknown numbers are left out, since JSON has none. Numbers have nine digits, more than a sensor resolves.
    """

    def __init__(self, target: Target) -> None:
        """Take the open file."""
        self._writer = Writer(
            _Counted(target.file),  # type: ignore[arg-type]  # has the methods that Writer uses: write, tell, flush
            chunk_size=_CHUNK_BYTES,
            compression=CompressionType.ZSTD,
        )
        self._channels: dict[str, int] = {}
        self._sequences: dict[str, int] = {}

    def begin(self, tables: Sequence[WheelTable]) -> None:
        """Write header, schemas, channels and conditions."""
        self._writer.start("treadlink.export", f"treadlink {__version__}")
        schemas: dict[str, int] = {}
        for table in tables:
            if table.what not in schemas:
                schema = json_schema(table)
                data = json.dumps(schema, separators=(",", ":")).encode()
                schemas[table.what] = self._writer.register_schema(schema["title"], "jsonschema", data)
            self._channels[topic(table)] = self._writer.register_channel(topic(table), "json", schemas[table.what])
            self._sequences[topic(table)] = 0
        for wheel, conditions in described(tables).items():
            texts = {name: json.dumps(entry) for name, entry in conditions.items()}
            self._writer.add_metadata(CONDITIONS_METADATA, {"wheel": wheel, **texts})

    def write(self, table: WheelTable, block: Block) -> None:
        """Append a message for each row."""
        name = topic(table)
        channel, sequence = self._channels[name], self._sequences[name]
        columns = [column for column in table.columns if column.name not in _LEFT_OUT]
        for host_ns, data in zip(block[HOST_NS].tolist(), _messages(columns, block), strict=True):
            self._writer.add_message(channel, host_ns, data, host_ns, sequence & 0xFFFFFFFF)
            sequence += 1
        self._sequences[name] = sequence

    def end(self) -> None:
        """Write index and footer."""
        self._writer.finish()  # type: ignore[no-untyped-call]


def _messages(columns: Sequence[Column], block: Block) -> Iterator[bytes]:
    """Yield the rows of a block as JSON objects."""
    complete = [c for c in columns if c.kind is not float or bool(np.isfinite(block[c.name]).all())]
    empty = [c for c in columns if c.kind is float and not bool(np.isfinite(block[c.name]).any())]
    partial = [column for column in columns if column not in complete and column not in empty]
    pattern = ",".join(f"{json.dumps(column.name)}:{_PATTERNS[column.kind]}" for column in complete)
    cells = [_cells(column, block[column.name]) for column in complete]
    rows = zip(*cells, strict=True) if cells else iter([()] * length(block))
    others = [(json.dumps(column.name), block[column.name].tolist()) for column in partial]
    for index, row in enumerate(rows):
        parts = [pattern % row] if complete else []
        parts += [f"{name}:{values[index]:.9g}" for name, values in others if math.isfinite(values[index])]
        yield f"{{{','.join(parts)}}}".encode()


def _cells(column: Column, values: NDArray[Any]) -> list[object]:
    if column.kind is str:
        return [json.dumps(str(text)) for text in values]
    if column.kind is bool:
        return ["true" if value else "false" for value in values.tolist()]
    return list(values.tolist())
