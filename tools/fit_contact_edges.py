"""Fit of the distance from the steepest slope of the radial waveform to the contact edge, on random exact rings.

Prints the constants of gateway/core/revolutions/edge_distance.py, with the errors at tires left out of the fit.
Run: python tools/fit_contact_edges.py
"""

import math
from collections.abc import Iterator

import numpy as np

from gateway.core.revolutions.angle_resampling import GRID_SIZE
from gateway.core.revolutions.contact_edges import contact_levels
from gateway.core.types import FloatArray
from gateway.ring.rolling_ring import RingNotConvergedError, RingParameters, RingSolution, solve_rolling_ring

TIRES = 700
WIDTHS = (15.0, 17.5, 20.0, 25.0, 30.0, 40.0)
# The error of real tires, which are no rings, over that of rings left out of the fit.
MARGIN = 1.3


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def random_ring(rng: np.random.Generator) -> RingSolution:
    """Return a tire from car to truck, rolling: load, tread, bending, damping and sensor depth drawn widely."""
    truck = rng.random() < 0.3
    radius = rng.uniform(0.40, 0.54) if truck else rng.uniform(0.27, 0.38)
    pressure = rng.uniform(4.5e5, 8.0e5) if truck else rng.uniform(1.5e5, 3.5e5)
    omega = log_uniform(rng, 30.0, 110.0 if truck else 250.0) / 3.6 / radius
    # Stiffness of tread and belt in proportion to the pressure; damping for up to a few percent of rolling resistance.
    relative = pressure / 2.1e5
    tread = relative * log_uniform(rng, 1.4e7, 4e8)
    damped = rng.random(2) < 0.7
    ring = RingParameters.from_numbers(
        log_uniform(rng, 6e-4, 5e-3),
        log_uniform(rng, 0.13, 0.30),
        log_uniform(rng, 1.7, 5.0),
        log_uniform(rng, 1.0, 4.0),
        radius_m=radius,
        pressure_pa=pressure,
        extension_stiffness_n=relative * log_uniform(rng, 4e6, 4e7),
        tread_stiffness_npm2=tread,
        tread_damping_nspm2=damped[0] * rng.uniform(0.0, 7e-4) * tread * 56.0 / omega,
        foundation_damping_nspm2=damped[1] * rng.uniform(0.0, 200.0) * relative,
    )
    load = log_uniform(rng, 0.03, 0.38) * pressure * radius**2
    offset = float(rng.choice([0.0, 0.003, 0.006]))
    return solve_rolling_ring(ring, load, pressure, omega, nodes=1440, sensor_offset_m=offset)


def random_rings(count: int, seed: int = 7) -> Iterator[RingSolution]:
    for number in range(count):
        try:
            yield random_ring(np.random.default_rng([seed, number]))
        except RingNotConvergedError:
            continue


def grid_wave(solution: RingSolution) -> FloatArray:
    spectrum = np.fft.rfft(solution.sensor.radial_m)[: GRID_SIZE // 2 + 1]
    return np.fft.irfft(spectrum, GRID_SIZE) * (GRID_SIZE / len(solution.sensor.radial_m))


def distances(solution: RingSolution, width: float) -> list[tuple[float, ...]]:
    """Return distance of the edge outside the steepest slope, and the features, for both edges."""
    shapes = contact_levels(grid_wave(solution), width).shapes
    if shapes is None:
        return []
    edges = (-1.0, solution.leading_edge_rad), (1.0, solution.trailing_edge_rad)
    return [
        (direction * (true - shape.steepest_rad), *shape.features_rad.tolist())
        for shape, (direction, true) in zip(shapes, edges, strict=True)
    ]


def fit(rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return means and spreads of the features, the coefficients about the means, and the left-out errors."""
    distance, features = rows[:, 0], rows[:, 1:]
    means, spreads = features.mean(axis=0), features.std(axis=0)
    matrix = np.column_stack([np.ones(len(rows)), features - means])
    inverse = np.linalg.pinv(matrix)
    leverage = np.einsum("ij,ji->i", matrix, inverse)
    coefficients = inverse @ distance
    return means, spreads, coefficients, (distance - matrix @ coefficients) / (1.0 - leverage)


def main() -> None:
    rings = list(random_rings(TIRES))
    print(f"{len(rings)} random rings, both edges; distance = constant + coefficients (feature - mean), mrad")
    print(f"{'orders':>7} {'uncorrected':>12} {'left out':>9} {'largest':>8}   constant, coefficients, means, spreads")
    table = []
    for width in WIDTHS:
        rows = np.array([row for ring in rings for row in distances(ring, width)])
        means, spreads, coefficients, errors = fit(rows)
        std = float(errors.std())
        print(
            f"{width:7.1f} {1e3 * rows[:, 0].std():12.1f} {1e3 * std:9.1f} {1e3 * np.abs(errors).max():8.1f}  ",
            np.round(coefficients, 4), np.round(means, 4), np.round(spreads, 4),
        )  # fmt: skip
        table.append((*coefficients, MARGIN * std, *means, *spreads))
    columns = np.array(table).T
    for name, part in (
        ("_DISTANCES", columns[:6]),
        ("_FEATURE_MEANS_RAD", columns[6:10]),
        ("_FEATURE_STDS_RAD", columns[10:]),
    ):
        print(f"{name}: Final = (")
        for column in part:
            print("    (" + ", ".join(f"{value:.4f}" for value in column) + "),")
        print(")")


if __name__ == "__main__":
    main()
