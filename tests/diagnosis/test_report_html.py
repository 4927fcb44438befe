import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from gateway.core.reasons import Reason
from gateway.core.revolutions.order_spectrum import ORDER_COUNT
from gateway.core.revolutions.order_spectrum import order_coefficients as reference_coefficients
from gateway.diagnosis.angle import likelihood
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import AxisError, Finding, Fitted, HeldOut, SingleSize, TireState, Verdict
from tests.testkit.diagnosis_data import NASTY, WARMER, curves, empty, nasty, ordinary, trends, undrawn

pytest.importorskip("matplotlib", reason="matplotlib (extra 'plot') is not installed")
pytest.importorskip("jinja2", reason="jinja2 (extra 'plot') is not installed")

from gateway.core.shown_units import ShownUnits, shown_in
from gateway.core.text.page_figure import inline_svg, report_style
from gateway.diagnosis.views import html
from gateway.diagnosis.views.figures import order_coefficients, orders_figure, trend_figure, waveform_figure
from gateway.diagnosis.views.html import chapters, diagnosis_html
from gateway.diagnosis.views.phrases import Kind, effect_kind, reason_text
from gateway.diagnosis.views.quantities import reference_group
from gateway.diagnosis.views.report_tables import (
    by_state,
    estimate_rows,
    omissions,
    sizes_alone,
    sizes_drawn,
    unexplained_rows,
)
from gateway.diagnosis.views.terminal import closure_summary_lines

VOID = {"meta", "br", "img", "link", "input", "hr"}


