import dataclasses

import numpy as np
import pytest

from gateway.console.page import ViewState, compose, panel_grid
from gateway.console.styled_rows import Role, row_width
from gateway.console.waveform import Zoom
from gateway.console.wheel_panel import _grid
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import Silence, SilentPart, WheelCounters, WheelSnapshot, WheelState
from gateway.core.links.reasons import LinkCode
from gateway.core.reasons import CoreCode, Notice, Reason
from gateway.core.session.reasons import SessionCode
from gateway.core.wheels.reasons import WheelCode

SIZES = [(80, 24), (120, 40), (200, 60)]


def quoted(text):
    return Reason(LinkCode.QUOTED_TEXT, text=text)


def page(snapshot, size=(80, 24), view=None, live=None):
    rows = compose(snapshot, view or ViewState(), *size, live)
    assert len(rows) == size[1]
    assert {row_width(row) for row in rows} == {size[0]}
    return ["".join(text for text, _ in row) for row in rows]


def row_with(rows, text):
    results = [row for row in rows if text in row]
    assert results, "\n".join(rows)
    return results[0]


@pytest.mark.parametrize("size", [*SIZES, (60, 20), (40, 10), (20, 5), (8, 2), (1, 1), (300, 100)])
@pytest.mark.parametrize("wheels", range(9))
def test_page_fills_the_screen(made, size, wheels):
    page(made.snapshot([f"W{i}" for i in range(wheels)], alarms=(made.alarm(),) * 7), size)


@pytest.mark.parametrize("size", SIZES)
def test_values_units_and_errors(made, size):
    wear = Estimate("wear_mm", 1.234, 0.31, Status.VALID)
    text = "\n".join(page(made.snapshot([made.wheel("FL", wear_mm=wear), "FR", "RL", "RR"]), size))
    for expected in (
        *("FL", "FR", "RL", "RR", "rolling", "65.000 ± 0.022 km/h", "210.0", "31.5", "5000 N"),
        *("-13.740 ± 0.097", "13.51 ± 0.10 deg", "rev 12", "wear", "1.23 ± 0.31 mm", "152.2 ± 1.1 mm"),
        *("(3.083 ± 0.012)e-3", "0.1953 ± 0.0012", "2.974 ± 0.031", "2.529 ± 0.099"),
        *("0:01:23", "4/4 rolling", "REC", "drive.mcap", "12.3 MB", "m/s²", "-180°", "▲", "lost 1.00 %"),
        *("sim:demo", "crc 12", "-61", "87", "0.43", "12", "quit", "help", "pause"),
    ):
        assert expected in text, expected


def test_every_wheel_has_a_line_at_80x24(made):
    names = ["FL", "FR", "RL", "RR", "A1L", "A1R", "A2L", "A2R"]
    wheels = [made.wheel(name, result={"speed_kmh": 60.0 + i}) for i, name in enumerate(names)]
    alarms = tuple(made.alarm(name, "pressure", "150.0 kPa is below 180.0 kPa") for name in names[:3])
    links = (made.link("serial:/dev/ttyUSB0"), made.link("serial:/dev/ttyUSB1"))
    rows = page(made.snapshot(wheels, alarms=alarms, links=links))
    for i, name in enumerate(names):
        line = row_with(rows, f"{i + 1}{'!' if i < 3 else ' '}{name}")
        assert line.split()[-10:] == [
            *("rolling", f"{60 + i}.00", "-13.74", "13.51", "210.0", "31.5", "3.083e-3", "0.1953", "2.974", "2.529")
        ]
    assert row_with(rows, "ALARM  FL: 150.0 kPa is below 180.0 kPa")
    assert row_with(rows, "ALARM  2 more: FR pressure, RL pressure")
    assert row_with(rows, "ttyUSB1 up loss 1.00 % crc 12 overwr 7 lag 12ms bat 87 % 0.43W -61dBm")
    assert row_with(rows, "-13.740 ± 0.097 deg")


def test_small_errors_keep_numbers_on_the_overview(made):
    estimates = tuple(e._replace(std=1e-9 * abs(e.value)) for e in made.result(speed_kmh=251.37).estimates)
    rows = page(made.snapshot([made.wheel("FL", result={"estimates": estimates}), "FR", "RL", "RR"]))
    line = row_with(rows, ">1 FL").split()
    assert line[3] == "251.37"
    assert float(line[-4]) == pytest.approx(3.0833e-3, rel=1e-3)
    assert float(line[-1]) == pytest.approx(2.529, rel=1e-3)


