import re
from dataclasses import replace

import pytest

from gateway.core.reasons import Reason
from gateway.core.text.text import width
from gateway.core.wheels.reasons import WheelCode
from gateway.diagnosis.bayes.parameter_estimates import fitted_parameter
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Drift, Fitted, TireState, Verdict
from gateway.diagnosis.views.diagnosis_json import diagnosis_json
from gateway.diagnosis.views.html import diagnosis_html
from gateway.diagnosis.views.phrases import remark
from gateway.diagnosis.views.quantities import show_fitted, significant, span_text, typeset
from gateway.diagnosis.views.terminal import LINE_WIDTH, closure_summary_lines
from tests.testkit.diagnosis_data import empty, nasty, ordinary, undrawn


@pytest.mark.parametrize("make", [ordinary, nasty, empty])
def test_lines_fit_the_terminal_and_are_printable(make):
    lines = closure_summary_lines(make())
    assert 4 <= len(lines) <= 16
    for line in lines:
        assert width(line) <= LINE_WIDTH
        assert line.isprintable()


def test_summary_lists_findings():
    text = "\n".join(closure_summary_lines(ordinary()))
    assert text.startswith("FL: the exact ring against 1240 revolutions of 4 recordings, 12 left out\n")
    assert "12.31 m/s² before, 2.10 m/s² after" in text
    assert "2.05 m/s²; after / noise floor 1.02" in text
    assert "mounting offset: 5.02±0.11 mm " in text
    assert "gain drift or run-out" in text
    assert text.count("gain drift") == 1, "confounders share a line"
    assert "to decide: record again with the tire 20 K warmer" in text
    assert "606.0 to 614.5 Hz" in text
    assert "Bs (2.610±0.011)e-3 -> (2.8340±0.0070)e-3" in text
    assert "Ts 2.95±0.12 -> 2.41±0.90" in text
    assert "not determined: Ts (load assumed; state it)" in text
    assert "clipping" not in text


def test_summary_without_findings():
    text = "\n".join(closure_summary_lines(empty()))
    assert "nothing: no effect has sufficient evidence" in text
    assert "nothing that repeats with the wheel exceeds the noise;" in text
    text = "\n".join(closure_summary_lines(replace(empty(), complete=False)))
    assert "nothing: the search ended before it was complete" in text
    text = "\n".join(closure_summary_lines(replace(empty(), spectra=ordinary().spectra)))
    assert "nothing exceeds the noise" in text


def test_many_findings_are_counted():
    diagnosis = ordinary()
    many = tuple(replace(diagnosis.findings[0], name=f"effect {index}") for index in range(9))
    remainder = diagnosis.unexplained * 3
    lines = closure_summary_lines(replace(diagnosis, findings=many, unexplained=remainder, notes=("a", "b", "c")))
    assert len(lines) <= 16
    text = "\n".join(lines)
    assert "(and 5 more)" in text
    assert "(+4)" in text
    assert lines[-1].strip() == "and 1 more note: all are in --json and --html"


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"load_known": True, "pressure_known": False}, "pressure assumed; state it"),
        ({"pressure_known": False}, "load and pressure assumed; state them"),
        ({"load_known": True}, "standard error above 30 %; record longer, or at more loads"),
    ],
)
def test_undetermined_estimates_have_reason_and_remedy(changes, reason):
    text = " ".join(line.strip() for line in closure_summary_lines(replace(ordinary(), **changes)))
    assert f"not determined: Ts ({reason})" in text


def test_undetermined_beside_much_that_is_unexplained():
    sure = replace(ordinary(), load_known=True, determined={"Bs": False})
    noted = Reason(DiagnosisCode.EVIDENCE_TEMPERED, axes=("circumferential", "radial"), residual_ratio=12.0)
    text = " ".join(line.strip() for line in closure_summary_lines(replace(sure, notes=(noted,))))
    assert "not determined: Bs (too uncertain beside what is left unexplained: see the notes)" in text
    assert (
        "evidence from circumferential, radial counts less: what is left unexplained there has 12 times the rms" in text
    )
    noted = Reason(DiagnosisCode.EVIDENCE_TEMPERED, axes=("lateral",), residual_ratio=12.0)
    text = " ".join(line.strip() for line in closure_summary_lines(replace(sure, notes=(noted,))))
    assert "too uncertain" not in text