class Page(HTMLParser):
    """Elements, attributes and text of a page; fails when an element is not closed properly."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.text = ""
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, name, value or "") for name, value in attrs]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def test_tables_hold_all_numbers(page_text):
    page = Page(page_text)
    for words in (
        "12.3", "2.10", "2.05", "1.02",  # errors
        "mounting offset", "5.02 ± 0.11 mm", "> 0.999", "41230",
        "structural damping", "cavity resonance",
        "undecided", "record again with the tire 20 K warmer",
        "clipping", "limit would be 9000 m/s², outside its plausible range of 0 to 2000 m/s²",
        "606.0 to 614.5", "1.210 ± 0.060", "81.4 to 90.5",
        "(2.610 ± 0.011)e-3", "(2.8340 ± 0.0070)e-3", "13.762 ± 0.023",
        "drum-40kmh.mcap", "load 4000 N", "12 revolutions are not used",
    ):  # fmt: skip
        assert words in page.text, words


def test_reasons_use_the_labels_of_the_table():
    refused = Finding(
        "contact edge scatter",
        Verdict.REFUSED,
        {"leading_m": Fitted(0.03, 0.001, "m", 1e3, "mm")},
        chi2=1.0, rms_mps2=1.0, lock="contact",
        reason=Reason(
            DiagnosisCode.IMPLAUSIBLE_PARAMETER, parameter="leading_m", value=30.0, low=0.0, high=20.0, unit="mm"
        ),
    )  # fmt: skip
    pure = Reason(DiagnosisCode.IMPLAUSIBLE_PARAMETER, parameter="roll_off", value=0.56, low=1.0, high=2.0, unit="")
    inverse = Reason(
        DiagnosisCode.IMPLAUSIBLE_PARAMETER,
        parameter="inverse_limit_s2pm",
        value=0.02,
        low=0.0,
        high=0.01,
        unit="s^2/m",
    )
    results = [refused, *(replace(refused, reason=reason) for reason in (pure, inverse))]
    assert [reason_text(finding.reason) for finding in results] == [
        "leading edge would be 30 mm, outside its plausible range of 0 to 20 mm",
        "roll-off would be 0.56, outside its plausible range of 1 to 2",
        "inverse limit would be 0.02 s²/m, outside its plausible range of 0 to 0.01 s²/m",
    ]


def test_revolutions_not_held_out_are_counted():
    every = undrawn()
    assert "1240 revolutions in all." in diagnosis_html(every)
    fewer = replace(every, held_out=replace(every.held_out, revolutions=1230))
    assert "1230 of the 1240 revolutions in all." in diagnosis_html(fewer)


def test_noise_floor_definition_matches_the_likelihood():
    text = diagnosis_html(empty())
    assert f"{1e5 * likelihood._OWN_SHARE:.0f}/100,000 of the signal" in text


def test_unexplained_residuals_are_listed_once():
    columns = [(row.remark, row.scaling) for row in unexplained_rows(ordinary())]
    assert columns == [("at the same frequency at every speed; also 0.3 m/s² radial", "constant"), ("", "ω²")]
    moving = replace(ordinary().unexplained[0], orders=(12, 13), speeds=None)
    text = diagnosis_html(replace(empty(), unexplained=(moving,)))
    assert Page(text).text.count("rises with the wheel's, but it does not repeat every turn") == 1
    remainder = (replace(moving, lock_known=False), replace(ordinary().unexplained[1], changes=True))
    rows = unexplained_rows(replace(empty(), unexplained=remainder))
    assert [row.lock for row in rows] == ["not known", "wheel angle"]
    assert "time-locked, or angle-locked" in rows[0].remark
    assert rows[1].remark.startswith("changes during the recording")
    text = Page(diagnosis_html(replace(empty(), unexplained=ordinary().unexplained[1:]))).text
    assert "repeats every revolution" not in text
    assert "Remarks" not in text, "no empty column"


def test_undecided_effects_are_in_summary_and_omissions():
    first, second, *_ = ordinary().findings
    unsure = replace(second, verdict=Verdict.INDISTINGUISHABLE, rivals=("run-out", "gain"), decide_with=WARMER)
    answer = Page(diagnosis_html(replace(empty(), findings=(unsure,), held_out=HeldOut(4.0, 2.05, 40, 4)))).text
    assert "The model needs structural damping, run-out or gain; these data do not distinguish them." in answer
    assert "from 4.00 to 2.05 m/s²" in answer
    assert "sufficient evidence" not in answer
    assert "Do not rely" not in answer
    answer = Page(diagnosis_html(replace(empty(), findings=(first,), held_out=HeldOut(2.0, 4.0, 40, 4)))).text
    assert "the error on unseen revolutions increases from 2.00 to 4.00" in answer
    assert "Do not rely on the effects" in answer
    answer = Page(diagnosis_html(replace(empty(), complete=False))).text
    assert "No effect is identified: the search ended at its time limit." in answer
    likely = tuple(replace(second, name=name, verdict=Verdict.REFUSED, probability=0.8) for name in ("gain", "run-out"))
    text = Page(diagnosis_html(replace(empty(), complete=False, findings=likely))).text
    assert "With gain and run-out, which are likely so far, the error" in text
    assert text.count("No effect is identified: the search ended at its time limit.") == 2
    assert not any(word in text for word in ("not certain", "Rejected effects", "not identified", "acceptance test,"))
    note = Reason(DiagnosisCode.CONTACTS_CONTRADICT, short="a.mcap", short_rad=0.22, long="b.mcap", long_rad=0.27)
    answer = Page(diagnosis_html(replace(empty(), notes=(note,)))).text
    assert (
        "Load, pressure or tire is not as stated: the contact half angle is 12.6 deg in a.mcap, 15.5 deg in b.mcap."
        in answer
    )
    lasting = replace(first, lock="time")
    answer = Page(diagnosis_html(replace(empty(), findings=(lasting,), held_out=HeldOut(4.0, 2.0, 40, 4)))).text
    assert "The error on unseen revolutions is 2.00 m/s² rms" in answer
    assert "With this effect" not in answer
    probable = replace(second, name="ply steer", verdict=Verdict.REFUSED, probability=0.83)
    held_out = HeldOut(4.0, 2.0, 40, 4)
    answer = Page(diagnosis_html(replace(empty(), findings=(lasting, probable), held_out=held_out))).text
    assert "With ply steer, which is not certain, the error on unseen revolutions falls from 4.00 to 2.00" in answer
    answer = Page(diagnosis_html(replace(empty(), findings=(first, probable), held_out=held_out))).text
    assert "With this effect and ply steer, which is not certain, the error on unseen revolutions falls" in answer
    shuffled = replace(ordinary(1), findings=(second, replace(first, verdict=Verdict.INDISTINGUISHABLE)))
    names, rows = omissions(shuffled)
    assert names[0] == "with all"
    assert set(names[1:]) == {"without mounting offset", "without structural damping"}
    assert len(rows[0].cells) == 3


def test_effect_that_an_unfinished_search_leaves_open_is_not_rejected():
    """Neither the table nor the caption of rejected effects speaks of it, and its probability is of what was tried."""
    _, second, *_ = ordinary().findings
    untried = Reason(DiagnosisCode.RIVALS_UNTRIED, effects=("lateral shift",))
    likely = replace(second, name="ply steer", verdict=Verdict.REFUSED, probability=0.9999, reason=untried)
    lasting = replace(likely, name="tire mode", lock="time")
    implausible = Reason(DiagnosisCode.PROBABILITY_TOO_LOW, probability=0.1, needed=0.99)
    rejected = replace(second, name="run-out", verdict=Verdict.REFUSED, probability=0.1, reason=implausible)
    diagnosis = replace(empty(), complete=False, findings=(likely, lasting, rejected))
    text = " ".join(Page(diagnosis_html(diagnosis)).text.split())
    open_part, refused_part = text.split("Each reduces the residual, but fails")
    assert "Likely so far, neither identified nor rejected. The probability is among the sets of effects" in open_part
    assert "> 0.999" in open_part
    assert "tried lateral shift in its place" in open_part
    assert "Tested, not identified: run-out (reasons)." in open_part
    assert not any(name in refused_part for name in ("ply steer", "tire mode"))
    assert "run-out" in refused_part
    summary = " ".join(map(str.strip, closure_summary_lines(diagnosis)))
    assert "so far       ply steer (probability > 0.999): in the error after, but others are untried" in summary


def test_page_says_what_it_was_made_of(page_text):
    text = Page(page_text).text
    for part in (
        "treadlink diagnose drum-40kmh.mcap --html report.html",
        "00c0ffee",
        "drum 3",
        "205/55R16",
        "SHA-256 " + "0123456789abcdef" * 4,
        "from 2025-10-09 08:53:20 to 2025-10-09 08:54:21 UTC",
        "12.31 ± 0.31",
        "2.100 ± 0.040",
        "After over before: 0.1706 ± 0.0060.",
        "Before, contact edges as recorded",
        "drum-40kmh.mcap: 40.0 km/h",
    ):
        assert part in text


def test_a_term_of_the_model_is_no_fault_and_one_of_sensor_or_wheel_is_named_as_such():
    first, *_ = ordinary().findings
    term, sensor, uneven = (
        replace(first, name=name, verdict=Verdict.NAMED)
        for name in ("belt extension", "circumferential gain by the radial axis", "run-out")
    )
    calm = replace(empty(), findings=(term,), complete=True, held_out=HeldOut(4.0, 2.0, 40, 4), determined={})
    answer = Page(diagnosis_html(calm)).text
    assert "Nothing is wrong that these data show. To describe this wheel, the model needs belt extension" in answer
    assert "not faults" in answer
    assert "lacks" not in answer.partition("Effects")[0]
    answer = Page(diagnosis_html(replace(calm, findings=(term, sensor, uneven)))).text
    assert "Nothing is wrong" not in answer
    assert "Sensor or mounting differ from what is stated or assumed: circumferential gain by" in answer
    assert "Tire or rim is not the same all around: run-out." in answer
    assert "Nothing is wrong" not in Page(diagnosis_html(replace(calm, unexplained=ordinary().unexplained))).text
    assert {effect_kind(name) for name in ("cavity resonance", "not in the catalogue")} == {Kind.OTHER}


def test_answer_says_on_which_axes_the_error_falls() -> None:
    """Ply steer takes nothing off the axes of the wheel's plane."""
    axes = tuple(
        AxisError(
            axis=name,
            before_mps2=before,
            after_mps2=after,
            with_discrepancy_mps2=1.0,
            noise_mps2=1.0,
            before_weighted=1.0,
            after_weighted=1.0,
        )
        for name, before, after in (("circumferential", 8.0, 8.0), ("lateral", 6.0, 1.0), ("radial", 16.0, 15.9))
    )
    diagnosis = undrawn()
    lateral = replace(diagnosis, held_out=replace(diagnosis.held_out, axes=axes))
    assert (
        "the error on unseen revolutions falls, on the lateral axis only, from 12.3"
        in Page(diagnosis_html(lateral)).text
    )
    every = replace(lateral.held_out, axes=tuple(replace(ax, after_mps2=1.0) for ax in axes))
    assert (
        "the error on unseen revolutions falls from 12.3" in Page(diagnosis_html(replace(lateral, held_out=every))).text
    )


