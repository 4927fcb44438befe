"""The page with real WebSocket clients and in a real browser: content, pace, guests, refusals, marks, recordings."""

import dataclasses
import json
import math
import re
import threading
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from gateway.core.clock import SystemClock
from gateway.core.errors import RecordingError
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import AlarmRecord, SessionSnapshot, Silence, SilentPart, WheelState
from gateway.core.links.reasons import LinkCode
from gateway.core.reasons import Notice, Reason
from gateway.core.session.reasons import SessionCode
from gateway.core.shown_units import ShownUnits
from gateway.core.text.numbers import Unit
from gateway.publishing import page_listener, page_server
from gateway.publishing.page_server import PageSink
from gateway.publishing.publisher import open_publisher
from gateway.publishing.sink import PublishedRevolution, PublishedState, SinkError, SinkSetting, open_sink
from gateway.publishing.sink_worker import SinkWorker
from gateway.publishing.web_page.drive_face import place_on_car, rounded
from gateway.publishing.web_page.page_state import page_state
from tests.testkit.waiting import TIMEOUT_S, until
from tools.browser import FAINT_TEXT, Tab

CURSOR = """(() => {
  const over = document.querySelector("#waveform .u-over"), box = over.getBoundingClientRect();
  over.dispatchEvent(new MouseEvent("mouseenter", { clientX: box.x + 50, clientY: box.y + 50 }));
  over.dispatchEvent(new MouseEvent("mousemove", { clientX: box.x + 50, clientY: box.y + 50 }));
})()"""


class Session:
    """What the page asks a session for."""

    def __init__(self) -> None:
        self.may_record = True
        self.asked: list[str] = []
        self.failure: RecordingError | None = None
        self.is_recording = True

    def mark(self, text: str) -> bool:
        self.asked.append(f"mark {text}")
        return self.is_recording

    def acknowledge(self) -> None:
        self.asked.append("acknowledge")

    def show_in(self, units: ShownUnits) -> None:
        self.asked.append(f"units {units}")

    @property
    def run_form(self) -> dict[str, str]:
        return {"test": "wet braking", "driver": "", "tire": "", "comment": "", "tags": "wet"}

    def start_recording(self, form) -> None:
        if self.failure is not None:
            raise self.failure
        self.asked.append(f"start {form}" if form else "start")

    def stop_recording(self) -> None:
        self.asked.append("stop")


class Served:
    """A page with its worker, and what it serves."""

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        self.session = Session()
        self.sink = PageSink(host, port, lambda: self.session)
        self.worker = SinkWorker("web://test", self.sink, SystemClock())
        self.worker.start()
        until(lambda: self.worker.snapshot().state == "up")

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self.sink.port}"

    def end(self) -> None:
        self.worker.finish()
        assert self.worker.join(TIMEOUT_S)


@pytest.fixture
def served() -> Iterator[Served]:
    served = Served()
    yield served
    served.end()


def guest(served: Served, path: str = "/", origin: str | None = None, **changes: Any) -> ClientConnection:
    address = f"ws://127.0.0.1:{served.sink.port}{path}"
    return connect(address, origin=origin or served.origin, open_timeout=TIMEOUT_S, max_size=None, **changes)  # type: ignore[arg-type]


def next_of(connection: ClientConnection, kind: str) -> dict[str, Any]:
    while True:
        message = json.loads(connection.recv(TIMEOUT_S))
        if message["type"] == kind:
            return message


def show(served: Served, items, change=lambda snapshot: snapshot) -> None:
    """Offer all revolutions, then the state."""
    for item in items:
        if isinstance(item, PublishedState):
            served.worker.offer(dataclasses.replace(item, snapshot=change(item.snapshot)))
        else:
            served.worker.offer(item)


def first_silent(silence: Silence) -> Callable[[SessionSnapshot], SessionSnapshot]:
    """Return what makes the first wheel of a session silent."""

    def changed(snapshot: SessionSnapshot) -> SessionSnapshot:
        first, *others = snapshot.wheels
        first = dataclasses.replace(first, state=WheelState.SILENT, silences=(silence,))
        return dataclasses.replace(snapshot, wheels=(first, *others))

    return changed


def test_state_has_the_words_of_the_console(served, items) -> None:
    show(served, items)
    with guest(served) as connection:
        state = next_of(connection, "state")
    assert [wheel["position"] for wheel in state["wheels"]] == ["FL", "FR", "RL", "RR"]
    front = state["wheels"][0]
    assert front["kind"] == front["state"] == "rolling"
    value, error, unit, mark, _ = front["speed"]
    assert 10.0 < float(value) < 120.0
    assert float(error) > 0.0
    assert (unit, mark) == ("km/h", "")
    assert any(text.endswith("kPa") for text, _ in front["surroundings"])
    assert {"bending stiffness number (Bs)", "contact width number (Cw)", "contact length"} <= {
        number[0] for number in front["numbers"]
    }
    assert state["links"][0][:2] == [["sim:demo", "label"], ["connected", "good"]]
    assert state["rolling"] == "4 of 4 wheels rolling"


