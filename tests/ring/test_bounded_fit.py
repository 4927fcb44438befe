import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares, nnls

from gateway.ring.bounded_fit import fit_nonnegative


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_linear_problems_match_scipy_nnls(seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix, data = rng.normal(size=(12, 4)), rng.normal(size=12)
    expected, norm = nnls(matrix, data)
    fit = fit_nonnegative(lambda p: (matrix @ p, matrix), data, np.ones(4), max_evaluations=300)
    assert fit.cost == pytest.approx(norm**2, rel=1e-6)
    np.testing.assert_allclose(fit.parameters, expected, atol=1e-3)
    assert (fit.parameters >= 0.0).all()


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1))
def test_rational_problems_match_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.linspace(0.2, 3.0, 40)
    terms = np.stack([np.ones_like(x), x, x**2], axis=1)

    def model(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        bottom = np.maximum(terms @ p, 1e-12)
        return 1.0 / bottom, -terms / bottom[:, np.newaxis] ** 2

    data = model(rng.uniform(0.3, 3.0, 3))[0] * (1.0 + rng.normal(size=40) * 0.05)
    start = np.ones(3)
    fit = fit_nonnegative(model, data, start, max_evaluations=200)
    reference = least_squares(
        lambda p: model(p)[0] - data, start, lambda p: model(p)[1], bounds=(0.0, np.inf), xtol=1e-12
    )
    assert fit.cost <= 2.0 * reference.cost * (1.0 + 1e-6)


def test_negative_optimum_is_held_at_zero() -> None:
    x = np.linspace(0.0, 1.0, 20)
    matrix = np.stack([np.ones_like(x), x], axis=1)
    fit = fit_nonnegative(lambda p: (matrix @ p, matrix), 2.0 - 0.5 * x, np.ones(2))
    assert fit.parameters[1] == 0.0
    assert fit.parameters[0] == pytest.approx(1.75)
    # A parameter leaves its bound when the data ask for it.
    back = fit_nonnegative(lambda p: (matrix @ p, matrix), 2.0 + 0.5 * x, np.array([2.0, 0.0]))
    np.testing.assert_allclose(back.parameters, [2.0, 0.5], rtol=1e-6)


def test_evaluations_are_bounded() -> None:
    x = np.linspace(0.1, 1.0, 10)
    calls = 0

    def model(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        nonlocal calls
        calls += 1
        return np.exp(p[0] * x), (x * np.exp(p[0] * x))[:, np.newaxis]

    fit_nonnegative(model, np.exp(3.0 * x), np.array([0.1]), max_evaluations=3)
    assert calls == 3