def test_errors_are_reported_by_axis():
    axis = AxisError("radial", 14.3, 3.05, 1.25, 0.47, 9.5, 2.4)
    far = replace(undrawn(), held_out=HeldOut(14.3, 3.05, 40, 4, (axis,)), noise_floor_mps2=0.47)
    text = Page(diagnosis_html(far)).text
    assert "Error by axis" in diagnosis_html(far)
    for words in ("14.3", "3.05", "1.25", "0.470", "9.50", "2.40"):
        assert words in text, words
    lines = "\n".join(closure_summary_lines(far))
    assert "radial     14.30 -> 3.05 m/s², floor 0.47; in noise 9.50 -> 2.40" in lines


def test_unfitted_estimate_is_not_called_determined():
    stated = {"Bs": Fitted(0.003, 1e-5), "contact_half_angle_rad": Fitted(0.2, 0.0, "rad")}
    rows = estimate_rows(replace(empty(), estimates_before=stated, estimates_after=stated))
    assert [row.determined_text for row in rows] == ["yes", "not fitted"]


def test_single_effect_has_no_table_of_omissions():
    assert omissions(replace(ordinary(1), findings=ordinary().findings[:1])) == ([], [])


def test_estimates_are_grouped_by_tire_state():
    name, state = "contact_half_angle_rad", TireState(6111.0, 228e3)
    other = {f"{name} (6111 N, 228 kPa)": Fitted(0.3, 0.001, "rad", quantity=name, state=state)}
    diagnosis = replace(empty(), estimates_before=other, estimates_after=other)
    (group,) = by_state(estimate_rows(diagnosis))
    assert (group.state, group.rows[0].label) == ("6111 N, 228 kPa", "contact half angle, deg")
    assert group.rows[0].after == "17.189 ± 0.057"
    page = Page(diagnosis_html(diagnosis))
    assert page.text.count("6111 N, 228 kPa") == 1