def test_ended_session_rolls_no_more(served, items) -> None:
    def ended(snapshot):
        wheels = tuple(dataclasses.replace(wheel, state=WheelState.ENDED) for wheel in snapshot.wheels)
        return dataclasses.replace(snapshot, ended=True, wheels=wheels)

    show(served, items, ended)
    with guest(served) as connection:
        state = next_of(connection, "state")
    assert state["rolling"] == "ended"
    for wheel in state["wheels"]:
        assert (wheel["kind"], wheel["state"]) == ("ended", "ended")
        assert wheel["speed"][0] == "—"
        assert wheel["note"][0].startswith("ended: values of revolution")


def test_silent_wheel_has_an_age_and_no_number(served, items, drive) -> None:
    silence = Silence(SilentPart.SENSOR, 7.0, Reason(SessionCode.SENSOR_SILENT, silence_s=7.0))
    show(served, items, first_silent(silence))
    with guest(served) as connection:
        connection.send(json.dumps({"wheel": "FL"}))
        front = next_of(connection, "state")["wheels"][0]
        connection.send(json.dumps({"wheel": "FR"}))
        assert next_of(connection, "waveform")["wheel"] == "FR"  # none came for the silent one
    assert front["state"] == "silent for 7 s"
    assert front["speed"][0] == "—"
    assert front["numbers"] == []
    assert [text for text, _ in front["surroundings"]][:2] == ["— kPa", "— °C"]


@pytest.mark.parametrize(
    ("part", "is_certain", "is_shown"),
    [
        (SilentPart.SAMPLES, True, True),
        (SilentPart.AXIS, True, True),
        (SilentPart.SAMPLES, False, False),
        (SilentPart.HUB, True, False),
    ],
)
def test_pressure_that_still_comes_is_shown_of_a_wheel_without_samples(
    served, items, part: SilentPart, is_certain: bool, is_shown: bool
) -> None:
    silence = Silence(part, 7.0, Reason(SessionCode.SAMPLES_SILENT, silence_s=7.0), is_certain)
    show(served, items, first_silent(silence))
    with guest(served) as connection:
        state = next_of(connection, "state")
    front = state["wheels"][0]
    assert front["state"] == "silent for 7 s"
    assert state["rolling"] == "3 of 4 wheels rolling, 1 silent"
    pressure, temperature, *_ = [text for text, _ in front["surroundings"]]
    assert (pressure, temperature) != ("— kPa", "— °C") if is_shown else (pressure, temperature) == ("— kPa", "— °C")


def test_waveform_of_the_chosen_wheel_over_its_average(served, items, drive) -> None:
    show(served, items)
    with guest(served) as connection:
        connection.send(json.dumps({"wheel": "RL"}))
        waveform = next_of(connection, "waveform")
    wheel = drive[1].wheels[2]
    assert waveform["revolution"] == wheel.last.revolution.index
    step = len(wheel.average_mps2) // len(waveform["angle_deg"])
    assert waveform["average_mps2"] == pytest.approx(wheel.average_mps2[::step], abs=0.01)
    assert waveform["scatter_mps2"] == pytest.approx(wheel.scatter_mps2[::step], abs=0.01)
    assert waveform["orders_mps2"][2] == pytest.approx(abs(wheel.last.revolution.orders_mps2[2]), abs=0.01)
    assert waveform["edges_deg"][0] == pytest.approx(math.degrees(wheel.last.revolution.leading_edge_rad), abs=0.01)


def test_trend_comes_whole_then_in_parts(served, items, drive) -> None:
    show(served, items)
    with guest(served) as connection:
        connection.send(json.dumps({"trend": "speed_mps"}))
        names = [quantity["name"] for quantity in next_of(connection, "quantities")["quantities"]]
        whole = next_of(connection, "trend")
        last = drive[0][-1]
        later = dataclasses.replace(last, host_ns=last.host_ns + 5_000_000_000)
        served.worker.offer(PublishedRevolution(later.host_ns, later))
        until(lambda: served.worker.snapshot().published == len(drive[0]) + 3)
        page = next(iter(served.sink._pages))
        page.trend_due_s = 0.0
        show(served, items[-1:])
        part = next_of(connection, "trend")
    assert {"speed_mps", "Bs", "pressure_pa", "contact_length_m"} <= set(names)
    assert whole["since_s"] == 0
    assert set(whole["wheels"]) == {"FL", "FR", "RL", "RR"}
    points = whole["wheels"][last.position]
    assert [point[0] for point in points] == sorted({point[0] for point in points})
    assert all(point[2] > 0.0 for point in points)
    assert part["since_s"] == max(points[-1][0] for points in whole["wheels"].values())
    assert [point[0] for point in part["wheels"][last.position]][-1] == later.host_ns // 10**9


