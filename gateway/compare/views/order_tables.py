"""Orders of wheels as terminal lines, CSV and JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import chain, repeat
from pathlib import Path
from typing import Final

import numpy as np

from gateway import __version__
from gateway.compare.order_statistics import BLOCK_REVOLUTIONS, OrderStatistics, SpeedBin
from gateway.compare.views.wheel_orders import WheelOrders
from gateway.core.constants import AXIS_NAMES
from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.text.aligned_table import WIDEST, table_lines
from gateway.core.text.numbers import MISSING, finite_or_none, fixed, round_to_error
from gateway.core.text.output_file import OutputFile, write_whole
from gateway.core.text.plain_values import plain
from gateway.core.text.table_sinks import Cell, CsvSink
from gateway.core.text.text import json_text
from gateway.core.text.wording import text
from gateway.core.types import FloatArray

# Share of the power of white noise on integer orders, for blocks of full length.
_NOISE_SHARE: Final = 1.0 / BLOCK_REVOLUTIONS

_COLUMNS: Final = (
    *("recording", "wheel", "speed_low_kmh", "speed_high_kmh", "revolutions", "order"),
    *(f"{name}_mps2" for name in AXIS_NAMES),
    *(f"{name}_repeated_mps2" for name in AXIS_NAMES),
)


def order_lines(wheel: WheelOrders, orders: int, columns: int = WIDEST) -> Iterator[str]:
    """Yield the orders of a wheel for a terminal of some columns: shares, then the amplitudes up to an order."""
    statistics = wheel.statistics
    speeds = wheel.speeds_text(1, *statistics.omega_range_radps)
    left_out = f", {wheel.rejected} with faults left out" if wheel.rejected else ""
    yield f"{wheel.wheel}  {statistics.revolutions} revolutions at {speeds}{left_out}"
    for doubt in wheel.doubts:
        yield f"  {text(doubt)}"
    shares = [
        [f"{'':{indent}}{label}", *cells]
        for indent, (label, cells) in zip(chain((2, 2), repeat(4)), share_rows(wheel), strict=False)
    ]
    yield from table_lines([["", *AXIS_NAMES], *shares], columns)
    yield "  amplitude in m/s^2, rms over the revolutions (the part that repeats):"
    amplitudes = [[f"  {label}", *cells] for label, cells in amplitude_rows(wheel, orders)]
    yield from table_lines([["", *AXIS_NAMES], *amplitudes], columns)
    radial, speed = wheel.mean.radial, wheel.speeds_text(1, wheel.mean.omega_radps)
    yield (
        f"  radial average at {speed} without gravity: rms {fixed(_rms(radial.radial_mps2), 2)}, scatter from "
        f"revolution to revolution {fixed(_rms(radial.scatter_mps2), 2)} m/s^2"
    )


def share_rows(wheel: WheelOrders) -> list[tuple[str, list[str]]]:
    """Return the shares of the power on integer orders: of all revolutions, of noise, of each range of speed."""
    noise = f"{100.0 * wheel.statistics.noise_share:.1f} %"
    measured = wheel.speeds_with_spectrum
    return [
        ("power on integer orders", share_texts(wheel.statistics)),
        ("(white noise alone)", [noise] * len(AXIS_NAMES)),
        *(
            (wheel.speeds_text(0, speeds.low_radps, speeds.high_radps), share_texts(speeds))
            for speeds in (measured if len(measured) > 1 else ())
        ),
    ]


def amplitude_rows(wheel: WheelOrders, orders: int) -> list[tuple[str, list[str]]]:
    """Return the amplitude of each order, and in brackets the part of it that repeats, up to an order."""
    statistics = wheel.statistics
    rows = []
    for order in range(min(orders, statistics.amplitude_mps2.shape[1] - 1) + 1):
        values = zip(
            statistics.amplitude_mps2[:, order].tolist(), statistics.repeated_mps2[:, order].tolist(), strict=True
        )
        cells = [f"{fixed(all_, 2)} ({fixed(part, 2)})" if math.isfinite(all_) else MISSING for all_, part in values]
        rows.append(("mean" if order == 0 else f"order {order}", cells))
    return rows


def share_texts(statistics: OrderStatistics | SpeedBin) -> list[str]:
    """Return the share of the power on integer orders of each axis, `99.21 ± 0.13 %`."""
    texts = []
    for share, std in zip(statistics.integer_share.tolist(), statistics.integer_share_std.tolist(), strict=True):
        number = round_to_error(100.0 * share, 100.0 * std) if math.isfinite(share) else None
        texts.append(MISSING if number is None else f"{number.joined()} %")
    return texts


def _rms(values: FloatArray) -> float:
    return math.sqrt(float(np.mean(np.square(values))))


def write_csv(path: Path, wheels: Sequence[WheelOrders], recording: str, *, force: bool = False) -> None:
    """Write the amplitudes of every order, for all speeds together and for each range of speed.

    Raises:
        OutputError: the file cannot be written.
    """
    with OutputFile(path, force=force) as output, output.explained():
        sink = CsvSink(output.file)
        sink.header(_COLUMNS)
        for wheel in wheels:
            for row in _rows(wheel):
                sink.row([recording, wheel.wheel, *row])
        sink.end()


def _rows(wheel: WheelOrders) -> Iterator[list[Cell]]:
    statistics = wheel.statistics
    for order in range(statistics.amplitude_mps2.shape[1]):
        yield [
            *wheel.speed_range_kmh,
            statistics.revolutions,
            order,
            *map(finite_or_none, statistics.amplitude_mps2[:, order].tolist()),
            *map(finite_or_none, statistics.repeated_mps2[:, order].tolist()),
        ]
    for speeds in statistics.speeds:
        for order in range(speeds.amplitude_mps2.shape[1]):
            yield [
                wheel.kmh(speeds.low_radps),
                wheel.kmh(speeds.high_radps),
                speeds.revolutions,
                order,
                *map(finite_or_none, speeds.amplitude_mps2[:, order].tolist()),
                *[None] * len(AXIS_NAMES),
            ]


def write_json(path: Path, wheels: Sequence[WheelOrders], recording: str, *, force: bool = False) -> None:
    """Write everything as one JSON object; what is not known is null.

    Raises:
        OutputError: the file cannot be written.
    """
    document = {
        "written_by": f"treadlink {__version__}",
        "recording": recording,
        "unit": "m/s^2",
        "noise_share": _NOISE_SHARE,
        "wheels": [_as_json(wheel) for wheel in wheels],
    }
    write_whole(path, json_text(plain(document)) + "\n", force=force)


def _as_json(wheel: WheelOrders) -> dict[str, object]:
    statistics, mean = wheel.statistics, wheel.mean
    return {
        "wheel": wheel.wheel,
        "revolutions": statistics.revolutions,
        "revolutions_with_faults": wheel.rejected,
        "speed_range_kmh": list(wheel.speed_range_kmh),
        "integer_share": _by_axis(statistics.integer_share),
        "integer_share_std": _by_axis(statistics.integer_share_std),
        "amplitude_mps2": _by_axis(statistics.amplitude_mps2),
        "repeated_mps2": _by_axis(statistics.repeated_mps2),
        "speeds": [
            {
                "low_kmh": wheel.kmh(speeds.low_radps),
                "high_kmh": wheel.kmh(speeds.high_radps),
                "revolutions": speeds.revolutions,
                "amplitude_mps2": _by_axis(speeds.amplitude_mps2),
                "fine_blocks": speeds.blocks,
                "fine_mps2": _by_axis(speeds.fine_mps2),
                "integer_share": _by_axis(speeds.integer_share),
                "integer_share_std": _by_axis(speeds.integer_share_std),
            }
            for speeds in statistics.speeds
        ],
        "noise_share": statistics.noise_share,
        "fine_blocks": statistics.blocks,
        "fine_block_revolutions": statistics.block_revolutions,
        "fine_order": statistics.fine_order,
        "fine_mps2": _by_axis(statistics.fine_mps2),
        "average": {
            "angle_rad": angle_grid(),
            "omega_radps": mean.omega_radps,
            "mean_mps2": _by_axis(mean.axes_mps2),
            "scatter_mps2": _by_axis(mean.axes_scatter_mps2),
            "normalised_mps2": mean.radial.radial_mps2,
            "normalised_scatter_mps2": mean.radial.scatter_mps2,
        },
    }


def _by_axis(values: FloatArray) -> dict[str, object]:
    return dict(zip(AXIS_NAMES, values, strict=True))
