"""Wheels and sensors other than configured are reported, by `estimate` and `diagnose` alike."""

from pathlib import Path

import pytest
from click.testing import Result

from firmware_protocol.decoder import FrameDecoder
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.errors import ConfigError, RecordingError
from gateway.core.reasons import Reason
from gateway.core.recording.reader import RecordingReader
from gateway.core.session.reasons import SessionCode
from gateway.core.session.wheel_identity import SensorsHeard, misplaced_sensor
from gateway.diagnosis.campaign import read_campaign, reading_orders
from gateway.diagnosis.reasons import DiagnosisCode
from tests.core.session.hub_frames import HubFrames
from tests.testkit.campaign_recordings import write_recording
from tests.testkit.commands import invoked

CONFIGURED = {"FL": "0000a001", "FR": "0000a002"}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("identity") / "rec.mcap", "[motion]\nspeed_kmh = 60.0")


def configuration(recording: Path, was: str, now: str) -> str:
    toml = RecordingReader(recording).vehicle_toml
    assert toml is not None
    assert was in toml
    return toml.replace(was, now)


def estimate(recording: Path, toml: str, tmp_path: Path) -> Result:
    (tmp_path / "car.toml").write_text(toml)
    return invoked("estimate", recording, "--config", tmp_path / "car.toml")


def test_only_another_sensor_is_misplaced() -> None:
    for position, sensor in (("FL", "0000a001"), ("FL", ""), ("RL", "dead")):
        assert misplaced_sensor(position, sensor, CONFIGURED) is None
    assert misplaced_sensor("FL", "0000dead", CONFIGURED) == Reason(
        SessionCode.OTHER_SENSOR, how="replaced", sensor="0000dead", expected="0000a001"
    )
    assert misplaced_sensor("FL", "0000a002", CONFIGURED) == Reason(
        SessionCode.OTHER_SENSOR, how="swapped", sensor="0000a002", owner="FR", position="FL"
    )


def test_hub_of_the_same_number_on_another_link_is_not_the_configured_one() -> None:
    wheel = 'position = "FL"\nhub = 0\nwheel = 0\nsensor_id = "0000a001"'
    vehicle = parse_vehicle(f"[tire]\nradius_mm = 320.0\n[[wheel]]\n{wheel}\n", "test")
    heard, hub = SensorsHeard(vehicle), HubFrames()
    decoder = FrameDecoder()
    for link, sensor in (("a", 0xA001), ("b", 0xB002), ("a", 0xA001)):
        hub.hello(sensor_id=sensor)
        if link == "b":
            hub.environment()
        for frame in decoder.feed(b"".join(hub.stream)):
            heard.message(link, frame)
        hub.stream.clear()
    assert heard.at("FL") == {0xA001}
    assert not heard.measures_pressure("FL")
    assert heard.at("hub0.wheel0 on b") == frozenset()
    assert list(heard.mismatches(["FL"])) == []


def test_given_configuration_of_another_sensor_is_refused(recording: Path) -> None:
    vehicle = parse_vehicle(configuration(recording, "0000b000", "0000dead"), "test")
    with pytest.raises(ConfigError, match="W0: sensor 0000b000 is here, but the configuration has 0000dead") as caught:
        read_campaign(reading_orders([recording], vehicle=vehicle))
    assert "Without --config" in caught.value.remedy


def test_recorded_configuration_of_another_sensor_is_noted(tmp_path: Path) -> None:
    """A recording made after the sensor was replaced has no other configuration."""
    path = write_recording(
        tmp_path / "renewed.mcap",
        "[motion]\nspeed_kmh = 60.0",
        change=lambda toml: toml.replace("0000b000", "0000dead"),
    )
    (note,) = read_campaign(reading_orders([path])).notes
    replaced = Reason(SessionCode.OTHER_SENSOR, how="replaced", sensor="0000b000", expected="0000dead")
    assert note == Reason(DiagnosisCode.ABOUT_RECORDING, recording="renewed.mcap, W0", reason=replaced)


def test_any_sensor_is_accepted_without_serial_number(recording: Path) -> None:
    vehicle = parse_vehicle(configuration(recording, 'sensor_id = "0000b000"\n', ""), "test")
    assert read_campaign(reading_orders([recording], vehicle=vehicle)).notes == ()


def test_unconfigured_wheel_is_reported(recording: Path, tmp_path: Path) -> None:
    toml = configuration(recording, "wheel = 0", "wheel = 3")
    words = "hub0.wheel0: not configured (the configuration has W0 (hub 0, wheel 3)): belt radius 320 mm is assumed"
    campaign = read_campaign(reading_orders([recording], vehicle=parse_vehicle(toml, "test")))
    assert campaign.wheel == "hub0.wheel0"
    assert any(
        (SessionCode.WHEEL_NOT_CONFIGURED, "others") in [inner.kind for inner in note] for note in campaign.notes
    )
    assert words in estimate(recording, toml, tmp_path).output
    with pytest.raises(RecordingError) as caught:
        read_campaign(reading_orders([recording], vehicle=parse_vehicle(toml, "test"), wheel="W0"))
    assert words in str(caught.value)


def test_estimate_reports_another_sensor(recording: Path, tmp_path: Path) -> None:
    printed = estimate(recording, configuration(recording, "0000b000", "0000dead"), tmp_path).output
    assert "W0: sensor 0000b000 is here, but the configuration has 0000dead: is it a new sensor or tire?" in printed
    assert "0000b000" not in invoked("estimate", recording).output