@pytest.mark.parametrize(
    ("wheels", "size", "grid"),
    [
        (4, (120, 34), (2, 2)),
        (4, (240, 30), (4, 1)),
        (4, (60, 60), (1, 4)),
        (1, (80, 18), (1, 1)),
        (4, (80, 18), None),
        (8, (120, 34), None),
        (8, (240, 50), (4, 2)),
    ],
)
def test_panels_are_used_where_they_fit(wheels, size, grid):
    assert panel_grid(wheels, *size) == grid


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("state", [state for state in WheelState if state is not WheelState.SILENT])
def test_wheel_without_revolution_says_why(made, size, state):
    rows = page(made.snapshot([WheelSnapshot("FL", state=state), "FR"]), size)
    text = "\n".join(rows)
    assert state.value in text
    reasons = {"no data": "nothing", "searching": "two passes", "standstill": "still", "rolling": "under way"}
    assert {**reasons, "ended": "no revolution"}[state.value] in text
    assert "load not stated" in text
    assert "nan" not in text.lower()


@pytest.mark.parametrize("size", SIZES)
def test_standstill_shows_values_with_their_age(made, size):
    rows = page(made.snapshot([made.wheel("FL", state=WheelState.STANDSTILL)]), size)
    text = " ".join("\n".join(rows).split())
    assert "standstill: values of revolution 12" in text
    assert "0.1953 ± 0.0012" in text
    assert "65.000" not in text


def silent(made, position="FL", age_s=20.0, part=SilentPart.HUB, **changes):
    code = {SilentPart.HUB: SessionCode.HUB_OF_WHEEL_SILENT, SilentPart.SAMPLES: SessionCode.SAMPLES_SILENT}[part]
    silence = Silence(part, age_s, Reason(code, silence_s=age_s))
    return made.wheel(position, state=WheelState.SILENT, silences=(silence,), **changes)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("names", [["FL"], ["FL", "FR", "RL", "RR"]])
def test_silent_wheel_shows_its_silence_in_place_of_numbers(made, size, names):
    link = made.link(silent_s=20.0, latency_s=None)
    wheels = [silent(made, name) for name in names]
    text = "\n".join(page(made.snapshot(wheels, links=(link,)), size))
    assert f"0/{len(names)} rolling  {len(names)} SILENT" in text
    assert "silent for 20 s" in text
    assert "SILENT: no frame of its hub for 20 s." in text
    for alive in ("0.1953", "3.083", "210.0", "31.5", "-13.740", "⡇", "lag", "lost 1", "loss 1", "-61", "bat"):
        assert alive not in text, alive
    assert text.count("65.000") <= 4, "the speed is named as that of the last revolution only"
    assert "Last revolution: 12, at 65.000 ± 0.022 km/h." in " ".join(text.replace("│", "").replace("║", "").split())


@pytest.mark.parametrize("size", SIZES)
def test_dead_wheel_is_told_from_its_living_neighbours(made, size):
    wheels = [silent(made, "FL", 7.0, SilentPart.SAMPLES), *map(made.wheel, ("FR", "RL", "RR"))]
    rows = page(made.snapshot(wheels), size)
    assert "3/4 rolling  1 SILENT" in rows[0]
    assert row_with(rows, "SILENT: no samples for 7 s, only other")
    assert "connected" in row_with(rows, "sim:demo") or " up " in row_with(rows, "sim:demo")


@pytest.mark.parametrize("size", SIZES)
def test_old_pressure_is_shown_with_its_age(made, size):
    old = Silence(SilentPart.ENVIRONMENT, 12.0, Reason(WheelCode.ENVIRONMENT_SILENT, silence_s=12.0))
    text = "\n".join(page(made.snapshot([made.wheel("FL", silences=(old,))]), size))
    assert "1/1 rolling" in text
    assert "210.0 kPa (12 s old)" in text
    overview = "\n".join(page(made.snapshot([made.wheel(n, silences=(old,)) for n in ("FL", "FR", "RL", "RR")])))
    assert "210.0" not in overview


def test_sensor_never_heard_says_for_how_long(made):
    never = Silence(SilentPart.SENSOR, 12.0, Reason(SessionCode.SENSOR_NEVER_HEARD, silence_s=12.0))
    text = "\n".join(page(made.snapshot([WheelSnapshot("FL", silences=(never,)), "FR"])))
    assert "nothing usable was received from its sensor in 12 s" in text


def test_no_label_of_the_details_is_cut(made):
    others = [
        Estimate("ply_steer_peak_rad", -0.0028123, 0.00021, Status.PROVISIONAL),
        Estimate("load_n", 4823.4, 17.3, Status.PROVISIONAL),
    ]
    wheel = made.wheel("FL", result={"estimates": (*made.result().estimates, *others)})
    for size in SIZES:
        rows = page(made.snapshot([wheel, "FR", "RL", "RR"]), size)
        assert any(f"{name} -0.161 ± 0.012 deg ~" in "\n".join(rows) for name in ("ply steer", "ply steer peak"))
        assert row_with(rows, "4823 ± 17 N ~")


