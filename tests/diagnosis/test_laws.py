"""Laws: their equations, the search with its conditions, files and plug-ins.

Plants are boxes where the library has normal windows, on a grid of their own.
"""

import math
import runpy
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from gateway.core.errors import TreadlinkError
from gateway.core.reasons import Code, Reason
from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.angle.likelihood import Whitened
from gateway.diagnosis.angle.set_evidence import Evaluated
from gateway.diagnosis.closed_loop import diagnose
from gateway.diagnosis.commands.diagnose import write_plugin
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    RADIAL,
    BaselineModel,
    GroupConditions,
    ModelledBlock,
    SignalEffect,
)
from gateway.diagnosis.effects.local_effects import LOCAL_CHANGES, LOCAL_TREAD_STIFFNESS, _window
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.diagnosis.known_effects import known_effects
from gateway.diagnosis.laws.law_plugin import plugin_files
from gateway.diagnosis.laws.law_search import LawsFound, propose_laws
from gateway.diagnosis.laws.library import library
from gateway.diagnosis.laws.sensor_errors import AxisCube, AxisSquare, CrossAxis
from gateway.diagnosis.laws.unseen_recordings import _beside_residual, judged_elsewhere, reasons_against
from gateway.diagnosis.model.baseline_registry import make_core
from gateway.diagnosis.model.sensor_signal import base_signal
from gateway.diagnosis.report.findings import findings_of
from gateway.diagnosis.result import Finding, Fitted, LawSize, UnseenError, Verdict
from gateway.diagnosis.transfer import transfer
from gateway.diagnosis.views.diagnosis_json import diagnosis_json
from gateway.diagnosis.views.html import diagnosis_html
from gateway.diagnosis.views.terminal import closure_summary_lines
from gateway.ring.rolling_ring import PATTERNS, Change, loaded_belt, local_response
from tests.diagnosis.planted_campaign import (
    RADIUS_M,
    Plant,
    among,
    campaign_of,
    conditions,
    evaluated,
    fitted,
    nothing,
    ring,
    searched,
)
from tests.diagnosis.test_closed_loop import table_of
from tests.testkit.diagnosis_data import empty, ordinary

# A size to 3 % needs three speeds: with two, losses and the window's form are left to their priors.
THREE_SPEEDS = (conditions(60.0), conditions(40.0), conditions(80.0))
SPEEDS = THREE_SPEEDS[::2]
SPLICE, PLACE_RAD, WIDTH_RAD, LOSS_S = 0.012, 0.8, 0.06, 2e-5
NAME = "law: local bending stiffness"


@lru_cache
def reading(change: Change, load_n: float, omega_radps: float) -> ComplexArray:
    return np.asarray(local_response(loaded_belt(ring(load_n)), omega_radps, LOSS_S, 0.0, (change,))[0, 0])