def test_every_figure_is_described(page_text):
    page = Page(page_text)
    figures = page.tags.count("figure")
    labels = re.findall(r'<div class="drawing" tabindex="0" role="img" aria-label="([^"]*)"', page_text)
    # Waveform and orders of three axes, the other group, two spectra, two trends.
    assert figures == 3 + 3 + 1 + 2 + 2
    assert page.tags.count("figcaption") == figures
    assert [name for tag, name, _ in page.attributes if tag == "html"] == ["lang"]
    assert len(labels) == figures
    assert all("m/s²" in label for label in labels)


@pytest.mark.parametrize("which", ["page_text", "nasty_text"])
def test_page_has_no_scripts_or_external_resources(which, request):
    text = request.getfixturevalue(which)
    page = Page(text)
    assert not {"script", "img", "link", "iframe", "object", "embed", "image", "base"} & set(page.tags)
    for tag, name, value in page.attributes:
        assert not name.startswith("on"), (tag, name)
        assert name not in {"src", "srcset", "action", "background", "data"}, (tag, name)
        if name in {"href", "xlink:href"}:
            assert value.startswith("#"), (tag, value)
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", text))
    assert "://" not in text
    assert "@import" not in text
    assert "\x1b" not in text
    ids = [value for _, name, value in page.attributes if name == "id"]
    assert len(ids) == len(set(ids))
    targets = {value[1:] for _, name, value in page.attributes if name in {"href", "xlink:href"}}
    assert targets | set(re.findall(r"url\(#([^)]*)\)", text)) <= set(ids)


def test_hostile_strings_are_shown_as_text(nasty_text):
    page = Page(nasty_text)
    assert "<script>document.title='taken'</script>" in page.text
    assert "{{7*7}}" in page.text
    assert NASTY.split("\x1b")[0] in page.text
    assert "nan" not in re.sub(r"[^\w]", " ", page.text.lower()).split()


def test_page_without_findings():
    page = Page(diagnosis_html(empty()))
    assert "figure" not in page.tags
    assert "Nothing that repeats with the wheel exceeds the noise; the rest was not analyzed" in page.text
    page = Page(diagnosis_html(replace(empty(), spectra=ordinary().spectra[:1])))
    assert "Nothing exceeds the noise." in page.text
    assert "Nothing else exceeds the noise." in page.text


def test_page_is_deterministic(page_text):
    assert diagnosis_html(ordinary(2)) == page_text


def test_drawn_groups_are_limited(monkeypatch):
    diagnosis = ordinary(4)
    assert reference_group(diagnosis.curves) == 3
    monkeypatch.setattr(html, "MOST_GROUPS", 2)
    monkeypatch.setattr(html, "inline_svg", lambda *_: "")  # most of the time of a figure
    result = chapters(replace(diagnosis, spectra=(), trends=()))
    drawn = {chapter.id: chapter for chapter in result}
    assert [drawing.title for drawing in drawn["groups"].drawings] == [
        diagnosis.curves[position].label for position in (0, 2)
    ]
    assert "2 of 3 groups" in drawn["groups"].text
    assert {"spectra", "trends"}.isdisjoint(drawn)
    assert diagnosis.curves[3].label in drawn["waveforms"].text