def test_mark_and_recording_reach_the_session_and_failures_the_page(served, items) -> None:
    show(served, items)
    with guest(served) as connection:
        for wish in (
            {"mark": " pothole\x1b[2J "},
            {"record": True, "run": {"test": "a\x1bb", "tags": 7}},
            {"record": False},
            {"acknowledge": True},
            {"mark": ""},
        ):
            connection.send(json.dumps(wish))
        said = [next_of(connection, "said")["text"] for _ in range(5)]
        assert said == [
            "mark set: pothole [2J",
            "recording started",
            "recording finished",
            "alarms acknowledged",
            "mark set: mark",
        ]
        served.session.failure = RecordingError("the disk is full", "Free some space.")
        connection.send(json.dumps({"record": True}))
        assert next_of(connection, "said")["text"] == "the disk is full. Free some space."
        for rubbish in ("{", "[" * 4096, "[1]", '{"mark": 1, "record": "x", "wheel": [], "trend": null}', "null"):
            connection.send(rubbish)
        connection.send(json.dumps({"mark": "x" * 999}))
        assert len(next_of(connection, "said")["text"]) < 250
        served.session.is_recording = False
        connection.send(json.dumps({"mark": "kerb"}))
        assert next_of(connection, "said")["text"] == "mark: kerb: not kept: nothing is recorded"
    assert served.session.asked[:5] == ["mark pothole [2J", "start {'test': 'a b'}", "stop", "acknowledge", "mark mark"]


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1"])
def test_page_of_another_site_is_refused(served, origin) -> None:
    with pytest.raises(InvalidStatus, match="403"), guest(served, origin=origin):
        pass


def test_client_without_origin_is_refused(served) -> None:
    address = f"ws://127.0.0.1:{served.sink.port}/"
    with pytest.raises(InvalidStatus, match="403"), connect(address, open_timeout=TIMEOUT_S):
        pass


def get(address: str, host: str = "") -> tuple[int, str, Any]:
    request = urllib.request.Request(address, headers={"Host": host} if host else {})
    try:
        with urllib.request.urlopen(request, timeout=TIMEOUT_S) as answer:
            return answer.status, answer.read().decode(), answer.headers
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode(), error.headers


def test_page_is_one_file_for_this_computer_only(served) -> None:
    status, html, headers = get(served.sink.address)
    assert status == 200
    assert "src=" not in html
    assert "http://" not in html
    assert "Permission is hereby granted" in html  # the licence of the plots goes with them
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert get(served.sink.address, host="evil.example")[0] == 403
    assert get(served.sink.address, host="localhost:9999")[0] == 200  # a forwarded port
    assert get(f"{served.sink.address}other")[0] == 404


def test_wider_page_needs_its_token() -> None:
    served = Served("0.0.0.0")
    try:
        token = served.sink.address.partition("?token=")[2]
        assert len(token) > 20
        assert "0.0.0.0" not in served.sink.address
        local = f"http://127.0.0.1:{served.sink.port}/"
        queries = ("", "?token=", "?token=x", f"?token={token}")
        assert [get(f"{local}{query}")[0] for query in queries] == [403, 403, 403, 200]
        for path, origin in (("/", served.origin), (f"/?token={token}", "http://evil.example")):
            with pytest.raises(InvalidStatus, match="403"), guest(served, path, origin):
                pass
        with guest(served, f"/?token={token}"):
            pass
    finally:
        served.end()


def test_twenty_pages_and_one_too_many(served, items) -> None:
    with ExitStack() as others:
        guests = [others.enter_context(guest(served)) for _ in range(page_listener.MOST_PAGES - 1)]
        with guest(served) as last:
            show(served, items)
            assert all(next_of(connection, "state")["wheels"] for connection in (*guests, last))
            with pytest.raises(InvalidStatus, match="503"), guest(served):
                pass
        until(lambda: len(served.sink._pages) < page_listener.MOST_PAGES)
        others.enter_context(guest(served))


def test_slow_page_holds_nobody_and_gets_the_latest(served, items) -> None:
    # More than the buffers of the system take for a client that does not read.
    long = Notice("x" * 500_000, Reason(LinkCode.LINK_CONNECTED))
    states = 40

    def numbered(number):
        return lambda snapshot: dataclasses.replace(snapshot, elapsed_s=number, notices=(long,))

    with guest(served, max_queue=1, ping_interval=None) as slow, guest(served) as quick:
        for number in range(1, states + 1):
            show(served, items[-1:], numbered(number))
            assert next_of(quick, "state")["elapsed"] == f"0:00:{number:02d}"
        assert served.worker.snapshot().state == "up"
        seen = 1
        while next_of(slow, "state")["elapsed"] != f"0:00:{states}":
            seen += 1
    assert seen < states