def local(change: Change, size: float) -> Plant:
    """Return a box of the belt's angle that is different by a share."""

    def plant(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
        count = np.arange(PATTERNS)
        share = np.where(count > 0, 1.0, 0.5) / math.pi
        amplitude = size * share * np.sinc(count * WIDTH_RAD / (2.0 * math.pi)) * np.exp(-1j * count * PLACE_RAD)
        turned = (
            reading(change, group_conditions.load_n, group_conditions.omega_radps)
            * np.exp(-1j * np.outer(count, theta))[:, None]
        )
        added = group_conditions.omega_radps**2 * np.tensordot(amplitude, turned, 1).real
        result = signal.copy()
        result[[RADIAL, CIRCUMFERENTIAL]] += added
        return result

    return plant


def found_in(campaign: Campaign, laws: Mapping[str, SignalEffect] | None = None) -> LawsFound:
    base, data = evaluated(campaign)
    chosen = laws if laws is not None else library()
    return propose_laws(base, data, laws=tuple(chosen.values()))


@lru_cache
def block() -> ModelledBlock:
    core = make_core(BaselineModel.EXACT)
    current = conditions(60.0)
    return base_signal(core, core.shape(core.prior_mean, current, RingOptions(sensor_offset_m=0.004), 0.0), current)


@pytest.fixture(scope="module")
def laws() -> dict[str, SignalEffect]:
    return library()


@pytest.mark.parametrize("name", list(library()))
def test_derivative_of_a_law_is_that_of_its_contribution(laws: Mapping[str, SignalEffect], name: str) -> None:
    law, current = laws[name], block()
    start = np.array(law.start_values[0])
    rows = law.derivative(current, start)
    for index, item in enumerate(law.parameters):
        step = np.zeros(len(start))
        step[index] = item.step
        slope = (law.contribution(current, start + step) - law.contribution(current, start - step)) / (2.0 * item.step)
        assert np.abs(slope - rows[index]).max() <= 1e-3 * max(np.abs(slope).max(), 1e-9)
    start[: law.sizes] = 0.0
    assert not law.contribution(current, start).any()


@pytest.mark.parametrize("share", [-0.35, -0.1, 0.5])
def test_block_of_other_rubber_is_pressed_as_a_beam_on_it_is(share: float) -> None:
    """A beam under tension on springs that differ by a share over a box: differences, no transform."""
    current = block()
    assert current.belt is not None
    law, nodes, half_m, reach_m = current.belt.law, 801, 0.015, 0.25
    place_m, step_m = np.linspace(-reach_m, reach_m, nodes, retstep=True)
    curvature = (np.eye(nodes, k=1) - 2.0 * np.eye(nodes) + np.eye(nodes, k=-1)) / step_m**2
    tension_n = law.pressure_pa * law.tension_width_m * law.radius_m
    belt = law.bending_nm2 * curvature @ curvature - tension_n * curvature + law.radial_npm2 * np.eye(nodes)
    pressed = law.tread_npm2 * share * (np.abs(place_m) <= half_m)
    tread = law.tread_npm2 * np.eye(nodes)
    first = np.linalg.solve(belt + tread, -pressed)
    finite = np.linalg.solve(belt + tread + np.diag(pressed), -pressed)
    width_rad = half_m / law.radius_m
    size = 2.0 * share * width_rad
    factor = LOCAL_TREAD_STIFFNESS.amplitude(current, size, width_rad / math.sqrt(3.0))[0] / size
    assert factor == pytest.approx(float(first @ finite / (first @ first)), rel=0.05)
    assert abs(factor - 1.0) > 0.02


def test_window_with_the_kurtosis_of_a_box_passes_what_a_box_does() -> None:
    half_rad = 0.1
    x = np.arange(PATTERNS) * half_rad / math.sqrt(3.0)
    box = np.sinc(np.arange(PATTERNS) * half_rad / math.pi)
    passed = _window(half_rad / math.sqrt(3.0), -1.2)[0] / _window(0.0, 0.0)[0]
    wide = x < 1.5
    assert np.abs(passed - box)[wide].max() < 0.05
    normal = np.exp(-0.5 * x**2)
    assert np.abs(normal - box)[wide].max() > 0.1


@pytest.mark.parametrize("name", list(library()))
def test_law_in_reverse_is_finite_and_says_what_it_is(laws: Mapping[str, SignalEffect], name: str) -> None:
    law, current = laws[name], block()
    backwards = replace(current, conditions=replace(current.conditions, reverse=True))
    assert np.isfinite(law.contribution(backwards, np.array(law.start_values[0]))).all()
    assert all((law.equation, law.summary, law.scaling, law.source))


@pytest.mark.parametrize("name", ["radial in the circumferential", "circumferential in the radial"])
def test_leak_between_the_axes_of_the_plane_turns_over_in_reverse(laws: Mapping[str, SignalEffect], name: str) -> None:
    law, current, size = laws[f"law: {name} axis"], block(), np.array([0.01])
    backwards = replace(current, conditions=replace(current.conditions, reverse=True))
    assert np.array_equal(law.contribution(backwards, size), -law.contribution(current, size))


@lru_cache
def without_splice() -> tuple[Evaluated, Whitened]:
    return evaluated(campaign_of(THREE_SPEEDS, local(Change.BENDING, SPLICE), noise_mps2=0.5))


@lru_cache
def splice_found() -> LawsFound:
    """Return what is found among the laws of the belt's bending and mass and of the sensor's axes."""
    base, data = without_splice()
    some = tuple(law for name, law in library().items() if any(word in name for word in ("bending", "mass", "axis")))
    return propose_laws(base, data, laws=some)


def test_splice_of_a_box_becomes_a_law_with_its_size() -> None:
    result = splice_found()
    (law,) = result.laws
    assert law.name == NAME
    assert law.certain
    assert not law.rivals
    assert law.parameters["stiffening_rad"].value == pytest.approx(SPLICE, rel=0.03)
    assert law.parameters["place_rad"].value == pytest.approx(PLACE_RAD, abs=5e-3)
    # A box has the second moment of a normal window of this width.
    assert law.parameters["width_rad"].value == pytest.approx(WIDTH_RAD / math.sqrt(12.0), abs=2e-3)
    assert law.share > 0.9
    assert all(item.after_mps2 < 1.02 * max(item.before_mps2, item.noise_mps2) for item in law.unseen)
    assert law.held_out is not None
    assert law.held_out.rms_after_mps2 < 0.5 * law.held_out.rms_before_mps2
    assert result.fit is not None


@pytest.mark.slow
def test_splice_has_no_rival_in_the_whole_library() -> None:
    base, data = without_splice()
    (law,) = propose_laws(base, data, laws=tuple(library().values())).laws
    assert (law.name, law.certain, law.rivals) == (NAME, True, ())
    assert law.parameters["stiffening_rad"].value == pytest.approx(SPLICE, rel=0.03)


def test_one_recording_gives_a_clue_at_most_and_its_evidence_undivided() -> None:
    """A posterior divides the evidence of its sets by what they leave; a law is compared with the whole."""
    base, data = evaluated(campaign_of(SPEEDS[:1], local(Change.BENDING, SPLICE), noise_mps2=0.5))
    (law,), (again,) = (
        propose_laws(each, data, laws=(library()[NAME],)).laws for each in (base, base.tempered(13.0, 2.0))
    )
    assert law.name == NAME
    assert not law.certain
    assert [reason.code for reason in law.reasons].count(Code.LAW_UNTESTED) == 1
    assert again.log_odds == pytest.approx(law.log_odds, rel=0.05)


def test_what_a_named_change_leaves_is_in_the_error_of_its_size() -> None:
    """Were half of the splice left, its size would be known to that half."""
    base, data = without_splice()
    fit = splice_found().fit
    assert fit is not None
    size = fit.vector[fit.model.layout.effect(NAME)][0]
    named = Finding(NAME, Verdict.NAMED, {"stiffening_rad": Fitted(size, 1e-6, "rad")}, math.nan, math.nan)
    half = fit.vector.copy()
    half[fit.model.layout.effect(NAME).start] *= 0.5
    leaving = replace(fit, predicted=tuple(fit.model.predict_mean(half, index) for index in range(len(THREE_SPEEDS))))
    stds = []
    for there in (fit, leaving):
        (finding,) = judged_elsewhere([named], there, {NAME: base.fit}, data)
        stds.append(finding.parameters["stiffening_rad"].std / size)
    assert stds[0] < 0.1
    assert stds[1] == pytest.approx(0.5, rel=0.1)


def test_noise_has_no_law() -> None:
    assert not found_in(campaign_of(SPEEDS, nothing)).laws


def test_turned_waveform_of_a_splice_is_no_law() -> None:
    """The same orders at another angle are no answer of this ring to anything."""
    campaign = campaign_of(SPEEDS, local(Change.BENDING, SPLICE), noise_mps2=0.5)
    plain = campaign_of(SPEEDS, nothing, noise_mps2=0.5)
    order = np.arange(campaign.groups[0].blocks[0].orders_mps2.shape[1])
    turned = []
    for group, without in zip(campaign.groups, plain.groups, strict=True):
        base = without.blocks
        turned.append(
            replace(
                group,
                blocks=tuple(
                    replace(item, orders_mps2=b.orders_mps2 + np.exp(2j * order) * (item.orders_mps2 - b.orders_mps2))
                    for item, b in zip(group.blocks, base, strict=True)
                ),
            )
        )
    some = {name: law for name, law in library().items() if "bending" in name or "mass" in name}
    assert not any(law.certain for law in found_in(replace(campaign, groups=tuple(turned)), some).laws)


def test_size_that_differs_between_recordings_is_a_clue() -> None:
    plant = local(Change.BENDING, SPLICE)

    def growing(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
        share = group_conditions.omega_radps / SPEEDS[0].omega_radps
        return np.asarray(signal + share**2 * (plant(signal, theta, group_conditions) - signal))

    some = {name: law for name, law in library().items() if "bending" in name}
    result = found_in(campaign_of(SPEEDS, growing, noise_mps2=0.5), some)
    assert result.laws
    assert not result.laws[0].certain
    assert result.fit is None
    assert Code.LAW_SIZES_DIFFER in {reason.code for reason in result.laws[0].reasons}


def test_leak_through_a_pole_becomes_another_axis_in_this_one() -> None:
    share, pole_hz = 0.01, 1500.0

    def leak(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
        result, order = signal.copy(), np.arange(len(theta) // 2 + 1)
        transfer = share / (1.0 + 1j * order * group_conditions.omega_radps / (2.0 * math.pi * pole_hz))
        result[CIRCUMFERENTIAL] += np.fft.irfft(np.fft.rfft(signal[RADIAL]) * transfer, n=len(theta))
        return result

    some = {name: law for name, law in library().items() if isinstance(law, (CrossAxis, AxisSquare, AxisCube))}
    (law,) = found_in(campaign_of(SPEEDS, leak, noise_mps2=0.5), some).laws
    assert (law.name, law.certain) == ("law: radial in the circumferential axis", True)
    assert law.parameters["share"].value == pytest.approx(share, rel=0.05)


def test_law_that_the_noise_of_a_recording_does_not_hide_is_tested_there() -> None:
    """Power 1.2 of the noise: no sum of squares shows it, the law's own waveform does."""
    right = UnseenError(1, "radial", math.sqrt(1.2), 1.0, 1.0, math.sqrt(0.2), 0.05, 221)
    sizes = (LawSize(0, 1.0, 0.05), LawSize(1, 1.02, 0.05))
    recordings = ("first", "second")
    assert reasons_against(recordings, (right,), sizes) == ()
    hidden = right._replace(fall_std=0.1)
    assert [reason.code for reason in reasons_against(recordings, (hidden,), sizes)] == [Code.LAW_UNTESTED]
    too_large = right._replace(after_mps2=math.sqrt(1.15))
    assert [reason.code for reason in reasons_against(recordings, (too_large,), sizes)] == [Code.LAW_FAILS_UNSEEN]


@pytest.mark.parametrize("coefficients", [20, 40, 89, 221])
def test_law_that_does_nothing_where_much_is_left_fails_however_few_the_coefficients(coefficients: int) -> None:
    sizes = (LawSize(0, 1.0, 0.05), LawSize(1, 1.02, 0.05))
    for before in (1.15, 1.2, 2.0):
        for contribution in (0.0, 1e-4):
            after = before - contribution
            error = UnseenError(1, "lateral", before, after, 1.0, contribution, contribution, coefficients)
            assert [reason.code for reason in reasons_against(("a", "b"), (error,), sizes)] == [Code.LAW_FAILS_UNSEEN]


def test_law_is_judged_on_other_recordings() -> None:
    """A law of a file lowers the error of a recording at another speed, nothing of it fitted again."""
    other = campaign_of((conditions(70.0),), local(Change.BENDING, SPLICE), noise_mps2=0.5, seed=5)
    values = {
        "stiffening_rad": SPLICE,
        "place_rad": PLACE_RAD,
        "width_rad": 0.0173,
        "log_loss": 0.29,
        "log_sidewall_loss": 0.0,
        "window_kurtosis": -1.2,
    }
    table = table_of({NAME: values})
    units = {parameter.name: parameter.unit for parameter in library()[NAME].parameters}
    effects = tuple(
        replace(e, parameters=tuple(replace(p, unit=units[p.name]) for p in e.parameters)) for e in table.effects
    )
    result = transfer(other, replace(table, effects=effects, radius_m=RADIUS_M))
    assert result.held_out.rms_after_mps2 < 0.5 * result.held_out.rms_before_mps2
    assert result.held_out.rms_after_mps2 < 1.3 * result.noise_floor_mps2


def test_law_of_a_file_needs_the_exact_ring() -> None:
    table = table_of({"law: delay of the lateral axis": {"delay_s": 4e-5}})
    with pytest.raises(TreadlinkError, match="for this baseline model"):
        known_effects(table, "file", BaselineModel.SERIES)


def test_plug_in_of_a_law_passes_its_own_test(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (law,) = splice_found().laws
    for part, text in plugin_files(law, "splice", 1234).items():
        (tmp_path / part).parent.mkdir(exist_ok=True)
        (tmp_path / part).write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    effect = runpy.run_path(str(tmp_path / "treadlink_splice" / "__init__.py"))["EFFECT"]
    assert (effect.name, effect.rank) == ("splice", 1234)
    assert effect.start_values[0][0] == pytest.approx(law.parameters["stiffening_rad"].value, rel=1e-3)
    namespace = runpy.run_path(str(tmp_path / "test_splice.py"))
    tests = [test for name, test in namespace.items() if name.startswith("test_")]
    assert len(tests) == 3
    for test in tests:
        test()
    assert 'splice = "treadlink_splice:EFFECTS"' in (tmp_path / "pyproject.toml").read_text(encoding="utf-8")


def test_command_writes_the_plug_in_of_a_law_alone(tmp_path: Path) -> None:
    """A clue is none, and a directory that exists is left as it is."""
    (law,) = splice_found().laws
    clue = replace(empty(), laws=(replace(law, certain=False),))
    with pytest.raises(TreadlinkError, match="no law was found"):
        write_plugin(clue, tmp_path / "splice of 7")
    result = replace(empty(), laws=(law,))
    assert "pip install" in write_plugin(result, tmp_path / "splice of 7")
    assert (tmp_path / "splice of 7" / "treadlink_splice_of_7" / "__init__.py").is_file()
    with pytest.raises(TreadlinkError, match="exists"):
        write_plugin(result, tmp_path / "splice of 7")


def test_page_and_summary_tell_a_law_with_its_size() -> None:
    (law,) = splice_found().laws
    diagnosis = replace(empty(), recordings=("1", "2", "3"), laws=(law,), unexplained=ordinary().unexplained)
    answer = diagnosis_html(diagnosis).partition('class="answer"')[2].partition("</p>")[0]
    assert "A law explains" in answer
    assert law.title in answer
    assert diagnosis_json(diagnosis)["laws"][0]["name"] == NAME
    lines = " ".join(line.strip() for line in closure_summary_lines(diagnosis))
    assert "parameters" not in lines.partition(law.title)[2].partition(law.summary[:20])[0]
    clue = replace(law, certain=False, reasons=(Reason(Code.LAW_UNTESTED),))
    assert "A clue, which is not certain, explains" in diagnosis_html(replace(diagnosis, laws=(clue,)))


def test_splice_in_one_recording_is_no_effect() -> None:
    """Nothing could tell it from what resembles it: a law is a clue there."""
    effects = among("gain", *(change.name for change in LOCAL_CHANGES))
    posterior, search = searched(campaign_of(SPEEDS[:1], local(Change.BENDING, SPLICE), noise_mps2=0.5), effects)
    assert posterior.identified() == ()
    assert not {name for names in search.evaluations for name in names} - {"gain"}


def test_effect_without_size_has_no_share_of_the_residual() -> None:
    fit, data = fitted(campaign_of(SPEEDS[:1]), *among("radial hysteresis").values())
    (effect,) = fit.model.effects
    vector = fit.vector.copy()
    vector[fit.model.layout.effect(effect.name)] = 0.0
    read = {"half_width_mps2": Fitted(0.0, 0.1, "m/s^2")}
    assert _beside_residual(read, effect, replace(fit, vector=vector), data) == read


@pytest.mark.slow
def test_splice_is_an_effect_where_other_recordings_test_it() -> None:
    effects = among("gain", "radial hysteresis", *(change.name for change in LOCAL_CHANGES))
    posterior, search = searched(campaign_of(SPEEDS, local(Change.BENDING, SPLICE), noise_mps2=0.5), effects)
    name = NAME.removeprefix("law: ")
    assert name in posterior.identified()
    without = {other: posterior.without(other).fit for other in posterior.best.names}
    judged = judged_elsewhere(findings_of(posterior, effects, {}), posterior.best.fit, without, search.data)
    # What a normal window leaves of a box resembles a little hysteresis, at one speed.
    (finding,) = (finding for finding in judged if finding.verdict is Verdict.NAMED)
    assert finding.name == name
    assert finding.parameters["stiffening_rad"].value == pytest.approx(SPLICE, rel=0.1)
    # The equation is right to some percent only.
    assert finding.parameters["stiffening_rad"].std > 0.05 * SPLICE


@pytest.mark.slow
def test_diagnosis_of_a_splice_names_it_and_needs_no_law() -> None:
    """The whole catalogue; text, JSON and page show it, and the saved effects hold it."""
    diagnosis = diagnose(campaign_of(THREE_SPEEDS, local(Change.BENDING, SPLICE), noise_mps2=0.5))
    name = NAME.removeprefix("law: ")
    assert [finding.name for finding in diagnosis.findings if finding.verdict is Verdict.NAMED] == [name]
    assert not diagnosis.laws
    # What a normal window leaves of a box is 6 % above the floor.
    assert diagnosis.held_out.rms_after_mps2 < 1.1 * diagnosis.noise_floor_mps2
    assert diagnosis.correction is not None
    assert name in {effect.name for effect in diagnosis.correction.effects}
