import dataclasses
import math

import pytest

from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.links.reasons import LinkCode
from gateway.core.reasons import CoreCode, Notice, Reason
from gateway.core.text.plain import HEADER_EVERY, LINE_WIDTH, PlainView
from gateway.core.text.wording import text
from gateway.core.wheels.reasons import WheelCode
from gateway.papers.reasons import PaperCode
from gateway.ring.reasons import RingCode


@pytest.fixture
def plain():
    lines: list[str] = []
    view = PlainView(lines.append)
    return view, lines


def is_header(line):
    return line.startswith("wheel")


def test_line_shows_the_measured_values(made, plain):
    view, lines = plain
    view.result(made.result("RL", index=7))
    header, line = lines
    assert line.split() == [
        *("RL", "7", "100.700", "65.000", "538.8", "—", "-13.740±0.097", "13.51±0.10"),
        *("Bs", "(3.083±0.012)e-3", "Cw", "0.1953±0.0012", "Rs", "2.974±0.031", "Ts", "2.529±0.099"),
        *("210.0", "ok"),
    ]
    for title, value in (("rev", "7"), ("km/h", "65.000"), ("begins at deg", "0.097"), ("kPa", "210.0")):
        assert header.index(title) + len(title) == line.index(value, line.index("RL") + 2) + len(value)


def test_line_shows_rotation_and_distance(made, plain):
    view, lines = plain
    measured = made.result("RL")
    rolled = (
        Estimate("rotation_rpm", 538.81, 0.02, Status.VALID),
        Estimate(
            "distance_m", 1234.567, 12.0, Status.PROVISIONAL, (Reason(EstimateCode.DISTANCE_INTERRUPTED, count=1.0),)
        ),
    )
    view.result(dataclasses.replace(measured, estimates=(*measured.estimates, *rolled)))
    header, line = lines
    for title, value in (("rpm", "538.8"), (" m ", "1234.6 ")):
        assert header.index(title) + len(title) == line.index(value) + len(value)


def test_header_returns_every_forty_lines(made, plain):
    view, lines = plain
    for index in range(100):
        view.result(made.result(index=index))
    assert [i for i, line in enumerate(lines) if is_header(line)] == [0, HEADER_EVERY + 1, 2 * (HEADER_EVERY + 1)]


def test_lines_fit_and_columns_stay_aligned(made, plain):
    view, lines = plain
    long_reason = Reason(EstimateCode.UNKNOWN_ESTIMATOR, estimator="a name that is far too long for the line, " * 3)
    results = [
        made.result("FL"),
        made.result("hub12.wheel3", status=Status.PROVISIONAL, reasons=(long_reason,)),
        made.result("a very long name of a wheel that is far too long for any vehicle", load_n=None),
        made.result("左前輪", status=Status.INVALID, reasons=(long_reason,)),
        made.result("FR", faults=(long_reason,)),
    ]
    for result in results:
        view.result(result)
    del lines[:]
    for result in results:  # by now every column has grown to its width
        view.result(result)
    assert all(len(line) <= LINE_WIDTH for line in lines)
    assert len({line.index("210.0") for line in lines if line.isascii() or "左" not in line}) == 1


def test_no_escape_code_no_nan(made, plain):
    view, lines = plain
    estimates = (Estimate("Cw", math.nan, math.nan, Status.VALID), Estimate("speed_mps", math.inf, 0.0, Status.VALID))
    view.result(made.result("\x1b[2Jevil", estimates=estimates))
    view.result(
        made.result(
            status=Status.INVALID, reasons=(Reason(EstimateCode.UNKNOWN_ESTIMATOR, estimator="bad\x07bell\nnext"),)
        )
    )
    view.notice(Notice("hub 1", Reason(LinkCode.QUOTED_TEXT, text="\x1b]0;title\x07\nthen a second line")))
    written = "".join(lines)
    assert written.isprintable()
    assert "nan" not in written
    assert "inf" not in written
    assert lines[-1] == "# hub 1: \\x1b]0;title\\x07\\nthen a second line"


def test_long_reason_is_written_in_full_once(made, plain):
    view, lines = plain
    for count in range(3):
        reason = Reason(RingCode.RING_DOES_NOT_FIT, residual=0.6 + 0.1 * count, limit=0.5)
        view.result(made.result(index=count, status=Status.PROVISIONAL, reasons=(reason,)))
    full = [line for line in lines if line.startswith("# ")]
    assert full == [f"# FL rev 0: {text(Reason(RingCode.RING_DOES_NOT_FIT, residual=0.6, limit=0.5))}"]
    assert all(" ~  the model of the tire does not" in line for line in lines if line.startswith("FL"))


def test_remark_on_valid_numbers_is_written_once(made, plain):
    view, lines = plain
    for position in ("FL", "FR", "FL"):
        view.result(made.result(position, reasons=(Reason(PaperCode.LINEAR_RING),)))
    assert [line for line in lines if line.startswith("#")] == [f"# FL rev 12: {text(Reason(PaperCode.LINEAR_RING))}"]
    assert all(line.endswith(" ok") for line in lines if line.startswith("F"))


def test_usual_reasons_fit_the_last_column(made, plain):
    view, lines = plain
    undetermined = Reason(CoreCode.NOT_DETERMINED, relative_error=0.36)
    old, settling = (
        Reason(WheelCode.PRESSURE_OLD, age_s=12.0),
        Reason(CoreCode.NOT_SETTLED, revolutions=3.0, needed=8.0),
    )
    for reason in (settling, old, undetermined):
        view.result(made.result(status=Status.PROVISIONAL, reasons=(reason,)))
        line = next(line for line in reversed(lines) if not line.startswith("#"))
        assert text(reason) in line, line


def test_ratios_are_named_as_such(made, plain):
    view, lines = plain
    view.result(made.result(load_n=None))
    assert "Bs/Cw 0.01579±0.00016" in lines[1]
    assert "ok ratios only" in lines[1]
    assert text(made.needs_load) in lines[2]


def test_differing_marks_are_at_the_numbers(made, plain):
    view, lines = plain
    estimates = (
        Estimate("Cw", 0.1953, 0.0012, Status.VALID),
        Estimate("Ts", 2.5, 2.6, Status.PROVISIONAL, (Reason(CoreCode.NOT_DETERMINED, relative_error=1.04),)),
    )
    view.result(made.result(estimates=estimates))
    assert "Cw 0.1953±0.0012 " in lines[1]
    assert "Ts 2.5±2.6~" in lines[1]


def test_missing_load_is_said_with_the_first_line_of_a_wheel_only(made, plain):
    view, lines = plain
    for position in ("FL", "FR"):
        for index in range(3):
            view.result(made.result(position, index=index, load_n=None))
    for position in ("FL", "FR"):
        selected = [line for line in lines if line.startswith(position)]
        assert ["ratios only" in line for line in selected] == [True, False, False]
