import asyncio
import dataclasses
import os
import re
import sys
import textwrap
import time

import pytest

from gateway.console.screen import ConsoleApp
from gateway.core.errors import RecordingError
from gateway.core.estimates.results import Alarm, AlarmRecord
from gateway.core.reasons import Reason
from gateway.core.session.reasons import SessionCode

LOAD = Reason(SessionCode.VALUE_ABOVE_LIMIT, quantity="load_n", value=6000.0, limit=5000.0)

SIZES = [(80, 24), (120, 40), (200, 60)]


class FakeSession:
    """A session whose state is set by the test."""

    def __init__(self, snapshot):
        self.state = snapshot
        self.marks = []
        self.recordings = []
        self.pauses = []
        self.stopped = False
        self.new_results = []

    def results(self):
        taken, self.new_results = self.new_results, []
        return taken

    def snapshot(self):
        return self.state

    def mark(self, text):
        self.marks.append(text)

    may_record = True
    run_form = {"test": "", "driver": "Ada", "tire": "", "comment": "old", "tags": ""}  # noqa: RUF012

    def start_recording(self, form):
        if form["tire"] == "wrong":
            raise RecordingError("tire: wrong", "Give another.")
        self.recordings.append(dict(form))

    def show_in(self, units):
        self.change(units=units)

    def acknowledge(self):
        record = AlarmRecord("FL", "load", LOAD, 1, 1.0, 1.0, 2.0, is_standing=True, is_acknowledged=True)
        self.change(alarm_records=(record,))

    def pause(self, paused):
        self.pauses.append(paused)
        return True

    def request_stop(self):
        self.stopped = True

    def change(self, **changes):
        self.state = dataclasses.replace(self.state, **changes)


@pytest.fixture
def session(made):
    return FakeSession(made.snapshot())


def screen(app):
    """Return the text rows that textual would send to the terminal."""
    return [strip.text for strip in app.screen._compositor.render_strips()]


async def drawn(app, pilot):
    app.tick()
    await pilot.pause()
    return screen(app)


async def resized(app, pilot, width, height):
    """Return the screen at a new size: the layout follows the terminal some time later."""
    await pilot.resize_terminal(width, height)
    end_s = time.monotonic() + 60.0
    while {len(row) for row in screen(app)} != {width} and time.monotonic() < end_s:
        await pilot.pause()
    return await drawn(app, pilot)


def has(rows, text):
    return any(text in row for row in rows)


@pytest.mark.parametrize("size", SIZES)
async def test_screen_shows_the_session(session, size):
    app = ConsoleApp(session)
    async with app.run_test(size=size) as pilot:
        rows = await drawn(app, pilot)
        assert (len(rows), {len(row) for row in rows}) == (size[1], {size[0]})
        for text in ("0:01:23", "REC", "65.000 ± 0.022 km/h", "(3.083 ± 0.012)e-3", "-13.740 ± 0.097", "m/s²"):
            assert has(rows, text), text
        assert app._board.rows
        session.change(elapsed_s=84.2, alarms=())
        assert has(await drawn(app, pilot), "0:01:24")


async def test_trend_of_any_quantity_in_place_of_the_waveform(session, made):
    app = ConsoleApp(session)
    async with app.run_test(size=(200, 60)) as pilot:
        for second in range(60):
            for position in ("FL", "FR"):
                result = made.result(position, speed_kmh=40.0 + second)
                session.new_results.append(dataclasses.replace(result, host_ns=second * 10**9))
        await drawn(app, pilot)
        await pilot.press("t")
        rows = await drawn(app, pilot)
        assert has(rows, "speed, km/h  dots: one standard error")
        assert has(rows, "-3 min")
        assert not has(rows, "┴")  # no axis of angles
        assert has(rows, "100┤")
        session.change(elapsed_s=83.2 + 60.0)
        (line,), (older,) = ([row for row in shown if "100┤" in row] for shown in (rows, await drawn(app, pilot)))
        assert older != line, "the last value gets older"
        await pilot.press("full_stop")
        assert has(await drawn(app, pilot), "contact begins at, deg")
        await pilot.press("comma", "comma")
        assert has(await drawn(app, pilot), "temperature, °C")
        await pilot.press("t")
        assert has(await drawn(app, pilot), "┴")