def test_absent_axis_is_not_drawn():
    diagnosis = replace(nasty(), spectra=(), trends=())
    drawn = {chapter.id: chapter for chapter in chapters(diagnosis)}
    assert [drawing.title for drawing in drawn["waveforms"].drawings] == [
        "Circumferential acceleration.",
        "Radial acceleration.",
    ]


def test_order_coefficients_agree_with_the_pipeline():
    rng = np.random.default_rng(3)
    theta = -np.pi + 2 * np.pi * np.arange(256) / 256
    values = rng.normal(size=256)
    cosine, sine = order_coefficients(theta, values, ORDER_COUNT)
    complex_ones = reference_coefficients(values)
    np.testing.assert_allclose(cosine, complex_ones.real, atol=1e-12)
    np.testing.assert_allclose(sine, -complex_ones.imag, atol=1e-12)


def test_waveform_figure_draws_residuals():
    curve = curves("any", 80.0)
    with report_style():
        figure = waveform_figure(curve, 2)
    middle, bottom = figure.axes[2], figure.axes[4]
    drawn = [np.asarray(line.get_ydata()) for line in middle.lines]
    assert any(len(y) == 512 and np.array_equal(y, curve.measured_mps2[2] - curve.before_mps2[2]) for y in drawn)
    low, high = bottom.get_ylim()
    remainder = curve.measured_mps2[2] - curve.after_mps2[2]
    assert low < remainder.min()
    assert high > remainder.max()
    assert high < 3.0 * remainder.max(), "the residual after has its own scale"


@pytest.mark.parametrize(("factor", "scale"), [(1.0, "linear"), (1000.0, "symlog")])
def test_order_figure_scale_shows_noise_and_maximum(factor, scale):
    curve = curves("any", 40.0)
    before = curve.measured_mps2 + factor * 0.1 * np.cos(3 * curve.theta_rad)
    curve = type(curve)(
        curve.label, curve.theta_rad, curve.measured_mps2, before, before, curve.noise_mps2, curve.order_noise_mps2
    )
    with report_style():
        figure = orders_figure(curve, 2)
    panel = figure.axes[0]
    assert panel.get_yscale() == scale
    low, high = panel.get_ylim()
    assert low < -0.1 * factor
    assert low == pytest.approx(-high, rel=0.3)


def test_unknown_noise_is_not_drawn():
    curve = curves("any", 40.0)
    unknown = np.full_like(curve.order_noise_mps2, np.nan)
    curve = type(curve)(
        curve.label,
        curve.theta_rad,
        curve.measured_mps2,
        curve.before_mps2,
        curve.after_mps2,
        np.full(3, np.nan),
        unknown,
    )
    with report_style():
        for figure in (waveform_figure(curve, 0), orders_figure(curve, 0)):
            assert "nan" not in inline_svg(figure, "x")


def test_trends_are_in_display_units():
    with report_style():
        figure = trend_figure([trends()[1]])
    assert figure.axes[0].get_xlabel() == "load, N"
    assert figure.axes[0].get_title(loc="left") == "circumferential"
    warm = replace(trends()[1], against="temperature_degc", at=np.array([20.0, 40.0, 30.0, 25.0]))
    with report_style(), shown_in(ShownUnits.US):
        (panel,) = trend_figure([warm]).axes
    assert panel.lines[0].get_xdata() == pytest.approx([68.0, 77.0, 86.0, 104.0])


def test_sizes_of_single_recordings_stand_beside_that_of_all() -> None:
    finding = Finding(
        "circumferential delay", Verdict.NAMED, {"delay_s": Fitted(2e-4, 1e-6, "s", 1e6, "us")}, 100.0, 1.0,
        single_sizes=(
            SingleSize("b/second.mcap", "delay_s", 1.604e-4, 7e-7),
            SingleSize("a/first.mcap", "other", 1.0, 1.0),
        ),
    )  # fmt: skip
    assert sizes_alone(finding, "delay_s", ("a/first.mcap", "b/second.mcap")) == [
        ("second.mcap alone", "160.40 ± 0.70 us")
    ]
    drawn = sizes_drawn(finding, "delay_s")
    assert [one.kind for one in drawn] == ["after", "before"]
    # To one scale: each is as far from the other as the values are in standard errors.
    assert (drawn[0].at - drawn[1].at) / (drawn[0].high - drawn[0].low) == pytest.approx(39.6 / 4.0, rel=0.01)
    assert sizes_drawn(replace(finding, single_sizes=()), "delay_s") == ()