def test_undetermined_despite_small_error():
    sure = replace(ordinary(), load_known=True)
    sure = replace(sure, estimates_after={**sure.estimates_after, "Ts": Fitted(2.41, 0.09)})
    lines = closure_summary_lines(replace(sure, determined={"Bs": False}))
    assert "too small to be measured" in " ".join(line.strip() for line in lines)


def test_undetermined_for_two_causes():
    sure = replace(ordinary(), load_known=True)
    sure = replace(sure, estimates_after={**sure.estimates_after, "Bs": Fitted(1e-5, 1e-6)})
    text = " ".join(map(str.strip, closure_summary_lines(replace(sure, determined={"Bs": False, "Ts": False}))))
    assert "not determined: Bs, Ts (standard error above 30 %; record longer, or at more loads; Bs: too small" in text


def test_undetermined_because_recordings_contradict():
    note = Reason(DiagnosisCode.CONTACTS_CONTRADICT, short="a.mcap", short_rad=0.22, long="b.mcap", long_rad=0.27)
    diagnosis = replace(ordinary(), notes=(note,), determined={"Bs": False})
    text = " ".join(map(str.strip, closure_summary_lines(diagnosis)))
    assert "not determined: Bs (the recordings contradict each other: see the notes)" in text
    assert "the contact half angle is 12.6 deg in a.mcap, 15.5 deg in b.mcap" in text


def test_probable_effects_are_in_the_summary():
    """The error after contains them: it must not be credited to others."""
    probable = replace(ordinary().findings[0], name="ply steer", verdict=Verdict.REFUSED, probability=0.83)
    text = " ".join(map(str.strip, closure_summary_lines(replace(ordinary(), findings=(probable,)))))
    assert "not certain  ply steer (probability 0.83): in the error after, but not identified" in text
    nearly = replace(probable, probability=0.98938)
    text = " ".join(map(str.strip, closure_summary_lines(replace(ordinary(), findings=(nearly,)))))
    assert "ply steer (probability 0.989): in the error" in text
    rare = replace(probable, probability=0.3)
    assert "not certain" not in "\n".join(closure_summary_lines(replace(ordinary(), findings=(rare,))))


def test_implausible_effect_that_would_fit_better_is_in_the_summary():
    why = Reason(
        DiagnosisCode.IMPLAUSIBLE_PARAMETER, parameter="inertia_kgm", value=1308.33, low=0.0, high=1000.0, unit="mg m"
    )
    result = replace(
        ordinary().findings[0], name="rotary inertia", verdict=Verdict.REFUSED, probability=0.0, reason=why
    )
    missing = replace(ordinary(), findings=(result,), noise_floor_mps2=1.8)
    text = " ".join(map(str.strip, closure_summary_lines(missing)))
    expected = "rejected     rotary inertia: inertia would be 1308 mg m, outside its plausible range"
    assert expected in text
    rare = replace(result, reason=Reason(DiagnosisCode.PROBABILITY_TOO_LOW, probability=0.1, needed=0.99))
    spectral = replace(result, lock="time")
    none = [replace(missing, findings=(item,)) for item in (rare, spectral)]
    for other in (*none, replace(missing, noise_floor_mps2=2.05)):
        assert "rejected  " not in "\n".join(closure_summary_lines(other))


def test_effect_that_the_exact_ring_does_not_confirm_is_in_the_summary():
    why = Reason(DiagnosisCode.NOT_ON_EXACT_RING, effect="gain-temperature drift", errors=0.3)
    result = replace(
        ordinary().findings[0], name="gain-temperature drift", verdict=Verdict.REFUSED, probability=0.999, reason=why
    )
    text = " ".join(map(str.strip, closure_summary_lines(replace(ordinary(), findings=(result,)))))
    assert "rejected     gain-temperature drift: it is not there with the equations of large deformations" in text
    assert "gain-temperature drift is 0.3 errors from zero" in text
    assert "not certain" not in text


