"""A whole diagnosis: verdicts, errors, progress, an end by time, unusable data; and transfer of its effects."""

import itertools
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, NoReturn

import numpy as np
import pytest

from gateway.core.errors import TreadlinkError
from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.effect_correction import CorrectedEffect, CorrectionTable, EffectParameter
from gateway.core.revolutions.reasons import RevolutionCode
from gateway.core.types import FloatArray
from gateway.diagnosis import closed_loop
from gateway.diagnosis.closed_loop import diagnose
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, LATERAL, GroupConditions
from gateway.diagnosis.effects.sensor_response import Gain
from gateway.diagnosis.model.exact_baseline import ExactCore
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Diagnosis, Verdict
from gateway.diagnosis.self_test import self_test, simulated
from gateway.diagnosis.transfer import Transfer, transfer
from gateway.diagnosis.views.diagnosis_json import diagnosis_json
from gateway.diagnosis.views.phrases import self_test_text
from gateway.diagnosis.views.terminal import closure_summary_lines
from gateway.diagnosis.views.transfer_report import transfer_json, transfer_lines
from gateway.ring.rolling_ring import RingNotConvergedError
from tests.diagnosis.planted_campaign import (
    ALL_AXES,
    ONE_SPEED,
    RADIUS_M,
    among,
    campaign_of,
    evaluated,
    larger_belt,
    nothing,
    turned,
)


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Restrict the catalogue."""
    names = ("rolling radius", "sample clock error", "zero-g offset", "roll tilt", "pitch tilt")
    chosen = {name: catalogue()[name] for name in names}
    monkeypatch.setattr(closed_loop, "candidates", lambda _model: chosen)


@pytest.mark.parametrize("method", ["starts", "expected", "contribution", "derivative"])
@pytest.mark.parametrize("error", [RuntimeError("its table is missing"), SystemExit(0), KeyboardInterrupt()])
def test_plug_in_effect_that_fails_is_left_out(
    monkeypatch: pytest.MonkeyPatch, method: str, error: BaseException
) -> None:
    calls: list[str] = []

    def fails(*_arguments: object) -> NoReturn:
        calls.append(method)
        raise error

    failing = type("Failing", (Gain,), {"name": "failing", "rank": 999, method: fails})()
    chosen = {"roll tilt": catalogue()["roll tilt"], "failing": failing}
    monkeypatch.setattr(closed_loop, "candidates", lambda _model: chosen)
    monkeypatch.setattr(closed_loop, "plugin_effects", lambda: frozenset({"failing"}))
    diagnosis = diagnose(campaign_of(ONE_SPEED, nothing))
    assert calls
    assert diagnosis.notes[0].code is DiagnosisCode.PLUGIN_EFFECTS_LEFT_OUT
    assert diagnosis.notes[0]["effects"] == "failing"
    assert type(error).__name__ in str(diagnosis.notes[0]["error"])
    assert "failing" not in {finding.name for finding in diagnosis.findings}


def test_exact_ring_gives_no_findings() -> None:
    """The whole catalogue on an exact ring's noise, one group of three axes."""
    notices: list[tuple[float, str]] = []
    diagnosis = diagnose(campaign_of(ONE_SPEED, nothing, axes=ALL_AXES), on_progress=lambda *step: notices.append(step))
    assert not diagnosis.named
    assert all(finding.verdict is Verdict.REFUSED for finding in diagnosis.findings)
    assert all(finding.probability < 0.5 for finding in diagnosis.findings if finding.lock == "angle")
    assert diagnosis.held_out.rms_after_mps2 == diagnosis.held_out.rms_before_mps2
    assert diagnosis.complete
    assert all(diagnosis.determined[name] for name in ("Cw", "Rs", "contact_half_angle_rad"))
    shares = [share for share, _ in notices]
    assert all(earlier <= later for earlier, later in itertools.pairwise(shares))
    assert 0.0 <= shares[0] < shares[-1] == 1.0
    assert all(text for _, text in notices)


@pytest.mark.usefixtures("few")
def test_simulations_of_a_result_are_diagnosed_as_they_were_made() -> None:
    notices: list[float] = []
    diagnosis = diagnose(
        campaign_of(ONE_SPEED, turned(LATERAL, 0.03), axes=ALL_AXES),
        self_tests=1,
        on_progress=lambda share, _text: notices.append(share),
    )
    tested = diagnosis.self_test
    assert tested is not None
    assert (tested.count, tested.wrong, tested.false, tested.missed) == (1, 0, {}, {})
    # Numbers of the ring, and the tilt.
    assert len(tested.pulls) >= 5
    assert 0.3 < tested.pull_rms < 2.5
    assert notices == sorted(notices)
    assert notices[-1] == pytest.approx(1.0)
    lines = " ".join(line.strip() for line in closure_summary_lines(diagnosis))
    assert "0 of 1 simulation with a false effect" in lines
    assert diagnosis_json(diagnosis)["self_test"]["count"] == 1