async def test_address_of_the_page_stands_below(session):
    app = ConsoleApp(session, addresses=("http://127.0.0.1:8780/",))
    async with app.run_test(size=(80, 24)) as pilot:
        assert has(await drawn(app, pilot), "page: http://127.0.0.1:8780/")


async def test_only_changed_lines_are_repainted(session, monkeypatch):
    app = ConsoleApp(session)
    async with app.run_test(size=(80, 24)) as pilot:
        await drawn(app, pilot)
        regions = []
        monkeypatch.setattr(app._board, "refresh", lambda *changed, **_: regions.extend(changed))
        app.tick()
        assert regions == []
        session.change(elapsed_s=84.2)
        app.tick()
        assert [(region.y, region.height) for region in regions] == [(0, 1)]


async def test_pause_freezes_the_view(session, made):
    app = ConsoleApp(session)
    async with app.run_test(size=(80, 24)) as pilot:
        await drawn(app, pilot)
        await pilot.press("space")
        session.change(wheels=(made.wheel("FL", result={"speed_kmh": 99.0}),), elapsed_s=90.0)
        rows = await drawn(app, pilot)
        assert has(rows, "PAUSED at 0:01:23")
        assert has(rows, "65.00 ")
        assert not has(rows, "99.000")
        assert session.pauses == [True]
        await pilot.press("space")
        rows = await drawn(app, pilot)
        assert has(rows, "99.000")
        assert not has(rows, "PAUSED")
        assert session.pauses == [True, False]


async def test_keys_switch_the_wheel(session):
    app = ConsoleApp(session)
    async with app.run_test(size=(80, 24)) as pilot:
        await drawn(app, pilot)
        for keys, selected in (
            (["tab"], 1),
            (["right"], 2),
            (["down", "down"], 0),
            (["shift+tab"], 3),
            (["left", "up"], 1),
            (["4"], 3),
            (["1"], 0),
            (["8"], 0),
        ):
            await pilot.press(*keys)
            assert app.view.selected == selected, keys
        await pilot.press("3")
        assert has(screen(app), ">3 RL")
        session.change(wheels=())
        app.tick()
        await pilot.press("tab", "1")
        assert has(screen(app), "waiting for the first hello")


async def test_units_are_switched_in_turn(session):
    app = ConsoleApp(session)
    async with app.run_test(size=(120, 40)) as pilot:
        assert has(await drawn(app, pilot), "210.0 kPa")
        await pilot.press("u")
        assert has(await drawn(app, pilot), "2.100 bar")
        await pilot.press("u")
        rows = await drawn(app, pilot)
        assert has(rows, "40.389 ± 0.013 mph")
        assert has(rows, "30.46 psi")
        assert has(rows, "88.7 °F")
        assert not any(unit in row for row in rows for unit in ("km/h", "kPa", "°C"))
        await pilot.press("u")
        assert has(await drawn(app, pilot), "210.0 kPa")


async def test_zoom_and_help(session):
    app = ConsoleApp(session)
    async with app.run_test(size=(80, 24)) as pilot:
        assert has(await drawn(app, pilot), "180°")
        await pilot.press("z")
        assert has(screen(app), "-90°")
        await pilot.press("z", "?")
        rows = screen(app)
        assert has(rows, "mark an event in the recording")
        assert has(rows, "provisional")
        await pilot.press("escape")
        assert has(screen(app), "180°")
        await pilot.press("?", "?")
        assert has(screen(app), "180°")