def test_non_stationary_and_unknown_lock_are_marked():
    diagnosis = ordinary()
    line, wave = diagnosis.unexplained
    remainder = (replace(wave, changes=True), replace(line, lock_known=False))
    text = "\n".join(closure_summary_lines(replace(diagnosis, unexplained=remainder)))
    assert "orders 18 to 60, 81.4 to 90.5 deg  0.840±0.050 m/s²\n               changes during the recording\n" in text
    assert "1.210±0.060 m/s²\n               time-locked or angle-locked: not known\n" in text


def test_drift_replaces_the_mark_of_a_change():
    wave = replace(undrawn().unexplained[1], changes=True)
    rate, begin, end = Fitted(-0.5, 0.02), Fitted(0.03, 1e-3), Fitted(-0.03, 1e-3)
    shown = [replace(fitted, factor=100.0, display_unit="%") for fitted in (rate, begin, end)]
    drifts = tuple(Drift("load", "load", label, *shown, ("pressure",)) for label in ("first", "second"))
    diagnosis = replace(undrawn(), unexplained=(replace(wave, drifts=drifts),))
    text = " ".join(" ".join(closure_summary_lines(diagnosis)).split())
    drift = "drift of load or pressure: -50.0 ± 2.0 % per minute, from 3.00 ± 0.10 % to -3.00 ± 0.10 % in first"
    assert f"{drift} (+1)" in text
    assert "changes during the recording" not in text
    (entry,) = diagnosis_json(diagnosis)["unexplained"]
    assert [(each["group"], each["end"]["value"]) for each in entry["drifts"]] == [("first", -0.03), ("second", -0.03)]
    assert drift in diagnosis_html(diagnosis)


def test_share_names_its_reference():
    finding = replace(
        ordinary().findings[0],
        name="gravity",
        parameters={"gravity_share": fitted_parameter(catalogue()["gravity"].parameters[0], 0.9923, 0.0029)},
    )
    text = "\n".join(closure_summary_lines(replace(ordinary(), findings=(finding,))))
    assert "gravity: 0.9923±0.0029 of known size" in text


def test_wide_terminal_shows_more():
    diagnosis = replace(ordinary(), notes=("words " * 30,))
    narrow, wide = closure_summary_lines(diagnosis), closure_summary_lines(diagnosis, 120)
    assert max(map(width, narrow)) <= 80
    assert 80 < max(map(width, wide)) <= 120
    assert closure_summary_lines(diagnosis, 40) == narrow
    assert closure_summary_lines(diagnosis, 500) == wide
    assert narrow[-2].endswith("words"), "broken between words"
    assert narrow[-1].endswith("words")
    assert " ".join(narrow).count("words") == 30, "whole"


def test_notes_that_decide_are_whole_and_first():
    inner = Reason(DiagnosisCode.SENSOR_ALARM, reason=Reason(WheelCode.RADIAL_CLIPPED))
    alarms = tuple(Reason(DiagnosisCode.ABOUT_RECORDING, recording=f"{name}.mcap", reason=inner) for name in "abc")
    diagnosis = replace(ordinary(), notes=("first", "second", *alarms))
    lines = closure_summary_lines(diagnosis)
    shown = [line for line in lines if line.startswith("  note")]
    assert [line.split()[1] for line in shown] == ["a.mcap:", "b.mcap:", "c.mcap:"]
    assert "and 2 more notes" in lines[-1]
    whole = closure_summary_lines(diagnosis, has_all_notes=True)
    assert [line.split()[1] for line in whole if line.startswith("  note")][3:] == ["first", "second"]
    assert "more note" not in "\n".join(whole)


def test_path_that_is_longer_than_a_line_is_whole():
    path = "/data/" + 30 * "recorded/" + "a.mcap"
    lines = closure_summary_lines(replace(ordinary(), notes=(f"of {path}: clipped",)), has_all_notes=True)
    assert max(map(width, lines)) <= LINE_WIDTH
    assert path in "".join(line.strip() for line in lines)


