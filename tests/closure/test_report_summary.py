from __future__ import annotations

from dataclasses import replace

import pytest

from gateway.closure.diagnosis import Fitted
from gateway.views.closure_summary import LINE_WIDTH, closure_summary_lines
from gateway.views.text import width
from tests.closure.diagnosis_data import empty, nasty, ordinary


@pytest.mark.parametrize("make", [ordinary, nasty, empty])
def test_lines_fit_the_terminal_and_command_nothing(make):
    lines = closure_summary_lines(make())
    assert 4 <= len(lines) <= 16
    for line in lines:
        assert width(line) <= LINE_WIDTH
        assert line.isprintable()


def test_the_summary_says_what_was_found():
    text = "\n".join(closure_summary_lines(ordinary()))
    assert text.startswith("FL: the exact ring against 1240 revolutions of 4 recordings, 12 left out\n")
    assert "12.31 m/s² before, 2.10 m/s² after" in text
    assert "2.05 m/s²; after / floor 1.02" in text
    assert "mounting offset: 5.02±0.11 mm " in text
    assert "gain drift or run-out" in text
    assert text.count("gain drift") == 1, "rivals share a line"
    assert "to decide: a recording at another temperature" in text
    assert "606.0 to 614.5 Hz" in text
    assert "Bs (2.610±0.011)e-3 -> (2.8340±0.0070)e-3" in text
    assert "Ts 2.95±0.12 -> 2.41±0.90 (not determined)" in text
    assert "clipping" not in text


def test_nothing_found_is_said():
    text = "\n".join(closure_summary_lines(empty()))
    assert "nothing: no effect of the catalogue has evidence enough" in text
    assert "nothing above the noise" in text


def test_many_findings_are_counted_not_listed():
    diagnosis = ordinary()
    many = tuple(replace(diagnosis.findings[0], name=f"effect {index}") for index in range(9))
    left = diagnosis.unexplained * 3
    lines = closure_summary_lines(replace(diagnosis, findings=many, unexplained=left, notes=("a", "b", "c")))
    assert len(lines) <= 16
    text = "\n".join(lines)
    assert "(and 5 more)" in text
    assert "(and 4 more)" in text
    assert "b (and 1 more)" in text


def test_an_angle_is_shown_in_degrees_and_a_display_unit_is_kept():
    diagnosis = ordinary()
    tilts = {"tilt_rad": Fitted(0.02, 0.001, "rad"), "shift_rad": Fitted(3.0, 0.1, "deg")}
    finding = replace(diagnosis.findings[0], name="tilt", parameters=tilts)
    text = "\n".join(closure_summary_lines(replace(diagnosis, findings=(finding,))))
    assert "tilt 1.146±0.057 deg, shift 3.00±0.10 deg" in text