@pytest.mark.parametrize("size", SIZES)
def test_ratios_are_shown_with_the_reason(made, size):
    rows = page(made.snapshot([made.wheel("FL", load_n=None), "FR"]), size)
    text = "\n".join(rows)
    assert "Bs/Cw 0.01579 ± 0.00016" in text
    assert "ratios only: the load is not known" in text
    assert "load not stated" in text


def test_ratios_stand_under_their_numerators_in_the_overview(made):
    rows = page(made.snapshot(["FL", made.wheel("FR", load_n=None), "RL"]))
    header, line = row_with(rows, "km/h"), row_with(rows, "2 FR")
    for label, value in (("Bs", "0.01579"), ("Cw", "/Cw"), ("Rs", "15.23"), ("Ts", "12.95")):
        assert line[: header.index(label) + len(label)].endswith(value)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(("status", "mark"), [(Status.PROVISIONAL, "~"), (Status.INVALID, "x")])
def test_status_is_a_mark_with_a_reason(made, size, status, mark):
    wheel = made.wheel(
        "FL", result={"status": status, "reasons": (Reason(CoreCode.NOT_SETTLED, revolutions=3.0, needed=8.0),)}
    )
    rows = page(made.snapshot([wheel]), size)
    assert row_with(rows, f"{mark} settling: 3 of 8")
    assert f"{'0.1953 ± 0.0012' if status is Status.PROVISIONAL else '—'} {mark}" in "\n".join(rows)


@pytest.mark.parametrize("size", SIZES)
def test_alarms_stand_on_top_and_at_their_wheel(made, size):
    rows = page(made.snapshot(alarms=(made.alarm("RR", "temperature", "95 °C is above 90 °C"),)), size)
    assert rows[1].startswith(" ALARM  RR: 95 °C is above 90 °C")
    assert row_with(rows[2:], "4!RR" if size == (80, 24) else "4 RR rolling  ALARM")


@pytest.mark.parametrize("size", SIZES)
def test_failed_link_is_listed_first_with_reason(made, size):
    links = [made.link(f"sim:link{i}") for i in range(7)]
    links[5] = dataclasses.replace(links[5], connected=False, note=quoted("lost, next try in 4 s"))
    rows = page(made.snapshot(links=tuple(links)), size)
    line = row_with(rows, "link5")
    assert "DOWN" in line
    assert "lost, next try in 4 s" in line
    assert row_with(rows, "more links")


@pytest.mark.parametrize("size", SIZES)
def test_link_that_is_down_has_an_age_unless_it_has_ended(made, size):
    link = dataclasses.replace(made.link("sim:far"), connected=False, silent_s=12.0, note=quoted("unplugged"))
    assert "DOWN 12 s" in row_with(page(made.snapshot(links=(link,)), size), "sim:far")
    ended = dataclasses.replace(link, note=Reason(LinkCode.LINK_ENDED))
    assert "DOWN 12 s" not in row_with(page(made.snapshot(links=(ended,)), size), "sim:far")


def test_link_without_hub_status_omits_its_fields(made):
    link = made.link(battery_percent=None, rssi_dbm=None, supply_w=None, latency_s=None, frames=0, frames_lost=0)
    rows = page(made.snapshot(links=(link,)), (120, 40))
    line = row_with(rows, "sim:demo connected")
    assert "loss 0 %" in line
    assert not any(word in line for word in ("bat", "dBm", " W", "lag"))


def test_overwritten_samples_are_reported(made):
    wheel = made.wheel("FL", counters=WheelCounters(samples=10, samples_overwritten=120))
    assert row_with(page(made.snapshot([wheel, "FR"])), "samples overwritten before use: FL 120")
    assert not any("overwritten before" in row for row in page(made.snapshot()))


@pytest.mark.parametrize("size", SIZES)
def test_long_names_and_paths_are_cut_in_the_middle(made, size):
    names = [f"a very long name of wheel number {i} on the trailer" for i in range(4)]
    text = "\n".join(page(made.snapshot(names, recording="/data/" + "deep/" * 40 + "drive.mcap"), size))
    assert "drive.mcap" in text
    assert "12.3 MB" in text
    for i in range(4):
        assert f"{i + 1} a " in text