def test_parameters_are_whole_or_counted():
    diagnosis = ordinary()
    many = {f"order_{index}": Fitted(20.0 + index, 0.5) for index in range(9)}
    finding = replace(diagnosis.findings[0], name="waves", parameters=many)
    text = "\n".join(closure_summary_lines(replace(diagnosis, findings=(finding,))))
    assert "waves: order 0 20.00±0.50 and 8 more parameters  11.2 m/s²" in text
    short = replace(finding, parameters={"a": Fitted(1.0, 0.5), "b_" + "c_" * 40 + "d": Fitted(1.0, 0.5)})
    text = "\n".join(closure_summary_lines(replace(diagnosis, findings=(short,))))
    assert "waves: a 1.00±0.50 and 1 more parameter  11.2 m/s²" in text
    steer = {"coupling_length_m": Fitted(1.2245e-3, 3.4e-6, "m"), **dict.fromkeys(("u", "v", "w"), Fitted(1.0, 0.5))}
    lines = closure_summary_lines(replace(diagnosis, findings=(replace(finding, name="ply steer", parameters=steer),)))
    assert "ply steer: coupling length 1.2245±0.0034 mm and 3 more  11.2 m/s²" in "\n".join(lines)
    finding = replace(finding, name="waves " * 9 + "x")
    text = "\n".join(closure_summary_lines(replace(diagnosis, findings=(finding,))))
    assert "±0.50" not in text


def test_increased_error_and_undecided_effects():
    diagnosis = ordinary()
    grown = replace(diagnosis, held_out=replace(diagnosis.held_out, rms_after_mps2=14.0))
    assert "14.00 m/s² after (increased)" in "\n".join(closure_summary_lines(grown))
    text = "\n".join(closure_summary_lines(replace(diagnosis, findings=diagnosis.findings[3:5])))
    assert "nothing: these data do not decide" in text


def test_angles_in_degrees_display_units_kept():
    diagnosis = ordinary()
    tilts = {"tilt_rad": Fitted(0.02, 0.001, "rad"), "shift_rad": Fitted(3.0, 0.1, "deg")}
    finding = replace(diagnosis.findings[0], name="tilt", parameters=tilts)
    text = "\n".join(closure_summary_lines(replace(diagnosis, findings=(finding,))))
    assert "tilt 1.146±0.057 deg, shift 3.00±0.10 deg" in text


@pytest.mark.parametrize(
    ("name", "fitted", "label", "text"),
    [
        ("length_squared_m2", Fitted(0.88, 0.14, "mm^2"), "length squared", "0.88 ± 0.14 mm²"),
        ("compliance_pn", Fitted(0.206, 0.011, "1/MN"), "compliance", "0.206 ± 0.011 1/MN"),
        ("drift_per_k", Fitted(0.021, 0.004, "%/K"), "drift", "0.0210 ± 0.0040 %/K"),
        ("rms_mps2", Fitted(4.8, 0.2, "m/s^2"), "rms", "4.80 ± 0.20 m/s²"),
        ("offset_m", Fitted(0.005, 0.0001, "m"), "offset", "5.00 ± 0.10 mm"),
        ("offset_m", Fitted(5.0, 0.1, "mm"), "offset", "5.00 ± 0.10 mm"),
        ("half_angle_rad", Fitted(0.24, 0.001, ""), "half angle", "13.751 ± 0.057 deg"),
        ("bending_ln", Fitted(0.2, 0.1), "ln bending", "0.20 ± 0.10"),
        (
            "half_angle_rad (3500 N, 210 kPa)",
            Fitted(0.24, 0.001, "rad", quantity="half_angle_rad", state=TireState(3500.0, 210e3)),
            "half angle (3500 N, 210 kPa)",
            "13.751 ± 0.057 deg",
        ),
        (
            "stiffness_npm2 (3500 N, 210 kPa)",
            Fitted(3.0, 0.1, "N/m^2", quantity="stiffness_npm2", state=TireState(3500.0, 210e3)),
            "stiffness (3500 N, 210 kPa)",
            "3.00 ± 0.10 N/m²",
        ),
        ("before_order", Fitted(92.9, 0.4), "before contact: order", "92.90 ± 0.40"),
        ("Bs", Fitted(float("nan"), 1.0), "Bs", "—"),
        ("zero_mps2", Fitted(300.0, 0.0, "m/s^2", 1 / 9.80665, "g"), "zero", "30.59 g"),
    ],
)
def test_labels_and_units(name, fitted, label, text):
    shown = show_fitted(name, fitted)
    assert (shown.label, shown.joined()) == (label, text)


