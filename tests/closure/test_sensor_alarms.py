"""Alarms that the pipeline raises about a sensor, in a diagnosis: noted first, and numbers are withheld."""

from dataclasses import replace
from pathlib import Path

import pytest

from gateway.reasons import Code, Reason
from gateway.session.campaign import read_campaign
from gateway.session.campaign_diagnosis import diagnose_recordings
from gateway.views.report.phrases import why_undetermined
from gateway.views.report.terminal import closure_summary_lines
from tests.closure.planted_campaign import ONE_SPEED, campaign_of
from tests.testkit.campaign_recordings import write_recording

AT_60 = "[motion]\nspeed_kmh = 60.0"


def recording(folder: Path, keys: str = "") -> Path:
    return write_recording(folder / "rec.mcap", AT_60, wheels=(keys,), duration_s=5.0)


def about(path: Path) -> list[Reason]:
    """Return the notes on the recording, without its name."""
    results = [note["reason"] for note in read_campaign([path]).notes if note.code is Code.ABOUT_RECORDING]
    return [reason for reason in results if isinstance(reason, Reason)]


@pytest.mark.parametrize(
    ("keys", "code", "is_doubted"),
    [
        ("[wheel.sensor]\nroll_deg = 60.0", Code.SENSOR_TILTED, True),
        # Up to 45 deg a tilt is stated, and corrected.
        ("[wheel.sensor]\nroll_deg = 30.0", Code.SENSOR_TILTED, False),
        ("[wheel.sensor]\nradial_sign = -1\nsign_declared = false", Code.SENSOR_FLIPPED, False),
        ("[wheel.sensor]\noffset_mm = 6.0\n[wheel.stated]\noffset_mm = 0.0", Code.OFFSET_CONTRADICTED, False),
    ],
)
def test_alarm_is_noted(
    tmp_path: Path, keys: str, code: Code, is_doubted: bool, caplog: pytest.LogCaptureFixture
) -> None:
    path = recording(tmp_path, keys)
    alarms = [reason["reason"] for reason in about(path) if reason.code is Code.SENSOR_ALARM]
    assert code in [alarm.code for alarm in alarms if isinstance(alarm, Reason)]
    assert {group.sensor_doubted for group in read_campaign([path]).groups} == {is_doubted}
    assert caplog.messages == []


def test_clipped_revolutions_are_noted(tmp_path: Path) -> None:
    (note,) = about(recording(tmp_path, "[wheel.defect]\nclip_g = 95.0"))
    assert note.code is Code.REVOLUTIONS_CLIPPED
    assert note["count"] == note["total"]


def test_sound_sensor_has_no_note(tmp_path: Path) -> None:
    assert about(recording(tmp_path)) == []


def test_numbers_of_a_loose_sensor_are_not_determined(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = campaign_of(ONE_SPEED)
    loose = Reason(Code.SENSOR_ALARM, reason=Reason(Code.SENSOR_LOOSE, frequency_hz=250.0, share=0.03))
    doubted = replace(
        plain,
        groups=tuple(replace(group, sensor_doubted=True) for group in plain.groups),
        notes=(Reason(Code.RECORDING_ORDER_UNKNOWN), Reason(Code.ABOUT_RECORDING, recording="run 1", reason=loose)),
    )
    monkeypatch.setattr("gateway.session.campaign_diagnosis.read_campaign", lambda *_, **__: doubted)
    diagnosis = diagnose_recordings([], budget_s=1e-6)
    assert [note.code for note in diagnosis.notes][:2] == [Code.SENSOR_IN_DOUBT, Code.ABOUT_RECORDING]
    assert not any(diagnosis.determined.values())
    assert not any(diagnosis.determined_before.values())
    assert why_undetermined(diagnosis, ["Bs"]) == "the sensor is in doubt: see the notes"
    assert any("alarm of the sensor: rings at 250 Hz" in line for line in closure_summary_lines(diagnosis, 200))
