"""Reader of `sensor_msgs/Imu` messages of ROS 2 in MCAP files, run by `gateway.importing.reader_process`.

Layout by the public definition of the message in CDR: stamp, frame, then 37 doubles: orientation (4), covariance (9),
angular velocity (3), covariance (9), linear acceleration (3), covariance (9).
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.storable_text import storable
from gateway.core.types import FloatArray
from gateway.importing.columns import Block, FileFacts
from gateway.importing.waveform_columns import Waveform, WaveformColumns

_SCHEMAS: Final = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
_DOUBLES: Final = 37
_COLUMNS: Final = {
    **{f"linear_acceleration.{axis}": (25 + k, "m/s^2") for k, axis in enumerate("xyz")},
    **{f"angular_velocity.{axis}": (13 + k, "rad/s") for k, axis in enumerate("xyz")},
}


class ImuColumns(WaveformColumns):
    """Messages, loaded as a whole. Columns are `topic/linear_acceleration.z`; `topic/time` is that of their stamps.

    Where all stamps are one, it is that of logging.
    """

    def __init__(self, path: Path) -> None:
        """Read the messages.

        Raises:
            ImportDataError: there is no such message.
            Exception: of mcap, where the file is damaged.
        """
        from mcap.reader import make_reader

        super().__init__(path)
        times_ns: dict[str, list[int]] = {}
        logged_ns: dict[str, list[int]] = {}
        values: dict[str, list[FloatArray]] = {}
        other_types: set[str] = set()
        with path.open("rb") as file:
            for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
                if schema is None or schema.name not in _SCHEMAS or channel.message_encoding != "cdr":
                    other_types.add(schema.name if schema is not None else channel.topic)
                    continue
                stamp_ns, numbers = _message(message.data)
                times_ns.setdefault(channel.topic, []).append(stamp_ns)
                logged_ns.setdefault(channel.topic, []).append(message.log_time)
                values.setdefault(channel.topic, []).append(numbers)
        if not values:
            types_text = ", ".join(sorted(map(storable, other_types))[:8]) or "none"
            raise ImportDataError(f"{path} has no messages of {_SCHEMAS[0]}", f"Its messages are: {types_text}.")
        for topic, stamps in times_ns.items():
            if len(stamps) > 1 and min(stamps) == max(stamps):
                times_ns[topic] = logged_ns[topic]
                self.warnings.append(
                    f"all stamps of {storable(topic)} are {stamps[0]} ns: its times are those of logging"
                )
        self.start_ns = min(min(stamps) for stamps in times_ns.values())
        for topic, stamps in times_ns.items():
            self._add(storable(topic).strip("/"), np.array(stamps), np.array(values[topic]))

    @property
    def facts(self) -> FileFacts:
        """Every topic, with times of its own that count from the first stamp."""
        times = tuple(name for name, waveform in self.waveforms.items() if waveform.name == "time")
        return replace(super().facts, further_times=times)

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns.

        Raises:
            ImportDataError: they are of several topics whose times differ.
        """
        topics = {self.waveforms[name].group for name in names}
        times_columns = [self.waveforms[f"{topic}/time"] for topic in topics]
        stamps = [times.read(0, times.rows) for times in times_columns]
        if not all(np.array_equal(times, stamps[0]) for times in stamps):
            raise ImportDataError(
                f"{self.path}: the columns are of topics with times of their own: {', '.join(sorted(topics))}",
                "Import one topic after the other, each with a map of its own.",
            )
        yield from super().blocks(names)

    def _add(self, topic: str, stamps_ns: FloatArray, numbers: FloatArray) -> None:
        order = np.argsort(stamps_ns, kind="stable")
        times_s = (stamps_ns[order] - (self.start_ns or 0)) * 1e-9
        columns = {name: (numbers[order, index], unit) for name, (index, unit) in _COLUMNS.items()}
        for name, (column, unit) in {"time": (times_s, "s"), **columns}.items():
            waveform = Waveform.of(column, unit, topic, name)
            self.waveforms[f"{topic}/{name}"] = replace(waveform, start_s=float(times_s[0]))


def _message(data: bytes) -> tuple[int, FloatArray]:
    """Return the stamp in ns and the (37,) doubles of a message.

    Raises:
        ValueError: it is too short.
    """
    order = "<" if data[1] & 1 else ">"
    body = data[4:]
    seconds, nanoseconds, length = struct.unpack_from(f"{order}iII", body, 0)
    index = 12 + length
    index += -index % 8
    return seconds * 1_000_000_000 + nanoseconds, np.frombuffer(body, f"{order}f8", _DOUBLES, index)
