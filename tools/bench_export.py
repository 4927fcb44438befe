"""Export of a simulated recording to every format, read back by other programs: agreement, size, time and memory.

    python tools/bench_export.py              # agreement: written by treadlink, read by others
    python tools/bench_export.py --cost       # size, time and memory against the length of the recording
    python tools/bench_export.py --keep DIR   # keeps the exported files

Agreement is the number of decimal digits to which the radial acceleration of every sample agrees with the recording;
`exact` means equal to the last bit.
"""

import argparse
import contextlib
import csv
import io
import itertools
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from firmware_protocol.decoder import FrameDecoder  # noqa: E402
from firmware_protocol.messages import Axis, Hello, SampleBlock  # noqa: E402
from gateway.core.cli import treadlink  # noqa: E402
from gateway.core.links.source import Chunk  # noqa: E402
from gateway.core.recording.reader import RecordingReader  # noqa: E402
from gateway.core.types import FloatArray  # noqa: E402
from gateway.exporting.export_registry import FORMATS  # noqa: E402
from gateway.exporting.recording_export import ExportRequest, export_recording  # noqa: E402

WHEEL, WHEEL_NUMBER = "FL", 0  # in the scenario `demo`
COLUMN = "radial_mps2"
_CHILD = """
import resource
import sys
from pathlib import Path
from gateway.exporting.recording_export import ExportRequest, export_recording
begin_s = resource.getrusage(resource.RUSAGE_SELF).ru_utime
request = ExportRequest([sys.argv[4]], sys.argv[3], ("kinematic", "weak-form"), ["FL"])
export_recording(Path(sys.argv[1]), Path(sys.argv[2]), request)
cpu_s = resource.getrusage(resource.RUSAGE_SELF).ru_utime - begin_s
# ru_maxrss would begin with the peak of the process that started this one.
print(int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]) / 1024.0, cpu_s)
"""


def simulated(folder: Path, duration_s: float) -> Path:
    path = folder / f"demo{duration_s:g}.mcap"
    words = ["simulate", "demo", "--duration", str(duration_s), "--out", str(path)]
    with contextlib.redirect_stdout(io.StringIO()):
        treadlink(words, standalone_mode=False)
    return path


def pandas_csv(path: Path) -> Any:
    import pandas

    frame = pandas.read_csv(path, comment="#")
    return frame[frame["wheel"] == WHEEL][COLUMN]


def polars_csv(path: Path) -> Any:
    import polars

    frame = polars.read_csv(path, comment_prefix="#")
    return frame.filter(polars.col("wheel") == WHEEL)[COLUMN].to_numpy()


def python_csv(path: Path) -> Any:
    with path.open(newline="", encoding="utf-8") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return [float(row[COLUMN]) for row in rows if row["wheel"] == WHEEL]


def pyarrow_parquet(path: Path) -> Any:
    import pyarrow.parquet

    return pyarrow.parquet.read_table(path, filters=[("wheel", "=", WHEEL)])[COLUMN].to_numpy()


def duckdb_parquet(path: Path) -> Any:
    import duckdb

    rows = duckdb.sql(f"select {COLUMN} from '{path}' where wheel = '{WHEEL}' order by number").fetchall()
    return [value for (value,) in rows]


def scipy_mat(path: Path) -> Any:
    import scipy.io

    return scipy.io.loadmat(path, simplify_cells=True)[WHEEL]["Data"][COLUMN]


def asammdf_mf4(path: Path) -> Any:
    import asammdf

    with asammdf.MDF(path) as mdf:
        return mdf.get(f"{WHEEL}.{COLUMN}").samples


def numpy_npz(path: Path) -> Any:
    with np.load(path) as archive:
        return archive[f"{WHEEL}/{COLUMN}"]


def numpy_tydex(path: Path) -> Any:
    lines = path.read_text("ascii").splitlines()
    channels = lines[lines.index("**MEASURCHANNELS") + 1 : lines.index("**MEASURDATA") - 1]
    key = next(line.split()[1].rstrip(":") for line in lines if line.endswith(f": {COLUMN}"))
    index = [line.split()[0] for line in channels].index(key)
    rows = lines[lines.index("**MEASURDATA") + 1 : lines.index("**END") - 1]
    return np.loadtxt(rows, usecols=index)