def test_state_that_comes_while_the_one_before_is_written_is_shown(served, items, monkeypatch) -> None:
    def overtaken(snapshot, run_form):
        if not snapshot.elapsed_s:
            later = dataclasses.replace(snapshot, elapsed_s=7)
            served.sink.send(dataclasses.replace(items[-1], snapshot=later), threading.Event())
        return page_state(snapshot, run_form=run_form)

    monkeypatch.setattr(page_server, "page_state", overtaken)
    with guest(served) as connection:
        show(served, items[-1:], lambda snapshot: dataclasses.replace(snapshot, elapsed_s=0))
        assert [next_of(connection, "state")["elapsed"] for _ in range(2)] == ["0:00:00", "0:00:07"]


def test_port_that_is_taken_is_an_error_at_once(served) -> None:
    with pytest.raises(SinkError, match=r"cannot listen on 127\.0\.0\.1") as failure:
        open_publisher([f"web://127.0.0.1:{served.sink.port}"], SinkSetting(), SystemClock())
    assert f"web://127.0.0.1:{served.sink.port + 1}" in str(failure.value.remedy)
    assert "while attempting" not in str(failure.value)
    with pytest.raises(SinkError) as failure:
        open_sink("web://192.0.2.7:0", SinkSetting())
    assert "address of this computer" in str(failure.value.remedy), "another port is no help"


def test_port_0_is_a_free_port() -> None:
    with ExitStack() as stack:
        pages = [open_sink("web://127.0.0.1:0", SinkSetting())[1] for _ in range(2)]
        for page in pages:
            assert isinstance(page, PageSink)
            stack.callback(page.close)
        assert len({8780, *(page.port for page in pages)}) == 3  # type: ignore[attr-defined]


@pytest.mark.parametrize("uri", ["web://127.0.0.1:0/path", "web://127.0.0.1:0?x=1", "web://:80", "web://192.0.2.7:0"])
def test_address_that_cannot_be_used(uri) -> None:
    with pytest.raises(SinkError):
        open_sink(uri, SinkSetting())


def test_drive_face_says_what_to_do_and_what_is_stated(served, items) -> None:
    show(served, items)
    with guest(served) as connection:
        drive = next_of(connection, "state")["drive"]
    assert (drive["kind"], drive["line"], drive["alarms"]) == ("good", "All is well.", [])
    front = drive["wheels"][0]
    assert (front["position"], front["place"], front["kind"], front["state"]) == ("FL", [0, 0], "good", "rolling")
    assert front["values"]["pressure_pa"]["source"] == "measured"
    assert front["values"]["load_n"]["source"] == "stated"
    assert front["values"]["load_n"]["unit"] == "N"
    assert drive["speed"]["unit"] == "km/h"


@pytest.mark.parametrize(
    ("units", "symbols"), [("si", "km/h kPa °C N"), ("bar", "km/h bar °C N"), ("us", "mph psi °F lbf")]
)
def test_both_faces_and_the_trends_have_the_units_of_the_session(served, items, units, symbols) -> None:
    show(served, items, lambda snapshot: dataclasses.replace(snapshot, units=ShownUnits(units)))
    with guest(served) as connection:
        state = next_of(connection, "state")
        connection.send(json.dumps({"trend": "pressure_pa"}))
        quantities = {item["name"]: item["unit"] for item in next_of(connection, "quantities")["quantities"]}
        (*_, point) = next_of(connection, "trend")["wheels"]["FL"]
    speed, pressure, temperature, load = symbols.split()
    front, tile = state["wheels"][0], state["drive"]["wheels"][0]["values"]
    assert front["speed"][2] == state["drive"]["speed"]["unit"] == quantities["speed_mps"] == speed
    runs = " ".join(text for text, _ in front["surroundings"])
    for symbol, name in ((pressure, "pressure_pa"), (temperature, "temperature_degc"), (load, "load_n")):
        assert f" {symbol}" in runs
        assert tile[name]["unit"] == symbol
    true_kpa = items[-1].snapshot.wheels[0].pressure_pa * 1e-3
    kpa = {"kPa": 1.0, "bar": 100.0, "psi": 6.894757}[pressure]
    assert point[1] * kpa == pytest.approx(true_kpa, abs=1.0)
    assert state["units"] == units


def test_units_are_asked_of_the_session(served, items) -> None:
    show(served, items)
    with guest(served) as connection:
        connection.send(json.dumps({"units": "us"}))
        assert next_of(connection, "said")["text"] == "units: mph, psi, °F, lbf"
        connection.send(json.dumps({"units": "furlongs"}))
        connection.send(json.dumps({"acknowledge": True}))
        assert next_of(connection, "said")["text"] == "alarms acknowledged"
    assert served.session.asked == ["units us", "acknowledge"]


