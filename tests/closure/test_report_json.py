from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gateway.closure.diagnosis import Diagnosis, Fitted
from gateway.errors import OutputError
from gateway.views.report.diagnosis_json import FORMAT, FORMAT_VERSION, diagnosis_json, write_json
from tests.testkit.diagnosis_data import NASTY, empty, nasty, ordinary


def _strict(text: str) -> dict:
    def refuse(constant: str):
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def _written(diagnosis: Diagnosis, folder: Path) -> dict:
    write_json(diagnosis, folder / "out.json")
    return _strict((folder / "out.json").read_text("utf-8"))


def test_keys_that_scripts_rely_on(tmp_path):
    diagnosis = ordinary()
    found = _written(diagnosis, tmp_path)
    assert (found["format"], found["version"]) == (FORMAT, FORMAT_VERSION)
    assert found["held_out"]["rms_before_mps2"] == 12.31
    assert found["held_out"]["rms_after_mps2"] == 2.10
    assert found["held_out"]["rms_empirical_mps2"] == 1.95
    assert found["noise_floor_mps2"] == 2.05
    assert found["wheel"] == "FL"
    assert found["revolutions"] == {"used": 1240, "rejected": 12}

    first = found["effects"][0]
    assert (first["name"], first["verdict"]) == ("mounting offset", "named")
    assert first["parameters"] == {"offset_m": 5.02}
    assert first["std"] == {"offset_m": 0.11}
    assert first["units"] == {"offset_m": "mm"}
    assert first["evidence"] == {
        "chi2": 41230.0,
        "held_out_gain": 40100.0,
        "held_out_std": 1210.0,
        "rms_mps2": 11.2,
        "held_out_rms_before_mps2": 12.31,
        "held_out_rms_after_mps2": 4.02,
    }
    assert first["estimates"]["before"]["Bs"]["value"] == 2.61e-3
    assert first["estimates"]["after"]["Bs"]["value"] == 2.80e-3
    verdicts = [effect["verdict"] for effect in found["effects"]]
    assert verdicts == [finding.verdict.value for finding in diagnosis.findings]
    undecided = found["effects"][verdicts.index("indistinguishable")]
    assert undecided["rivals"] == ["run-out"]
    assert "another temperature" in undecided["decide_with"]
    assert "limit_mps2 would be" in found["effects"][verdicts.index("refused")]["reason"]

    tone, bump = found["unexplained"]
    assert (tone["axis"], tone["lock"], tone["orders"], tone["hz"]) == (
        "circumferential",
        "time",
        None,
        [606, 614.5],
    )
    assert tone["angle_rad"] is None
    assert (tone["lock_known"], tone["changes"]) == (True, False)
    left = (replace(diagnosis.unexplained[0], lock_known=False), replace(diagnosis.unexplained[1], changes=True))
    tone, bump = diagnosis_json(replace(diagnosis, unexplained=left))["unexplained"]
    assert (tone["lock"], tone["lock_known"], bump["lock"], bump["changes"]) == ("time", False, "angle", True)
    assert (bump["hz"], bump["scaling"], bump["rms_mps2"], bump["std_mps2"]) == (None, "omega^2", 0.84, 0.05)

    assert found["estimates"]["before"]["Bs"] == {"value": 2.61e-3, "std": 1.1e-5, "unit": "", "determined": True}
    assert found["estimates"]["after"]["Ts"] == {"value": 2.41, "std": 0.9, "unit": "", "determined": False}


def test_an_inverse_keeps_its_name_and_si_value():
    diagnosis = ordinary()
    inverse = {"inverse_corner_s": Fitted(7e-4, 7e-6, "s", 1e3, "ms", (1.0, "Hz"))}
    finding = replace(diagnosis.findings[0], parameters=inverse)
    effect = diagnosis_json(replace(diagnosis, findings=(finding,)))["effects"][0]
    assert (effect["parameters"], effect["units"]) == ({"inverse_corner_s": 7e-4}, {"inverse_corner_s": "s"})


def test_residuals_of_groups_are_those_of_the_curves(tmp_path):
    diagnosis = ordinary(2)
    groups = _written(diagnosis, tmp_path)["groups"]
    for group, curves in zip(groups, diagnosis.curves, strict=True):
        left = curves.measured_mps2[2] - curves.before_mps2[2]
        assert group["residual"]["radial"]["rms_before_mps2"] == pytest.approx(math.sqrt(np.mean(left**2)))
        assert group["residual"]["radial"]["noise_mps2"] == curves.noise_mps2[2]


def test_what_is_not_known_is_null_and_text_stays_text(tmp_path):
    found = _written(nasty(), tmp_path)
    assert found["noise_floor_mps2"] is None
    assert found["held_out"]["rms_after_mps2"] is None
    name = NASTY.replace("\udcff", "\\udcff")
    assert found["wheel"] == name
    effect = found["effects"][0]
    assert effect["parameters"][name] is None
    assert effect["std"][name] is None
    assert effect["evidence"]["chi2"] is None
    assert found["unexplained"][0]["hz"] == [None, 5.0]
    assert "lateral" not in found["groups"][0]["residual"]


def test_nothing_found_is_empty_lists(tmp_path):
    found = _written(empty(), tmp_path)
    assert found["effects"] == found["unexplained"] == found["groups"] == found["trends"] == []
    assert found["estimates"] == {"before": {}, "after": {}}
    assert found["held_out"]["rms_empirical_mps2"] is None


def test_numbers_of_numpy_become_plain():
    for diagnosis in (ordinary(), nasty()):
        json.dumps(diagnosis_json(diagnosis), allow_nan=False)


def test_a_report_is_not_overwritten_unasked(tmp_path):
    path = tmp_path / "out.json"
    path.write_text("mine")
    with pytest.raises(OutputError, match="exists already"):
        write_json(ordinary(), path)
    assert path.read_text() == "mine"
    write_json(ordinary(), path, force=True)
    assert _strict(path.read_text("utf-8"))["wheel"] == "FL"
