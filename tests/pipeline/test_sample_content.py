"""Samples against what a hello states: bytes swapped, and a steady value with AC coupling; never where it is right."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from firmware_protocol.messages import Coupling
from gateway.pipeline.sample_content import SampleContent, chosen
from gateway.reasons import Code
from tests.session.hub_frames import HELLO

BLOCKS = 16
Words = NDArray[np.int16]


def codes_of(words: Words, **hello: object) -> set[Code]:
    content, codes = SampleContent(), set()
    for rows in np.array_split(words.astype("<i2"), BLOCKS):
        codes |= {code for code, _ in content.block(HELLO._replace(**hello), rows)}
    return codes


def wheel(seed: int, noise: float, steady: float) -> Words:
    """Return 864 rows of a wheel that rolls: a steady value with dips, and noise."""
    rng = np.random.default_rng(seed)
    dips = 1.0 - np.exp(-(((np.arange(864) % 200 - 100) / 10.0) ** 6))
    rows = np.stack([0.2 * steady * np.gradient(dips) * 20, 0.0 * dips, steady * dips], axis=1)
    return np.clip(np.round(rows + rng.normal(0.0, noise, rows.shape)), -32768, 32767).astype("<i2")


@given(st.integers(0, 2**31), st.floats(0.6, 300.0), st.floats(-15_000.0, 15_000.0))
def test_right_bytes_pass_and_swapped_ones_are_named(seed: int, noise: float, steady: float) -> None:
    words = wheel(seed, noise, steady)
    assert codes_of(words) == set()
    assert codes_of(words.byteswap()) == {Code.SAMPLES_BYTES_SWAPPED}


@given(st.integers(0, 2**31), st.integers(1, 15))
def test_left_aligned_words_of_fewer_bits_pass(seed: int, shift: int) -> None:
    words = np.random.default_rng(seed).integers(-(2 ** (15 - shift)), 2 ** (15 - shift), (864, 3)) << shift
    assert codes_of(words.astype("<i2")) == set()


def test_noise_over_the_full_scale_and_still_samples_pass() -> None:
    assert codes_of(np.random.default_rng(1).integers(-32768, 32768, (864, 3)).astype("<i2")) == set()
    assert codes_of(np.full((864, 3), 1000, "<i2")) == set()


@pytest.mark.parametrize(
    ("hello", "named"),
    [
        ({"coupling": Coupling.DC}, False),
        ({"coupling": Coupling.AC}, True),
        ({"coupling": Coupling.AC, "highpass_hz": 2.0}, True),
        # It passes what is steady for seconds.
        ({"coupling": Coupling.AC, "highpass_hz": 0.05}, False),
        # The steady value is the stated zero.
        ({"coupling": Coupling.AC, "offset_counts": (0.0, 0.0, 7000.0)}, False),
    ],
)
def test_a_steady_value_contradicts_ac_coupling(hello: dict[str, object], named: bool) -> None:
    words = wheel(1, 20.0, 7600.0)
    assert codes_of(words, **hello) == ({Code.HELLO_AC_WITH_STEADY_VALUE} if named else set())


def test_ac_coupled_wheel_and_gravity_alone_pass() -> None:
    words = wheel(1, 20.0, 7600.0).astype(float)
    assert codes_of(np.round(words - words.mean(axis=0)), coupling=Coupling.AC) == set()
    assert codes_of(wheel(1, 2.0, 9.81 / 0.125), coupling=Coupling.AC) == set()


def test_the_level_between_contacts_is_no_steady_value() -> None:
    """Of an AC-coupled sensor, and no block has met a contact."""
    words = wheel(1, 20.0, 7600.0).astype(float)
    between = (words - words.mean(axis=0))[words[:, 2] > 7500]
    assert between[:, 2].mean() > 300
    assert codes_of(np.round(between), coupling=Coupling.AC) == set()


def test_one_block_in_32_is_chosen_at_distances_that_differ() -> None:
    places = np.flatnonzero(chosen(np.arange(0, 36 * 100_000, 36)))
    assert len(places) == pytest.approx(100_000 / 32, rel=0.05)
    assert len(set(np.diff(places).tolist())) > 2
    assert [bool(chosen(int(first))) for first in range(0, 36 * 50, 36)] == chosen(np.arange(0, 36 * 50, 36)).tolist()