@pytest.mark.parametrize(
    ("value", "std", "unit", "text"),
    [
        (228.4, 1.0, Unit("kPa"), "230"),
        (2.284, 0.01, Unit("bar"), "2.3"),
        (2.284, 0.3, Unit("bar"), "2.5"),
        (-0.04, 0.02, Unit("mm"), "0.0"),
        (64.6, 0.65, Unit("km/h"), "65"),
        (64.6, math.nan, Unit("km/h"), "65"),
        (1043.0, 60.0, Unit("lbf"), "1000"),
    ],
)
def test_number_of_the_driver_is_no_finer_than_its_error(value, std, unit, text) -> None:
    assert rounded(value, std, unit) == text


def test_drive_face_begins_with_an_alarm_and_lists_the_others(served, items, made) -> None:
    alarms = (made.alarm("FR"), made.alarm("RL", "silent", "no samples for 7 s. A fault?"))
    show(served, items, lambda snapshot: dataclasses.replace(snapshot, alarms=alarms))
    with guest(served) as connection:
        drive = next_of(connection, "state")["drive"]
    assert (drive["kind"], drive["line"]) == ("act", "FR: 171.0 kPa is below 180.0 kPa")
    assert drive["step"] == "FR: stop as soon as you can, and check the tire"
    assert drive["alarms"] == ["RL: no samples for 7 s. A fault?"]
    records = (AlarmRecord("FR", alarms[0].name, alarms[0].reason, 1, 2.0, 38.0, 40.0, is_standing=True),)
    show(served, items[-1:], lambda snapshot: dataclasses.replace(snapshot, alarms=alarms, alarm_records=records))
    with guest(served) as connection:
        while (drive := next_of(connection, "state")["drive"])["line"] == "FR: 171.0 kPa is below 180.0 kPa":
            pass
    assert drive["line"] == "FR: 171.0 kPa is below 180.0 kPa (alarm since 0:00:38)"
    assert [wheel["kind"] for wheel in drive["wheels"]] == ["good", "act", "act", "good"]


def test_drive_face_of_an_ended_or_silent_session_has_no_number_that_looks_alive(served, items) -> None:
    silence = Silence(SilentPart.SENSOR, 7.0, Reason(SessionCode.SENSOR_SILENT, silence_s=7.0))
    show(served, items, first_silent(silence))
    with guest(served) as connection:
        drive = next_of(connection, "state")["drive"]
        assert drive["line"] == "FL: silent for 7 s."
        assert drive["step"] == "FL: not watched now: drive on with care"
        values = drive["wheels"][0]["values"]
        assert {name: (value["source"], value["note"]) for name, value in values.items() if value} == {
            **dict.fromkeys(("pressure_pa", "temperature_degc"), ("old", "7 s old")),
            **({"wear_mm": ("old", "7 s old")} if values["wear_mm"] else {}),
            "load_n": ("stated", "stated"),
        }
        show(served, items[-1:], lambda snapshot: dataclasses.replace(snapshot, ended=True))
        while not (state := next_of(connection, "state"))["ended"]:
            pass
    drive = state["drive"]
    assert (drive["kind"], drive["line"]) == ("unknown", "The session has ended.")
    assert drive["wheels"][1]["values"]["pressure_pa"]["note"] == "at the end"


def test_pressure_that_a_silent_wheel_still_sends_is_said_to_be_received(served, items) -> None:
    silence = Silence(SilentPart.SAMPLES, 7.0, Reason(SessionCode.SAMPLES_SILENT, silence_s=7.0))
    show(served, items, first_silent(silence))
    with guest(served) as connection:
        state = next_of(connection, "state")
    assert state["drive"]["wheels"][0]["values"]["pressure_pa"]["source"] == "received"
    text, role = state["wheels"][0]["surroundings"][0]
    assert (text.endswith("kPa still received"), role) == (True, "label")
    assert state["wheels"][1]["surroundings"][0][1] == "value"


@pytest.mark.parametrize(
    ("wear_mm", "std_mm", "text", "note"),
    [(-0.7, 0.53, "0", ""), (-0.7, 0.2, "—", "check what is taken as new"), (0.9, 0.2, "0.8", "")],
)
def test_wear_below_zero_is_no_wear_or_a_wrong_reference(served, items, wear_mm, std_mm, text, note) -> None:
    wear = Estimate("wear_mm", wear_mm, std_mm, Status.VALID)

    def worn(snapshot):
        wheels = tuple(dataclasses.replace(wheel, wear_mm=wear) for wheel in snapshot.wheels)
        return dataclasses.replace(snapshot, wheels=wheels)

    show(served, items, worn)
    with guest(served) as connection:
        state = next_of(connection, "state")
    shown = state["drive"]["wheels"][0]["values"]["wear_mm"]
    assert (shown["text"], shown["note"]) == (text, note)
    (row,) = (row for row in state["wheels"][0]["numbers"] if row[0] == "wear")
    assert row[1].startswith("-") == (wear_mm < -2.0 * std_mm)


@pytest.mark.parametrize(
    ("position", "expected"),
    [
        ("FL", (0, 0)),
        ("RR", (1, 1)),
        ("rear.left", (1, 0)),
        ("Front_Right", (0, 1)),
        ("hub0.wheel2", None),
        ("drum", None),
    ],
)
def test_place_of_a_wheel_on_a_car(position, expected) -> None:
    assert place_on_car(position) == expected