def test_hub_text_cannot_command_the_terminal(made):
    evil = "boo\x1b[2J\x07\x9b1m"
    snapshot = made.snapshot(
        [made.wheel(evil, sensor_id=evil)],
        notices=(Notice(evil, quoted(evil)),),
        alarms=(made.alarm(evil, evil, evil),),
        links=(made.link(evil, note=quoted(evil)),),
        recording=evil,
    )
    for size in SIZES:
        assert "".join(page(snapshot, size)).isprintable()


def test_paused_view_freezes_wheels_only(made):
    frozen = made.snapshot([made.wheel("FL", result={"speed_kmh": 50.0})])
    marked = (Notice("", quoted("mark: bump")),)
    live = made.snapshot(["FL"], elapsed_s=100.0, alarms=(made.alarm(),), notices=marked)
    rows = page(frozen, view=ViewState(paused_at_s=83.2), live=live)
    assert row_with(rows, "mark: bump")
    assert "PAUSED at 0:01:23" in rows[0]
    assert "0:01:40" in rows[0]
    assert "ALARM" in rows[1]
    assert row_with(rows, "50.000 ± ")
    assert "resume" in rows[-1]


def test_header_shows_recording_and_end(made):
    assert "not recording" in page(made.snapshot(recording=""))[0]
    assert "ENDED" in page(made.snapshot(ended=True))[0]


def test_notices_show_the_latest(made):
    notices = tuple(Notice("", quoted(f"notice {i}")) for i in range(20))
    small, large = page(made.snapshot(notices=notices)), page(made.snapshot(notices=notices), (200, 60))
    assert row_with(small, "notice 19")
    assert not any("notice 18" in row for row in small)
    assert sum("notice" in row for row in large) == 6


def test_zoom_and_selection(made):
    view = ViewState(selected=1, zoom=Zoom.CONTACT)
    rows = page(made.snapshot(), view=view)
    assert row_with(rows, ">2 FR")
    assert row_with(rows, "══ 2 FR")
    assert row_with(rows, "-90°")
    assert not any("180°" in row for row in rows)
    # A selected wheel that no longer exists does not break the view.
    assert row_with(page(made.snapshot(["FL"]), view=ViewState(selected=5)), "1 FL")


def test_waveform_is_redrawn_per_revolution_only(made):
    view, snapshot = ViewState(), made.snapshot(["FL", "FR"])
    wheel = snapshot.wheels[0]
    first = view.plots.rows(wheel, 50, 10, Zoom.WHOLE)
    assert view.plots.rows(wheel, 50, 10, Zoom.WHOLE) is first
    assert view.plots.rows(wheel, 50, 10, Zoom.CONTACT) is not first
    again = made.wheel("FL", result={"speed_kmh": 30.0})
    assert view.plots.rows(again, 50, 10, Zoom.WHOLE) != first


def test_difference_from_the_average_is_a_number(made):
    wheel = made.wheel("FL")
    shifted = dataclasses.replace(wheel, average_mps2=wheel.last.revolution.radial_mps2 + 12.5)
    assert row_with(page(made.snapshot([shifted]), (120, 40)), "difference 12.5 m/s² rms")
    other_grid = dataclasses.replace(wheel, average_mps2=np.ones(7))
    assert not any("difference" in row for row in page(made.snapshot([other_grid]), (120, 40)))


def test_alarms_are_marked_by_words_too(made):
    """Alarms, lost links and doubtful numbers have words or marks besides colours."""
    snapshot = made.snapshot(alarms=(made.alarm(),), links=(made.link(connected=False),))
    for row in compose(snapshot, ViewState(), 120, 40):
        for text, role in row:
            if role is Role.ALARM and text.strip():
                assert text.strip().startswith(("ALARM", "DOWN", "PAUSED", "ENDED", "SILENT", "!"))


def test_values_side_by_side_never_touch():
    rows = [(("a" * size, Role.VALUE),) for size in (10, 10, 9, 10, 20, 3, 4)]
    lines = ["".join(text for text, _ in line) for line in _grid(rows, 2, 10)]
    assert [line.split() for line in lines] == [
        ["a" * 10],
        ["a" * 10],
        ["a" * 9, "a" * 10],
        ["a" * 20],
        ["aaa", "aaaa"],
    ]


def test_keys_name_the_recording_where_it_can_be_begun_and_all_fit(made):
    def keys(cells, recording=None, **changes):
        shown = made.snapshot(["FL", "FR"], recording=recording)
        return page(shown, (cells, 24), ViewState(**{"may_record": True} | changes))[-1]

    assert "r record" in keys(100)
    assert "r record" not in keys(100, may_record=False)
    assert "r record" not in keys(100, recording=made.snapshot(["FL"]).recording)
    for cells in (79, 80, 81, 90):
        assert "q quit" in keys(cells, zoom=Zoom.CONTACT, paused_at_s=1.0)
