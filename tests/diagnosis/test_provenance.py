"""Inputs of a diagnosis besides its samples: stated, assumed, alarms of the sensor, and an unstated mounting offset.

At one speed a sensor e below the neutral layer reads a (1 - e a / V^2) on its radial axis: as a nonlinear one does.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest

from gateway.core.config.vehicle import parse_vehicle
from gateway.core.reasons import Code, CoreCode, Reason
from gateway.core.recording.reader import RecordingReader
from gateway.core.text.wording import text
from gateway.core.trust.reasons import TrustCode
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.set_evidence import log_prior_odds
from gateway.diagnosis.campaign import read_campaign, reading_orders
from gateway.diagnosis.campaign_diagnosis import diagnose_recordings
from gateway.diagnosis.data.campaign_data import Remark
from gateway.diagnosis.effects.effect import RADIAL, BaselineModel, GroupConditions
from gateway.diagnosis.model.baseline_registry import make_core
from gateway.diagnosis.model.closure_model import ClosureModel
from gateway.diagnosis.provenance import provenance_of
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.views.diagnosis_json import diagnosis_json
from gateway.diagnosis.views.html import diagnosis_html
from gateway.diagnosis.views.phrases import why_undetermined
from gateway.diagnosis.views.terminal import closure_summary_lines
from tests.diagnosis.planted_campaign import ONE_SPEED, Plant, among, campaign_of, conditions, nothing, searched
from tests.diagnosis.test_sensor_depth import at_depth, bent
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
    assert words(read_campaign(reading_orders([recording])).stated) == (
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
    assert words(read_campaign(reading_orders([recording], vehicle=vehicle)).stated) == (
        "belt radius 315 mm (--config)",
        "load 4000 N (--config)",
        "pressure 210 kPa (measured by the sensor)",
        "mounting offset 0.0 mm below the neutral layer (measured by the sensor)",
    )


def test_unmeasured_pressure_is_the_stated_one(recording: Path) -> None:
    vehicle = parse_vehicle(RecordingReader(recording).vehicle_toml or "", "test")
    stated, _ = provenance_of(
        vehicle,
        vehicle.wheel[0],
        read_campaign(reading_orders([recording])).groups,
        CoreCode.FROM_CONFIGURATION,
        pressure_measured=False,
    )
    assert "pressure 210 kPa (--config)" in words(stated)


def test_differing_values_name_their_recording(recording: Path, tmp_path: Path) -> None:
    other = write_recording(
        tmp_path / "other.mcap", AT_60, wheels=("load_n = 3500.0",), duration_s=3.0, start_ns=START_NS + 10**11
    )
    stated = words(read_campaign(reading_orders([recording, other])).stated)
    assert f"belt radius 320 mm {RECORDED}" in stated
    assert f"load 4300 N {RECORDED}: rec.mcap" in stated
    assert f"load 3500 N {RECORDED}: other.mcap" in stated


def test_assumed_configuration_value_is_not_stated(recording: Path) -> None:
    vehicle = parse_vehicle(
        "[vehicle]\nassumed = ['belt radius 315 mm: not stated']\n[tire]\nradius_mm = 315\n"
        "[[wheel]]\nposition = 'W0'\nhub = 0\nwheel = 0\nload_n = 4000",
        "test",
    )
    campaign = read_campaign(reading_orders([recording], vehicle=vehicle))
    assert words(campaign.stated)[0] == "load 4000 N (--config)"
    assert campaign.assumed[0] == "belt radius 315 mm: not stated"


def test_missing_configuration_is_assumed(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "bare.mcap", AT_60, configured=False, duration_s=3.0)
    campaign = read_campaign(reading_orders([path]))
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


def failing_recording(folder: Path, keys: str = "") -> Path:
    return write_recording(folder / "rec.mcap", AT_60, wheels=(keys,), duration_s=5.0)


def about(path: Path) -> list[Reason]:
    """Return the notes on the recording, without its name."""
    results = [
        note["reason"]
        for note in read_campaign(reading_orders([path])).notes
        if note.code is DiagnosisCode.ABOUT_RECORDING
    ]
    return [reason for reason in results if isinstance(reason, Reason)]


@pytest.mark.parametrize(
    ("keys", "code", "is_doubted"),
    [
        ("[wheel.sensor]\nroll_deg = 60.0", TrustCode.SENSOR_TILTED, True),
        # Up to 45 deg a tilt is stated, and corrected.
        ("[wheel.sensor]\nroll_deg = 30.0", TrustCode.SENSOR_TILTED, False),
        ("[wheel.sensor]\nradial_sign = -1\nsign_declared = false", TrustCode.SENSOR_FLIPPED, False),
        ("[wheel.sensor]\noffset_mm = 6.0\n[wheel.stated]\noffset_mm = 0.0", TrustCode.OFFSET_CONTRADICTED, False),
    ],
)
def test_alarm_is_noted(
    tmp_path: Path, keys: str, code: Code, is_doubted: bool, caplog: pytest.LogCaptureFixture
) -> None:
    path = failing_recording(tmp_path, keys)
    alarms = [reason["reason"] for reason in about(path) if reason.code is DiagnosisCode.SENSOR_ALARM]
    assert code in [alarm.code for alarm in alarms if isinstance(alarm, Reason)]
    assert {group.sensor_doubted for group in read_campaign(reading_orders([path])).groups} == {is_doubted}
    assert caplog.messages == []


def test_clipped_revolutions_are_noted(tmp_path: Path) -> None:
    (note,) = about(failing_recording(tmp_path, "[wheel.defect]\nclip_g = 95.0"))
    assert note.code is DiagnosisCode.REVOLUTIONS_CLIPPED
    assert note["count"] == note["total"]


def test_sound_sensor_has_no_note(tmp_path: Path) -> None:
    assert about(failing_recording(tmp_path)) == []


def test_numbers_of_a_loose_sensor_are_not_determined(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = campaign_of(ONE_SPEED)
    loose = Reason(DiagnosisCode.SENSOR_ALARM, reason=Reason(TrustCode.SENSOR_LOOSE, frequency_hz=250.0, share=0.03))
    doubted = replace(
        plain,
        groups=tuple(replace(group, sensor_doubted=True) for group in plain.groups),
        notes=(
            Reason(DiagnosisCode.RECORDING_ORDER_UNKNOWN),
            Reason(DiagnosisCode.ABOUT_RECORDING, recording="run 1", reason=loose),
        ),
    )
    monkeypatch.setattr("gateway.diagnosis.campaign_diagnosis.read_campaign", lambda *_, **__: doubted)
    diagnosis = diagnose_recordings([], budget_s=1e-6)
    assert [note.code for note in diagnosis.notes][:2] == [DiagnosisCode.SENSOR_IN_DOUBT, DiagnosisCode.ABOUT_RECORDING]
    assert not any(diagnosis.determined.values())
    assert not any(diagnosis.determined_before.values())
    assert why_undetermined(diagnosis, ["Bs"]) == "the sensor is in doubt: see the notes"
    assert any(
        "alarm of the sensor: the sensor may have come loose" in line for line in closure_summary_lines(diagnosis, 200)
    )


OFFSET, NONLINEARITY = "mounting offset", "sensor nonlinearity"
EFFECTS = among(OFFSET, NONLINEARITY, "belt extension", "gain")


def rolling_at(speed_kmh: float, *, is_known: bool = False) -> GroupConditions:
    return conditions(speed_kmh, offset_known=is_known)


@pytest.mark.parametrize(
    ("plant", "speed_kmh", "noise_mps2"),
    [(at_depth(4e-3), 75.0, 0.3), (at_depth(3e-3), 60.0, 1.0), (bent(-1e-5, 0.0), 60.0, 1.0)],
    ids=["below, belt stretched", "below", "nonlinear"],
)
def test_offset_and_nonlinearity_are_left_open_at_one_speed(plant: Plant, speed_kmh: float, noise_mps2: float) -> None:
    campaign = campaign_of((rolling_at(speed_kmh),), plant, axes=(RADIAL,), noise_mps2=noise_mps2, seed=2)
    posterior, _ = searched(campaign, EFFECTS)
    assert posterior.identified() == ()
    assert {OFFSET, NONLINEARITY} <= set(*posterior.alternatives())


def test_nothing_is_named_where_the_assumption_holds() -> None:
    posterior, _ = searched(campaign_of((rolling_at(60.0),), nothing, axes=(RADIAL,)), EFFECTS)
    assert posterior.identified() == ()
    assert posterior.probability([OFFSET]) < criteria.SUPPORTED


def test_only_an_unstated_offset_is_expected() -> None:
    offset = EFFECTS[OFFSET]
    assert not offset.expected((rolling_at(60.0, is_known=True), rolling_at(30.0, is_known=True)))
    assert offset.expected((rolling_at(60.0, is_known=True), rolling_at(30.0)))
    for item, odds in ((True, criteria.PRIOR_ODDS), (False, criteria.EXPECTED_ODDS)):
        campaign = campaign_of((rolling_at(60.0, is_known=item),), axes=(RADIAL,))
        model = ClosureModel(campaign, make_core(BaselineModel.EXACT), (offset, EFFECTS["gain"]))
        assert log_prior_odds(model) == pytest.approx(math.log(odds * criteria.PRIOR_ODDS))


def test_unstated_offset_is_listed_as_assumed(tmp_path: Path) -> None:
    def unstated(toml: str) -> str:
        return "\n".join(line for line in toml.splitlines() if not line.startswith("offset_mm"))

    keys = "[wheel.sensor]\noffset_mm = 3.0\naxes = ['radial']"
    path = write_recording(tmp_path / "rec.mcap", AT_60, wheels=(keys,), duration_s=3.0, change=unstated)
    campaign = read_campaign(reading_orders([path]))
    assert Reason(DiagnosisCode.ASSUMED, quantity="offset_m") in campaign.assumed
    assert not any(group.conditions.offset_known for group in campaign.groups)
    assert all("offset_m" not in dict(reason.values).values() for reason in campaign.stated)

    recorded_toml = RecordingReader(path).vehicle_toml or ""
    text = recorded_toml.replace("[wheel.mounting]", "[wheel.mounting]\noffset_mm = 3.0")
    stated = read_campaign(reading_orders([path], vehicle=parse_vehicle(text, "test")))
    assert Reason(DiagnosisCode.ASSUMED, quantity="offset_m") not in stated.assumed
    assert all(group.conditions.offset_known for group in stated.groups)

    listed = text.replace("[vehicle]", "[vehicle]\nassumed = ['mounting offset 3 mm: as on other tires']")
    guessed = read_campaign(reading_orders([path], vehicle=parse_vehicle(listed, "test")))
    assert guessed.assumed == ("mounting offset 3 mm: as on other tires",)
    assert not any(group.conditions.offset_known for group in guessed.groups)
    assert guessed.groups[0].declared_offset_m == pytest.approx(3e-3)
