import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gateway.core.errors import OutputError
from gateway.diagnosis.effects.effect import InverseDisplay
from gateway.diagnosis.result import Diagnosis, Fitted, Scaling, ScalingStatus
from gateway.diagnosis.views.diagnosis_json import FORMAT, FORMAT_VERSION, diagnosis_json, write_json
from gateway.diagnosis.views.phrases import residual_sentence, scaling_text
from tests.testkit.diagnosis_data import NASTY, empty, nasty, ordinary


def _strict(text: str) -> dict:
    def refuse(constant: str):
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def _written(diagnosis: Diagnosis, folder: Path) -> dict:
    write_json(diagnosis, folder / "out.json")
    return _strict((folder / "out.json").read_text("utf-8"))


def test_keys_are_stable(tmp_path):
    diagnosis = ordinary()
    result = _written(diagnosis, tmp_path)
    assert (result["format"], result["version"]) == (FORMAT, FORMAT_VERSION)
    assert result["held_out"]["rms_before_mps2"] == 12.31
    assert result["held_out"]["rms_after_mps2"] == 2.10
    assert result["held_out"]["rms_empirical_mps2"] == 1.95
    assert result["held_out"]["std_after_over_before"] == 0.006
    assert result["held_out"]["as_recorded"]["rms_after_mps2"] == 3.15
    assert [block["rms_after_mps2"] for block in result["held_out"]["blocks"]] == [2.11]
    assert (result["origin"]["sensor_id"], result["origin"]["tire"]) == ("00c0ffee", "205/55R16")
    assert result["origin"]["recordings"][0]["last_s"] == 1.76e9 + 61.0
    assert result["noise_floor_mps2"] == 2.05
    assert result["wheel"] == "FL"
    assert result["revolutions"] == {"used": 1240, "rejected": 12}

    first = result["effects"][0]
    assert (first["name"], first["verdict"]) == ("mounting offset", "named")
    assert first["parameters"] == {"offset_m": 5.02}
    assert first["std"] == {"offset_m": 0.11}
    assert first["units"] == {"offset_m": "mm"}
    assert first["probability"] == 0.9999
    assert first["evidence"] == {
        "log_odds": 42.0,
        "chi2": 41230.0,
        "rms_mps2": 11.2,
        "held_out_rms_before_mps2": 12.31,
        "held_out_rms_after_mps2": 4.02,
    }
    assert first["estimates"]["before"]["Bs"]["value"] == 2.61e-3
    assert first["estimates"]["after"]["Bs"]["value"] == 2.80e-3
    verdicts = [effect["verdict"] for effect in result["effects"]]
    assert verdicts == [finding.verdict.value for finding in diagnosis.findings]
    undecided = result["effects"][verdicts.index("indistinguishable")]
    assert undecided["rivals"] == ["run-out"]
    assert "20 K warmer" in undecided["decide_with"]
    assert undecided["deciding_recordings"] == [
        {"code": "record_again", "values": {"how": "warmer", "difference_k": 20.0}, "text": undecided["decide_with"]}
    ]
    refused = result["effects"][verdicts.index("refused")]
    assert "limit_mps2 would be" in refused["reason"]
    assert refused["reasons"][0]["values"]["value"] == 9000.0
    assert result["notes"] == [result["reasons"]["notes"][0]["text"]]

    tone, bump = result["unexplained"]
    assert (tone["axis"], tone["lock"], tone["orders"], tone["hz"]) == ("circumferential", "time", None, [606, 614.5])
    assert tone["angle_rad"] is None
    assert (tone["lock_known"], tone["changes"]) == (True, False)
    remainder = (replace(diagnosis.unexplained[0], lock_known=False), replace(diagnosis.unexplained[1], changes=True))
    tone, bump = diagnosis_json(replace(diagnosis, unexplained=remainder))["unexplained"]
    assert (tone["lock"], tone["lock_known"], bump["lock"], bump["changes"]) == ("time", False, "angle", True)
    assert (bump["hz"], bump["scaling"], bump["rms_mps2"], bump["std_mps2"]) == (None, "omega^2", 0.84, 0.05)

    assert result["estimates"]["before"]["Bs"] == {"value": 2.61e-3, "std": 1.1e-5, "unit": "", "determined": True}
    assert result["estimates"]["after"]["Ts"] == {"value": 2.41, "std": 0.9, "unit": "", "determined": False}