@pytest.mark.usefixtures("few")
def test_result_outlives_simulations_that_fail_or_are_cut_short() -> None:
    campaign = campaign_of(ONE_SPEED, turned(LATERAL, 0.03), axes=ALL_AXES)
    result = diagnose(campaign)
    blind = replace(result, findings=())
    outcomes = iter([TreadlinkError("no model fits"), result, replace(blind, complete=False), blind])

    def again(_campaign: Campaign, _progress: Callable[[float, str], None]) -> Diagnosis:
        outcome = next(outcomes)
        if isinstance(outcome, TreadlinkError):
            raise outcome
        return outcome

    tested = self_test(
        evaluated(campaign, *among("roll tilt").values())[0].fit, result, again, 4, lambda *_: None, lambda: False
    )
    assert (tested.count, tested.failed, tested.missed) == (1, 1, {})
    words = self_test_text(tested)
    assert "1 simulation without a diagnosis" in words
    assert "0 of 1 simulation with a false effect" in words
    assert self_test_text(replace(tested, count=0)) == "1 simulation without a diagnosis"


def test_simulation_holds_scatter_and_unexplained_of_the_recording() -> None:
    """The scatter of blocks keeps its size; what no effect explains is turned, and as large as it was."""

    def hum(signal: FloatArray, theta: FloatArray, _: GroupConditions) -> FloatArray:
        return np.asarray(signal + 10.0 * np.cos(40.0 * theta))

    campaign = campaign_of(ONE_SPEED, hum, axes=ALL_AXES)
    base, _ = evaluated(campaign)
    made = simulated(base.fit, np.random.default_rng(3))
    blocks, recorded = (np.stack([block.orders_mps2 for block in of.groups[0].blocks]) for of in (made, campaign))
    spread, recorded_spread = (np.abs(orders - orders.mean(axis=0)).std() for orders in (blocks, recorded))
    assert spread == pytest.approx(recorded_spread, rel=0.15)
    remainder = blocks.mean(axis=0) - base.fit.model.predict_group(base.fit.vector, 0).mean(axis=0)
    was_left = recorded.mean(axis=0) - base.fit.predicted[0]
    assert np.abs(remainder[:, 40]) == pytest.approx(np.abs(was_left[:, 40]), rel=0.1)
    assert np.abs(np.angle(remainder[0, 40] / was_left[0, 40])) > 0.1


@pytest.mark.usefixtures("few")
def test_planted_tilt_is_named_with_its_probability() -> None:
    diagnosis = diagnose(campaign_of(ONE_SPEED, turned(LATERAL, 0.03), axes=ALL_AXES), empirical=True)
    (tilt,) = diagnosis.named
    assert tilt.name == "roll tilt"
    assert tilt.probability > 0.99
    assert tilt.log_odds > 50.0
    assert tilt.parameters["roll_rad"].value == pytest.approx(0.03, abs=4.0 * tilt.parameters["roll_rad"].std)
    assert tilt.rms_before_mps2 > 2.0 * tilt.rms_after_mps2
    assert diagnosis.held_out.rms_after_mps2 == pytest.approx(diagnosis.noise_floor_mps2, rel=0.05)
    assert diagnosis.empirical_rms_mps2 == pytest.approx(diagnosis.noise_floor_mps2, rel=0.05)
    assert diagnosis.correction is not None
    assert [effect.name for effect in diagnosis.correction.effects] == ["roll tilt"]


@pytest.mark.usefixtures("few")
def test_undecided_effects_widen_the_estimates() -> None:
    diagnosis = diagnose(campaign_of(ONE_SPEED, larger_belt))
    open_ = [finding for finding in diagnosis.findings if finding.verdict is Verdict.INDISTINGUISHABLE]
    assert {finding.name for finding in open_} == {"rolling radius", "sample clock error"}
    assert all(finding.decide_with == Reason(DiagnosisCode.RECORD_AGAIN, how="live") for finding in open_)
    cw = diagnosis.estimates_after["Cw"]
    assert cw.value == pytest.approx(0.21, abs=2.0 * cw.std)


@pytest.mark.usefixtures("few")
def test_estimates_before_are_judged_by_themselves() -> None:
    """A large tilt makes the numbers of the baseline model uncertain, those with the tilt are as good as ever."""
    diagnosis = diagnose(campaign_of(ONE_SPEED, turned(CIRCUMFERENTIAL, 0.2)))
    assert [finding.name for finding in diagnosis.named] == ["pitch tilt"]
    assert diagnosis.determined["Rs"]
    assert diagnosis.determined_before != diagnosis.determined
    before, after = diagnosis.estimates_before["Rs"], diagnosis.estimates_after["Rs"]
    assert before.std > 5.0 * after.std


