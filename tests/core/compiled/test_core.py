"""The compiled core does what the functions in numpy do, refuses what does not fit, and stays in its arrays."""

import csv
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hatch_build
from gateway.core.compiled import core
from gateway.core.contacts import contact_template, contact_tracking, segmentation
from gateway.core.revolutions import angle_resampling, sensor_mounting, speed_normalisation
from gateway.core.revolutions.angle_resampling import Phase, Scale, elapsed_angles
from gateway.forces import switching_step, turn_tracker
from gateway.forces.free_belt import first_order_rows
from gateway.ring import small_systems, weak_form_rows
from tests.core.compiled import core_calls

ROOT = Path(__file__).parents[3]
needs_core = pytest.mark.skipif(core is None, reason="the compiled core was not built: no C compiler")
needs_compiler = pytest.mark.skipif(hatch_build.compiler() is None, reason="there is no C compiler")
seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)


def assert_equal(first: Any, other: Any, scale: float = 1.0) -> None:
    np.testing.assert_allclose(first, other, rtol=1e-10, atol=1e-10 * scale, equal_nan=True)


@needs_core
@given(
    rng=seeds,
    lengths=st.lists(st.integers(8, 2500), min_size=0, max_size=3),
    axes=st.integers(1, 3),
    order=st.sampled_from([3, 5]),
    kind=st.sampled_from(["int16", "float64", "float32", "NaN", "columns", "reversed"]),
    n=st.sampled_from([8, 128, 1024]),
)
def test_resampling_is_that_in_numpy(rng, lengths, axes, order, kind, n):
    samples, phases = [], []
    for length in lengths:
        values = rng.normal(0.0, 3000.0, (length, 2 * axes))
        values = (
            values[:, ::2] if kind == "columns" else values[::-1, :axes] if kind == "reversed" else values[:, :axes]
        )
        if kind in ("int16", "float32"):
            values = values.astype(kind)
        if kind == "NaN":
            values[rng.integers(length), 0] = math.nan
        start, end = np.sort(rng.uniform(0.0, length - 1.0, 2))
        end = max(end, min(start + 1.0, length - 1.0))
        start = min(start, end - 0.5)
        mean, change = 2.0 * math.pi / (end - start), rng.uniform(-0.9, 0.9)
        phases.append((start, end, mean * (1.0 - change), 2.0 * mean * change / (end - start)))
        samples.append(values)
    scale = Scale(rng.normal(0.0, 50.0, axes), rng.uniform(0.01, 1.0, axes)) if kind == "int16" else None
    results = np.empty((2, len(lengths), axes, n))
    for result, function in zip(
        results, (angle_resampling._interpolated_by_numpy, angle_resampling._interpolated_by_core), strict=True
    ):
        if samples:
            function(samples, np.array(phases), elapsed_angles(n), order, scale, result)
    if samples:
        assert_equal(results[1], results[0], 1e4)
        assert kind != "NaN" or np.isnan(results[1][:, 0]).all()


@pytest.mark.parametrize("order", [3, 5])
@pytest.mark.parametrize("length", [2, 3, 4, 17, 40, 300])
def test_factors_of_a_filter_give_its_equations(order, length):
    for pole, (diagonal, beside) in zip(
        angle_resampling._POLES[order], angle_resampling._filter_factors(order, length), strict=True
    ):
        lower = np.eye(length) + np.diag(beside, -1)
        ends = np.ones(length)
        ends[[0, -1]] = 0.5
        wanted = np.diag((1.0 + pole * pole) * ends) - pole * (np.eye(length, k=1) + np.eye(length, k=-1))
        np.testing.assert_allclose(lower @ np.diag(diagonal) @ lower.T, wanted, rtol=0.0, atol=1e-15)


