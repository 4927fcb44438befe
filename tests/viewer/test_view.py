"""The viewer: parts of a recording as the whole has them, what it stores and refuses, and the page in a browser."""

import json
import math
import threading
from array import array
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from gateway.compare.views.drive import Drive
from gateway.compare.views.drive_pictures import begin_ns
from gateway.core.errors import RecordingError, TreadlinkError
from gateway.core.recording import reader
from gateway.core.recording.reader import RecordingReader
from gateway.core.session.recording_pass import open_recording
from gateway.exporting.recorded_signals import SignalBlock, revolutions, sample_blocks
from gateway.viewer import level_cache, recording_view
from gateway.viewer.chunk_index import RecordedPart, chunk_index
from gateway.viewer.order_waterfall import OrderWaterfall, magnitudes
from gateway.viewer.recording_view import RecordingView
from gateway.viewer.rolled_revolutions import RolledRevolutions
from gateway.viewer.sample_levels import SampleLevels, SampleTimes
from gateway.viewer.view_server import ViewServer
from tests.testkit.campaign_recordings import write_recording
from tests.testkit.commands import invoked
from tests.testkit.revolution_data import plain_revolution
from tests.testkit.vehicle_bus import DBC, MAPPING
from tests.testkit.waiting import TIMEOUT_S, until
from tools.browser import Tab

TABLES = "faults = ['drop:rate=0.004']\n[sensor]\nrate_hz = 2000.0"
WHEELS = ("load_n = 4200.0", "load_n = 3900.0\n[wheel.sensor]\naxes = ['circumferential', 'radial']")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """A recording of two wheels that loses frames; the sensor of W1 has no lateral axis."""
    return write_recording(tmp_path_factory.mktemp("view") / "drive.mcap", TABLES, wheels=WHEELS, duration_s=9.0)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    """The user's cache."""
    monkeypatch.setattr(level_cache, "cache_folder", lambda: tmp_path / "cache")
    return tmp_path / "cache"


@pytest.fixture
def view(recorded) -> RecordingView:
    complete = RecordingView(recorded)
    complete.complete(lambda: False)
    return complete


def never() -> bool:
    return False


def test_chunks_of_a_finished_recording_are_those_of_the_same_file_cut_off(recorded, tmp_path) -> None:
    whole = chunk_index(recorded)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[: int(whole.offset[-1] + whole.length[-1])])
    walked = chunk_index(cut)
    for name in ("offset", "length", "begin_ns", "end_ns", "channels"):
        assert np.array_equal(getattr(walked, name), getattr(whole, name)), name
    assert np.all(np.diff(whole.offset) >= whole.length[:-1])


def test_part_has_the_messages_of_its_chunks(recorded) -> None:
    index = chunk_index(recorded)
    every = [message.data for message in RecordingReader(recorded).messages()]
    halves = [RecordedPart(recorded, index, part) for part in np.array_split(np.arange(len(index.offset)), 2)]
    parts = [message.data for part in halves for message in part.messages()]
    assert parts == every
    assert all(part.damage is None for part in halves)


@pytest.mark.parametrize(("field", "stated"), [(0, 2**61), (0, 2**64 - 1), (-16, 2**63)])
def test_summary_of_a_place_beyond_the_file_or_an_impossible_time_is_left_out(
    recorded, tmp_path, field, stated
) -> None:
    hostile, whole = tmp_path / "hostile.mcap", chunk_index(recorded)
    data = bytearray(recorded.read_bytes())
    at = data.index(int(whole.offset[3]).to_bytes(8, "little") + int(whole.length[3]).to_bytes(8, "little"))
    data[at + field : at + field + 8] = stated.to_bytes(8, "little")
    hostile.write_bytes(data)
    assert len(chunk_index(hostile).offset) == len(whole.offset) - 1
    assert len(RecordingView(hostile).samples(2.0, 3.0, 100)["W0"].time_s)


