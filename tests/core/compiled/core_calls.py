"""Calls of the compiled core with random arguments, right and wrong ones.

`python core_calls.py MODULE COUNT SEED` makes them with the module of a file, as built with sanitizers.
"""

import importlib.machinery
import importlib.util
import math
import sys
from collections.abc import Callable
from types import ModuleType

import numpy as np

ODD_NUMBERS = (0.0, -1.0, 0.5, 3.0, 1e6, -1e18, 1e300, math.inf, -math.inf, math.nan)


def loaded(path: str) -> ModuleType:
    """Return the module of a file."""
    loader = importlib.machinery.ExtensionFileLoader("gateway.core.compiled._core", path)
    spec = importlib.util.spec_from_loader(loader.name, loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module


def _resample(rng):
    rows, axes, taps = int(rng.integers(4, 200)), int(rng.integers(1, 5)), int(rng.choice([4, 6]))
    count, length = int(rng.integers(0, 150)), rows + 3 + int(rng.choice([4, 6])) + int(rng.integers(0, 40))
    samples = rng.normal(0.0, 1e3, (2 * rows, axes)).astype(rng.choice([np.int16, np.float64]))[:: rng.choice([1, 2])]
    start = rng.uniform(-1.0, 5.0)
    phase = np.array([start, start + rng.uniform(0.0, rows), rng.normal(0.0, 0.1), rng.normal(0.0, 1e-3)])
    return [
        samples[:rows], np.zeros(axes), np.ones(axes), rng.normal(size=(taps // 3, 2, length)),
        rng.normal(size=(taps, taps)), rng.uniform(-1.0, 7.0, count), phase,
        np.empty((length, axes)), np.empty((axes, count)),
    ]  # fmt: skip


def _spline_lines(rng):
    rows = int(rng.integers(1, 100))
    length = rows + int(rng.integers(0, 60))
    return [rng.normal(size=rows), np.zeros(1), np.ones(1), rng.normal(size=(2, 2, length)), np.empty(length)]


def _normalise(rng):
    k, n = int(rng.integers(0, 4)), int(rng.integers(0, 70))
    rows = rng.normal(0.0, 10.0, (k, 6))
    rows[:, 4:] = np.sort(rng.integers(-2, n + 3, (k, 2)), axis=1)
    return [
        rng.normal(30.0, 30.0, (k, n)), rows, rng.integers(-1, 5, k).astype(float), 9.8 * int(rng.integers(0, 2)),
        rng.normal(size=n), rng.normal(size=n), np.empty(n), np.empty((k, n)), np.empty((k, n)), np.zeros(k),
        np.empty(k),
    ]  # fmt: skip


def _match(rng):
    k, m, length = int(rng.integers(0, 4)), int(rng.integers(0, 150)), int(rng.integers(10, 80))
    phases = rng.normal(0.0, 0.1, (k, 4))
    return [
        rng.normal(size=(k, length)), rng.uniform(0.0, length, k), phases, rng.uniform(1.0, 1e4, k),
        rng.normal(size=(6, 6)), rng.normal(size=m), rng.normal(size=m), rng.normal(size=m),
        rng.normal(size=(5, m)), rng.normal(size=(m, 5)),
        float(rng.integers(-1, m + 2)), np.empty(m), np.empty((k, 5)),
    ]  # fmt: skip


def _refine(rng):
    n = int(rng.integers(0, 200))
    radial = rng.normal(0.0, 1.0, n) + 50.0 * (np.abs(np.arange(n) - n / 2) > rng.uniform(2.0, 30.0))
    radial[rng.random(n) < rng.choice([0.0, 0.01])] = rng.choice(ODD_NUMBERS)
    prefix = np.concatenate([[0.0], np.cumsum(radial)])
    return [radial, prefix, rng.uniform(-10.0, n + 10.0), rng.uniform(0.1, 80.0), int(rng.integers(-5, 5)), np.empty(n)]


def _summits(rng):
    prefix = np.cumsum(rng.normal(20.0, 50.0, int(rng.integers(1, 300))))
    return [prefix, rng.uniform(0.1, 90.0), rng.uniform(-5.0, 500.0), *rng.uniform(0.0, 1e5, 2), 0.0, 2.0]


def _solve_lower(rng):
    n, k = rng.integers(0, 12, 2).tolist()
    return [rng.normal(size=(n, n)), rng.normal(size=(n, k)), bool(rng.integers(2)), np.empty((n, k))]


def _least_squares(rng):
    n, k = rng.integers(0, 8, 2).tolist()
    m = n + int(rng.integers(0, 12))
    return [rng.normal(size=(m, n)), rng.normal(size=(m, k)), np.empty((m + 1, n + k)), np.empty((n, k))]


def _mounting_rows(rng):
    k = int(rng.integers(0, 4))
    return [
        rng.normal(size=(k, 2, 122)), rng.normal(size=122), rng.normal(size=(2, 122)), rng.normal(size=k),
        rng.normal(size=k), 0.3, rng.integers(-2, 70, k).astype(float), bool(rng.integers(2)), 9.8,
        np.empty((k, 70)), np.empty((k, 7)),
    ]  # fmt: skip


def _row_sensitivity(rng):
    m, r = int(rng.integers(0, 40)), int(rng.integers(0, 5))
    f = int(rng.integers(0, m + 1))
    return [
        rng.normal(size=2 * m), rng.normal(size=2 * m), rng.normal(size=m), rng.normal(size=(r, f)), rng.normal(size=3),
        0.02, np.empty(2 * m), np.empty((r + 1, m)),
    ]  # fmt: skip


def _mounting_solutions(rng):
    k = int(rng.integers(0, 4))
    return [rng.normal(size=(k, 70)), np.empty((k, 3)), np.empty((k, 3))]


def _switching_step(rng):
    n, m = int(rng.integers(1, 18)), int(rng.integers(1, 6))
    return [
        rng.uniform(0.0, 1.0, (4, 2, n)), 10.0, int(rng.integers(-1, n)), *rng.uniform(0.0, 1.0, 2).tolist(),
        rng.normal(size=m), rng.normal(size=(m, n)), rng.uniform(0.1, 1.0, m), rng.normal(size=(2, n)),
        np.stack([np.eye(n)] * 2),
    ]  # fmt: skip


def _first_orders(rng):
    k = int(rng.integers(0, 30))
    return [*rng.normal(size=(2, 2 * k)), rng.normal(size=k), rng.normal(size=(2, 2 * k)), rng.normal()]


CALLS: dict[str, Callable[[np.random.Generator], list]] = {
    "resample": _resample, "spline_lines": _spline_lines, "normalise": _normalise, "match": _match,
    "refine": _refine, "summits": _summits, "solve_lower": _solve_lower, "least_squares": _least_squares,
    "mounting_rows": _mounting_rows, "mounting_solutions": _mounting_solutions,
    "row_sensitivity": _row_sensitivity, "switching_step": _switching_step,
    "first_orders": _first_orders,
}  # fmt: skip


def disturbed(rng: np.random.Generator, arguments: list) -> list:
    """Return arguments of which one is wrong."""
    index = int(rng.integers(len(arguments)))
    value = arguments[index]
    if isinstance(value, np.ndarray):
        wrong = [None, 3.0, value[:-1], np.append(value, value.ravel()[:1]), value.astype(np.float32), value.T[::-1]]
        odd = value.copy()
        if odd.size and odd.dtype == np.float64:
            odd.flat[rng.integers(odd.size)] = rng.choice(ODD_NUMBERS)
        wrong += [odd] * 6
        value = wrong[rng.integers(len(wrong))]
    else:
        value = [None, "1", *ODD_NUMBERS][rng.integers(2 + len(ODD_NUMBERS))]
    return [*arguments[:index], value, *arguments[index + 1 :]]


def make(core: ModuleType, count: int, seed: int) -> int:
    """Make random calls; return how many of them were refused."""
    rng = np.random.default_rng(seed)
    refused = 0
    for _ in range(count):
        name = list(CALLS)[rng.integers(len(CALLS))]
        with np.errstate(all="ignore"):
            arguments = CALLS[name](rng)
            if rng.random() < 0.5:
                arguments = disturbed(rng, arguments)
        if rng.random() < 0.02:
            arguments = arguments[: rng.integers(len(arguments))]
        try:
            getattr(core, name)(*arguments)
        except (TypeError, ValueError, BufferError, OverflowError):
            refused += 1
    return refused


if __name__ == "__main__":
    print(make(loaded(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])))