@pytest.mark.usefixtures("few")
def test_expired_budget_reports_what_is_known() -> None:
    diagnosis = diagnose(campaign_of(ONE_SPEED, turned(LATERAL, 0.03), axes=ALL_AXES), expired=lambda: True)
    assert not diagnosis.complete
    (note,) = [note for note in diagnosis.notes if note.code is DiagnosisCode.SEARCH_ENDED_EARLY]
    assert int(str(note["sets"])) >= 1
    assert "pitch tilt" in note["untried"]  # type: ignore[operator]
    assert not diagnosis.named
    assert diagnosis.estimates_after["Cw"].std > 0.0
    assert diagnosis.held_out.folds == 5
    # A tilt of 1.7 deg is left unexplained: what moves the lateral axis may move the numbers.
    assert DiagnosisCode.LEFT_WHEN_ENDED in [note.code for note in diagnosis.notes]
    assert not any(diagnosis.determined.values())
    assert not any(diagnosis.determined_before.values())


def test_single_fold_has_a_remedy() -> None:
    campaign = campaign_of(ONE_SPEED)
    (group,) = campaign.groups
    with pytest.raises(TreadlinkError, match="at least two revolutions") as error:
        diagnose(replace(campaign, groups=(replace(group, blocks=group.blocks[:1]),)))
    assert "Record longer" in error.value.remedy


def test_unfittable_model_has_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    def unsolvable(*_: object, **__: object) -> None:
        raise RingNotConvergedError("no equilibrium")

    for method in ("shape", "refine"):
        monkeypatch.setattr(ExactCore, method, unsolvable)
    with pytest.raises(TreadlinkError, match="'exact' cannot be fitted") as error:
        diagnose(campaign_of(ONE_SPEED))
    assert "radius, load and pressure" in error.value.remedy


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


@cache
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
    from gateway.diagnosis.views.html import diagnosis_html

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
    assert wrong.notes[0].code is DiagnosisCode.EFFECTS_ENLARGE_ERROR
    line = next(line for line in transfer_lines(wrong, "fl.json") if line.startswith("  note"))
    before, after = wrong.held_out.rms_before_mps2, wrong.held_out.rms_after_mps2
    assert f"they make the error larger ({before:.3g} -> {after:.3g} m/s²)" in line
    assert DiagnosisCode.EFFECTS_ENLARGE_ERROR not in [note.code for note in with_roll(ROLL_RAD).notes]


def test_what_differs_is_noted() -> None:
    campaign = campaign_of(ONE_SPEED, turned(LATERAL, ROLL_RAD), axes=ALL_AXES, seed=9)
    stated = replace(campaign, sensor_id=0xB001, vehicle="rig", tire="205/55 R16")
    effects = {"roll tilt": {"roll_rad": ROLL_RAD}}
    same = table_of(effects, sensor_id=0xB001, vehicle="rig", tire="205/55 R16")
    assert transfer(stated, same).notes == campaign.notes
    # What one of both does not state, or the fit finds, is no difference.
    assert transfer(campaign, same).notes == campaign.notes
    conditions = [replace(item, offset_measured=True) for item in ONE_SPEED]
    measured = campaign_of(conditions, turned(LATERAL, ROLL_RAD), axes=ALL_AXES, seed=9)
    alike = transfer(measured, replace(same, sensor_offset_m=2e-3))
    assert alike.notes == campaign.notes
    assert "sensor depth" in alike.refitted
    other = table_of(
        effects, sensor_id=0xB002, vehicle="car", tire="195/65 R15", radius_m=1.01 * RADIUS_M, sensor_offset_m=2e-3
    )
    noted = transfer(stated, other)
    assert "sensor depth" not in noted.refitted
    assert [note.code for note in noted.notes[:5]] == [
        CoreCode.EFFECTS_OF_OTHER_SENSOR,
        RevolutionCode.EFFECTS_OF_OTHER,
        RevolutionCode.EFFECTS_OF_OTHER,
        CoreCode.EFFECTS_OF_OTHER_RADIUS,
        CoreCode.EFFECTS_OF_OTHER_OFFSET,
    ]
    lines = [line for line in transfer_lines(noted, "fl.json") if line.startswith("  note")]
    assert "identified on sensor 0000b002, but this is sensor 0000b001" in lines[0]
    assert "2.00 mm below the neutral layer, but 0.00 mm" in lines[4]
    assert transfer_json(noted)["reasons"]["notes"][0]["code"] == "effects_of_other_sensor"
