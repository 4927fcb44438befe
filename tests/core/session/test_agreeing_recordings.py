"""A tire is diagnosed from those of its recordings that agree; each of the others is named with its reason."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from gateway.core.errors import RecordingError
from gateway.core.reasons import Code, Reason
from gateway.diagnosis import campaign_diagnosis
from gateway.diagnosis.campaign_diagnosis import diagnose_agreeing
from gateway.diagnosis.checks.outvoted_recordings import RecordingsContradictedError
from gateway.diagnosis.closed_loop import BaselineUnfittedError
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Diagnosis
from tests.testkit.campaign_recordings import START_NS, write_recording
from tests.testkit.diagnosis_data import undrawn

REVERSED = Reason(DiagnosisCode.CIRCUMFERENTIAL_REVERSED)


@pytest.fixture(scope="module")
def paths(tmp_path_factory) -> list[Path]:
    folder = tmp_path_factory.mktemp("agreeing")
    return [
        write_recording(
            folder / f"{number}.mcap",
            f"[sensor]\nrate_hz = 2000\n[motion]\nspeed_kmh = {60 + 10 * number}\n",
            duration_s=1.6,
            seed=number + 1,
            start_ns=START_NS + number * 100 * 10**9,
        )
        for number in range(4)
    ]


@pytest.fixture
def judged(monkeypatch) -> Callable[..., list[tuple[str, ...]]]:
    """Return what replaces the diagnosis by one that judges campaigns by the names of their recordings."""

    def install(judge: Callable[[list[str]], dict[int, Reason]]) -> list[tuple[str, ...]]:
        seen: list[tuple[str, ...]] = []

        def diagnose(campaign: Campaign, **_: object) -> Diagnosis:
            names = [Path(path).stem for path in campaign.recordings]
            seen.append(tuple(names))
            assert [group.recording for group in campaign.groups] == list(range(len(names)))
            return replace(undrawn(), recordings=campaign.recordings, outvoted=judge(names))

        monkeypatch.setattr(campaign_diagnosis, "diagnose", diagnose)
        return seen

    return install


def left_out(diagnosis: Diagnosis) -> dict[str, Code]:
    return {Path(str(item["recording"])).stem: item["reason"].code for item in diagnosis.left_out}


def test_recordings_that_cannot_be_read_are_left_out(paths, judged, tmp_path):
    judged(lambda _: {})
    text = tmp_path / "text.mcap"
    text.write_text("no recording")
    other = write_recording(tmp_path / "other.mcap", duration_s=1.6, change=lambda toml: toml.replace("W0", "FL"))
    diagnosis = diagnose_agreeing([paths[0], text, other, tmp_path / "gone.mcap", paths[1]], "W0")
    assert [Path(path).stem for path in diagnosis.recordings] == ["0", "1"]
    assert left_out(diagnosis) == {
        "text": DiagnosisCode.RECORDING_NOT_USED,
        "other": DiagnosisCode.RECORDING_WITHOUT_WHEEL,
        "gone": DiagnosisCode.RECORDING_NOT_USED,
    }


def test_reversed_recordings_are_left_out(paths, judged):
    def judge(names: list[str]) -> dict[int, Reason]:
        if "1" in names:
            raise RecordingsContradictedError("reversed", "", {names.index("1"): REVERSED})
        return {}

    seen = judged(judge)
    diagnosis = diagnose_agreeing(paths, "W0")
    assert seen == [("0", "1", "2", "3"), ("0", "2", "3")]
    assert left_out(diagnosis) == {"1": DiagnosisCode.CIRCUMFERENTIAL_REVERSED}


def test_outvoted_recordings_are_left_out_and_the_rest_diagnosed_again(paths, judged):
    load = Reason(DiagnosisCode.WIDTH_UNLIKE_OTHERS, value=0.3, other=0.2, count=3)
    seen = judged(lambda names: {names.index("2"): load} if "2" in names else {})
    diagnosis = diagnose_agreeing(paths, "W0")
    assert seen == [("0", "1", "2", "3"), ("0", "1", "3")]
    assert left_out(diagnosis) == {"2": DiagnosisCode.WIDTH_UNLIKE_OTHERS}


def test_another_stated_radius_is_left_out_before_the_diagnosis(paths, judged, tmp_path):
    seen = judged(lambda _: {})
    wrong = write_recording(tmp_path / "wrong.mcap", duration_s=1.6, change=lambda toml: toml.replace("320.0", "350.0"))
    diagnosis = diagnose_agreeing([*paths[:2], wrong], "W0")
    assert seen == [("0", "1")]
    assert left_out(diagnosis) == {"wrong": DiagnosisCode.RADIUS_UNLIKE_OTHERS}


def test_recordings_without_a_fit_are_left_out(paths, judged, monkeypatch):
    def judge(names: list[str]) -> dict[int, Reason]:
        if "3" in names:
            raise BaselineUnfittedError("no fit")
        return {}

    seen = judged(judge)
    monkeypatch.setattr(campaign_diagnosis, "baseline_fits", lambda campaign: "3.mcap" not in campaign.recordings[0])
    diagnosis = diagnose_agreeing(paths, "W0")
    assert seen[-1] == ("0", "1", "2")
    assert left_out(diagnosis) == {"3": DiagnosisCode.BASELINE_UNFITTED}


def test_what_is_wrong_with_all_is_an_error(paths, judged, monkeypatch, tmp_path):
    def all_reversed(names: list[str]) -> dict[int, Reason]:
        raise RecordingsContradictedError("all reversed", "", dict.fromkeys(range(len(names)), REVERSED))

    judged(all_reversed)
    with pytest.raises(RecordingsContradictedError, match="all reversed"):
        diagnose_agreeing(paths, "W0")

    def no_fit(_: list[str]) -> dict[int, Reason]:
        raise BaselineUnfittedError("no fit of all")

    judged(no_fit)
    for fits in (True, False):
        monkeypatch.setattr(campaign_diagnosis, "baseline_fits", lambda _, fits=fits: fits)
        with pytest.raises(BaselineUnfittedError, match="no fit of all"):
            diagnose_agreeing(paths, "W0")
    with pytest.raises(RecordingError, match="no recording of wheel FL can be used"):
        diagnose_agreeing(paths, "FL")
