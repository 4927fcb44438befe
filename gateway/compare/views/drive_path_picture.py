"""Picture of the path of a car, from above: the line, ellipses of its error, and positions of a receiver."""

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from gateway.compare.views.drive_path import CarPath, WheelPath, car_path
from gateway.core.text.numbers import fixed
from gateway.core.text.text import clean
from gateway.core.types import FloatArray

_ELLIPSES: Final = 10
# Room about the path, over its size.
_MARGIN: Final = 0.05
_DOT: Final = 0.008


class Ellipse(NamedTuple):
    """One standard error of a place; y downward, as pictures have it."""

    x: str
    y: str
    long: str
    short: str
    deg: str


class PathPicture(NamedTuple):
    """What the page draws.

    Attributes:
        summary: what the path says.
        caption: what is drawn.
        box: of the picture, in m.
        car: points of the line.
        received: points of the receiver, empty without one.
        ellipses: at even distances.
        dot: radius of the start.
        scale: line whose length the caption says.
    """

    summary: str
    caption: str
    box: str
    car: str
    received: str
    ellipses: list[Ellipse]
    dot: str
    scale: str


def path_picture(wheels: Mapping[str, WheelPath]) -> PathPicture | None:
    """Return the picture of a car's path, ahead of its start upward; None where no wheel has a turn rate."""
    path = car_path(wheels)
    if path is None:
        return None
    points = _points_of_ellipses(path)
    reach = [path.position_m[point] + sign * path.ellipse(point)[0] for point in points for sign in (-1.0, 1.0)]
    places = _on_page(np.concatenate([path.position_m, path.received_m, reach]))
    low, high = places.min(axis=0), places.max(axis=0)
    size = max(float((high - low).max()), 1.0)
    margin = _MARGIN * size
    step_m = 10.0 ** math.floor(math.log10(size))
    length_m = max(step for step in (step_m, 2.0 * step_m, 5.0 * step_m) if step <= size)
    foot = high[1] + 2.0 * margin
    width, height = high - low + margin * np.array([2.0, 4.0])
    return PathPicture(
        _summary(path),
        _caption(path, length_m),
        " ".join(fixed(value, 1) for value in (low[0] - margin, low[1] - margin, width, height)),
        _points(path.position_m),
        _points(path.received_m),
        _ellipses(path),
        fixed(_DOT * size, 1),
        f"M{fixed(low[0], 1)} {fixed(foot, 1)}h{fixed(length_m, 1)}",
    )


def _on_page(points_m: FloatArray) -> FloatArray:
    """Return places to the right and downward of points ahead and to the left."""
    return -points_m[:, ::-1]


def _points(points_m: FloatArray) -> str:
    return " ".join(f"{fixed(x, 1)},{fixed(y, 1)}" for x, y in _on_page(points_m).tolist()) if len(points_m) else ""


def _points_of_ellipses(path: CarPath) -> list[int]:
    """Return indices of points at even distances along a path, its end among them."""
    rolled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path.position_m, axis=0).T))])
    indices = np.searchsorted(rolled, rolled[-1] * np.arange(1, _ELLIPSES + 1) / _ELLIPSES)
    points: list[int] = np.unique(np.minimum(indices, len(rolled) - 1)).tolist()
    return points


def _ellipses(path: CarPath) -> list[Ellipse]:
    ellipses = []
    for point in _points_of_ellipses(path):
        long, short, angle = path.ellipse(point)
        (x, y), *_ = _on_page(path.position_m[point : point + 1]).tolist()
        # An angle from ahead to the left is one from the right to above, a quarter of a turn on.
        page_angle_deg = -math.degrees(angle) - 90.0
        ellipses.append(Ellipse(*(fixed(value, 1) for value in (x, y, long, short, page_angle_deg))))
    return ellipses


def _summary(path: CarPath) -> str:
    long, short, _ = path.ellipse(-1)
    gap_m = float(np.hypot(*path.position_m[-1]))
    sentences = [
        f"{_length(path.length_m)} by {clean(', '.join(path.wheels))}, which end {_length(gap_m)} from the start. One "
        f"standard error of the end is {_length(long)} by {_length(short)}."
    ]
    if path.is_lost:
        sentences.append("The path ends where its direction is uncertain by a quarter of a turn.")
    if len(path.received_m):
        sentences.append(f"The receiver's positions are {_length(path.apart_m)} rms from it.")
    return " ".join(sentences)


def _caption(path: CarPath, length_m: float) -> str:
    received = " Dashed: the receiver, moved and turned to fit." if len(path.received_m) else ""
    return (
        "Solid: speed and turn rate of the wheels, integrated from the circle, ahead is up, with ellipses of one "
        f"standard error.{received} The bar is {_length(length_m)} long."
    )


def _length(length_m: float) -> str:
    return (
        f"{fixed(1e-3 * length_m, 2)} km"
        if length_m >= 1000.0
        else f"{fixed(length_m, 0 if length_m >= 10.0 else 1)} m"
    )