# In a browser


def text_of(tab: Tab, selector: str) -> str:
    return str(tab.value(f"document.querySelector({selector!r}).innerText"))


def test_browser_shows_wheels_plots_trends_and_marks(browser, served, items) -> None:
    show(served, items)
    tab = browser.tab()
    tab.open(served.sink.address)
    tab.until("document.querySelectorAll('.wheel.rolling').length === 4")
    assert "km/h" in text_of(tab, ".wheel .speed")
    tab.until("['waveform', 'orders', 'trend'].every((id) => document.querySelector(`#${id} canvas`))")
    tab.until("document.querySelectorAll('#quantity option').length > 20")
    tab.value("document.querySelectorAll('.wheel')[2].click()")
    tab.until("document.querySelector('#numbers-title').innerText.endsWith('RL')")
    tab.until("document.querySelector('#waveform-note').innerText.startsWith('RL')")
    tab.value("quantity.value = 'contact_length_m'; quantity.dispatchEvent(new Event('change'))")
    tab.until("document.querySelector('#trend-legend').innerText.includes('mm')")
    tab.until(
        "[...document.querySelectorAll('#trend-legend > *')].map((e) => e.innerText.slice(0, 2)) == 'FL,FR,RL,RR'"
    )
    # Wheels are left out and zoomed by buttons that a keyboard reaches; the cursor reads values.
    tab.value("document.querySelector('#trend-legend button').click()")
    tab.until("document.querySelector('#trend-legend').innerText.startsWith('FL: left out')")
    tab.value("document.querySelector('#trend-legend button').click()")
    tab.value("document.querySelector('#zoom-in').click()")
    assert tab.value("latest.ariaPressed") == "false"
    tab.value("latest.click()")
    assert tab.value("latest.ariaPressed") == "true"
    tab.value(CURSOR)
    tab.until("document.querySelector('#waveform-read').innerText.includes('last')")
    # By keyboard: a mark from its field, then the button of the recording.
    tab.value("document.querySelector('#mark-text').focus()")
    tab.call("Input.insertText", text="pothole")
    for kind in ("keyDown", "keyUp"):
        tab.call("Input.dispatchKeyEvent", type=kind, key="Enter", code="Enter", windowsVirtualKeyCode=13, text="\r")
    tab.until("said.innerText === 'mark set: pothole'")
    assert text_of(tab, "#history").endswith("mark set: pothole")
    tab.value("document.querySelector('#record').click()")
    tab.until("document.querySelector('#run').elements.test.value === 'wet braking'")
    tab.value("document.querySelector('#run').elements.driver.focus()")
    tab.call("Input.insertText", text="Ada")
    tab.value("document.querySelector('#run button').click()")
    tab.until("said.innerText === 'recording started'")
    form = {"test": "wet braking", "driver": "Ada", "tire": "", "comment": "", "tags": "wet"}
    assert served.session.asked == ["mark pothole", f"start {form}"]
    assert tab.errors == []


def test_two_browsers_get_every_state_at_their_own_wheel(browser, served, items) -> None:
    tabs = [browser.tab(), browser.tab()]
    for tab in tabs:
        tab.open(served.sink.address, 390, 844)
    show(served, items)
    for tab in tabs:
        tab.until("document.querySelectorAll('.wheel').length === 4")
    tabs[1].value("document.querySelectorAll('.wheel')[1].click()")
    for number in range(10, 20):
        show(served, items[-1:], lambda snapshot, number=number: dataclasses.replace(snapshot, elapsed_s=number))
        for tab in tabs:
            tab.until(f"elapsed.innerText === 'running 0:00:{number}'")
    chosen = [text_of(tab, '.wheel[aria-pressed="true"] .name') for tab in tabs]
    assert chosen == ["FL", "FR"]
    for tab in tabs:
        assert tab.value("document.documentElement.scrollWidth") <= 390
        # A note has the width of its row, not a column of a few words.
        note, row = (f"document.querySelector('#numbers {part}').clientWidth" for part in ("td:last-child", "tr"))
        assert tab.value(f"{note} > 0.9 * {row}")


def test_lost_connection_has_an_age_in_place_of_numbers_and_comes_back(browser, items) -> None:
    served = Served()
    port = served.sink.port
    tab = browser.tab()
    tab.open(served.sink.address)
    show(served, items)
    tab.until("document.querySelectorAll('.wheel.rolling').length === 4")
    served.end()
    tab.until("document.querySelectorAll('.wheel.silent').length === 4")
    assert text_of(tab, ".wheel .speed").startswith("—")
    assert text_of(tab, ".wheel .kind").startswith("no connection for")
    assert text_of(tab, "#drive-line").startswith("This page hears nothing")
    tab.value("document.querySelector('#to-drive').click()")
    tile = text_of(tab, ".tile")
    assert re.search(r"pressure, \d+ s old", tile)
    assert "load, stated" in tile
    assert tab.value("getComputedStyle(document.querySelector('.tile dd.old')).fontWeight") == "400"
    tab.value("document.querySelector('#to-engineer').click(); localStorage.clear()")
    again = Served(port=port)
    try:
        show(again, items)
        tab.until("document.querySelectorAll('.wheel.rolling').length === 4")
        tab.until("link.innerText === 'connected'")
    finally:
        again.end()