def test_bins_hold_the_smallest_and_the_largest_sample() -> None:
    random = np.random.default_rng(5)
    times = np.sort(random.uniform(0.0, 10.0, 5000))
    axes = random.normal(size=(5000, 3))
    axes[:, 1] = np.nan
    levels = SampleLevels(0.0, 0.05, 200)
    for part in np.array_split(np.arange(5000), 13):
        levels.add("FL", times[part], axes[part], lost=2)
    shown = levels.envelope("FL", 2.0, 4.0, 10)
    assert shown.lost.sum() <= 26
    width = np.diff(shown.time_s)[0]
    for column, time_s in enumerate(shown.time_s):
        inside = np.abs(times - time_s) < 0.5 * width
        assert shown.low[column, [0, 2]] == pytest.approx(axes[inside][:, [0, 2]].min(axis=0))
        assert shown.high[column, [0, 2]] == pytest.approx(axes[inside][:, [0, 2]].max(axis=0))
        assert np.isnan(shown.low[column, 1])


def test_zoomed_samples_are_those_of_the_recording_at_the_same_times(view, recorded) -> None:
    blocks = [block for block in sample_blocks(open_recording(RecordingReader(recorded))) if block.wheel == "W0"]
    times = np.concatenate([(block.host_time_ns - view.begin_ns) * 1e-9 for block in blocks])
    axes = np.concatenate([block.axes_mps2 for block in blocks])
    for begin_s, end_s in ((0.0, 0.05), (5.0, 5.02), (5.01, 5.3), (7.9, 8.0)):
        shown = view.samples(begin_s, end_s, 1000)["W0"]
        inside = (times >= begin_s) & (times < end_s)
        assert shown.time_s == pytest.approx(times[inside], abs=2e-6)
        assert np.array_equal(shown.low, axes[inside], equal_nan=True)
        assert np.array_equal(shown.low, shown.high, equal_nan=True)
    assert np.isnan(view.samples(5.0, 5.1, 10)["W1"].low[:, 1]).all()


def test_long_part_has_the_extremes_and_the_losses_of_its_samples(view, monkeypatch) -> None:
    exact = view.samples(1.0, 8.0, 50)
    monkeypatch.setattr(recording_view, "LONGEST_PART_S", 1.0)
    binned = view.samples(1.0, 8.0, 50)
    for wheel in ("W0", "W1"):
        assert np.nanmax(binned[wheel].high) == pytest.approx(np.nanmax(exact[wheel].high), rel=1e-6)
        assert len(binned[wheel].time_s) <= 52
    assert sum(binned[wheel].lost.sum() for wheel in binned) > 0


def test_first_glance_lies_within_the_samples(recorded, monkeypatch) -> None:
    monkeypatch.setattr(recording_view, "LONGEST_PART_S", 1.0)
    monkeypatch.setattr(recording_view, "_GLANCES", 8)
    glanced, complete = RecordingView(recorded), RecordingView(recorded)
    glanced.glance()
    complete.complete(never)
    assert glanced.wheels == ["W0", "W1"]
    first, last = glanced.samples(0.0, 9.0, 60)["W0"], complete.samples(0.0, 9.0, 60)["W0"]
    assert len(first.time_s) >= 8
    assert np.isfinite(first.low[:, 2]).all(), "no gap where nothing has been read yet"
    assert np.nanmax(first.high) <= np.nanmax(last.high) * (1.0 + 1e-6)


class _Block(SimpleNamespace):
    def __len__(self) -> int:
        return 2


def test_times_by_counted_survive_their_wrap_and_a_restart() -> None:
    last = 2.0**32 - 3000.0
    times = SampleTimes({"FL": np.array([[0.0, 0.0, 1.0], [last, last + 6000.0, 50.0], [100.0, 106.0006, 200.0]])})
    block = cast("SignalBlock", _Block(wheel="FL", first_sample=1000, rate_hz=1000.0))
    assert times.dated(block, np.array([104.02, 104.021])) == pytest.approx([104.0004, 104.0014])
    unknown_s = np.array([250.0, 250.001])
    assert times.dated(block, unknown_s) is unknown_s, "no number of this start of the hub is known"