@pytest.mark.parametrize(
    ("typed", "printed"),
    [
        ("R omega^2, 3 +- 1 m/s^2", "R ω², 3 ± 1 m/s²"),
        ("omega^2.4, omega^20, omega^3, omega^2. And", "ω^2.4, ω^20, ω³, ω². And"),
        ("dtheta, d theta, omega_dot", "dθ, d θ, ω_dot"),
        ("alphabet, somega, thetas, pitch", "alphabet, somega, thetas, pitch"),
        ("2 / (pi width), 2 pi corner", "2 / (π width), 2 π corner"),
        ("error * a\x1b[2J", "error · a [2J"),
    ],
)
def test_typesetting(typed, printed):
    assert typeset(typed) == printed


def test_a_remark_keeps_paths_and_psi():
    assert remark("/home/pi/beta_1.mcap: 31.9 psi +- 1 m/s^2") == "/home/pi/beta_1.mcap: 31.9 psi ± 1 m/s²"


@pytest.mark.parametrize(
    ("name", "value", "std", "label", "text"),
    [
        ("clipping", 458.6e-6, 0.4586e-6, "limit", "222.35 ± 0.22 g"),
        ("anti-alias filter", 0.693e-3, 0.00693e-3, "corner", "1443 ± 14 Hz"),
        ("anti-alias filter", 0.01e-3, 0.00693e-3, "inverse corner", "0.0100 ± 0.0069 ms"),
        ("anti-alias filter", -0.1e-3, 0.00693e-3, "inverse corner", "-0.1000 ± 0.0069 ms"),
        ("mounting resonance", 0.0395786e-6, 0.000791572e-6, "resonance", "800.0 ± 8.0 Hz"),
        ("mounting resonance", 0.001e-6, 0.002e-6, "inverse resonance", "(1.0 ± 2.0)e-3 ms²"),
    ],
)
def test_inverse_parameters_are_inverted_when_significant(name, value, std, label, text):
    parameter = catalogue()[name].parameters[0]
    shown = show_fitted(parameter.name, fitted_parameter(parameter, value, std))
    assert (shown.label, shown.joined()) == (label, text)


@pytest.mark.parametrize("effect", catalogue().values(), ids=lambda effect: effect.name)
def test_equations_are_mathematics_not_code(effect):
    assert not re.search(r"[+*-]=|->|\*\*|\bOmega\b|d2", effect.equation)
    for parameter in effect.parameters:
        if "_" in parameter.name:
            assert parameter.name not in effect.equation


@pytest.mark.parametrize(
    ("span", "text"),
    [
        ((606.0, 614.5), "606.0 to 614.5"),
        ((3.0, 3.0), "3.000"),
        ((0.0, 1500.0), "0 to 1500"),
        ((float("nan"), 1.0), "—"),
    ],
)
def test_ranges(span, text):
    assert span_text(span) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0.00"), (12.31, "12.3"), (41230.0, "41230"), (0.151, "0.151"), (1e-9, "1.00e-09"), (float("inf"), "—")],
)
def test_numbers_without_error(value, text):
    assert significant(value) == text


def test_whole_number_is_shown_without_error() -> None:
    order = catalogue()["torsional ripple"].parameters[2]
    assert show_fitted(order.name, fitted_parameter(order, 12.0, order.step)).joined() == "12 per revolution"
