"""Transfer: the error with the effects of another recording, as they were found there."""

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gateway.closure.effects.catalogue import catalogue
from gateway.closure.effects.effect import LATERAL
from gateway.closure.transfer import Transfer, transfer
from gateway.errors import TreadlinkError
from gateway.reasons import Code
from gateway.signal.effect_correction import CorrectedEffect, CorrectionTable, EffectParameter
from gateway.views.report.transfer_report import transfer_json, transfer_lines
from tests.closure.planted_campaign import ALL_AXES, ONE_SPEED, RADIUS_M, campaign_of, turned

ROLL_RAD = 0.03


def unit_of(effect: str, parameter: str) -> str:
    """Return the catalogue's unit, empty for what it does not have."""
    parameters = catalogue()[effect].parameters if effect in catalogue() else ()
    return next((declared.unit for declared in parameters if declared.name == parameter), "")


def table_of(effects: Mapping[str, Mapping[str, float]], **changes: Any) -> CorrectionTable:
    """Return effects as a file has them; their contributions are not used."""
    plain = CorrectionTable(
        position="W",
        omega_radps=np.array([50.0]),
        orders_mps2=np.zeros((1, 3, 2), dtype=np.complex128),
        effects=tuple(
            CorrectedEffect(
                name, tuple(EffectParameter(key, value, 0.0, unit_of(name, key)) for key, value in values.items())
            )
            for name, values in effects.items()
        ),
        radius_m=RADIUS_M,
        omega_range_radps=(40.0, 60.0),
    )
    return replace(plain, **changes)


def with_roll(angle_rad: float) -> Transfer:
    """Return the transfer of a roll tilt to a campaign that has one of `ROLL_RAD`."""
    campaign = campaign_of(ONE_SPEED, turned(LATERAL, ROLL_RAD), axes=ALL_AXES, seed=9)
    return transfer(campaign, table_of({"roll tilt": {"roll_rad": angle_rad}}))


def test_right_effects_lower_the_error_to_the_noise() -> None:
    result = with_roll(ROLL_RAD)
    assert result.held_out.rms_before_mps2 > 2.0 * result.noise_floor_mps2
    assert result.held_out.rms_after_mps2 == pytest.approx(result.noise_floor_mps2, rel=0.05)
    assert "contact centre" in result.refitted
    report = result.report
    assert report is not None
    assert (report.held_out, report.taken_from) == (result.held_out, "effects")
    (effect,) = report.findings
    assert effect.parameters["roll_rad"].value == ROLL_RAD
    # sin(0.03) of the radial axis.
    assert effect.rms_mps2 == pytest.approx(
        ROLL_RAD * math.sqrt(np.mean(np.square(report.curves[0].measured_mps2[2]))), rel=0.05
    )
    assert report.determined["Cw"]
    assert report.unexplained == ()
    assert "roll tilt" not in result.refitted


def test_page_says_where_the_effects_are_from() -> None:
    pytest.importorskip("matplotlib", reason="matplotlib (extra 'plot') is not installed")
    from gateway.views.report.html import diagnosis_html

    report = with_roll(ROLL_RAD).report
    assert report is not None
    page = diagnosis_html(report)
    assert "Roll tilt: as found in effects, nothing of it refitted." in page
    assert "falls, on the lateral axis only," in page
    assert "The model lacks" not in page
    assert "correct the vehicle file" not in page


