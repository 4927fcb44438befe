"""Shared data of the import tests: maps, files of each format, and samples read back from recordings."""

from pathlib import Path
from typing import Any

import numpy as np

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Environment, Frame, Hello, SampleBlock
from gateway.core.links.source import Chunk
from gateway.core.recording.reader import RecordingReader
from gateway.core.types import FloatArray


def waveform(samples: int, seed: int = 1) -> FloatArray:
    """Return (samples, 3) values with a different range for each axis."""
    return np.random.default_rng(seed).normal(size=(samples, 3)) * np.array([3.0, 0.2, 150.0])


def write_csv(path: Path, columns: dict[str, FloatArray], delimiter: str = ",", decimal: str = ".") -> Path:
    lines = [delimiter.join(columns)]
    rows = zip(*columns.values(), strict=True)
    lines += [delimiter.join(repr(float(cell)).replace(".", decimal) for cell in row) for row in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def simple_map(**sections: str) -> str:
    """Return a map of columns x, y, z in g at 10 kHz; a given section replaces the default."""
    default = {
        "file": "",
        "sampling": "rate_hz = 10000",
        "axis.circumferential": 'column = "x"\nunit = "g"',
        "axis.lateral": 'column = "y"\nunit = "g"',
        "axis.radial": 'column = "z"\nunit = "g"',
        "sensor": 'coupling = "DC"',
        "conditions": "radius_mm = 300",
    }
    return "\n".join(f"[{name}]\n{text}" for name, text in {**default, **sections}.items() if text)


class Decoded:
    """Recording decoded by the real decoder.

    Attributes:
        items: everything in the recording.
        frames: every frame.
        hello: the first hello.
        samples_mps2: (n, channels) all samples in order.
    """

    def __init__(self, path: Path) -> None:
        reader = RecordingReader(path)
        self.vehicle_toml = reader.info.vehicle_toml
        self.items = list(reader.items())
        decoder = FrameDecoder()
        self.frames: list[Frame] = []
        for item in self.items:
            if isinstance(item, Chunk):
                self.frames += decoder.feed(item.data)
        decoder.finish()
        self.counters: Any = decoder.counters
        self.hello = next(frame.message for frame in self.frames if isinstance(frame.message, Hello))
        self.blocks = [frame for frame in self.frames if isinstance(frame.message, SampleBlock)]
        axes = [axis for axis in range(3) if self.hello.axes >> axis & 1]
        scale = np.array([self.hello.scale_mps2[axis] for axis in axes])
        counts = [block.message.counts for block in self.blocks if isinstance(block.message, SampleBlock)]
        self.counts = np.concatenate(counts)
        self.samples_mps2 = self.counts * scale

    @property
    def environments(self) -> list[Environment]:
        return [frame.message for frame in self.frames if isinstance(frame.message, Environment)]