def test_alarm_of_an_ended_session_is_not_over_and_a_mark_after_it_not_done(browser, items, made) -> None:
    served = Served()
    tab = browser.tab()
    tab.open(served.sink.address)
    show(served, items[-1:], lambda snapshot: dataclasses.replace(snapshot, alarms=(made.alarm("FR"),)))
    tab.until("document.querySelector('#history')?.innerText.includes('ALARM FR')")
    show(served, items[-1:], lambda snapshot: dataclasses.replace(snapshot, ended=True, alarms=()))
    tab.until("link.innerText === 'session ended'")
    assert "over" not in text_of(tab, "#history")
    served.end()
    click = "document.querySelector('#marks button').click()"
    tab.until(f"{click} || said.innerText === 'not done: the session has ended'")
    tab.value(f"document.querySelector('#mark-text').value = 'pothole'; {click}")
    assert tab.value("document.querySelector('#mark-text').value") == "pothole", "it can be sent again"


def test_alarm_has_one_line_with_its_begin_and_the_value_of_now(browser, served, items, made) -> None:
    """Also on a page that is opened later: the history has the time that the verdict and the notices have."""
    tab = browser.tab()
    tab.open(served.sink.address)
    for silence_s in (9, 10):
        alarm = made.alarm("FR", "silent", f"no samples for {silence_s} s")
        record = AlarmRecord("FR", "silent", alarm.reason, 2, 9.0, 1.0, 14.0, is_standing=True, raised_s=5.1)
        changed = {"alarms": (alarm,), "alarm_records": (record,), "elapsed_s": 5.0 + silence_s}
        show(served, items[-1:], lambda snapshot, changed=changed: dataclasses.replace(snapshot, **changed))
        tab.until(f"document.querySelector('#history')?.innerText.includes('no samples for {silence_s} s')")
    assert text_of(tab, "#history") == "0:00:05ALARM FR: no samples for 10 s"


def test_names_from_outside_stay_text(browser, served, items) -> None:
    name = "<img src=x onerror=document.title='x'>"

    def renamed(snapshot):
        return dataclasses.replace(snapshot, wheels=(dataclasses.replace(snapshot.wheels[0], position=name),))

    show(served, items, renamed)
    tab = browser.tab()
    tab.open(served.sink.address)
    tab.until("document.querySelectorAll('.wheel').length === 1")
    assert text_of(tab, ".wheel .name") == name
    assert tab.value("document.images.length") == 0


@pytest.mark.parametrize("is_dark", [False, True])
def test_contrast_is_enough_by_day_and_by_night(browser, served, items, is_dark) -> None:
    show(served, items)
    tab = browser.tab()
    tab.open(served.sink.address, is_dark=is_dark)
    tab.until("document.querySelectorAll('.wheel.rolling').length === 4")
    assert tab.value(FAINT_TEXT) == []
    tab.value("document.querySelector('#to-drive').click()")
    tab.until("document.querySelectorAll('.tile.good').length === 4")
    assert tab.value(FAINT_TEXT) == []
    tab.value("localStorage.clear()")


def test_both_faces_have_the_verdict_once_and_say_that_nothing_is_recorded(browser, served, items, made) -> None:
    alarms = (made.alarm("FR"), made.alarm("RL", "silent", "no samples for 7 s. A fault?"))
    tab = browser.tab()
    tab.open(served.sink.address)
    show(served, items, lambda snapshot: dataclasses.replace(snapshot, alarms=alarms, elapsed_s=40.0))
    tab.until("document.querySelectorAll('.wheel').length === 4")
    for face in ("engineer", "drive"):
        tab.value(f"document.querySelector('#to-{face}').click()")
        assert text_of(tab, "#drive-line b") == "FR: stop as soon as you can, and check the tire"
        assert tab.value("document.querySelector('#drive-line').checkVisibility()")
        assert (
            tab.value("getComputedStyle(document.querySelector('#drive-line')).backgroundColor") != "rgba(0, 0, 0, 0)"
        )
        assert tab.value("document.querySelector('#drive-line').role") == "alert"
        assert text_of(tab, "#elapsed") == "running 0:00:40"
        assert text_of(tab, "#recording") == "not recording"
        filled, plain = (
            tab.value(f"getComputedStyle(document.querySelector('{pill}')).backgroundColor")
            for pill in ("#recording", "#link")
        )
        assert filled != plain
        assert tab.value(FAINT_TEXT) == []
    tab.value("document.querySelector('#to-engineer').click(); localStorage.clear()")
    assert text_of(tab, "#alarms") == "ALARM RL: no samples for 7 s. A fault?"


