"""Dialogue of `treadlink setup`: sensors, wheels, radius, pressure and load, each checked at once."""

import queue
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Final, Self

import click

from gateway.bench.heard_sensors import HeardSensor, SensorListener
from gateway.bench.rolled_turns import rolled_radius
from gateway.core.clock import SystemClock
from gateway.core.config.toml_writer import toml_text
from gateway.core.config.vehicle import ASSUMED_RADIUS_MM, VehicleConfig, parse_vehicle
from gateway.core.errors import ConfigError, SourceError
from gateway.core.links.source import Chunk, LinkEvent, LinkItem, Source, open_source
from gateway.core.text.text import clean
from gateway.core.text.wording import notice_text, text
from gateway.security.hub_commands import with_commands

# A hub sends HELLO for each sensor every 2 s. This many windows of samples last longer.
_LISTENED_WINDOWS: Final = 25
# Windows after a first movement in which another sensor would show that the whole vehicle moves.
_DOUBT_WINDOWS: Final = 5
# Windows without a movement that end a roll.
_STOPPED_WINDOWS: Final = 20
_SILENT_S: Final = 15.0
_USUAL_POSITIONS: Final = {1: "W1", 2: "FL,FR", 4: "FL,FR,RL,RR"}
_LEFT_OUT: Final = "-"
# Items that wait while something is worked on; a link that brings more waits itself.
_MOST_EVENTS: Final = 4096
_WAIT_S: Final = 0.1
_ANY_RADIUS: Final = {"radius_mm": ASSUMED_RADIUS_MM}
_REQUIRED: Final = object()

Event = LinkItem | str | Exception | None
"""An item of a link, a line of the user, an error of either, or the end of the user's lines."""


@dataclass(slots=True)
class Answers:
    """What the options state; the rest is asked.

    Attributes:
        name: of the vehicle, None to ask.
        positions: of the wheels, empty to ask.
        assigned: sensor by position: serial number, or hub.wheel.
        radius_mm: by position, that of all at ''.
        distance_m: over which the vehicle is rolled, None for a stated radius.
        pressure_kpa: by position, that of all at ''.
        load_n: by position, that of all at ''.
    """

    name: str | None = None
    positions: tuple[str, ...] = ()
    assigned: Mapping[str, str] = field(default_factory=dict)
    radius_mm: Mapping[str, float] = field(default_factory=dict)
    distance_m: float | None = None
    pressure_kpa: Mapping[str, float] = field(default_factory=dict)
    load_n: Mapping[str, float] = field(default_factory=dict)


