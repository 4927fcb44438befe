"""Stated and assumed inputs of a diagnosis, with their sources."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest

from gateway.closure.data.campaign_data import Remark
from gateway.config.vehicle import parse_vehicle
from gateway.reasons import Code, Reason
from gateway.recording.reader import RecordingReader
from gateway.session.campaign import read_campaign
from gateway.session.provenance import stated_conditions
from gateway.views.report.diagnosis_json import diagnosis_json
from gateway.views.report.html import diagnosis_html
from gateway.views.wording import text
from tests.testkit.campaign_recordings import START_NS, write_recording
from tests.testkit.diagnosis_data import undrawn

AT_60 = "[motion]\nspeed_kmh = 60.0"
RECORDED = "(configuration recorded with it)"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    keys = "load_n = 4300.0\n[wheel.stated]\noffset_mm = 2.0\nroll_deg = 1.5"
    return write_recording(tmp_path_factory.mktemp("stated") / "rec.mcap", AT_60, wheels=(keys,))


def words(remarks: Iterable[Remark]) -> tuple[str, ...]:
    return tuple(text(remark) if isinstance(remark, Reason) else remark for remark in remarks)


def test_recorded_configuration_is_stated(recording: Path) -> None:
    assert words(read_campaign([recording]).stated) == (
        f"belt radius 320 mm {RECORDED}",
        f"load 4300 N {RECORDED}",
        "pressure 210 kPa (measured by the sensor)",
        f"mounting offset 2.0 mm below the neutral layer {RECORDED}",
        f"mounting roll 1.5 deg {RECORDED}",
    )


def test_given_configuration_is_stated(recording: Path) -> None:
    vehicle = parse_vehicle(
        "[tire]\nradius_mm = 315\n[[wheel]]\nposition = 'W0'\nhub = 0\nwheel = 0\nload_n = 4000", "test"
    )
    assert words(read_campaign([recording], vehicle=vehicle).stated) == (
        "belt radius 315 mm (--config)",
        "load 4000 N (--config)",
        "pressure 210 kPa (measured by the sensor)",
        "mounting offset 0.0 mm below the neutral layer (measured by the sensor)",
    )


def test_unmeasured_pressure_is_the_stated_one(recording: Path) -> None:
    vehicle = parse_vehicle(RecordingReader(recording).vehicle_toml or "", "test")
    stated = stated_conditions(
        vehicle, vehicle.wheel[0], read_campaign([recording]).groups, Code.FROM_CONFIGURATION, pressure_measured=False
    )
    assert "pressure 210 kPa (--config)" in words(stated)


def test_differing_values_name_their_recording(recording: Path, tmp_path: Path) -> None:
    other = write_recording(
        tmp_path / "other.mcap", AT_60, wheels=("load_n = 3500.0",), duration_s=3.0, start_ns=START_NS + 10**11
    )
    stated = words(read_campaign([recording, other]).stated)
    assert f"belt radius 320 mm {RECORDED}" in stated
    assert f"load 4300 N {RECORDED}: rec.mcap" in stated
    assert f"load 3500 N {RECORDED}: other.mcap" in stated


def test_assumed_configuration_value_is_not_stated(recording: Path) -> None:
    vehicle = parse_vehicle(
        "[vehicle]\nassumed = ['belt radius 315 mm: not stated']\n[tire]\nradius_mm = 315\n"
        "[[wheel]]\nposition = 'W0'\nhub = 0\nwheel = 0\nload_n = 4000",
        "test",
    )
    campaign = read_campaign([recording], vehicle=vehicle)
    assert words(campaign.stated)[0] == "load 4000 N (--config)"
    assert campaign.assumed[0] == "belt radius 315 mm: not stated"


def test_missing_configuration_is_assumed(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "bare.mcap", AT_60, configured=False, duration_s=3.0)
    campaign = read_campaign([path])
    assert words(campaign.stated) == (
        "pressure 210 kPa (measured by the sensor)",
        "mounting offset 0.0 mm below the neutral layer (measured by the sensor)",
    )
    assert any("belt radius" in text for text in words(campaign.assumed))


def test_inputs_are_in_page_and_json() -> None:
    pytest.importorskip("matplotlib")
    pytest.importorskip("jinja2")
    diagnosis = replace(undrawn(), stated=("load 4300 N (--config)",))
    page = diagnosis_html(diagnosis)
    rests = page[page.index('<h2 id="rests">') :]
    assert "<li>load 4300 N (--config)</li>" in rests
    assert rests.index("4300 N") < rests.index("<h3>Assumed</h3>")
    assert "Standard errors of the estimates do not include those of load" in rests
    assert "do not include those of load" not in diagnosis_html(undrawn())
    assert diagnosis_json(diagnosis)["stated"] == ["load 4300 N (--config)"]