def test_every_revolution_is_reached_by_its_number(view, recorded) -> None:
    every = {
        (result.position, result.revolution.index): result
        for result in revolutions(open_recording(RecordingReader(recorded)))
    }
    counted = [number for wheel, number in every if wheel == "W1"]
    for number in (counted[1], counted[len(counted) // 2], counted[-1]):
        result, end_s, shown = view.revolution("W1", view.rolled.time_s("W1", number))
        expected = every["W1", number]
        assert shown == number
        assert end_s == pytest.approx((expected.host_ns - view.begin_ns) * 1e-9, abs=2e-3)
        assert result.revolution.period_s == pytest.approx(expected.revolution.period_s, rel=1e-3)
        assert result.revolution.axes_mps2[2] == pytest.approx(expected.revolution.axes_mps2[2], abs=60.0)
    assert view.rolled.time_s("W1", counted[-1] + 1) is None
    middle = every["W0", counted[3]]
    inside_s = (middle.host_ns - view.begin_ns) * 1e-9 - 0.5 * middle.revolution.period_s
    assert view.revolution("W0", inside_s)[2] == counted[3]


def test_question_while_the_estimates_are_made_does_not_end_them() -> None:
    rolled, rows = RolledRevolutions(1.0), array("d", [*bytes(3 * 400_000), 1.0, 1.0, 1.0])
    rolled._rows["W0"] = rows
    asking = threading.Thread(target=lambda: [rolled.time_s("W0", 5) for _ in range(5)])
    asking.start()
    while asking.is_alive():
        rows.extend((1.0, 1.0, 1.0))
    asking.join()
    assert rolled.time_s("W0", 1) == 1.0


def test_magnitudes_of_orders_are_amplitudes() -> None:
    angle = -math.pi + 2.0 * math.pi * np.arange(256) / 256
    radial = 5.0 + 3.0 * np.cos(4 * angle) + 0.5 * np.sin(20 * angle)
    axes = np.array([np.full(256, np.nan), np.zeros(256), radial])
    shown = magnitudes(replace(plain_revolution(), axes_mps2=axes, order_max=30))
    assert shown[2, [0, 3, 4, 20]] == pytest.approx([5.0, 0.0, 3.0, 0.5], abs=1e-9)
    assert np.isnan(shown[2, 31:]).all()
    assert np.isnan(shown[0]).all()


def test_waterfall_averages_columns_of_time_and_of_speed() -> None:
    waterfall = OrderWaterfall(512.0)
    for time_s, speed_mps, size in ((0.2, 10.1, 1.0), (0.7, 10.3, 3.0), (100.5, 20.2, 5.0)):
        waterfall.add(time_s, speed_mps, np.full((3, 61), size))
    by_time, by_speed = (waterfall.columns(2, is_over_speed=is_over_speed) for is_over_speed in (False, True))
    assert by_time.x.tolist() == [0.5, 100.5]
    assert by_time.orders_mps2[:, 7].tolist() == [2.0, 5.0]
    assert by_speed.x.tolist() == [10.25, 20.25]


def test_orders_of_a_short_part_are_those_of_each_revolution(view) -> None:
    shown = view.orders("W0", 2, 3.0, 5.0, is_over_speed=False)
    assert len(shown.x) > 10
    assert ((shown.x >= 3.0) & (shown.x <= 5.0)).all()
    assert view.orders("nobody", 2, 0.0, 99.0, is_over_speed=False) is None


def test_stored_view_is_the_one_that_was_read(view, recorded, monkeypatch) -> None:
    monkeypatch.setattr(RecordingView, "_read", lambda *_: pytest.fail("it is read again"))
    again = RecordingView(recorded)
    again.complete(never)
    assert again.rolled.pictures == view.rolled.pictures
    assert again.progress.stage == ""
    for reopened, first in zip(again.samples(5.0, 5.01, 99)["W0"], view.samples(5.0, 5.01, 99)["W0"], strict=True):
        assert np.array_equal(reopened, first, equal_nan=True)
    assert again.rolled.time_s("W0", 5) == view.rolled.time_s("W0", 5)


def test_stored_view_is_that_of_its_keys_and_bus_file(recorded, monkeypatch, tmp_path) -> None:
    config, keys, bus = tmp_path / "vehicle.toml", tmp_path / "keys", tmp_path / "car.dbc"
    plain = RecordingReader(recorded).vehicle_toml or ""
    config.write_text(f'{plain}\n{MAPPING.format(wheel="W0")}\n[security]\npolicy = "require"\n')
    text, asked = DBC.read_text(), set[str]()
    monkeypatch.setattr(recording_view, "stored", lambda key: asked.add(key) or {})
    monkeypatch.setattr(RecordingView, "_restore", lambda *_: True)
    for number, key, end in ((1, "", ""), (2, "0" * 32, ""), (3, "0" * 32, "\n"), (3, "0" * 32, "\n")):
        keys.touch(mode=0o600)
        keys.write_text(f"0000b000 {key}\n" if key else "")
        bus.write_text(text + end)
        RecordingView(recorded, config, keys).complete(never)
        assert len(asked) == number


def test_copy_is_known_by_its_content_and_a_damaged_store_is_made_again(view, recorded, folder, tmp_path) -> None:
    copied = tmp_path / "other.mcap"
    copied.write_bytes(recorded.read_bytes())
    (stored,) = folder.iterdir()
    RecordingView(copied).complete(never)
    assert [file.name for file in folder.iterdir()] == [stored.name]
    stored.write_bytes(stored.read_bytes()[:1000])
    again = RecordingView(copied)
    again.complete(never)
    assert again.rolled.pictures == view.rolled.pictures


def test_cache_is_bounded(folder, monkeypatch) -> None:
    monkeypatch.setattr(level_cache, "MAX_BYTES", 5000)
    for key in "abcdef":
        level_cache.store(key, {"values": np.zeros(200)})
        level_cache.os.utime(folder / f"{key}.npz", (ord(key), ord(key)))
    assert sum(file.stat().st_size for file in folder.iterdir()) <= 5000
    assert level_cache.stored("a") is None
    assert level_cache.stored("f") is not None


def test_cache_that_cannot_be_written_stops_nothing(recorded, folder) -> None:
    folder.write_text("a file")
    view = RecordingView(recorded)
    view.complete(never)
    assert view.rolled.pictures is not None


def test_part_that_there_was_is_read_of_a_recording_that_grows(recorded, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(reader, "is_being_written", lambda _: True)
    data, index, growing = recorded.read_bytes(), chunk_index(recorded), tmp_path / "growing.mcap"
    growing.write_bytes(data[: index.offset[len(index.offset) // 4]])
    view, shares = RecordingView(growing), []
    growing.write_bytes(data)
    view.complete(lambda: shares.append(view.progress.share))
    assert view.progress.stage == ""
    assert 0.5 < max(shares) <= 1.0
    last_s = max(float(times[2, -1]) for times in view._times.tables.values())
    assert last_s < view.span_s + 0.1


def test_stop_is_answered_where_no_revolution_comes(tmp_path) -> None:
    standing = write_recording(tmp_path / "standing.mcap", "[motion]\nspeed_kmh = 0.0", duration_s=2.0)
    view = RecordingView(standing)
    view.complete(lambda: view.progress.stage == recording_view._ESTIMATING)
    assert view.progress.stage == recording_view._ESTIMATING


def test_recording_is_not_touched(recorded) -> None:
    before = recorded.read_bytes(), recorded.stat().st_mtime_ns
    view = RecordingView(recorded)
    view.glance()
    view.complete(never)
    view.revolution("W0", 4.0)
    assert (recorded.read_bytes(), recorded.stat().st_mtime_ns) == before


@contextmanager
def served(*paths: Path, host: str = "127.0.0.1"):
    server = ViewServer(host, 0, [RecordingView(path) for path in paths], may_move=False)
    server.start()
    try:
        yield server
    finally:
        server.close()


def answer(connection, **asked):
    connection.send(json.dumps({"id": 7, **asked}))
    reply = json.loads(connection.recv(TIMEOUT_S))
    assert reply.pop("id") == 7
    return reply


def test_page_asks_and_nonsense_is_refused(recorded) -> None:
    with served(recorded) as server:
        origin = server.address.rstrip("/")
        with connect(f"ws{origin[4:]}/", origin=origin, max_size=None) as connection:  # type: ignore[arg-type]
            until(lambda: not answer(connection, ask="state")["recordings"][0]["stage"])
            state = answer(connection, ask="state")["recordings"][0]
            assert (state["name"], state["wheels"], state["fault"]) == ("drive.mcap", ["W0", "W1"], "")
            assert answer(connection, ask="pictures", recording=0)["pictures"]["summary"].startswith("2 wheels")
            shown = answer(connection, ask="samples", recording=0, begin=3.0, end=3.01, columns=500)["wheels"]["W1"]
            assert shown["low"][1] == [None] * len(shown["t"])
            revolution = answer(connection, ask="revolution", recording=0, wheel="W0", number=9)["revolution"]
            assert revolution["number"] == 9
            assert revolution["edges"][0] < 0.0 < revolution["edges"][1]
            refused = {"error": "The question of the page is not valid."}
            for nonsense in (
                {"ask": "samples", "recording": 9, "begin": 0, "end": 1, "columns": 5},
                {"ask": "samples", "recording": -1, "begin": 0, "end": 1, "columns": 5},
                {"ask": "samples", "recording": 0, "begin": 1, "end": 1, "columns": 5},
                {"ask": "samples", "recording": 0, "begin": 0, "end": "nan", "columns": 5},
                {"ask": "orders", "recording": 0, "wheel": "W0", "axis": 3, "over": "time", "begin": 0, "end": 1},
                {"ask": "revolution", "recording": 0, "wheel": "nobody", "time": 1},
                {"ask": "__class__"},
                {},
            ):
                assert answer(connection, **nonsense) == refused
            assert (
                "no revolution 999999"
                in answer(connection, ask="revolution", recording=0, wheel="W0", number=999999)["error"]
            )
            for rubbish in ("{", "[" * 4096):
                connection.send(rubbish)
                assert json.loads(connection.recv(TIMEOUT_S)) == {"id": 0, **refused}


def test_wider_page_needs_its_token(recorded) -> None:
    with served(recorded, host="0.0.0.0") as server:
        port = server.address.split("?")[0].rstrip("/").rpartition(":")[2]
        assert "?token=" in server.address
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://127.0.0.1:{port}/", origin=f"http://127.0.0.1:{port}")  # type: ignore[arg-type]


def test_taken_port_moves_only_where_none_was_asked_for(recorded) -> None:
    with served(recorded) as first:
        port = int(first.address.rstrip("/").rpartition(":")[2])
        with pytest.raises(TreadlinkError, match="cannot listen"):
            ViewServer("127.0.0.1", port, [], may_move=False)
        moved = ViewServer("127.0.0.1", port, [], may_move=True)
        assert str(port) not in moved.address
        moved.start()
        moved.close()


def test_command_refuses_what_it_cannot_show(recorded, tmp_path) -> None:
    empty = tmp_path / "empty.mcap"
    empty.write_bytes(recorded.read_bytes()[:300])
    with pytest.raises(RecordingError, match="no message"):
        RecordingView(empty)
    for words, said in (
        ((tmp_path / "none.mcap",), "does not exist"),
        ((recorded, recorded), "given twice"),
        ((recorded, "--listen", "a:b:c"), "is no HOST"),
        ((recorded, "--listen", "192.0.2.7:0"), "cannot listen"),
        ([recorded] * 9, "too many"),
    ):
        result = invoked("view", *words)
        assert result.exit_code != 0
        assert said in f"{result.output}{result.exception}"


def drag(tab: Tab, begin: float, end: float, meanwhile: str = "0") -> None:
    """Drag with the mouse over the first picture of samples, from one share of its width to another.

    While the button is held, an expression is evaluated in the page.
    """
    tab.value("document.querySelector('#samples .u-over').scrollIntoView({ block: 'center' })")
    rectangle = "(({ left, top, width }) => [left, top, width])(document.querySelector('#samples .u-over')"
    left, top, width = tab.value(f"{rectangle}.getBoundingClientRect())")
    held = {"button": "left", "buttons": 1, "clickCount": 1}
    for kind, share, button in (
        ("mouseMoved", begin, {}),
        ("mousePressed", begin, held),
        ("mouseMoved", end, held),
        ("mouseReleased", end, held | {"buttons": 0}),
    ):
        if kind == "mouseReleased":
            tab.value(meanwhile)
        tab.call("Input.dispatchMouseEvent", type=kind, x=left + share * width, y=top + 60.0, **button)


def test_drag_and_click_hold_while_pictures_are_drawn_anew(browser, recorded) -> None:
    with served(recorded) as server:
        tab = browser.tab()
        tab.open(server.address, 1280, 900)
        tab.until("document.querySelectorAll('#verdicts .answer').length === 1")
        tab.until("document.querySelectorAll('#samples .legend li').length === 2")
        over = "document.querySelector('#samples .u-over')"
        first_of_all = "(document.querySelector('#axes input').click(), document.querySelector('#axes input').click())"
        drag(tab, 0.4, 0.6, f"(window.pressed = {over}, {first_of_all}, window.pressed === {over})")
        tab.until("document.querySelector('#samples').dataset.range.split(' ')[0] > 3")
        tab.until("window.pressed !== document.querySelector('#samples .u-over')")
        drag(tab, 0.5, 0.5, first_of_all)
        tab.until("document.querySelectorAll('#waveforms canvas').length > 0")
        assert tab.errors == []


def test_browser_zooms_to_samples_and_shows_revolutions_and_orders(browser, recorded, tmp_path) -> None:
    other = write_recording(tmp_path / "other.mcap", TABLES, wheels=WHEELS[:1], duration_s=5.0, seed=2)
    with served(recorded, other) as server:
        tab = browser.tab()
        tab.open(server.address, 1280, 900)
        tab.until("document.querySelectorAll('#verdicts .answer').length === 2")
        tab.until("document.querySelectorAll('#samples .legend li').length === 3")
        tab.until("document.querySelectorAll('#orders canvas, #overview canvas').length === 2")
        drag(tab, 0.4, 0.6)
        tab.until("document.querySelector('#samples').dataset.range.split(' ')[0] > 3")
        begin, end = map(float, tab.value("document.querySelector('#samples').dataset.range").split())
        assert 1.5 < end - begin < 2.1
        for _ in range(9):
            tab.value("document.querySelector('[aria-label=\"zoom in\"]').click()")
        tab.until(
            "(([a, b]) => b - a < 0.005)(document.querySelector('#samples').dataset.range.split(' ').map(Number))"
        )
        drag(tab, 0.5, 0.5)
        tab.until("document.querySelectorAll('#waveforms canvas').length === 1")
        number = int(tab.until("document.querySelector('#number').value"))
        tab.value("document.querySelector('#behind').click()")
        tab.until(f"document.querySelector('#number').value === '{number + 1}'")
        note = "document.querySelector('#revolution-note').innerText"
        tab.until(f"{note}.startsWith('drive.mcap W0: revolution {number + 1} ')")
        tab.value("over.value = 'speed'; over.dispatchEvent(new Event('change'))")
        tab.until("document.querySelector('#orders-note').innerText.includes('orders over speed. Dark')")
        tab.value("document.querySelector('#axes input').click()")
        tab.until("document.querySelectorAll('#samples figure').length === 2")
        assert tab.errors == []
        tab.open(server.address, 390, 844, is_dark=True)
        tab.until("document.querySelectorAll('#verdicts .answer').length === 2")
        assert tab.value("document.documentElement.scrollWidth") == 390
        assert tab.errors == []


def test_silence_is_marked_from_its_begin_and_in_the_verdict(browser, tmp_path) -> None:
    tables = TABLES.replace("drop:rate=0.004", "silence:part=1,wheel=0,at=3,for=3")
    silent = write_recording(tmp_path / "silent.mcap", tables, wheels=WHEELS[:1], duration_s=9.0)
    with served(silent) as server:
        tab = browser.tab()
        tab.open(server.address, 1280, 900)
        tab.until("document.querySelectorAll('#verdicts .answer.act').length === 1")
        verdict = tab.value("document.querySelector('#verdicts').innerText")
        assert "W0 was silent for 3 s." in verdict
        assert verdict.index("What to do") < verdict.index("What happened")
        assert "0:00:03 to 0:00:06" in verdict
        assert RecordingView(silent).begin_ns == begin_ns(Drive.of(RecordingReader(silent))), "times as in the drive"
        colour = """((share, fromTop) => {
          const canvas = document.querySelector("#samples canvas"), over = document.querySelector("#samples .u-over");
          const outer = canvas.getBoundingClientRect(), inner = over.getBoundingClientRect();
          const y = fromTop ? inner.top - outer.top + 2 : inner.bottom - outer.top - 3;
          const x = inner.left - outer.left + share * inner.width;
          const [r, g, b] = canvas.getContext("2d").getImageData(x, y, 1, 1).data;
          return "#" + [r, g, b].map((part) => part.toString(16).padStart(2, "0")).join("");
        })"""
        alarm = tab.value("pictures.css('--alarm')")
        for from_top in ("true", "false"):
            tab.until(f"{colour}(0.5, {from_top}) === {alarm!r}")
            assert [tab.value(f"{colour}({share}, {from_top})") == alarm for share in (0.2, 0.36, 0.64, 0.8)] == [
                False, True, True, False,
            ]  # fmt: skip
        assert tab.errors == []