async def test_mark_has_text_and_time_of_its_key(session):
    app = ConsoleApp(session)
    async with app.run_test(size=(80, 24)) as pilot:
        await drawn(app, pilot)
        await pilot.press("m")
        assert has(screen(app), "text of the mark")
        session.change(elapsed_s=95.0)
        # Keys with a meaning elsewhere are text here; Tab must not leave the line.
        await pilot.press(*"pot q1", "tab", "left", "left", "z", "enter")
        assert session.marks == ["pot zq1 (key pressed at 83.2 s)"]
        assert app.view.selected == 0
        assert not session.stopped
        await pilot.press("m", "enter")
        assert session.marks[1] == "mark (key pressed at 95.0 s)"
        await pilot.press("m", "x", "escape", "2")
        assert len(session.marks) == 2
        assert app.view.selected == 1
        assert not has(screen(app), "text of the mark")


async def test_record_key_asks_for_the_run_first(session):
    session.change(recording="")
    app = ConsoleApp(session)
    async with app.run_test(size=(100, 24)) as pilot:
        await drawn(app, pilot)
        await pilot.press("r")
        assert has(screen(app), "record, test: Enter leaves it out")
        await pilot.press(*"wet 3", "enter")
        assert has(screen(app), "record, driver: Enter keeps 'Ada', - clears it")
        await pilot.press("enter", "enter", "minus", "enter", *"qm", "enter")
        assert session.recordings == [{"test": "wet 3", "driver": "Ada", "tire": "", "comment": "", "tags": "qm"}]
        await pilot.press("r", "enter", "enter", *"wrong", "enter", "enter", "enter")
        assert has(screen(app), "not recorded: tire: wrong. Give another.")
        await pilot.press("enter")
        assert not has(screen(app), "not recorded")
        await pilot.press("r", "x", "escape", "m", "enter")
        assert len(session.recordings) == 1
        assert len(session.marks) == 1
        session.change(recording="drive.mcap")
        await drawn(app, pilot)
        await pilot.press("r")
        assert has(screen(app), "drive.mcap is being recorded; Enter or Escape goes back")
        await pilot.press("enter")
        assert not has(screen(app), "goes back")
        assert len(session.recordings) == 1


async def test_acknowledged_alarms_come_last_and_say_so(session):
    session.change(alarms=(Alarm("FL", "load", LOAD), Alarm("FR", "load", LOAD)), alarm_records=())
    app = ConsoleApp(session)
    async with app.run_test(size=(120, 24)) as pilot:
        rows = [row.strip() for row in await drawn(app, pilot) if "ALARM" in row]
        assert [row.partition(":")[0] for row in rows[:2]] == ["ALARM  FL", "ALARM  FR"]
        await pilot.press("a")
        rows = [row.strip() for row in await drawn(app, pilot) if "ALARM" in row]
        assert [row.partition(":")[0] for row in rows[:2]] == ["ALARM  FR", "ALARM  FL"]
        assert ["acknowledged" in row for row in rows[:2]] == [False, True]
        assert ["(a: acknowledge)" in row for row in rows[:2]] == [True, False]
        session.change(alarms=(Alarm("FL", "load", LOAD),))
        assert not any("(a:" in row for row in await drawn(app, pilot)), "there is nothing to acknowledge"


@pytest.mark.parametrize("key", ["q", "Q", "ctrl+c", "ctrl+q"])
async def test_quit_stops_the_session_and_ends(session, key):
    app = ConsoleApp(session)
    async with app.run_test(size=(80, 24)) as pilot:
        await drawn(app, pilot)
        await pilot.press(key)
        assert app.return_code == 0
    assert session.stopped


async def test_ctrl_c_quits_while_typing_a_mark(session):
    app = ConsoleApp(session)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("m", "a", "ctrl+c")
        assert app.return_code == 0
    assert session.stopped
    assert session.marks == []