def test_drive_face_is_one_click_away_remembered_and_in_the_chosen_units(browser, served, items) -> None:
    show(served, items)
    tab = browser.tab()
    tab.open(served.sink.address, 390, 844)
    tab.until("document.querySelectorAll('.wheel.rolling').length === 4")
    assert tab.value("document.querySelector('#drive').hidden")
    tab.value("document.querySelector('#to-drive').click()")
    tab.until("document.querySelectorAll('.tile.good').length === 4")
    assert text_of(tab, "#drive-line") == "All is well."
    assert tab.value("document.querySelector('main').hidden")
    assert tab.value("document.documentElement.scrollWidth") <= 390
    first = text_of(tab, ".tile")
    assert "kPa" in first
    assert "load, stated" in first
    tab.value("units.value = 'us'; units.dispatchEvent(new Event('change'))")
    until(lambda: served.session.asked == ["units us"])
    show(served, items[-1:], lambda snapshot: dataclasses.replace(snapshot, units=ShownUnits.US))
    tab.until("document.querySelector('.tile').innerText.includes('psi')")
    assert "mph" in text_of(tab, "#drive-speed")
    tab.open(served.sink.address, 390, 844)
    tab.until("document.querySelectorAll('.tile.good').length === 4")
    assert "psi" in text_of(tab, ".tile")
    tab.value("document.querySelector('#to-engineer').click(); localStorage.clear()")
    assert not tab.value("document.querySelector('main').hidden")
    assert tab.errors == []


@pytest.mark.parametrize("face", ["drive", "engineer"])
def test_keyboard_and_screen_reader_reach_all_in_the_order_of_the_page(browser, served, items, made, face) -> None:
    show(served, items, lambda snapshot: dataclasses.replace(snapshot, alarms=(made.alarm("FR"),)))
    tab = browser.tab()
    tab.open(served.sink.address)
    tab.until("document.querySelectorAll('.wheel.rolling').length === 4")
    tab.until("document.querySelectorAll('#trend-legend button').length === 4")
    tab.value(f"document.querySelector('#to-{face}').click()")
    controls = "[...document.querySelectorAll('button, select, input')].filter((one) => one.checkVisibility())"
    expected = tab.value(f"{controls}.length")
    assert expected > (6 if face == "drive" else 18)
    tab.value("document.activeElement.blur(); window.reached = new Set()")
    for _ in range(2 * expected):
        for kind in ("keyDown", "keyUp"):
            tab.call("Input.dispatchKeyEvent", type=kind, key="Tab", code="Tab", windowsVirtualKeyCode=9)
        tab.value("window.reached.add(document.activeElement)")
    assert tab.value(f"{controls}.filter((one) => !window.reached.has(one)).map((one) => one.outerHTML)") == []
    tab.call("Accessibility.enable")
    named = {"button", "combobox", "textbox", "image", "alert", "region", "group"}
    without_name = [
        node["role"]["value"]
        for node in tab.call("Accessibility.getFullAXTree")["nodes"]
        if not node["ignored"] and node["role"]["value"] in named and not node.get("name", {}).get("value")
    ]
    assert without_name == []
    tab.value("localStorage.clear()")


def test_nothing_is_squeezed_on_a_phone(browser, served, items, made) -> None:
    alarm = made.alarm("FR")
    show(served, items, lambda snapshot: dataclasses.replace(snapshot, alarms=(alarm,)))
    tab = browser.tab()
    tab.open(served.sink.address, 390, 844)
    tab.until("document.querySelectorAll('.wheel').length === 4")
    tab.value("document.querySelector('#to-drive').click()")
    tab.until("document.querySelectorAll('.tile').length === 4")
    assert tab.value("document.documentElement.scrollWidth") <= 390
    inside = "[...document.querySelectorAll('#drive *, header :not(.hidden)')]"
    is_cut = "one.scrollWidth > one.clientWidth + 1 && one.clientWidth && getComputedStyle(one).overflow != 'visible'"
    assert tab.value(f"{inside}.filter((one) => {is_cut}).map((one) => one.outerHTML)") == []
    # A number stands on one line with its unit, and a mark can be read while it is typed.
    heights = tab.value("[...document.querySelectorAll('.tile dd')].map((one) => one.clientHeight)")
    assert max(heights) < 1.6 * tab.value("parseFloat(getComputedStyle(document.querySelector('.tile dd')).fontSize)")
    assert tab.value("document.querySelector('#mark-text').clientWidth") > 300
    assert tab.value("document.querySelector('#drive-line').clientWidth") > 340
    assert text_of(tab, "#drive-line b") == "FR: stop as soon as you can, and check the tire"
    tab.value("localStorage.clear()")
