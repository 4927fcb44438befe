"""The page of a drive: self-contained, escaped, and with what each wheel did."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from gateway.compare.views.drive import MAX_POINTS, MAX_WAVEFORMS, Drive, DriveWheel
from gateway.compare.views.drive_comparison import comparison_lines
from gateway.compare.views.drive_page import drive_page
from gateway.compare.views.drive_pictures import begin_ns, drawn_quantities, first_ns, lines_of, pictures_json
from gateway.compare.views.drive_verdict import verdict
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.results import AlarmRecord, WheelCounters, WheelSnapshot
from gateway.core.links.reasons import LinkCode
from gateway.core.quantity_catalogue import declared
from gateway.core.reasons import Notice, Reason
from gateway.core.recording.mcap_layout import JSON_ENCODING, MARKS_TOPIC, ChannelInfo, RecordedMessage
from gateway.core.session.alarms import AlarmName
from gateway.core.session.reasons import SessionCode
from gateway.ring.reasons import RingCode

HOSTILE = "<script>alert('x')</script>\x1b[2J"
DOUBT = Reason(RingCode.NEEDS_LOAD)


def data_of(page: str) -> dict:
    """Return what the script of a page with one recording draws."""
    return json.loads(re.search(r'id="r0-data">(.*?)</script>', page)[1])


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
    assert "<script>alert" not in page
    assert page.count("<script") == page.count("</script>") == 5
    assert "\x1b" not in page
    assert not re.findall(r'(?:src|href)="(?!#)', page)
    assert set(data_of(page)) == {"begin_ms", "wheels", "quantities", "first", "pairs", "events", "waveforms"}
    assert data_of(page)["wheels"][0]["name"] == HOSTILE
    assert "2001-09-09 01:46:40 UTC" in page


def test_page_shows_means_what_varies_and_why_a_value_is_missing(make_drive):
    page = drive_page([make_drive(21)])
    assert "0.1953 ± 0.0012" in page
    assert re.search(r"<td class=\"n\">36.0 to 108.0<small>varies<", page), "of what varies the span"
    assert "varied within the recording" not in page
    assert re.search(r"\(Rs\)</th><td class=\"n none\">—<", page)
    assert "FL, radial sidewall stiffness number (Rs): " in page
    assert "revolutions is drawn" not in page


@pytest.mark.parametrize(
    ("status", "said"),
    [
        (Status.VALID, "65.0 km/h, 65.0 to 65.0"),
        (Status.PROVISIONAL, "65.0 km/h, 65.0 to 65.0; provisional"),
        (Status.INVALID, "— invalid"),
    ],
)
def test_mean_speed_has_the_status_of_the_speed_on_the_page_and_in_a_comparison(made, status, said):
    drive = Drive("a.mcap")
    for index in range(4):
        speed = Estimate("speed_mps", 10.0, 0.01, status, () if status is Status.VALID else (DOUBT,))
        drive.add(made.result(position="FL", index=index, estimates=(speed,)))
    assert re.findall(r"speed, mean and span</th><td[^>]*>([^<]*)<", drive_page([drive])) == [said]
    words = " ".join(comparison_lines(drive, drive, [])).split()
    assert [words.count(str(word)) for word in Status] == [2 * (word is status is not Status.VALID) for word in Status]


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
    assert drawn_quantities(drive) == ["pressure_pa", "temperature_degc", "Cw"]
    (line,) = lines_of(drive, "Cw", begin_ns(drive))
    assert [math.isnan(value) for value in line.value] == [False, False, True, False]
    assert line.is_valid.tolist() == [True, True, False, True]


def with_silence(
    made, revolutions: int, silent_after: int, *, reason: Reason | None = None, silent_s: float = 0.0
) -> Drive:
    """Return a drive at 0.1 s a revolution with 35 s without revolutions after one of them."""
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
        host_ns = 10**18 + round((start_s + 0.1) * 1e9)
        before_s = silent_s if index == silent_after + 1 else 0.0
        drive.add(replace(result, revolution=revolution, host_ns=host_ns, silent_before_s=before_s))
    return drive


@pytest.mark.parametrize("revolutions", [40, MAX_POINTS + 1, 3 * MAX_POINTS + 5])
@pytest.mark.parametrize("silent_after", [0, 17, 18, 19, 20, 31])
def test_no_line_is_drawn_through_a_silence(made, revolutions, silent_after):
    drive = with_silence(made, revolutions, silent_after)
    (line,) = lines_of(drive, "Cw", begin_ns(drive))
    (gap,) = np.flatnonzero(np.isnan(line.value))
    assert line.time_s[gap + 1] - line.time_s[gap - 1] > 35.0
    assert np.diff(np.delete(line.time_s, gap)).min() > 0.0
    assert not line.is_valid[gap]


def test_page_and_terminal_say_the_same_of_a_distance_that_was_bridged(made):
    bridged = Reason(EstimateCode.DISTANCE_BRIDGED, duration_s=35.0, distance_m=833.0, std_m=180.0)
    page = drive_page([with_silence(made, 50, 20, reason=bridged)])
    assert re.search(r">distance</th><td class=\"n\">98 ± 12 m ~<", page)
    assert "FL, distance: 833 m ± 180 m of it was not measured: it is taken from the speeds before and after" in page
    assert '>distance</th><td class="n">98 ± 12 m<' in drive_page([with_silence(made, 50, 20)])


@pytest.mark.parametrize("revolutions", [MAX_POINTS, MAX_POINTS + 1, 5 * MAX_POINTS + 7])
def test_points_are_few_evenly_spaced_and_from_the_first_revolution(made, revolutions):
    wheel, result = DriveWheel(), made.result()
    for index in range(revolutions):
        wheel.add(replace(result, host_ns=1 + index))
    numbers = [point.time_ns - 1 for point in wheel.points]
    assert numbers == list(range(0, revolutions, wheel.stride))
    assert MAX_POINTS // 2 <= len(numbers) <= MAX_POINTS


def said_of(drive: Drive):
    """Return the verdict of a drive."""
    return verdict(drive, begin_ns(drive), max(wheel.points[-1].time_ns for wheel in drive.wheels.values()))


def test_a_drive_without_trouble_has_nothing_to_act_on(make_drive):
    said = said_of(make_drive(21))
    assert said.summary == "1 wheel in 2 s. Nothing to act on."
    assert not said.actions
    assert not said.events


def test_what_stands_at_the_end_is_acted_on_and_what_has_ended_is_told(make_drive):
    drive = make_drive(21)
    reason = Reason(LinkCode.QUOTED_TEXT, text="171.0 kPa is below 180.0 kPa")
    ended = AlarmRecord("FL", "pressure", reason, 2, 0.7, 0.4, 1.5, is_standing=False)
    standing = AlarmRecord("FL", "silent", reason, 1, 0.5, 1.0, 2.0, is_standing=True)
    drive.finish((), (ended, standing), (Notice("FL", DOUBT),))
    said = said_of(drive)
    assert said.summary == "1 wheel in 2 s. 1 alarm came and went. 1 alarm stood at the end."
    assert said.actions[0] == ("FL silent", "171.0 kPa is below 180.0 kPa")
    assert len(said.actions) == 2
    assert [(event.kind, event.times()) for event in said.events] == [
        ("alarm", "0:00:00 to 0:00:01"),
        ("alarm", "0:00:01 to the end"),
    ]


@pytest.mark.parametrize(("silent_s", "kind"), [(35.0, "silence"), (0.0, "standstill")])
def test_a_silence_is_named_and_a_standstill_is_none(made, silent_s, kind):
    drive = with_silence(made, 40, 20, silent_s=silent_s)
    said = said_of(drive)
    assert [event.kind for event in said.events] == [kind]
    assert ("FL was silent for 35 s." in said.summary) == (kind == "silence")
    assert said.events[0].begin_s == pytest.approx(2.0)
    assert said.events[0].end_s == pytest.approx(37.0)
    assert [action.about for action in said.actions] == ["FL"] * (kind == "silence")


def test_a_silence_that_an_alarm_told_of_is_one_event_with_one_begin(made):
    drive = with_silence(made, 40, 20, silent_s=35.0)
    drive.start_ns = first_ns(drive) - 10**9
    reason = Reason(SessionCode.SAMPLES_SILENT, silence_s=34.0)
    alarm = AlarmRecord("FL", AlarmName.SILENT, reason, 1, 34.0, 4.0, 38.0, is_standing=False)
    drive.finish((), (alarm,), ())
    said = said_of(drive)
    assert said.summary == "1 wheel, 78 ± 12 m in 40 s. FL was silent for 35 s. Nothing else to act on."
    ((begin_s, end_s, kind, wheel, words),) = said.events
    assert (round(begin_s), round(end_s), kind, wheel) == (3, 38, "silence", "FL"), "since the session's start"
    assert "no samples for 34 s, only other messages" in words
    assert "look for a command that stopped it" in said.actions[0].step


def test_an_alarm_of_another_time_stays_an_event_of_its_own(made):
    drive = with_silence(made, 40, 20, silent_s=35.0)
    reason = Reason(SessionCode.SENSOR_SILENT, silence_s=3.0)
    drive.finish((), (AlarmRecord("FL", AlarmName.SILENT, reason, 1, 1.0, 50.0, 53.0, is_standing=False),), ())
    said = said_of(drive)
    assert "1 alarm came and went." in said.summary
    assert [event.kind for event in said.events] == ["silence", "alarm"]


def test_the_distance_is_that_of_a_wheel_that_was_measured_all_the_way(made):
    bridged = Reason(EstimateCode.DISTANCE_BRIDGED, duration_s=35.0, distance_m=833.0, std_m=180.0)
    drive = with_silence(made, 50, 20, reason=bridged)
    drive.wheels["FR"] = with_silence(made, 40, 20).wheels["FL"]
    assert said_of(drive).summary.startswith("2 wheels, 78 ± 12 m in ")


def test_a_wear_below_zero_within_its_error_is_said_to_be_none(made):
    drive = Drive("a.mcap")
    for index in range(5):
        wears = {"FL": (-0.2, 0.5), "FR": (-2.0, 0.5), "RL": (0.4, 0.5)}
        for position, (wear_mm, std_mm) in wears.items():
            estimates = (Estimate("wear_mm", wear_mm, std_mm, Status.VALID),)
            drive.add(made.result(position=position, index=index, estimates=estimates))
        none = (Estimate.invalid("wear_mm", Reason(EstimateCode.NEEDS_LOAD_CALIBRATION)),)
        drive.add(made.result(position="RR", index=index, estimates=none))
    page = drive_page([drive])
    why = "Wear is drawn as measured: below zero by less than twice its error it means none, and is 0 in the table."
    assert why in page
    assert why not in drive_page([with_silence(made, 50, 20)])
    assert re.findall(r"<li>([^<]*): below zero by less than twice its error", page) == ["FL, wear"]
    assert "<dt>Wear</dt>" in page
    assert re.findall(r'class="n[^"]*">(-?[\d.]+ ± [\d.]+)', page.split(">wear ")[1].split("</tr>")[0]) == [
        "0.00 ± 0.50",
        "-2.00 ± 0.50",
        "0.40 ± 0.50",
    ]
    assert data_of(page)["quantities"][-1]["wheels"][0]["v"][0] == pytest.approx(-0.2), (
        "the picture has what was measured"
    )
    assert "(assumed)" in page, "no vehicle file states the belt radius"


def test_silence_is_no_loss_and_a_mean_says_what_it_leaves_out(made):
    drive = with_silence(made, 40, 20, silent_s=35.0)
    counters = WheelCounters(samples=9600, samples_lost=9600 * 35 + 96, samples_silent=9600 * 35, silent_s=35.0)
    drive.finish((WheelSnapshot("FL", rate_hz=9600.0, counters=counters),), (), ())
    page = drive_page([drive])
    assert '>samples lost</th><td class="n">0.99 %, besides 35 s of silence<' in page
    assert re.search(r">speed, mean and span</th><td class=\"n\">[^<]*; not measured for 35 s<", page)


def test_marks_are_shown_and_keep_the_waveform_of_their_moment(make_drive, made):
    drive = make_drive(3)
    for index, words in ((2, HOSTILE), (5, "kerb")):
        data = json.dumps({"link": "", "kind": "mark", "text": words}).encode()
        drive.take_mark(RecordedMessage(ChannelInfo(MARKS_TOPIC, JSON_ENCODING), 0, 10**18 + index * 10**8, data))
    drive.take_mark(RecordedMessage(ChannelInfo("/alarms", JSON_ENCODING), 0, 10**18, b"{}"))
    for index in range(3, 8):
        drive.add(replace(made.result(index=index), host_ns=10**18 + index * 10**8))
    page = drive_page([drive])
    assert "\x1b" not in page
    assert [(event.kind, event.begin_s) for event in said_of(drive).events] == [("mark", 0.2), ("mark", 0.5)]
    causes = [(shown["cause"], shown["t"]) for shown in data_of(page)["waveforms"] if shown["cause"]]
    assert causes == [(HOSTILE, 0.3), ("kerb", 0.5)]


def test_waveforms_of_a_long_drive_are_bounded_and_cover_it(made):
    wheel, result = DriveWheel(), made.result()
    times_s = range(0, 60 * 5 * MAX_WAVEFORMS, 20)
    for second in times_s:
        wheel.add(replace(result, host_ns=10**18 + second * 10**9))
    kept_s = [(shown.time_ns - 10**18) / 1e9 for shown in wheel.waveforms]
    assert MAX_WAVEFORMS // 2 <= len(kept_s) <= MAX_WAVEFORMS
    assert kept_s[0] == 0.0
    assert kept_s[-1] > times_s[-1] - max(np.diff(kept_s))
    assert max(np.diff(kept_s)) <= 2 * min(np.diff(kept_s))


def test_pictures_have_numbers_to_a_tenth_of_their_error(made):
    drive = Drive("a.mcap")
    for index in range(5):
        estimate = Estimate("Cw", 0.195312345 + 0.01 * index, 0.0012, Status.VALID)
        drive.add(made.result(index=index, estimates=(estimate,)))
    (cw,) = [shown for shown in pictures_json(drive, (), 0)["quantities"] if shown["name"] == "Cw"]
    assert cw["wheels"][0]["v"][0] == pytest.approx(0.1953123, abs=0.0012 / 10)
    assert len(str(cw["wheels"][0]["v"][0])) <= len("0.19531")


def test_a_browser_draws_the_pictures_zooms_them_together_and_shows_a_waveform(browser, made, tmp_path):
    drive = with_silence(made, 200, 80, silent_s=35.0)
    page = tmp_path / "drive.html"
    page.write_text(drive_page([drive]), "utf-8")
    tab = browser.tab()
    tab.show(page, 1280)
    assert tab.value("document.querySelectorAll('.pictures canvas').length") == 2, "pressure with temperature, waveform"
    tab.value("document.querySelector('.events button').click()")
    assert "FL at" in tab.value("document.querySelector('.grid').innerText")
    tab.value(
        "{ const s = document.querySelector('.tools select'); s.value = 'Cw'; s.dispatchEvent(new Event('change')); }"
    )
    assert "Cw" in tab.value("[...document.querySelectorAll('.picture-title')].map(t => t.innerText).join()")
    tab.show(page, 390)
    assert tab.value("document.documentElement.scrollWidth") <= 390
    assert not tab.errors


def test_dots_are_of_no_wheel_and_long_numbers_stay_in_their_picture(browser, made, tmp_path):
    drive = Drive("a.mcap")
    for index in range(9):
        estimates = (Estimate("speed_mps", 10.0, 0.1, Status.VALID), Estimate("Bs", 3.0e4 * index, 1.0, Status.VALID))
        drive.add(replace(made.result(index=index, estimates=estimates), host_ns=10**18 + index * 10**8))
    page = tmp_path / "drive.html"
    page.write_text(drive_page([drive]), "utf-8")
    tab = browser.tab()
    tab.show(page, 1280)
    dashes = tab.value("Array.from({ length: 8 }, (_, i) => pictures.dashOf(i))")
    assert len({str(dash) for dash in dashes}) == 4
    assert all(piece > 3 for dash in dashes for piece in dash[::2]), "a wheel's line has no dots"
    assert tab.value("Array.from({ length: 8 }, (_, i) => pictures.seriesOf(i)[1].dash[0])") == [1.5] * 8
    select = "document.querySelector('.picture-title select')"
    tab.value(f"{{ const s = {select}; s.value = 'Bs'; s.dispatchEvent(new Event('change')); }}")
    widths = tab.value(
        "[...document.querySelector('.grid figure').querySelectorAll('.u-axis')].map((a) => a.clientWidth)"
    )
    text = "(() => { const c = document.createElement('canvas').getContext('2d'); c.font = '12px system-ui'; "
    needed = tab.value(f"{text} return c.measureText('240,000').width; }})()")
    assert widths[-1] >= needed + 10
    assert not tab.errors


def test_paper_holds_every_column_and_the_times_of_what_happened(browser, made, tmp_path):
    drive = with_silence(made, 60, 20, silent_s=35.0)
    for position in ("FR", "RL", "RR"):
        drive.wheels[position] = drive.wheels["FL"]
    page = tmp_path / "drive.html"
    page.write_text(drive_page([drive]), "utf-8")
    tab = browser.tab()
    tab.show(page, 1280)
    tab.call("Emulation.setEmulatedMedia", media="print")
    tab.call("Emulation.setDeviceMetricsOverride", width=700, height=900, deviceScaleFactor=1, mobile=False)
    wide = "[...document.querySelectorAll('.scroll')].filter((one) => one.scrollWidth > one.clientWidth + 1).length"
    assert tab.value(wide) == 0
    cut = (
        "[...document.querySelectorAll('canvas')].filter((c) => c.clientWidth > c.closest('figure').clientWidth).length"
    )
    assert tab.value(cut) == 0, "pictures that were drawn for a wide window"
    assert "0:00:02 to 0:00:37" in tab.value("document.querySelector('.events').innerText")
    shown = "[...document.querySelectorAll('.picture-title select')].filter((one) => one.checkVisibility()).length"
    assert tab.value(shown) == 1, "pressure with temperature"


def test_page_of_four_wheels_stays_below_three_megabytes_however_long_the_drive(made):
    drive, random = Drive("a.mcap"), np.random.default_rng(1)
    names = [quantity.name for quantity in declared()][:40]
    positions = ("FL", "FR", "RL", "RR")
    # So many revolutions that points are as many as ever, and a waveform is due at each.
    for index in range(2 * MAX_POINTS - 1):
        if index < MAX_WAVEFORMS:
            drive.marks.append((10**18 + index * 61 * 10**9, "mark"))
        values = random.normal(1.0, 0.01, size=(len(positions), len(names)))
        for position, row in zip(positions, values, strict=True):
            estimates = tuple(
                Estimate(name, value, 0.0123456, Status.VALID) for name, value in zip(names, row.tolist(), strict=True)
            )
            result = made.result(position=position, index=index, estimates=estimates)
            drive.add(replace(result, host_ns=10**18 + index * 61 * 10**9))
    wheel = drive.wheels["FL"]
    assert len(wheel.points) >= MAX_POINTS - 1
    assert len(wheel.waveforms) + len(wheel.marked_waveforms) > 1.4 * MAX_WAVEFORMS
    size = len(drive_page([drive]).encode())
    assert 1e6 < size < 3e6