def test_transferred_parameters_are_not_refitted() -> None:
    """Twice the tilt leaves as much as none: nothing moves it to the size that these recordings have."""
    result = with_roll(2.0 * ROLL_RAD)
    assert result.effects == {"roll tilt": {"roll_rad": 2.0 * ROLL_RAD}}
    assert result.held_out.rms_after_mps2 == pytest.approx(result.held_out.rms_before_mps2, rel=0.1)


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ({"wings": {"span_m": 1.0}}, "no effect 'wings'"),
        ({"roll tilt": {}}, "lacks the parameter 'roll_rad'"),
        ({"roll tilt": {"roll_rad": 0.1, "yaw_rad": 0.1}}, "no parameter 'yaw_rad'"),
        (
            {"mounting offset": {"offset_m": 0.5}},
            "effect 'mounting offset': parameter 'offset_m' is 0.5 m, outside its plausible range of -0.03 to 0.04 m",
        ),
        (
            {"structural damping": {"damping_time_s": -1e-3}},
            "'structural damping': parameter 'damping_time_s' is -0.001 s, outside",
        ),
        ({"gain": {"error": math.nan}}, "'gain': parameter 'error' is nan, outside"),
    ],
)
def test_impossible_effects_are_rejected(effects: dict[str, dict[str, float]], message: str) -> None:
    with pytest.raises(TreadlinkError, match=re.escape(message)) as error:
        transfer(campaign_of(ONE_SPEED), table_of(effects), origin="fl.json")
    assert str(error.value).startswith("fl.json: ")
    assert error.value.remedy


def test_value_within_its_error_of_the_range_is_taken() -> None:
    parameter = EffectParameter("roll_rad", 0.36, 0.02, "rad")
    table = replace(table_of({}), effects=(CorrectedEffect("roll tilt", (parameter,)),))
    assert transfer(campaign_of(ONE_SPEED, axes=ALL_AXES), table).effects == {"roll tilt": {"roll_rad": 0.36}}
    wrong = replace(table, effects=(CorrectedEffect("roll tilt", (replace(parameter, unit="deg"),)),))
    with pytest.raises(TreadlinkError, match="is in deg, not in rad"):
        transfer(campaign_of(ONE_SPEED), wrong)


def test_effects_of_another_tire_are_said_to_enlarge_the_error() -> None:
    wrong = with_roll(-ROLL_RAD)
    assert wrong.held_out.rms_after_mps2 > 1.5 * wrong.held_out.rms_before_mps2
    assert wrong.notes[0].code is Code.EFFECTS_ENLARGE_ERROR
    line = next(line for line in transfer_lines(wrong, "fl.json") if line.startswith("  note"))
    before, after = wrong.held_out.rms_before_mps2, wrong.held_out.rms_after_mps2
    assert f"the effects make the error larger ({before:.3g} -> {after:.3g} m/s²)" in line
    assert Code.EFFECTS_ENLARGE_ERROR not in [note.code for note in with_roll(ROLL_RAD).notes]


def test_what_differs_is_noted() -> None:
    campaign = campaign_of(ONE_SPEED, turned(LATERAL, ROLL_RAD), axes=ALL_AXES, seed=9)
    stated = replace(campaign, sensor_id=0xB001, vehicle="rig", tire="205/55 R16")
    effects = {"roll tilt": {"roll_rad": ROLL_RAD}}
    same = table_of(effects, sensor_id=0xB001, vehicle="rig", tire="205/55 R16")
    assert transfer(stated, same).notes == campaign.notes
    # What one of both does not state is no difference.
    assert transfer(campaign, same).notes == campaign.notes
    other = table_of(
        effects, sensor_id=0xB002, vehicle="car", tire="195/65 R15", radius_m=1.01 * RADIUS_M, sensor_offset_m=2e-3
    )
    noted = transfer(stated, other)
    assert [note.code for note in noted.notes[:5]] == [
        Code.EFFECTS_OF_OTHER_SENSOR,
        Code.EFFECTS_OF_OTHER_VEHICLE,
        Code.EFFECTS_OF_OTHER_TIRE,
        Code.EFFECTS_OF_OTHER_RADIUS,
        Code.EFFECTS_OF_OTHER_OFFSET,
    ]
    lines = [line for line in transfer_lines(noted, "fl.json") if line.startswith("  note")]
    assert "found on sensor 0000b002, but this is sensor 0000b001" in lines[0]
    assert "2.00 mm below the neutral layer, but here 0.00 mm" in lines[4]
    assert transfer_json(noted)["reasons"]["notes"][0]["code"] == "effects_of_other_sensor"
