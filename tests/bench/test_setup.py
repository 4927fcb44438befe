"""`treadlink setup`: sensors are named by turning wheels, radii measured by rolling; the file is whole or not there."""

import math
import subprocess
import sys
import threading
import tomllib
from io import BytesIO, TextIOWrapper
from pathlib import Path

import pytest

from gateway.bench.commands import setup_dialogue
from gateway.bench.heard_sensors import HeardSensor, SensorAddress, SensorListener
from gateway.bench.rolled_turns import rolled_radius
from gateway.core.clock import ManualClock
from gateway.core.config.vehicle import load_vehicle
from gateway.core.errors import ConfigError
from gateway.core.links.source import Chunk, open_source
from tests.testkit.commands import invoked
from tests.testkit.hub_ends import PtyPort
from tests.testkit.waiting import until

START_NS = ManualClock().now_ns()
# Both stand; the left wheel is turned at 5 s, the right one at 10 s; from 16 s on the car is pushed over 5 m.
PUSHED_M = 5.0
TURNED = Path(__file__).with_name("turned_wheels.toml").read_text()
RADIUS_M = 0.320


@pytest.fixture(scope="module")
def scenario(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("setup") / "turned.toml"
    path.write_text(TURNED)
    return path


@pytest.fixture(scope="module")
def chunks(scenario) -> list[tuple[float, Chunk]]:
    """Chunks of the hub with their times in s."""
    items = open_source(f"sim:{scenario}?speed=max", ManualClock()).items(threading.Event())
    return [((item.host_ns - START_NS) * 1e-9, item) for item in items if isinstance(item, Chunk)]


def test_only_the_turned_sensor_moves_and_the_pushed_distance_gives_the_radius(chunks) -> None:
    listener, moved = SensorListener(), {}
    for at_s, chunk in chunks:
        if at_s > 16.0:
            break
        if int(at_s * 100) in (0, 900):
            listener.begin_rest()
        listener.take(chunk)
        if listener.is_rest_known:
            for sensor in listener.moved():
                moved.setdefault(sensor.address.wheel, at_s)
    assert 5.0 < moved[0] < 6.0
    assert 10.0 < moved[1] < 11.0
    listener.begin_rest()
    for at_s, chunk in chunks:
        if at_s > 14.0:
            listener.take(chunk)
    for sensor in listener.sensors.values():
        rolled = rolled_radius(tuple(sensor.windows), PUSHED_M)
        assert rolled.turns == pytest.approx(PUSHED_M / (6.2832 * RADIUS_M), abs=0.06)
        assert abs(rolled.radius_m - RADIUS_M) < 3.0 * rolled.std_m
        assert rolled.std_m < 0.006
        assert rolled_radius(tuple(sensor.windows)[:30], PUSHED_M) is None, "a wheel that stands has no turns"


def test_nothing_waits_for_a_sensor_that_is_out_of_reach(chunks) -> None:
    listener = SensorListener()
    for at_s, chunk in chunks:
        if at_s > 1.0:
            break
        listener.take(chunk)
    silent = SensorAddress(chunk.link, 0, 9)
    listener.sensors[silent] = HeardSensor(silent, listener.sensors[SensorAddress(chunk.link, 0, 0)].hello)
    listener.begin_rest()
    rest_at_s = math.inf
    for at_s, chunk in chunks:
        if 1.0 < at_s < 5.0:
            listener.take(chunk)
            rest_at_s = min(rest_at_s, at_s if listener.is_rest_known else math.inf)
    assert rest_at_s < 3.0
    assert [sensor.address.wheel for sensor in listener.sending] == [0, 1]


def test_bytes_without_samples_are_no_sensor(monkeypatch, tmp_path) -> None:
    class Babble:
        """A link of another device."""

        link, vehicle_toml = "serial:other", None

        def items(self, stop):
            while not stop.wait(0.01):
                yield Chunk(self.link, START_NS, b"$GPGGA,,,\r\n")

        def close(self) -> None:
            pass

    monkeypatch.setattr(setup_dialogue, "open_source", lambda _uri, _clock: Babble())
    monkeypatch.setattr(setup_dialogue, "_SILENT_S", 0.3)
    out = tmp_path / "car.toml"
    options = ["setup", "serial:other", "--out", str(out), "--no-input", "--wheel", "FL=0.0", "--radius-mm", "320"]
    done = invoked(*options)
    assert "no samples of a sensor were received for 0.3 s" in f"{done.output} {done.exception}"
    assert not out.exists()


def test_a_typed_number_is_that_of_the_list(chunks, monkeypatch) -> None:
    dialogue = setup_dialogue.Dialogue([], setup_dialogue.Answers(), asks=True)
    listener = dialogue._listener
    unnamed = SensorAddress(chunks[0][1].link, 0, 9)
    # Samples of a sensor came before its hello: it is not in the list.
    listener.sensors[unnamed] = HeardSensor(unnamed)
    for _, chunk in chunks[:200]:
        listener.take(chunk)
    listed = dialogue._listed()
    monkeypatch.setattr(dialogue, "_rest", lambda *, or_line: None)
    dialogue._lines.append("1\n")
    assert dialogue._tapped("FL", listed, listed) is listed[0]


class User:
    """Answers questions of the program as they come, and lets the hub go on up to a time."""

    def __init__(self, process, port, chunks) -> None:
        self._process = process
        self._port = port
        self._chunks = iter(chunks)
        self.shown = ""

    def sees(self, words: str) -> None:
        while words not in self.shown:
            character = self._process.stdout.read(1)
            assert character, f"ended without '{words}': {self.shown}"
            self.shown += character
        self.shown = self.shown.partition(words)[2]

    def sends(self, until_s: float) -> None:
        for at_s, chunk in self._chunks:
            self._port.send(chunk.data)
            if at_s >= until_s:
                break

    def types(self, line: str) -> None:
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()


@pytest.mark.slow
def test_dialogue_over_a_serial_port_writes_the_vehicle(chunks, tmp_path) -> None:
    port = PtyPort(tmp_path / "ttyHUB")
    out = tmp_path / "car.toml"
    command = [sys.executable, "-m", "gateway.core.cli", "setup", f"serial:{port.path}", "--out", str(out)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        user = User(process, port, chunks)
        user.sees("connected")
        user.sends(3.0)
        user.sees("2: sensor")
        user.types("Test car")
        user.sees("Positions of the wheels [FL,FR]:")
        user.types("")
        user.sees("Leave all wheels standing")
        user.sends(4.9)
        user.sees("FL firmly")
        user.sends(9.5)
        user.sees("FL is sensor")
        user.sees("FR firmly")
        user.sends(14.5)
        user.sees("FR is sensor")
        user.sees("Belt radius in mm")
        user.types("3")
        user.sees("not possible")
        user.types("roll")
        user.sees("Distance to roll")
        user.types(f"{PUSHED_M}")
        user.sees("Leave all wheels standing")
        user.sends(15.9)
        user.sees("Roll the vehicle")
        user.sends(30.0)
        user.sees("FR: 2.4")
        user.sees("Gauge pressure")
        user.types("2100")
        user.sees("not possible")
        user.types("210")
        user.sees("Vertical load in N, one for all or one each (FL FR)")
        user.types("4000, 4200")
        user.sees("written")
        user.sees("drive one curve")
        process.stdin.close()
        assert process.wait(20) == 0
    port.close()
    vehicle = load_vehicle(out)
    assert vehicle.name == "Test car"
    assert [(wheel.position, wheel.wheel, wheel.load_n) for wheel in vehicle.wheel] == [
        ("FL", 0, 4000.0),
        ("FR", 1, 4200.0),
    ]
    for wheel in vehicle.wheel:
        assert vehicle.tire_of(wheel).radius_m == pytest.approx(RADIUS_M, abs=0.012)
        assert vehicle.tire_of(wheel).pressure_pa == 210e3


def run(scenario, *options: str, lines: str = ""):
    return invoked("setup", f"sim:{scenario}?speed=max", *options, input=lines)


def test_options_answer_everything(scenario, tmp_path) -> None:
    out = tmp_path / "car.toml"
    options = ["--out", str(out), "--no-input", "--wheel", "FL=0.0", "--wheel", "FR=0.1", "--name", "Rig"]
    numbers = ["--radius-mm", "320", "--radius-mm", "FR=318", "--pressure-kpa", "210", "--load-n", "FL=4000"]
    done = run(scenario, *options, *numbers)
    assert done.exit_code == 0, done.output + str(done.exception)
    content = tomllib.loads(out.read_text())
    assert content["tire"] == {"radius_mm": 320.0, "pressure_kpa": 210.0}
    assert content["wheel"][0]["load_n"] == 4000.0
    assert content["wheel"][1]["tire"] == {"radius_mm": 318.0}
    load_vehicle(out)
    before = out.read_bytes()
    refused = run(scenario, *options, *numbers)
    assert "already exists" in str(refused.exception)
    assert out.read_bytes() == before
    replaced = run(scenario, *options, "--radius-mm", "300", "--force")
    assert replaced.exit_code == 0, replaced.output
    assert tomllib.loads(out.read_text())["tire"] == {"radius_mm": 300.0}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--no-input", "--wheel", "FL=0.7", "--radius-mm", "320"], "no sensor '0.7' is heard"),
        (["--no-input", "--wheel", "FL=0.0", "--wheel", "FR=0.0", "--radius-mm", "320"], "sensor of another wheel"),
        (["--no-input", "--wheel", "FL=0.0", "--wheel", "FL=0.1"], "'FL' has two sensors: 0.0 and 0.1"),
        (
            ["--no-input", "--wheel", "FL=0.0", "--radius-mm", "320", "--radius-mm", "310"],
            "Two numbers for all wheels",
        ),
        (["--no-input", "--wheel", "FL=0.0", "--radius-mm", "3"], "radius_mm"),
        (["--no-input", "--wheel", "FL=0.0", "--radius-mm", "320", "--load-n", "RR=4000"], "'RR', which has no sensor"),
        (["--no-input", "--wheel", "F L=0.0", "--radius-mm", "320"], "position"),
        (["--no-input", "--wheel", "FL=0.0"], "no radius for FL"),
        (["--no-input"], "needs --wheel"),
        (["--wheel", "FL=0.0", "--wheel", "FR=0.1", "--name", "x"], "the input has ended"),
    ],
)
def test_wrong_and_missing_answers_write_nothing(scenario, tmp_path, options, words) -> None:
    out = tmp_path / "car.toml"
    done = run(scenario, "--out", str(out), *options)
    assert done.exit_code != 0
    assert words in f"{done.output} {done.exception}"
    assert not out.exists()


