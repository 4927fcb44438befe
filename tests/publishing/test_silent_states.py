"""States of what is silent: no output repeats a number that has no successor, and all say how old it is."""

from dataclasses import replace

import jsonschema
import pytest

from gateway.pipeline.results import Silence, SilentPart
from gateway.publishing.line_schema import line_schema
from gateway.publishing.payloads import messages
from gateway.publishing.sink import PublishedState
from gateway.reasons import Code, Reason

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
    return Silence(part, AGE_S, Reason(Code.SENSOR_SILENT, silence_s=AGE_S))


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
