"""What is said of damaged files of loggers and buses, as a table in Markdown.

    python -m tools.reliability.damage_table

Each good file is cut, blanked, swapped, doubled, moved to another zone of time or to another code page. A cell is the
message; or what is said of a file that is read in part; or `all` where every value is that of the good file; or
`SILENT` where values or their number differ and nothing is said.
"""

import re
import threading
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Hello, SampleBlock
from gateway.core.clock import ManualClock
from gateway.core.errors import TreadlinkError
from gateway.core.links.bus_frames import unpack
from gateway.core.links.source import BusFrames, Chunk, LinkEvent, open_source
from gateway.core.recording.reader import RecordingReader
from gateway.core.text import wording
from gateway.importing.import_map import parse_map
from gateway.importing.importer import import_file
from gateway.importing.map_guess import guess_map
from tools.reliability.logger_files import good_files, good_logs

SILENT: Final = "SILENT"
_TEXTS: Final = (".csv", ".vbo", ".log", ".asc", ".tdx", ".uff")
_SHOWN: Final = 90


def _cut(data: bytes) -> bytes:
    return data[: int(0.703 * len(data))]


def _blanked(data: bytes) -> bytes:
    """Return data with a stretch in the second half replaced: by blanks in text, else by zeros."""
    begin, end = int(0.6 * len(data)), int(0.62 * len(data))
    is_text = b"\n" in data[:64] or data.isascii()
    return data[:begin] + (b" " if is_text else b"\0") * (end - begin) + data[end:]


def _swapped(data: bytes) -> bytes:
    a, b, c = (int(share * len(data)) for share in (0.5, 0.6, 0.7))
    return data[:a] + data[b:c] + data[a:b] + data[c:]


def _doubled(data: bytes) -> bytes:
    a, b = int(0.5 * len(data)), int(0.6 * len(data))
    return data[:b] + data[a:b] + data[b:]


def _zone(data: bytes) -> bytes:
    """Return text whose second half states another zone of time, as behind a change of the clock."""
    half = len(data) // 2
    return data[:half] + data[half:].replace(b"+02:00", b"+01:00")


def _recoded(data: bytes) -> bytes:
    return data.decode("latin-1").encode("utf-16")


DAMAGES: Final[dict[str, Callable[[bytes], bytes]]] = {
    "cut": _cut, "blank": _blanked, "swapped": _swapped, "doubled": _doubled, "zone": _zone,
    "UTF-16": _recoded,
}  # fmt: skip


def verdicts() -> dict[str, dict[str, str]]:
    """Return what is said of each damage, by file."""
    table = {}
    for files, verdict in ((good_files(), _import_verdict), (good_logs(), _log_verdict)):
        for name, data in files.items():
            with TemporaryDirectory() as folder:
                table[name] = {
                    damage: verdict(name, data, change(data), Path(folder) / damage)
                    for damage, change in DAMAGES.items()
                    if (damage != "UTF-16" or name.endswith(_TEXTS)) and (damage != "zone" or b"+02:00" in data)
                }
    return table


def _import_verdict(name: str, good: bytes, damaged: bytes, folder: Path) -> str:
    expected, _ = _samples(name, good, folder / "good")
    try:
        values, said = _samples(name, damaged, folder / "damaged")
    except TreadlinkError as error:
        return _short(str(error))
    same = values.shape == expected.shape and np.allclose(values, expected, atol=0.5, equal_nan=True)
    return "all" if same else f"{len(values)} samples: {_short(said)}" if said else SILENT


def _samples(name: str, data: bytes, folder: Path) -> tuple[np.ndarray, str]:
    """Return the samples of a file in m/s^2, and what is said of it beyond what is said of every file."""
    folder.mkdir(parents=True)
    path = folder / name
    path.write_bytes(data)
    text = guess_map(path)
    report = import_file(path, parse_map(text, "map"), folder / "out.mcap")
    usual = ("belt radius", "error of the stated rate")
    said = [text for text in report.assumed if not text.startswith(usual)]
    said += [f"{report.left_out} samples are gaps"] * (report.left_out > 0)
    said += [f"{wheel.gaps} gaps" for wheel in report.wheels if wheel.gaps]
    said += [str(finding.code) for wheel in report.wheels for finding in wheel.findings]
    said += [
        line.split("#")[1].strip(" ?")
        for line in text.splitlines()
        if (line.startswith(("time_column", "# ?")) and "# ?" in line)
        or "not read: " in line
        or (line.startswith("rate_hz") and "; " in line)
    ]
    decoder = FrameDecoder()
    chunks = (item.data for item in RecordingReader(report.recording).items() if isinstance(item, Chunk))
    messages = [frame.message for chunk in chunks for frame in decoder.feed(chunk)]
    hello = next(message for message in messages if isinstance(message, Hello))
    scale = np.array([hello.scale_mps2[axis] for axis in range(3) if hello.axes >> axis & 1])
    counts = [message.counts for message in messages if isinstance(message, SampleBlock)]
    return np.concatenate(counts) * scale, "; ".join(said)


def _log_verdict(name: str, good: bytes, damaged: bytes, folder: Path) -> str:
    expected, _ = _frames(name, good, folder / "good")
    try:
        frames, said = _frames(name, damaged, folder / "damaged")
    except TreadlinkError as error:
        return _short(str(error))
    return "all" if frames == expected else f"{len(frames)} of {len(expected)}: {_short(said)}" if said else SILENT


def _frames(name: str, data: bytes, folder: Path) -> tuple[list[tuple[int, int, bytes]], str]:
    folder.mkdir(parents=True)
    path = folder / name
    path.write_bytes(data)
    items = list(open_source(f"can:{path}?speed=max", ManualClock()).items(threading.Event()))
    frames = [f for item in items if isinstance(item, BusFrames) for f in unpack(item.data, item.host_ns)]
    events = [item for item in items if isinstance(item, LinkEvent)]
    said = [event.text for event in events if event.text]
    said += [wording.text(reason) for event in events for reason in event.details]
    return [(frame.host_ns, frame.can_id, frame.data) for frame in frames], "; ".join(said)


def _short(text: str) -> str:
    line = " ".join(text.replace("|", "/").split())
    first = line.find(": ") if line.startswith("/") else -1
    line = line[first + 2 :] if first > 0 else line
    line = re.sub(r"/\S*/(damaged|good)/", "", line)
    return line if len(line) <= _SHOWN else line[: _SHOWN - 1] + "…"


def main() -> None:
    """Print the table."""
    print("| file | " + " | ".join(DAMAGES) + " |")
    print("|" + "---|" * (len(DAMAGES) + 1))
    for name, row in verdicts().items():
        print(f"| {name} | " + " | ".join(row.get(damage, "") for damage in DAMAGES) + " |")


if __name__ == "__main__":
    main()