def mcap_reader(path: Path) -> Any:
    from mcap.reader import make_reader

    with path.open("rb") as file:
        messages = make_reader(file, validate_crcs=True).iter_messages([f"/wheel/{WHEEL}/samples"])
        return [json.loads(message.data)[COLUMN] for _, _, message in messages]


READERS: tuple[tuple[str, str, Callable[[Path], Any]], ...] = (
    ("csv", "csv", python_csv),
    ("csv", "pandas", pandas_csv),
    ("csv", "polars", polars_csv),
    ("parquet", "pyarrow", pyarrow_parquet),
    ("parquet", "duckdb", duckdb_parquet),
    ("mat", "scipy.io", scipy_mat),
    ("mf4", "asammdf", asammdf_mf4),
    ("npz", "numpy", numpy_npz),
    ("tydex", "numpy.loadtxt", numpy_tydex),
    ("mcap", "mcap", mcap_reader),
)


def agreement(result: Any, truth: FloatArray) -> str:
    """Return the number of equal digits of the worst sample, relative to the largest."""
    values = np.asarray(result, np.float64)
    if values.shape != truth.shape:
        return f"{len(values)} values instead of {len(truth)}"
    error = float(np.abs(values - truth).max())
    if error == 0.0:
        return "exact"
    return f"{math.floor(-math.log10(error / float(np.abs(truth).max())))} digits"


def sent_mps2(recording: Path) -> FloatArray:
    """Return the radial acceleration that the frames of the wheel state, by no code that feeds a writer."""
    decoder, parts, offset_counts, scale_mps2 = FrameDecoder(), [], math.nan, math.nan
    chunks = (item.data for item in RecordingReader(recording).items() if isinstance(item, Chunk))
    for frame in itertools.chain.from_iterable(map(decoder.feed, chunks)):
        if frame.wheel == WHEEL_NUMBER and isinstance(hello := frame.message, Hello):
            offset_counts, scale_mps2 = hello.offset_counts[Axis.RADIAL], hello.scale_mps2[Axis.RADIAL]
        elif frame.wheel == WHEEL_NUMBER and isinstance(block := frame.message, SampleBlock):
            parts.append((block.counts[:, Axis.RADIAL] - offset_counts) * scale_mps2)
    return np.concatenate(parts)


def compare(recording: Path, folder: Path) -> Iterator[str]:
    truth = sent_mps2(recording)
    yield f"| format | read by | samples of {WHEEL} | agreement |"
    yield "|---|---|---|---|"
    for name in FORMATS:
        path = folder / f"exported{FORMATS[name].suffixes[0]}"
        wheels = [WHEEL] if name == "tydex" else []
        export_recording(recording, path, ExportRequest(["samples"], name, wheels=wheels), force=True)
        for of, reader, read in READERS:
            if of == name:
                yield f"| {name} | {reader} | {len(truth)} | {agreement(read(path), truth)} |"


def costs(folder: Path, short_s: float, long_s: float) -> Iterator[str]:
    recordings = [simulated(folder, duration_s) for duration_s in (short_s, long_s)]
    sizes = [path.stat().st_size for path in recordings]
    yield f"recordings of {short_s:g} and {long_s:g} s, four wheels: {sizes[0] / 1e6:.1f} and {sizes[1] / 1e6:.1f} MB"
    yield ""
    yield f"| format | samples of {WHEEL}: MB | bytes a sample | CPU s | peak memory, MB | of {short_s:g} s, MB |"
    yield "|---|---|---|---|---|---|"
    samples = 9600.0 * long_s
    for name in FORMATS:
        results = []
        for recording in recordings:
            out = folder / f"{recording.stem}.out{FORMATS[name].suffixes[0]}"
            words = [sys.executable, "-c", _CHILD, str(recording), str(out), name, "samples"]
            done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=ROOT)
            results.append((out.stat().st_size, *map(float, done.stdout.split())))
            out.unlink()
        (_, short_mb, _), (size, long_mb, cpu_s) = results
        yield f"| {name} | {size / 1e6:.1f} | {size / samples:.1f} | {cpu_s:.1f} | {long_mb:.0f} | {short_mb:.0f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cost", action="store_true", help="size, time and memory")
    parser.add_argument("--keep", type=Path, help="folder for the files")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        lines = costs(folder, 20.0, 120.0) if options.cost else compare(simulated(folder, 5.0), folder)
        for line in lines:
            print(line, flush=True)


if __name__ == "__main__":
    main()