def test_each_answer_is_checked_at_once_and_numbers_replace_taps(scenario, tmp_path) -> None:
    out = tmp_path / "car.toml"
    answers = ["Car", "FL,FL", "FL,FR", "3", "2", "2", "1", "abc", "320", "2.2 bar", "", ""]
    done = run(scenario, "--out", str(out), lines="\n".join(answers) + "\n")
    assert done.exit_code == 0, done.output + str(done.exception)
    refused = [line for line in done.output.splitlines() if "not possible" in line or "no free sensor" in line]
    assert [
        words in line
        for words, line in zip(["FL", "'3'", "'2'", "'abc' is no number", "'bar' is no number"], refused, strict=True)
    ]
    assert [(wheel.position, wheel.wheel) for wheel in load_vehicle(out).wheel] == [("FL", 1), ("FR", 0)]


class Broken:
    """A source that brings what it is given, then raises."""

    link = "broken"

    def __init__(self, items=(), error=None) -> None:
        self.given, self.error, self.taken = items, error, 0

    def items(self, stop):
        for item in self.given:
            self.taken += 1
            yield item
        if self.error is not None:
            raise self.error

    def close(self) -> None:
        pass


def dialogue_of(monkeypatch, source, lines=None) -> setup_dialogue.Dialogue:
    monkeypatch.setattr(setup_dialogue, "open_source", lambda *_: source)
    monkeypatch.setattr(setup_dialogue, "with_commands", lambda source, _: source)
    if lines is not None:
        monkeypatch.setattr(sys, "stdin", lines)
    return setup_dialogue.Dialogue(["broken"], setup_dialogue.Answers(), asks=lines is not None)


def test_what_ends_a_thread_of_the_dialogue_ends_the_dialogue(monkeypatch, chunks) -> None:
    with dialogue_of(monkeypatch, Broken(error=KeyError("in a plug-in"))) as dialogue, pytest.raises(KeyError):
        dialogue.run()
    undecodable = TextIOWrapper(BytesIO(b"\xff\n"), "utf-8")
    source = Broken([chunk for at_s, chunk in chunks if at_s < 4.0])
    with dialogue_of(monkeypatch, source, undecodable) as dialogue, pytest.raises(ConfigError, match="is no text"):
        dialogue.run()


def test_a_link_that_floods_waits_for_the_dialogue(monkeypatch) -> None:
    monkeypatch.setattr(setup_dialogue, "_MOST_EVENTS", 10)
    source = Broken([Chunk("broken", START_NS, b"x")] * 1000)
    with dialogue_of(monkeypatch, source) as dialogue:
        until(lambda: dialogue._events.full())
        assert source.taken <= 11
