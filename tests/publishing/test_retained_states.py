"""States that receivers keep: none repeats a number of what is silent or over."""

import json
from dataclasses import replace

import jsonschema
import pytest

from gateway.core.estimates.results import Silence, SilentPart
from gateway.core.reasons import Reason
from gateway.core.session.reasons import SessionCode
from gateway.publishing.line_schema import line_schema
from gateway.publishing.payloads import messages
from gateway.publishing.sink import PublishedState
from tests.publishing.receivers import publish
from tests.publishing.scripted_broker import Received, ScriptedBroker

EXPIRES_AFTER_30_S = b"\x02\x00\x00\x00\x1e"
PRESENT = {"rate_hz", "speed_mps", "pressure_pa", "temperature_degc", "load_n", "battery_percent", "rssi_dbm"}


@pytest.fixture
def published(items):
    """All messages of a session with one state."""
    broker = ScriptedBroker()
    publish(f"mqtt://127.0.0.1:{broker.port}/car?discovery=off", [items[-1]])
    broker.close()
    return broker


def of_states(broker: ScriptedBroker) -> dict[str, list[Received]]:
    topics = {message.topic for message in broker.messages if message.topic != "car/status"}
    return {topic: [message for message in broker.messages if message.topic == topic] for topic in topics}


def test_last_states_have_no_numbers_and_say_that_the_session_is_over(published) -> None:
    states = of_states(published)
    assert len(states) == 4 + 1 + 1
    for topic, (_, last) in states.items():
        payload = json.loads(last.payload)
        jsonschema.Draft202012Validator(line_schema()).validate(payload)
        assert last.is_retained
        assert not PRESENT & payload.keys()
        assert payload["alarms"] == []
        expected = {"wheel": ("state", "ended"), "link": ("connected", False), "session": ("ended", True)}
        name, value = expected[payload["type"]]
        assert payload[name] == value, topic
    assert published.messages[-1][:2] == ("car/status", b"offline")


def test_states_of_a_gateway_that_dies_expire(published) -> None:
    assert b"car/status" in published.connects[0]
    assert b"offline" in published.connects[0], "the last will"
    for present, last in of_states(published).values():
        assert present.properties == EXPIRES_AFTER_30_S
        assert last.properties == b""


AGE_S = 60.0
MEASURED = {"rate_hz", "speed_mps", "rotation_rpm", "distance_m", "pressure_pa", "temperature_degc", "load_n"}
HEARD = {"latency_s", "battery_percent", "rssi_dbm", "supply_w"}


def states(drive, *silences: Silence, **of_link) -> tuple[dict, dict]:
    """Return the states of the first wheel and link."""
    snapshot = drive[1]
    wheels = tuple(replace(wheel, silences=silences) for wheel in snapshot.wheels)
    links = tuple(replace(link, **of_link) for link in snapshot.links)
    results = list(messages(PublishedState(1, replace(snapshot, wheels=wheels, links=links))))
    for payload in results:
        jsonschema.Draft202012Validator(line_schema()).validate(payload)
    return results[0], next(payload for payload in results if payload["type"] == "link")


def silence(part: SilentPart) -> Silence:
    return Silence(part, AGE_S, Reason(SessionCode.SENSOR_SILENT, silence_s=AGE_S))


@pytest.mark.parametrize("part", [SilentPart.LINK, SilentPart.HUB, SilentPart.SENSOR])
def test_silent_wheel_has_an_age_and_no_number(drive, part: SilentPart) -> None:
    assert {"pressure_pa", "temperature_degc", "rate_hz"} <= states(drive)[0].keys()
    wheel, _ = states(drive, silence(part))
    assert not {*MEASURED, "wear_mm"} & wheel.keys()
    assert wheel["silent_s"] == AGE_S


def test_old_pressure_has_an_age_and_no_number(drive) -> None:
    wheel, _ = states(drive, silence(SilentPart.ENVIRONMENT))
    assert not {"pressure_pa", "temperature_degc"} & wheel.keys()
    assert "speed_mps" in wheel
    assert wheel["environment_silent_s"] == AGE_S


@pytest.mark.parametrize("state", [{"connected": False}, {"silent_s": AGE_S}])
def test_silent_link_has_no_number_of_its_hub(drive, state: dict) -> None:
    assert states(drive)[1].keys() >= HEARD
    _, link = states(drive, **state)
    assert not HEARD & link.keys()
    assert link.get("silent_s") == state.get("silent_s")
