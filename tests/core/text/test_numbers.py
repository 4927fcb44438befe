import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.reasons import Reason
from gateway.core.shown_units import ShownUnits, shown_in
from gateway.core.text.numbers import (
    MISSING,
    Unit,
    duration,
    fixed,
    percent,
    round_to_error,
    show,
    shown_value,
    split_name,
    unit_symbol,
)
from gateway.core.text.plain_values import plain
from gateway.core.text.text import file_size
from gateway.core.wheels.reasons import WheelCode


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.19532, 0.00121, "0.1953 ± 0.0012"),
        (3.0833e-3, 1.2e-5, "(3.083 ± 0.012)e-3"),
        (2.974, 0.031, "2.974 ± 0.031"),
        (65.0312, 0.0996, "65.03 ± 0.10"),  # the error rounds up into the next decade
        (1234.0, 560.0, "1230 ± 560"),
        (-0.04, 2.3, "0.0 ± 2.3"),  # no minus sign on a zero
        (0.0, 0.5, "0.00 ± 0.50"),
        (4.2e7, 1.1e5, "(42.00 ± 0.11)e6"),
        (65.0, math.nan, "65.00"),
        (65.0, 0.0, "65.00"),
        (65.0, math.inf, "65.00"),
        (0.0, math.nan, "0"),
        (12345.678, math.nan, "12350"),
        (3.0833e-3, math.nan, "3.083e-3"),
        (math.nan, 0.1, MISSING),
        (math.inf, 0.1, MISSING),
        (65.03, 1e-12, "65.0300 ± 0.0001"),  # an error is never shown as zero
    ],
)
def test_value_is_rounded_to_its_error(value, std, text):
    assert round_to_error(value, std).joined() == text


finite = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e12, max_value=1e12)


@given(finite, st.floats(min_value=1e-12, max_value=1e12))
@example(0.0078125, 5.960464477539063e-08)
def test_rounding_keeps_two_digits_of_the_error(value, std):
    shown = round_to_error(value, std)
    scale = 10.0**shown.exponent
    error = float(shown.error) * scale
    digits = int(shown.error.replace(".", ""))
    off = abs(float(shown.value) * scale - value)
    if digits >= 10:
        assert abs(error - std) <= 0.0501 * std
        assert off <= 0.0501 * error
    else:  # at the limit of six digits of the value the error has one digit, and is never rounded to 0
        last_digit = scale * 10.0 ** -len(shown.error.partition(".")[2])
        assert digits >= 1
        assert abs(error - max(std, last_digit)) <= 0.501 * last_digit
        assert off <= 0.501 * last_digit
    assert len(shown.value.partition(".")[2]) == len(shown.error.partition(".")[2])
    assert len(shown.value.lstrip("-").replace(".", "").lstrip("0")) <= 7


@given(st.floats(), st.floats())
def test_nan_is_never_shown(value, std):
    estimate = Estimate("Cw", value, std, Status.VALID)
    text = show(estimate).text()
    assert "nan" not in text
    assert "inf" not in text
    assert "nan" not in fixed(value, 2) + shown_value("pressure_pa", value, 1) + duration(value)


@pytest.mark.parametrize(
    ("name", "value", "std", "text"),
    [
        ("speed_mps", 65.0 / 3.6, 0.02 / 3.6, "65.000 ± 0.020 km/h"),
        ("leading_edge_rad", -0.2398, 0.0017, "-13.740 ± 0.097 deg"),
        ("pressure_pa", 210e3, 1500.0, "210.0 ± 1.5 kPa"),
        ("temperature_degc", 31.52, 0.25, "31.52 ± 0.25 °C"),
        ("load_n", 5012.0, 49.0, "5012 ± 49 N"),
        ("wear_mm", 1.234, 0.31, "1.23 ± 0.31 mm"),
        ("contact_length_m", 0.1522, 0.0011, "152.2 ± 1.1 mm"),
        ("noise_mps2", 20.0, 1.0, "20.0 ± 1.0 m/s²"),
        ("Bs/Cw", 0.01579, 0.00012, "0.01579 ± 0.00012"),
    ],
)
def test_values_are_shown_in_field_units(name, value, std, text):
    assert show(Estimate(name, value, std, Status.VALID)).text() == text


def test_names_become_labels():
    assert split_name("leading_edge_rad")[0] == "leading edge"
    assert split_name("Bs_over_Cw")[0] == "Bs/Cw"
    assert split_name("distance_m")[1].symbol == "m"
    label, unit = split_name("gain_per_degc")
    assert (label, unit.symbol) == ("gain with temperature", "1/K")
    assert split_name("Cw") == ("Cw", split_name("Ts")[1])


def test_status_is_marked_and_invalid_values_hidden():
    assert show(Estimate("Cw", 0.2, 0.01, Status.PROVISIONAL)).text() == "0.200 ± 0.010 ~"
    assert show(Estimate("Cw", 0.2, 0.01, Status.INVALID)).text() == f"{MISSING} x"
    assert show(Estimate("speed_mps", 18.0, 0.01, Status.INVALID)).text() == f"{MISSING} km/h x"


def test_sizes_durations_and_shares():
    assert [file_size(n) for n in (0, 999, 1000, 9_994, 99_949, 999_499, 999_600, 12_345_678)] == [
        "0 B",
        "999 B",
        "1.00 kB",
        "9.99 kB",
        "99.9 kB",
        "999 kB",
        "1.00 MB",
        "12.3 MB",
    ]
    assert [duration(s) for s in (0.0, 59.99, 3661.0, -1.0)] == ["0:00:00", "0:00:59", "1:01:01", "0:00:00"]
    assert [percent(*p) for p in ((0, 0), (0, 9), (1, 10**6), (1, 100), (3, 4))] == [
        "0 %",
        "0 %",
        "<0.01 %",
        "1.00 %",
        "75.0 %",
    ]
    assert fixed(None, 1) == MISSING
    assert shown_value("pressure_pa", 210_040.0, 1) == "210.0"
    assert fixed(-0.001, 1) == "0.0"


def test_plain_values_are_those_of_json():
    value = {"nan": math.nan, "array": np.array([[1.0, math.inf]]), "flag": np.bool_(True), "path": "a\udcff"}
    assert plain(value) == {"nan": None, "array": [[1.0, None]], "flag": True, "path": "a\\udcff"}
    assert plain(Unit("deg", 2.0)) == {"symbol": "deg", "factor": 2.0, "offset": 0.0, "decimals": 0}
    assert plain((Reason(WheelCode.NO_SAMPLES),))[0]["code"] == "no_samples"
    with pytest.raises(TypeError, match="no object"):
        plain(object())


def test_values_are_shown_in_the_chosen_units() -> None:
    with shown_in(ShownUnits.US):
        assert show(Estimate("speed_mps", 20.0, 0.2, Status.VALID)).text() == "44.74 ± 0.45 mph"
        assert shown_value("pressure_pa", 220e3, 1) + unit_symbol("pressure_pa") == "31.91psi"
        assert shown_value("temperature_degc", -40.0, 1) + unit_symbol("temperature_degc") == "-40.0°F"
        assert show(Estimate("wear_mm", 1.0, 0.1, Status.VALID)).text() == "1.00 ± 0.10 mm"
    with shown_in(ShownUnits.BAR):
        assert shown_value("pressure_pa", 220e3, 1) + unit_symbol("pressure_pa") == "2.200bar"
    assert show(Estimate("speed_mps", 20.0, 0.2, Status.VALID)).text() == "72.00 ± 0.72 km/h"
