"""Wheels and sensors that are not those of the configuration are told, by `estimate` and `diagnose` alike."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from gateway.cli import treadlink
from gateway.config.vehicle import parse_vehicle
from gateway.errors import ConfigError, RecordingError
from gateway.recording.reader import RecordingReader
from gateway.session.campaign import read_campaign
from gateway.session.wheel_identity import misplaced
from tests.testkit.campaign_recordings import write_recording

WANTED = {"FL": "0000a001", "FR": "0000a002"}


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
    return CliRunner().invoke(treadlink, ["estimate", str(recording), "--config", str(tmp_path / "car.toml")])


def test_only_another_sensor_is_out_of_place() -> None:
    assert misplaced("FL", "0000a001", WANTED) == misplaced("FL", "", WANTED) == misplaced("RL", "dead", WANTED) == ""
    assert "the configuration names 0000a001: a new sensor" in misplaced("FL", "0000dead", WANTED)
    assert "of FR speaks here: wheels swapped?" in misplaced("FL", "0000a002", WANTED)


def test_a_given_configuration_of_another_sensor_is_refused_by_a_diagnosis(recording: Path) -> None:
    vehicle = parse_vehicle(configuration(recording, "0000b000", "0000dead"), "test")
    with pytest.raises(
        ConfigError, match="W0: sensor 0000b000 speaks here, the configuration names 0000dead"
    ) as caught:
        read_campaign([recording], vehicle=vehicle)
    assert "Without --config" in caught.value.remedy


def test_a_recorded_one_is_told(tmp_path: Path) -> None:
    """Nothing else can be given to a recording that was made after the sensor was replaced."""
    path = write_recording(
        tmp_path / "renewed.mcap",
        "[motion]\nspeed_kmh = 60.0",
        change=lambda toml: toml.replace("0000b000", "0000dead"),
    )
    (note,) = read_campaign([path]).notes
    assert "renewed.mcap: W0: sensor 0000b000 speaks here, the configuration names 0000dead" in note


def test_without_a_serial_number_any_sensor_will_do(recording: Path) -> None:
    vehicle = parse_vehicle(configuration(recording, 'sensor_id = "0000b000"\n', ""), "test")
    assert read_campaign([recording], vehicle=vehicle).notes == ()


def test_a_wheel_that_the_configuration_has_not_is_told(recording: Path, tmp_path: Path) -> None:
    toml = configuration(recording, "wheel = 0", "wheel = 3")
    says = "hub0.wheel0 is not configured, the configuration has W0 (hub 0, wheel 3): belt radius 320 mm assumed"
    campaign = read_campaign([recording], vehicle=parse_vehicle(toml, "test"))
    assert campaign.wheel == "hub0.wheel0"
    assert any(says in note for note in campaign.notes)
    assert says in estimate(recording, toml, tmp_path).output
    with pytest.raises(RecordingError) as caught:
        read_campaign([recording], vehicle=parse_vehicle(toml, "test"), wheel="W0")
    assert says in str(caught.value)


def test_estimate_tells_another_sensor_in_the_same_words(recording: Path, tmp_path: Path) -> None:
    printed = estimate(recording, configuration(recording, "0000b000", "0000dead"), tmp_path).output
    assert "W0: sensor 0000b000 speaks here, the configuration names 0000dead: a new sensor or tire?" in printed
    assert "speaks here" not in CliRunner().invoke(treadlink, ["estimate", str(recording)]).output