async def test_ended_session_closes_after_its_last_state(session):
    app = ConsoleApp(session)
    async with app.run_test(size=(80, 24)) as pilot:
        await drawn(app, pilot)
        await pilot.press("space")
        session.change(ended=True, elapsed_s=99.0)
        app.tick()
        assert app.return_code is None
        first = "".join(text for text, _ in app._board.rows[0])
        assert "ENDED" in first
        assert "0:01:39" in first
        assert "PAUSED" not in first
        await pilot.pause()
        assert app.return_code == 0


async def test_duration_stops_the_session(session):
    app = ConsoleApp(session, lambda: session.snapshot().elapsed_s >= 90.0)
    async with app.run_test(size=(80, 24)) as pilot:
        await drawn(app, pilot)
        assert not session.stopped
        session.change(elapsed_s=90.0)
        app.tick()
        await pilot.pause()
        assert app.return_code == 0
    assert session.stopped


async def test_timer_draws(session, monkeypatch):
    ticked = asyncio.Event()
    snapshot = session.snapshot

    def observed():
        ticked.set()
        return snapshot()

    app = ConsoleApp(session)
    async with app.run_test(size=(80, 24)) as pilot:
        session.change(elapsed_s=7.0)
        monkeypatch.setattr(session, "snapshot", observed)
        await asyncio.wait_for(ticked.wait(), 10.0)
        await pilot.pause()
        assert has(screen(app), "0:00:07")


async def test_resize_draws_for_the_new_size(session):
    app = ConsoleApp(session)
    async with app.run_test(size=(80, 24)) as pilot:
        await drawn(app, pilot)
        rows = await resized(app, pilot, 120, 40)
        assert {len(row) for row in rows} == {120}
        assert has(rows, "╔═ 1 FL")
        rows = await resized(app, pilot, 30, 6)
        assert (len(rows), {len(row) for row in rows}) == (6, {30})


SCRIPT = textwrap.dedent(
    """
    from gateway.core.estimates.results import Alarm, LinkSnapshot, SessionSnapshot, WheelSnapshot
    from gateway.core.reasons import Notice, Reason
    from gateway.core.session.reasons import SessionCode
    from gateway.console.screen import run_console

    LOAD = Reason(SessionCode.VALUE_ABOVE_LIMIT, quantity="load_n", value=6000.0, limit=5000.0)

    class Session:
        calls = 0
        may_record = False
        def snapshot(self):
            self.calls += 1
            return SessionSnapshot(float(self.calls), (WheelSnapshot("FL"),), (), (Alarm("FL", "load", LOAD),),
                                   (Notice("", LOAD),), "", 0, self.calls > 4)
        def results(self): return []
        def mark(self, text): pass
        def request_stop(self): pass

    run_console(Session(), lambda: False, ())
    print("ended on its own")
    """
)


@pytest.mark.parametrize("environment", [{"NO_COLOR": "1", "TERM": "screen"}, {"TERM": "xterm-256color"}])
def test_on_a_real_terminal(environment):
    pty = pytest.importorskip("pty", reason="no pseudo-terminals on this system")
    pid, terminal = pty.fork()
    if pid == 0:  # the child is the console
        os.environ.pop("NO_COLOR", None)
        os.environ.update(environment)
        os.execv(sys.executable, [sys.executable, "-c", SCRIPT])
    output = b""
    while True:
        try:
            piece = os.read(terminal, 65536)
        except OSError:  # Linux reports the end of a pseudo-terminal as an error
            break
        if not piece:
            break
        output += piece
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    text = output.decode()
    assert "ended on its own" in text
    assert "ALARM  FL: load 6000 N is above 5000 N" in text
    assert "ENDED" in text
    codes = {code for sequence in re.findall(r"\x1b\[([0-9;]*)m", text) for code in sequence.split(";")}
    colours = codes & {"38", "48", *map(str, (*range(30, 38), *range(40, 48), *range(90, 98), *range(100, 108)))}
    assert bool(colours) == ("NO_COLOR" not in environment)
