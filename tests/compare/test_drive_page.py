"""The page of a drive: self-contained, escaped, and with what each wheel did."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from gateway.compare.views.drive import MOST_POINTS, Drive, DriveWheel
from gateway.compare.views.drive_page import begin_ns, drawn_quantities, drive_page, lines_of
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.reasons import Code, Notice, Reason

HOSTILE = "<script>alert('x')</script>\x1b[2J"
DOUBT = Reason(Code.NEEDS_LOAD)


@pytest.fixture
def make_drive(made):
    def make(revolutions: int, name: str = "a.mcap", position: str = "FL") -> Drive:
        drive = Drive(name)
        for index in range(revolutions):
            estimates = (
                Estimate("Cw", 0.1953, 0.0012, Status.PROVISIONAL if index % 2 else Status.VALID),
                Estimate.invalid("Rs", DOUBT),
                Estimate("speed_mps", 10.0 + index, 0.01, Status.VALID),
            )
            result = made.result(position=position, index=index, estimates=estimates)
            drive.add(replace(result, host_ns=10**18 + index * 10**8))
        return drive

    return make


def test_page_is_self_contained_and_escapes_names(make_drive):
    drive = make_drive(5, name=HOSTILE, position=HOSTILE)
    drive.finish((), (), (Notice(HOSTILE, DOUBT),))
    page = drive_page([drive])
    assert "<script" not in page
    assert "\x1b" not in page
    assert not re.findall(r'(?:src|href)="(?!#)', page)
    assert page.count("<svg") == 2
    assert "2001-09-09 01:46:40 UTC" in page


def test_page_shows_means_what_varies_and_why_a_value_is_missing(make_drive):
    page = drive_page([make_drive(21)])
    assert "0.1953 ± 0.0012" in page
    assert "FL, speed: varies within the recording by far more" in page
    assert re.search(r">Rs</th><td class=\"n none\">—<", page)
    assert "FL, Rs: " in page
    assert "is drawn" not in page


def test_page_says_what_is_stated_of_the_run():
    page = drive_page([Drive("a.mcap", ["test: braking <7>", "driver: M. Kurz"])])
    assert "<br>test: braking &lt;7&gt;<br>driver: M. Kurz</p>" in page


def test_page_without_a_revolution_says_so():
    drive = Drive("a.mcap")
    page = drive_page([drive])
    assert "No revolution was completed." in page


def test_lines_have_gaps_where_an_estimate_is_invalid(made):
    drive = Drive("a.mcap")
    for index in range(4):
        estimate = Estimate.invalid("Cw", DOUBT) if index == 2 else Estimate("Cw", 0.2, 0.01, Status.VALID)
        drive.add(made.result(index=index, estimates=(estimate,)))
    assert drawn_quantities(drive) == ["Cw"]
    (line,) = lines_of(drive, "Cw", begin_ns(drive))
    assert [math.isnan(value) for value in line.value] == [False, False, True, False]
    assert line.is_valid.tolist() == [True, True, False, True]


def with_silence(made, revolutions: int, silent_after: int, *, reason: Reason | None = None) -> Drive:
    """Return a drive at 0.1 s a revolution with a silence of 35 s after one of them."""
    drive = Drive("a.mcap")
    for index in range(revolutions):
        status = Status.VALID if reason is None or index <= silent_after else Status.PROVISIONAL
        doubts = () if status is Status.VALID else (reason,)
        estimates = (Estimate("Cw", 0.2, 0.01, Status.VALID), Estimate("distance_m", 2.0 * index, 12.0, status, doubts))
        result = made.result(index=index, estimates=estimates)
        start_s = 0.1 * index + 35.0 * (index > silent_after)
        revolution = replace(
            result.revolution, start_s=start_s, period_s=0.1, follows=index not in (0, silent_after + 1)
        )
        drive.add(replace(result, revolution=revolution, host_ns=10**18 + round((start_s + 0.1) * 1e9)))
    return drive


@pytest.mark.parametrize("revolutions", [40, MOST_POINTS + 1, 3 * MOST_POINTS + 5])
@pytest.mark.parametrize("silent_after", [0, 17, 18, 19, 20, 31])
def test_no_line_is_drawn_through_a_silence(made, revolutions, silent_after):
    drive = with_silence(made, revolutions, silent_after)
    (line,) = lines_of(drive, "Cw", begin_ns(drive))
    (gap,) = np.flatnonzero(np.isnan(line.value))
    assert line.time_s[gap + 1] - line.time_s[gap - 1] > 35.0
    assert np.diff(np.delete(line.time_s, gap)).min() > 0.0
    assert not line.is_valid[gap]


def test_page_and_terminal_say_the_same_of_a_distance_that_was_bridged(made):
    bridged = Reason(Code.DISTANCE_BRIDGED, duration_s=35.0, distance_m=833.0, std_m=180.0)
    page = drive_page([with_silence(made, 50, 20, reason=bridged)])
    assert re.search(r">distance</th><td class=\"n\">98 ± 12 m ~<", page)
    assert "FL, distance: 35.0 s without revolutions bridged at the mean speed: 833.0 m ± 180.0 m" in page
    assert '>distance</th><td class="n">98 ± 12 m<' in drive_page([with_silence(made, 50, 20)])


@pytest.mark.parametrize("revolutions", [MOST_POINTS, MOST_POINTS + 1, 5 * MOST_POINTS + 7])
def test_points_are_few_evenly_spaced_and_from_the_first_revolution(made, revolutions):
    wheel, result = DriveWheel(), made.result()
    for index in range(revolutions):
        wheel.add(replace(result, host_ns=1 + index))
    numbers = [point.time_ns - 1 for point in wheel.points]
    assert numbers == list(range(0, revolutions, wheel.stride))
    assert MOST_POINTS // 2 <= len(numbers) <= MOST_POINTS