def test_inverse_keeps_name_and_si_value():
    diagnosis = ordinary()
    inverse = {"inverse_corner_s": Fitted(7e-4, 7e-6, "s", 1e3, "ms", InverseDisplay(1.0, "Hz"))}
    finding = replace(diagnosis.findings[0], parameters=inverse)
    effect = diagnosis_json(replace(diagnosis, findings=(finding,)))["effects"][0]
    assert (effect["parameters"], effect["units"]) == ({"inverse_corner_s": 7e-4}, {"inverse_corner_s": "s"})


def test_group_residuals_match_the_curves(tmp_path):
    diagnosis = ordinary(2)
    groups = _written(diagnosis, tmp_path)["groups"]
    for group, curves in zip(groups, diagnosis.curves, strict=True):
        remainder = curves.measured_mps2[2] - curves.before_mps2[2]
        assert group["residual"]["radial"]["rms_before_mps2"] == pytest.approx(math.sqrt(np.mean(remainder**2)))
        assert group["residual"]["radial"]["noise_mps2"] == curves.noise_mps2[2]


def test_unknown_numbers_are_null(tmp_path):
    result = _written(nasty(), tmp_path)
    assert result["noise_floor_mps2"] is None
    assert result["held_out"]["rms_after_mps2"] is None
    name = NASTY.replace("\udcff", "\\udcff")
    assert result["wheel"] == name
    effect = result["effects"][0]
    assert effect["parameters"][name] is None
    assert effect["std"][name] is None
    assert effect["evidence"]["chi2"] is None
    assert result["unexplained"][0]["hz"] == [None, 5.0]
    assert "lateral" not in result["groups"][0]["residual"]


def test_empty_diagnosis_has_empty_lists(tmp_path):
    result = _written(empty(), tmp_path)
    assert result["effects"] == result["unexplained"] == result["groups"] == result["trends"] == []
    assert result["estimates"] == {"before": {}, "after": {}}
    assert result["held_out"]["rms_empirical_mps2"] is None


def test_numpy_numbers_become_plain():
    for diagnosis in (ordinary(), nasty()):
        json.dumps(diagnosis_json(diagnosis), allow_nan=False)


def test_report_is_not_overwritten_without_force(tmp_path):
    path = tmp_path / "out.json"
    path.write_text("mine")
    with pytest.raises(OutputError, match="already exists"):
        write_json(ordinary(), path)
    assert path.read_text() == "mine"
    write_json(ordinary(), path, force=True)
    assert _strict(path.read_text("utf-8"))["wheel"] == "FL"


@pytest.mark.parametrize(
    ("scaling", "text"),
    [
        (Scaling(ScalingStatus.KNOWN, 0.0), "constant"),
        (Scaling(ScalingStatus.KNOWN, 2.0), "omega^2"),
        (Scaling(ScalingStatus.KNOWN, 1.46), "omega^1.5"),
        (Scaling(ScalingStatus.UNCERTAIN, 1.0, 0.6), "not known: omega^(1.0 +- 0.6)"),
        (Scaling(ScalingStatus.ONE_SPEED), "not known: one speed"),
        (Scaling(ScalingStatus.SEEN_AT_ONE_SPEED), "not known: seen at one speed on this axis"),
        (Scaling(ScalingStatus.TOO_WEAK), "not known: too weak at other speeds"),
        (Scaling(ScalingStatus.NON_STATIONARY), "not known: changes during the recording"),
    ],
)
def test_scaling_keeps_its_json_text(scaling, text):
    assert scaling_text(scaling) == text


def test_residuals_are_described_in_one_sentence():
    line, wave = ordinary().unexplained
    assert residual_sentence(line) == (
        "line at 610.2 Hz on the circumferential axis, 1.2 m/s^2 rms; at the same frequency at every speed; "
        "also 0.3 m/s² radial; scaling: constant"
    )
    assert residual_sentence(wave) == (
        "radial axis, orders 18 to 60, between 81 and 91 deg of the contact's centre: 0.84 m/s^2 rms, repeats every "
        "revolution; scaling: omega^2"
    )
    changing = replace(wave, changes=True, largest_in="a.mcap")
    assert "orders 18 to 60, 81.4 to 90.5 deg: changes during the recording" in residual_sentence(changing)
    assert "most in a.mcap" in residual_sentence(changing)
    moving = replace(line, speeds=None, orders=(12, 13), centre_hz=math.nan, centre_order=12.4)
    assert residual_sentence(moving).startswith("line at order 12.40 of the wheel on the circumferential axis")