class Dialogue:
    """Reads the hubs and the user's lines, and builds the vehicle file step by step."""

    def __init__(self, sources: Sequence[str], answers: Answers, *, asks: bool) -> None:
        """Prepare the dialogue.

        Args:
            sources: of the hubs.
            answers: what the options state.
            asks: whether the rest is asked; else it stays unknown.

        Raises:
            SourceError: a source is wrong.
        """
        self._answers = answers
        self._asks = asks
        self._events: queue.Queue[Event] = queue.Queue(_MOST_EVENTS)
        self._stop = threading.Event()
        self._listener = SensorListener()
        self._lines: list[str] = []
        self._lines_ended = False
        self._document: dict[str, Any] = {"vehicle": {}, "tire": {}, "wheel": []}
        self._clock = SystemClock()
        self._sources = [with_commands(open_source(uri, self._clock), self._clock) for uri in sources]

    def __enter__(self) -> Self:
        for source in self._sources:
            threading.Thread(target=self._read, args=(source,), name="setup-link", daemon=True).start()
        if self._asks:
            threading.Thread(target=self._read_lines, name="setup-lines", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for source in self._sources:
            source.close()

    def text(self) -> str:
        """Return the vehicle file."""
        return "# Written by `treadlink setup`; docs/reference/configuration.md lists what else it may have.\n" + (
            toml_text(self._document)
        )

    def run(self) -> VehicleConfig:
        """Ask and measure everything; return the vehicle.

        Raises:
            TreadlinkError: a link failed, no sensor is heard, or an option is wrong.
        """
        self._listen()
        sensors = self._listed()
        name = self._answers.name
        if name is None:
            name = self._ask("Name of the vehicle []:", lambda line: line, "")
        if name:
            self._document["vehicle"]["name"] = name
        self._choose_wheels(sensors)
        self._find_radius()
        for key, numbers, question in (
            ("pressure_kpa", self._answers.pressure_kpa, "Gauge pressure in kPa"),
            ("load_n", self._answers.load_n, "Vertical load in N"),
        ):
            self._find_numbers(key, numbers, question)
        vehicle = self._checked()
        for notice in vehicle.notices():
            click.echo(f"  {clean(notice_text(notice))}")
        return vehicle

    # Sensors

    def _listen(self) -> None:
        click.echo("Listening to the hubs; leave the vehicle standing.")
        listener = self._listener
        self._until(
            lambda: max((sensor.window_count for sensor in listener.sensors.values()), default=0) >= _LISTENED_WINDOWS
        )

    def _listed(self) -> list[HeardSensor]:
        sensors = [sensor for sensor in self._listener.sensors.values() if sensor.hello is not None]
        numbers = [(sensor.address.hub, sensor.address.wheel) for sensor in sensors]
        duplicate = next((number for number in numbers if numbers.count(number) > 1), None)
        if duplicate is not None:
            raise ConfigError(
                f"two links have a sensor with hub {duplicate[0]}, wheel {duplicate[1]}",
                "A vehicle file cannot tell them apart: give one hub another number.",
            )
        for number, sensor in enumerate(sensors, 1):
            hello = sensor.hello
            assert hello is not None
            pressure = "" if sensor.pressure_pa is None else f", {sensor.pressure_pa * 1e-3:.1f} kPa"
            click.echo(
                f"  {number}: sensor {sensor.sensor_id}, hub {sensor.address.hub}, wheel {sensor.address.wheel}, "
                f"{hello.rate_hz:g} Hz{pressure}"
            )
        return sensors

    def _choose_wheels(self, sensors: list[HeardSensor]) -> None:
        positions = self._answers.positions
        if not positions:
            default = _USUAL_POSITIONS.get(len(sensors), ",".join(f"W{number + 1}" for number in range(len(sensors))))
            positions = self._ask(f"Positions of the wheels [{default}]:", _names, _names(default), self._check_names)
        free = list(sensors)
        for position in positions:
            assigned = self._answers.assigned.get(position)
            sensor = (
                _assigned_sensor(position, assigned, sensors)
                if assigned is not None
                else self._tapped(position, sensors, free)
            )
            if sensor is None:
                continue
            if sensor not in free:
                raise ConfigError(f"{position} has the sensor of another wheel", "Give each wheel a sensor of its own.")
            free.remove(sensor)
            entry = {"position": position, "hub": sensor.address.hub, "wheel": sensor.address.wheel}
            entry["sensor_id"] = sensor.sensor_id
            self._document["wheel"].append(entry)
            self._check_wheels()
            click.echo(f"  {position} is sensor {sensor.sensor_id}")
        for sensor in free:
            click.echo(f"  sensor {sensor.sensor_id} is on no wheel")

    def _tapped(self, position: str, sensors: Sequence[HeardSensor], free: Sequence[HeardSensor]) -> HeardSensor | None:
        """Return the sensor that is tapped or turned, or typed; None where the position gets none."""
        if not self._asks or not free:
            return None
        numbers = {str(number): sensor for number, sensor in enumerate(sensors, 1)}
        click.echo(f"{position}: tap its tire when asked, or type the number of its sensor, or '{_LEFT_OUT}' for none.")
        while True:
            self._rest(or_line=True)
            if not self._lines:
                click.echo(f"Tap the tire {position} firmly, or turn it.")
            self._until(lambda: bool(self._lines or self._listener.moved()))
            if self._lines:
                line = self._lines.pop(0).strip()
                if line == _LEFT_OUT:
                    return None
                typed = numbers.get(line)
                if typed in free:
                    return typed
                click.echo(f"  there is no free sensor '{clean(line)}'")
                continue
            first = self._listener.moved()[0]
            end, moved_ids = first.window_count + _DOUBT_WINDOWS, set[str]()

            def watched(first: HeardSensor = first, end: int = end, moved_ids: set[str] = moved_ids) -> bool:
                moved_ids.update(sensor.sensor_id for sensor in self._listener.moved())
                return first.window_count >= end

            self._until(watched)
            if len(moved_ids) > 1:
                click.echo(f"  several moved: {', '.join(sorted(moved_ids))}. One at a time, please.")
            elif first not in free:
                click.echo(f"  that was sensor {first.sensor_id}, which has its wheel already")
            else:
                return first

    def _rest(self, *, or_line: bool = False) -> None:
        """Wait until all sensors stand still, or with `or_line` until the user has typed a line."""
        click.echo("Leave all wheels standing ...")
        self._listener.begin_rest()
        self._until(lambda: self._listener.is_rest_known or (or_line and bool(self._lines)))

    # Numbers

    def _find_radius(self) -> None:
        radii_mm, distance_m = self._answers.radius_mm, self._answers.distance_m
        if not radii_mm and distance_m is None and self._asks:
            answer = self._ask("Belt radius in mm, or 'roll' to measure it:", _radius, check=self._fits("radius_mm"))
            if answer == "roll":
                distance_m = self._ask("Distance to roll in m, 5 or more turns are best:", _distance)
            else:
                radii_mm = {"": answer}
        if distance_m is not None and not self._roll(distance_m) and self._asks:
            radii_mm = {"": self._ask("Belt radius of the others in mm:", _number, check=self._fits("radius_mm"))}
        self._set_numbers("radius_mm", radii_mm)
        self._checked()

    def _roll(self, distance_m: float) -> bool:
        """Measure the radius of every wheel; return whether all could be measured."""
        listener = self._listener
        self._rest()
        click.echo(f"Roll the vehicle straight over {distance_m:g} m, at a walking pace or slower, and stop.")
        self._until(lambda: bool(listener.moved()))
        stopped_at = {address: sensor.window_count for address, sensor in listener.sensors.items()}

        def has_stopped() -> bool:
            for address, sensor in listener.sensors.items():
                if sensor.is_turning:
                    stopped_at[address] = sensor.window_count
            return all(
                sensor.window_count - stopped_at.get(sensor.address, 0) >= _STOPPED_WINDOWS
                for sensor in listener.sending
            )

        self._until(has_stopped)
        by_number = {(sensor.address.hub, sensor.address.wheel): sensor for sensor in listener.sensors.values()}
        for entry in self._document["wheel"]:
            sensor = by_number[entry["hub"], entry["wheel"]]
            rolled = rolled_radius(tuple(sensor.windows), distance_m)
            if rolled is None:
                click.echo(f"  {entry['position']}: its turns are not seen (AC-coupled, or less than one turn)")
                continue
            radius_mm, std_mm = rolled.radius_m * 1e3, rolled.std_m * 1e3
            click.echo(f"  {entry['position']}: {rolled.turns:.2f} turns, radius {radius_mm:.1f} ± {std_mm:.1f} mm")
            entry["tire"] = {"radius_mm": round(radius_mm, 2), "radius_std_mm": round(std_mm, 2)}
        return all("tire" in entry for entry in self._document["wheel"])

    def _find_numbers(self, key: str, values: Mapping[str, float], question: str) -> None:
        positions = [entry["position"] for entry in self._document["wheel"]]
        if not values and self._asks:
            order = " ".join(positions)
            numbers = self._ask(
                f"{question}, one for all or one each ({order}) []:", _numbers(len(positions)), (), self._fits(key)
            )
            values = (
                {"": numbers[0]} if len(numbers) == 1 else dict(zip(positions, numbers, strict=True)) if numbers else {}
            )
        self._set_numbers(key, values)

    def _set_numbers(self, key: str, numbers: Mapping[str, float]) -> None:
        entries = {entry["position"]: entry for entry in self._document["wheel"]}
        for position, number in numbers.items():
            if position and position not in entries:
                raise ConfigError(
                    f"{key} is given for '{position}', which has no sensor",
                    f"Wheels with one: {', '.join(entries) or 'none'}.",
                )
            if key != "load_n":
                table = entries[position].setdefault("tire", {}) if position else self._document["tire"]
                table[key] = number
                continue
            for entry in [entries[position]] if position else entries.values():
                entry[key] = number

    def _fits(self, key: str) -> Callable[[Any], None]:
        """Return a check of answers by the rules of the vehicle file."""

        def check(answer: Any) -> None:
            for number in answer if isinstance(answer, tuple) else (answer,):
                if isinstance(number, float):
                    wheel = {"position": "W1", "hub": 0, "wheel": 0}
                    tire = dict(_ANY_RADIUS)
                    (wheel if key == "load_n" else tire)[key] = number
                    parse_vehicle(toml_text({"tire": tire, "wheel": [wheel]}), "answer")

        return check

    def _check_names(self, positions: Sequence[str]) -> None:
        """Check names of wheels before a sensor is known."""
        wheels = [{"position": position, "hub": 0, "wheel": number} for number, position in enumerate(positions)]
        parse_vehicle(toml_text({"tire": _ANY_RADIUS, "wheel": wheels}), "answer")

    def _check_wheels(self) -> None:
        """Check the wheels while their radius is not asked yet."""
        parse_vehicle(toml_text({**self._document, "tire": _ANY_RADIUS}), "the vehicle file")

    def _checked(self) -> VehicleConfig:
        return parse_vehicle(toml_text(self._document), "the vehicle file")

    # Input

    def _ask(
        self, question: str, parse: Callable[[str], Any], default: Any = _REQUIRED, check: Callable[[Any], object] = id
    ) -> Any:
        """Ask until the answer is right; return `default` for an empty one, or where nothing is asked."""
        while self._asks:
            click.echo(f"{question} ", nl=False)
            self._until(lambda: bool(self._lines), is_timed=False)
            line = self._lines.pop(0).strip()
            if not line and default is not _REQUIRED:
                return default
            try:
                answer = parse(line)
                check(answer)
            except (ValueError, ConfigError) as error:
                click.echo(f"  not possible: {clean(str(error))}")
                continue
            return answer
        return default

    def _until(self, is_done: Callable[[], bool], *, is_timed: bool = True) -> None:
        """Take events until `is_done`, or until no sensor sends samples for a time.

        Raises:
            TreadlinkError: a link cannot be opened, or all are silent.
            ConfigError: the user's lines have ended.
        """
        heard_ns = self._clock.now_ns()
        while not is_done():
            try:
                silence_s = (self._clock.now_ns() - heard_ns) * 1e-9
                remaining_s = max(_SILENT_S - silence_s, 0.0) if is_timed else None
                event = self._events.get(timeout=remaining_s)
            except queue.Empty:
                raise SourceError(
                    f"no samples of a sensor were received for {_SILENT_S:g} s",
                    "Are hub and sensors on? `treadlink live` shows more.",
                ) from None
            if isinstance(event, Chunk):
                if self._takes_samples(event):
                    heard_ns = self._clock.now_ns()
            elif isinstance(event, str):
                self._lines.append(event)
            elif isinstance(event, Exception):
                raise event
            elif isinstance(event, LinkEvent):
                click.echo(f"  {event.link}: {clean(text(event.reason))}")
            elif event is None:
                self._lines_ended = True
            if self._lines_ended and not self._lines and not is_done():
                raise ConfigError(
                    "an answer is missing: the input has ended", "Give it as an option, or --no-input to leave it out."
                )

    def _takes_samples(self, chunk: Chunk) -> bool:
        """Take bytes of a link; return whether a window of samples ends in them."""
        self._listener.take(chunk)
        return any(sensor.heard_ns == chunk.host_ns for sensor in self._listener.sensors.values())

    def _put(self, event: Event) -> None:
        while not self._stop.is_set():
            with suppress(queue.Full):
                self._events.put(event, timeout=_WAIT_S)
                return

    def _read(self, source: Source) -> None:
        try:
            for item in source.items(self._stop):
                self._put(item)
        except Exception as error:  # raised by the thread that waits
            self._put(error)

    def _read_lines(self) -> None:
        try:
            for line in sys.stdin:
                self._put(line)
            self._put(None)
        except UnicodeDecodeError as error:
            self._put(ConfigError(f"an answer is no text: {error.reason}", "Type it in the encoding of the terminal."))


def _names(line: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in line.replace(" ", ",").split(",") if name.strip())


def _number(line: str) -> float:
    try:
        return float(line)
    except ValueError:
        raise ValueError(f"'{line}' is no number") from None


def _radius(line: str) -> float | str:
    return "roll" if line.lower() == "roll" else _number(line)


def _distance(line: str) -> float:
    distance_m = _number(line)
    if not 1.0 <= distance_m <= 1000.0:
        raise ValueError("give 1 to 1000 m")
    return distance_m


def _numbers(count: int) -> Callable[[str], tuple[float, ...]]:
    def parse(line: str) -> tuple[float, ...]:
        numbers = tuple(map(_number, line.replace(",", " ").split()))
        if len(numbers) not in (1, count):
            raise ValueError("give one number" if count == 1 else f"give one number, or {count}")
        return numbers

    return parse


def _assigned_sensor(position: str, assigned: str, sensors: Sequence[HeardSensor]) -> HeardSensor:
    for sensor in sensors:
        if assigned.lower() in (sensor.sensor_id, f"{sensor.address.hub}.{sensor.address.wheel}"):
            return sensor
    serials = ", ".join(sensor.sensor_id for sensor in sensors) or "none"
    raise ConfigError(f"no sensor '{assigned}' is heard for {position}", f"Heard: {serials}.")