@needs_core
@given(
    rng=seeds,
    count=st.integers(1, 4),
    n=st.sampled_from([64, 1024]),
    coupling=st.sampled_from(["DC", "AC, steady value", "AC, contact"]),
    level=st.sampled_from([0.0, 0.3, 3.0, 30.0, 3000.0]),
    gravity=st.sampled_from([0.0, 9.80665]),
    is_broken=st.booleans(),
)
def test_normalisation_is_that_in_numpy(rng, count, n, coupling, level, gravity, is_broken):
    """From wheels at which gravity exceeds R Omega^2 to fast ones, coupled either way, and without a contact."""
    theta = angle_resampling.angle_grid(n)
    dip = 1.0 - 1.2 * np.exp(-((theta / 0.2) ** 2))
    radial = level * dip + 9.80665 * np.cos(theta) + rng.normal(0.0, 0.05 * level + 0.01, (count, n))
    if is_broken:
        radial[0, rng.integers(n)] = rng.choice([math.nan, math.inf, 1e9])
    periods = rng.uniform(200.0, 4000.0, count)
    phases = []
    for period in periods.tolist():
        mean, change = 2.0 * math.pi / period, rng.uniform(-0.8, 0.8)
        phases.append(Phase(0.0, period, mean * (1.0 - change), 2.0 * mean * change / period))
    interiors = None
    if coupling == "AC, contact":
        radial -= level
        interiors = [None if rng.random() < 0.2 else slice(n // 2 - 3, n // 2 + 4) for _ in range(count)]
    steady = level * rng.uniform(0.9, 1.1, count) if coupling == "AC, steady value" else None
    with np.errstate(all="ignore"):
        single = speed_normalisation._normalised_by_numpy(radial, phases, interiors, steady, gravity)
    # A view whose rows are apart, as that of an axis of three.
    apart = np.stack([radial, radial], axis=1)[:, 0]
    other = speed_normalisation._normalised_by_core(apart, phases, interiors, steady, gravity)
    np.testing.assert_array_equal(single.used_belt_angle, other.used_belt_angle)
    assert_equal(other.constant_mps2, single.constant_mps2, level + 10.0)
    finite = np.isfinite(single.radial_mps2)
    np.testing.assert_array_equal(finite, np.isfinite(other.radial_mps2))
    assert_equal(other.radial_mps2[finite], single.radial_mps2[finite], level + 10.0)
    assert_equal(other.belt_angle_rad, single.belt_angle_rad)


@needs_core
@given(rng=seeds, lengths=st.lists(st.integers(30, 300), min_size=1, max_size=4), points=st.integers(2, 300))
def test_matching_is_that_in_numpy(rng, lengths, points):
    samples = [rng.normal(300.0, 100.0, length) for length in lengths]
    lines = angle_resampling._lines_by_core(samples)
    assert_equal(lines, angle_resampling._lines_by_numpy(samples), 1e3)
    angles = np.sort(rng.uniform(-0.6, 0.6, points))
    region = contact_template._Region(
        angles_rad=angles, values=rng.normal(size=points), model=rng.normal(size=(points, 5)),
        gravity_mps2=rng.normal(9.0, 1.0, points), rows=rng.normal(0.0, 0.1 / points, (5, points)),
        middle=int(rng.integers(1, points)), covariances_rad2=np.zeros((1, 2, 2, 2)),
    )  # fmt: skip
    count = np.array(lengths, dtype=float)
    passages = np.stack([0.5 * count, 9.0 * count, rng.uniform(0.5, 4.0, len(count)) / count, 0.1 / count**2], axis=1)
    given_ = lines, count - 1.0, passages, rng.uniform(20.0, 60.0, len(count)) / passages[:, 2], region
    first, other = contact_template._matched_by_numpy(*given_), contact_template._matched_by_core(*given_)
    assert_equal(other, first, np.abs(first).max())


@needs_core
@given(
    rng=seeds,
    n=st.integers(0, 1500),
    width=st.floats(0.5, 200.0),
    noise=st.sampled_from([0.0, 0.3, 20.0]),
    first=st.integers(-5, 10**9),
    is_broken=st.booleans(),
)
def test_refinement_is_that_in_numpy(rng, n, width, noise, first, is_broken):
    position, depth = rng.uniform(0.0, max(n, 1)), rng.uniform(5.0, 4000.0)
    radial = depth * np.tanh(np.abs(np.arange(n) - position) / (0.5 * width)) ** 4 + rng.normal(0.0, 1.0, n) * noise
    if is_broken and n:
        radial[rng.integers(n)] = math.nan
    # Counts are whole numbers, and so many differences are equal.
    radial = np.repeat(radial, 2)[::2] if noise else np.rint(radial)
    guess = first + position + rng.normal(0.0, 0.1 * width)
    given_ = radial, segmentation.cumulative(radial), guess, width, first
    by_numpy, other = segmentation._refined_by_numpy(*given_), segmentation._refined_by_core(*given_)
    assert (by_numpy is None) is (other is None)
    if by_numpy is not None and other is not None:
        assert_equal(other, by_numpy)


@needs_core
@given(
    rng=seeds,
    n=st.integers(0, 900),
    width=st.floats(3.0, 120.0),
    band=st.sampled_from([(-math.inf, math.inf), (0.8, 1.25)]),
)
def test_summits_are_those_in_numpy(rng, n, width, band):
    period, depth = rng.uniform(30.0, 1500.0), rng.uniform(10.0, 3000.0)
    radial = rng.normal(depth, 0.1 * depth, n)
    for _ in range(4):
        begin = int(rng.integers(0, max(n, 1)))
        radial[begin : begin + round(width)] -= rng.uniform(0.3, 1.2) * depth
    prefix = segmentation.cumulative(np.rint(radial))
    given_ = prefix, width, rng.uniform(0.4, 1.5) * period, depth * period**2, period, *band
    assert core is not None
    assert core.summits(*given_) == contact_tracking._summits_by_numpy(*given_)


@needs_core
@given(rng=seeds, n=st.integers(1, 40), more=st.integers(0, 20), k=st.integers(1, 35), is_singular=st.booleans())
def test_small_systems_are_those_of_lapack(rng, n, more, k, is_singular):
    factor = np.tril(rng.normal(0.0, 0.3, (n, n))) + 2.0 * np.eye(n)
    # A matrix of orthogonal columns times a factor is as well conditioned as that.
    matrix = np.linalg.qr(rng.normal(size=(n + more, n)))[0] @ factor.T
    if is_singular:
        factor[-1, -1] = 0.0
        matrix[:, -1] = 0.0
    right, longer = rng.normal(size=(n, k)), rng.normal(size=(n + more, k))
    for transposed in (False, True):
        out = np.empty((2, n, k))
        calls = (small_systems._solved_by_lapack, small_systems._solved_by_core)
        regular = [call(factor, right, transposed, item) for call, item in zip(calls, out, strict=True)]
        assert regular == [not is_singular] * 2
        if not is_singular:
            assert_equal(out[1], out[0], np.abs(out[0]).max())
    out = np.empty((2, n, k))
    fits = (small_systems._fitted_by_lapack, small_systems._fitted_by_core)
    independent = [call(np.asfortranarray(matrix), longer, item) for call, item in zip(fits, out, strict=True)]
    assert independent == [not is_singular] * 2
    if not is_singular:
        assert_equal(out[1], out[0], np.abs(out[0]).max())


@needs_core
@given(
    rng=seeds,
    count=st.integers(1, 4),
    with_mean=st.booleans(),
    level=st.sampled_from([2.0, 300.0, 5000.0]),
    kind=st.sampled_from(["whole", "NaN", "no offset", "few orders"]),
)
def test_mounting_is_that_in_numpy(rng, count, with_mean, level, kind):
    theta = angle_resampling.angle_grid()
    wave = level * (1.0 - np.exp(-((theta / 0.2) ** 2))) * (1.0 + 0.05 * rng.normal(size=len(theta)))
    belt = sensor_mounting.belt_kinematics(wave, rng.uniform(0.0, 0.02), 0.0)
    spectra = rng.normal(0.0, 0.1 * level, (count, 4, 61)) + 1j * rng.normal(0.0, 0.1 * level, (count, 4, 61))
    spectra = spectra[:, ::2]
    if kind == "NaN":
        spectra[0, 0] = math.nan
    if kind == "no offset":
        belt = replace(belt, along=np.zeros_like(belt.along))
    omega = rng.uniform(1.0, 150.0, count)
    order_max = rng.integers(4, 9, count) if kind == "few orders" else rng.integers(20, 90, count)
    given_ = spectra, belt, omega, rng.normal(0.0, 10.0, count), 0.3, order_max, with_mean
    first, other = sensor_mounting._rows_by_numpy(*given_), sensor_mounting._rows_by_core(*given_)
    for equations, same in zip(first.sums, other.sums, strict=True):
        assert_equal(same, equations, np.nanmax(np.abs(equations), initial=1.0))
    assert_equal(other.hub, first.hub, level)
    # From the same sums, which differ in their last digits.
    result, same = sensor_mounting._solutions_by_numpy(first.sums), sensor_mounting._solutions_by_core(first.sums)
    for values, others in zip(result, same, strict=True):
        assert_equal(others, values, np.nanmax(np.abs(values), initial=1.0))


@needs_core
@given(rng=seeds, half_angle=st.floats(0.05, 0.6), numbers=st.lists(st.floats(0.0, 2.0), min_size=3, max_size=3))
def test_sensitivity_of_the_balance_is_that_in_numpy(rng, half_angle, numbers):
    motion = weak_form_rows.virtual_motion(weak_form_rows.motion_begin(half_angle))
    rotation = motion.rotation[:, :: weak_form_rows.STRIDE]
    points = len(weak_form_rows.ALONG[:: weak_form_rows.STRIDE])
    tangent = np.exp(1j * np.cumsum(rng.uniform(0.0, 0.05, points)))
    out = np.empty((2, weak_form_rows.ROWS + 1, points))
    given_ = tangent, rng.normal(size=points), rotation, np.array(numbers)
    for item, function in zip(out, (weak_form_rows._by_angle_by_numpy, weak_form_rows._by_angle_by_core), strict=True):
        function(*given_, item)
    assert_equal(out[1], out[0])


@needs_core
@given(
    rng=seeds,
    n=st.integers(1, switching_step.MOST_STATES),
    m=st.integers(1, switching_step.MOST_MEASURED),
    free=st.sampled_from([0.0, 1.0, 1e9]),
    fixed=st.integers(-1, 2),
    is_broken=st.booleans(),
)
def test_a_step_of_switching_filters_is_that_in_numpy(rng, n, m, free, fixed, is_broken):
    roots = rng.normal(size=(2, n, n))
    change = np.stack([rng.uniform(0.5, 1.0, (2, n)), *rng.uniform(0.0, 1.0, (3, 2, n))])
    model = switching_step.SwitchingModel(change, free, min(fixed, n - 1))
    values = rng.normal(0.0, 10.0, m)
    if is_broken:
        values[rng.integers(m)] = math.nan
    measured = values, rng.normal(size=(m, n)), rng.uniform(0.1, 10.0, m)
    switched = float(rng.uniform()), float(rng.uniform())
    results = []
    for function in (switching_step._stepped_by_numpy, switching_step._stepped_by_core):
        means, covariances = np.stack([np.arange(n, dtype=float)] * 2), roots @ roots.transpose(0, 2, 1)
        results.append((function(model, switched, measured, means, covariances), means, covariances))
    for value, same in zip(*results, strict=True):
        assert_equal(same, value, np.abs(np.nan_to_num(value)).max() + 1.0)
    assert np.isnan(results[1][1]).any() == is_broken


@needs_core
@given(rng=seeds, leading=st.floats(-0.6, -0.05), trailing=st.floats(0.05, 0.6), is_broken=st.booleans())
def test_predicted_first_orders_are_those_in_numpy(rng, leading, trailing, is_broken):
    rows = first_order_rows(0.5 * (trailing - leading))
    lateral, radial = rng.normal(0.0, 1e-3, (2, rows.shape[1]))
    if is_broken:
        radial[rng.integers(len(radial))] = math.nan
    given_ = lateral, radial, rows, 0.5 * (leading + trailing)
    first, other = turn_tracker._predicted_by_numpy(*given_), turn_tracker._predicted_by_core(*given_)
    assert_equal(other, first, 1e-3)
    assert np.isnan(other[2:]).all() == is_broken
    assert np.isfinite(other[:2]).all()


@needs_core
@pytest.mark.parametrize("name", core_calls.CALLS)
def test_what_does_not_fit_together_is_refused(name):
    assert core is not None
    rng = np.random.default_rng(5)
    arguments = core_calls.CALLS[name](rng)
    with pytest.raises(TypeError, match="arguments are needed"):
        getattr(core, name)(*arguments[:-1])
    for index, value in enumerate(arguments):
        if isinstance(value, np.ndarray):
            with pytest.raises((TypeError, ValueError, BufferError)):
                getattr(core, name)(*arguments[:index], value.astype(np.bool_), *arguments[index + 1 :])


@needs_core
@pytest.mark.parametrize("name", sorted(set(core_calls.CALLS) - {"summits", "first_orders"}))
def test_a_result_that_is_too_short_is_refused(name):
    assert core is not None
    rng = np.random.default_rng(5)
    refused = 0
    for _ in range(20):
        *arguments, out = core_calls.CALLS[name](rng)
        if out.size:
            with pytest.raises(ValueError, match=r"differ in size|fit together"):
                getattr(core, name)(*arguments, out.ravel()[:-1])
            refused += 1
    assert refused


def fuzzed(module: Path, count: int, **environment: str) -> str:
    script = Path(core_calls.__file__)
    done = subprocess.run(
        [sys.executable, str(script), str(module), str(count), "7"],
        env={**os.environ, **environment}, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-4000:]
    return done.stdout


@needs_compiler
def test_random_calls_pass_under_sanitizers(tmp_path):
    """Reads and writes beside an array, undefined conversions and overflow end the process."""
    module = tmp_path / "sanitized.so"
    options = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer")
    failure = hatch_build.build(ROOT, module, options)
    library = subprocess.run(
        [*(hatch_build.compiler() or ()), "-print-file-name=libasan.so"], capture_output=True, text=True, check=False
    ).stdout.strip()
    if failure or not Path(library).is_absolute():
        pytest.skip(f"the compiler has no sanitizers: {failure}")
    refused = fuzzed(module, 3000, LD_PRELOAD=library, ASAN_OPTIONS="detect_leaks=0", PYTHONMALLOC="malloc")
    assert 300 < int(refused) < 2500


@needs_compiler
def test_the_sanitizers_see_a_write_beside_an_array(tmp_path, monkeypatch):
    """So that the test above can fail: without the check of a size it does."""
    source = (ROOT / hatch_build.SOURCE).read_text()
    check = "if (count >= 0 && view->len != count * (Py_ssize_t)sizeof(double)) {"
    assert check in source
    (tmp_path / hatch_build.SOURCE).parent.mkdir(parents=True)
    (tmp_path / hatch_build.SOURCE).write_text(source.replace(check, "if (0) {"))
    module = tmp_path / "sanitized.so"
    options = ("-g", "-O1", "-fsanitize=address", "-fno-omit-frame-pointer")
    library = subprocess.run(
        [*(hatch_build.compiler() or ()), "-print-file-name=libasan.so"], capture_output=True, text=True, check=False
    ).stdout.strip()
    if hatch_build.build(tmp_path, module, options) or not Path(library).is_absolute():
        pytest.skip("the compiler has no sanitizers")
    with pytest.raises(AssertionError, match="AddressSanitizer"):
        fuzzed(module, 3000, LD_PRELOAD=library, ASAN_OPTIONS="detect_leaks=0", PYTHONMALLOC="malloc")


@needs_core
@settings(max_examples=20)
@given(seed=st.integers(0, 10**9))
def test_random_calls_end(seed):
    assert core is not None
    core_calls.make(core, 200, seed)


def _in_use(**environment: str) -> str:
    code = "from gateway.core.compiled import core; print(core is not None)"
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()


@needs_core
def test_a_variable_turns_the_core_off():
    assert (_in_use(), _in_use(TREADLINK_COMPILED="0")) == ("True", "False")


@needs_core
def test_a_recording_gives_the_same_estimates_without_the_core(tmp_path):
    def run(*arguments: str, **environment: str) -> None:
        subprocess.run(
            [sys.executable, "-m", "gateway.core.cli", *arguments],
            cwd=ROOT, env={**os.environ, **environment}, capture_output=True, check=True,
        )  # fmt: skip

    recording = str(tmp_path / "drive.mcap")
    run("simulate", "lab", "--duration", "4", "--out", recording)
    rows = []
    for name, used in (("with", "1"), ("without", "0")):
        table = tmp_path / f"{name}.csv"
        run("estimate", recording, "--csv", str(table), TREADLINK_COMPILED=used)
        with table.open(newline="") as file:
            rows.append([line for line in csv.reader(file) if not line[0].startswith("#")])
    assert len(rows[0]) == len(rows[1]) > 20
    for first, other in zip(*rows, strict=True):
        for cell, same in zip(first, other, strict=True):
            try:
                assert float(cell) == pytest.approx(float(same), rel=2e-8, abs=1e-12, nan_ok=True)
            except ValueError:
                assert cell == same


def _built(root: Path, module: ModuleType = hatch_build) -> str:
    return module.build(root, root / "made.so")


def test_without_a_compiler_there_is_a_reason(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("CC", "no-such-compiler")
    assert _built(tmp_path).startswith("no C compiler")


@needs_compiler
def test_a_source_that_does_not_compile_is_a_reason(tmp_path):
    assert "core.c" in _built(tmp_path)
