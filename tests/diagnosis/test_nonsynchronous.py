"""Diagnosis of the time-locked signal."""

import dataclasses
import math
import pickle

import numpy as np
import pytest

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.reasons import Reason
from gateway.diagnosis import criteria
from gateway.diagnosis.data.campaign_data import Block, Group
from gateway.diagnosis.data.group_statistics import label
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.effects.effect import GroupConditions, SpectrumEffect
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.remainder.contact_edge_jitter import edge_findings
from gateway.diagnosis.result import Finding, Scaling, ScalingStatus, Verdict
from gateway.diagnosis.spectrum.nonsynchronous_density import Site
from gateway.diagnosis.spectrum.nonsynchronous_diagnosis import UNKNOWN, TimeLocked, beside_larger, diagnose_time_locked
from gateway.diagnosis.spectrum.nonsynchronous_spectra import group_spectra
from gateway.diagnosis.spectrum.spectrum_sets import envelope_moment
from gateway.diagnosis.spectrum.unexplained_spectrum import Part, parts_left, unexplained
from gateway.diagnosis.views.phrases import reason_text, residual_remarks
from tests.diagnosis.nonsynchronous_data import simulated_groups
from tests.testkit.agreement import values_of

RATE_HZ = 4000.0
EFFECTS = [effect for effect in catalogue().values() if isinstance(effect, SpectrumEffect)]
POSITIONS = {
    "road vibration": (1.3, 400.0, 2.2),
    "hub vibration": (0.7, 11.3, 5.0),
    "cavity resonance": (0.9, 222.0, 6.0, 0.7),
}
CONSTANT = values_of(Scaling(ScalingStatus.KNOWN, 0.0))


def conditions(speed_kmh: float = 80.0) -> GroupConditions:
    return GroupConditions(speed_kmh / 3.6 / 0.32, 0.0, 0.32, 4000.0, 2.1e5, 25.0, 25.0, 9600.0, 0.0)


def noisy_group(speed_kmh: float, rng: np.random.Generator, seconds: float = 20.0, axes: str = "clr") -> Group:
    """A group with nothing but white noise, of another size on each axis."""
    noise = rng.standard_normal((3, round(seconds * RATE_HZ))) * rng.uniform(0.5, 5.0, (3, 1))
    noise[[axis not in axes for axis in "clr"]] = np.nan
    flat = np.zeros((3, ORDERS), dtype=complex)
    current = conditions(speed_kmh)
    return Group(
        f"{speed_kmh} km/h", 0, 0, current, (Block(100, current, flat),), np.ones((3, ORDERS)), 0.24,
        deviations_mps2=(noise,), deviation_rate_hz=RATE_HZ,
    )  # fmt: skip


def added(group: Group, signal: np.ndarray) -> Group:
    return dataclasses.replace(group, deviations_mps2=(group.deviations_mps2[0] + signal,))


def test_band_above_what_a_slow_recording_shows_is_no_envelope() -> None:
    noise = np.random.default_rng(5).standard_normal((3, 4000))
    assert envelope_moment([noise], 500.0, 2, (252.0, 300.0)) == (2.0, 0.0)
    ratio, count = envelope_moment([noise], 500.0, 2, (225.0, 300.0))
    assert (round(ratio), count) == (2, 201)


def test_label_without_a_temperature_is_the_same_in_another_process() -> None:
    of_unknown = label("a.mcap", dataclasses.replace(conditions(), temperature_degc=math.nan))
    assert pickle.loads(pickle.dumps(of_unknown)) == of_unknown
    assert reason_text(of_unknown) == "a.mcap: 80.0 km/h, 4000 N, 210 kPa"


def named(result: TimeLocked) -> set[str]:
    return {finding.name for finding in result.findings if finding.verdict is Verdict.NAMED}


def values(result: TimeLocked, name: str) -> dict[str, tuple[float, float]]:
    actual = next(finding for finding in result.findings if finding.name == name)
    return {key: (item.value, item.std) for key, item in actual.parameters.items()}


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
class TestEffects:
    def test_derivative(self, effect: SpectrumEffect) -> None:
        frequency, position = np.arange(2.0, 1600.0), np.array(POSITIONS[effect.name])
        analytic = effect.density_derivative(conditions(), frequency, position)
        for number, parameter in enumerate(effect.parameters):
            step = np.zeros(len(position))
            step[number] = parameter.step
            numeric = effect.density(conditions(), frequency, position + step) - effect.density(
                conditions(), frequency, position - step
            )
            numeric /= 2.0 * parameter.step
            assert np.abs(numeric - analytic[number]).max() < 1e-5 * np.abs(analytic[number]).max()

    def test_density_is_zero_at_zero_and_grows(self, effect: SpectrumEffect) -> None:
        frequency, position = np.arange(0.05, 2e4, 0.1), np.array(POSITIONS[effect.name])
        assert not effect.density(conditions(), frequency, np.append(0.0, position[1:])).any()
        power = [effect.density(conditions(kmh), frequency, position).sum() for kmh in (50.0, 100.0)]
        growth = position[3] if effect.name == "cavity resonance" else 1.0
        assert power[1] / power[0] == pytest.approx(4.0**growth, rel=0.02)

    def test_power_matches_the_parameter(self, effect: SpectrumEffect) -> None:
        frequency, position = np.arange(0.05, 2e4, 0.1), np.array(POSITIONS[effect.name])
        power = effect.density(conditions(65.0), frequency, position).sum(axis=1) * 0.1
        share = 0.5 if effect.name == "hub vibration" else 1.0
        assert power[list(effect.axes)] == pytest.approx(share * position[0] ** 2, rel=0.01)


class TestEmpty:
    def test_white_noise_has_no_findings(self) -> None:
        for seed in range(12):
            rng = np.random.default_rng(seed)
            result = diagnose_time_locked([noisy_group(kmh, rng) for kmh in (40.0, 70.0, 110.0)[: 1 + seed % 3]])
            assert not result.findings
            assert not result.unexplained
            assert not result.notes

    def test_smooth_road_has_no_findings(self) -> None:
        result = diagnose_time_locked(simulated_groups())
        assert not result.findings
        assert not result.unexplained
        assert [spectra.label for spectra in result.spectra] == [group.label for group in simulated_groups()]

    def test_short_groups_are_noted(self) -> None:
        rng = np.random.default_rng(1)
        assert diagnose_time_locked([noisy_group(60.0, rng, seconds=3.0)]).notes == (
            Reason(DiagnosisCode.GROUPS_TOO_SHORT, groups=1, of=1),
        )
        assert diagnose_time_locked([]) == TimeLocked()


class TestNamed:
    def test_the_road(self) -> None:
        result = diagnose_time_locked(simulated_groups("[road]\nrms_mps2 = 1\nbandwidth_hz = 350"))
        assert named(result) == {"road vibration"}
        assert not result.unexplained
        estimates = values(result, "road vibration")
        for name, true in (("rms_mps2", 1.0), ("corner_hz", 350.0), ("roll_off", 2.0)):
            value, std = estimates[name]
            assert abs(value - true) < 4.0 * std + 0.02 * true

    def test_the_hub(self) -> None:
        tables = "[vibration]\nhub_rms_mps2 = 1\nhub_hz = 12.5\nhub_bandwidth_hz = 4"
        result = diagnose_time_locked(simulated_groups(tables))
        assert named(result) == {"hub vibration"}
        estimates = values(result, "hub vibration")
        assert estimates["rms_mps2"][0] == pytest.approx(1.0, rel=0.12)
        assert estimates["centre_hz"][0] == pytest.approx(12.5, abs=0.5)
        assert estimates["width_hz"][0] == pytest.approx(4.0, abs=1.0)

    def test_road_and_cavity_together(self) -> None:
        tables = "[road]\nrms_mps2 = 0.7\n[vibration]\ncavity_rms_mps2 = 0.6\ncavity_hz = 209"
        result = diagnose_time_locked(simulated_groups(tables))
        assert named(result) == {"road vibration", "cavity resonance"}
        estimates = values(result, "cavity resonance")
        for name, true in (("rms_mps2", 0.6), ("centre_hz", 209.0), ("width_hz", 6.0)):
            value, std = estimates[name]
            assert abs(value - true) < 4.0 * std + 0.05 * true * (name == "rms_mps2")
        gain = next(finding for finding in result.findings if finding.name == "cavity resonance")
        assert gain.lock == "time"
        assert gain.probability >= criteria.NAMED
        assert gain.log_odds > 10.0


class TestNotNamed:
    def test_tone_at_the_cavity_frequency(self) -> None:
        result = diagnose_time_locked(simulated_groups("[sensor]\ntone_mg = [0, 0, 60]\ntone_hz = 217"))
        assert not named(result)
        line = result.unexplained[0]
        assert (line.axis, line.lock, values_of(line.scaling)) == ("radial", "time", CONSTANT)
        assert line.hz is not None
        assert line.hz[0] < 217.0 < line.hz[1]
        assert line.rms_mps2 == pytest.approx(60e-3 * STANDARD_GRAVITY_MPS2 / math.sqrt(2.0), rel=0.25)

    def test_edge_jitter_is_no_road(self) -> None:
        tables = "[road]\nleading_jitter_mm = 0.8\ntrailing_jitter_mm = 0.3\n[sensor]\noffset_mm = 5"
        result = diagnose_time_locked(simulated_groups(tables))
        assert not named(result)
        assert [edge.verdict for edge in edge_findings(simulated_groups(tables))] == [Verdict.NAMED]

    def test_loose_sensor_is_no_cavity(self) -> None:
        tables = "[road]\nrms_mps2 = 0.4\nbandwidth_hz = 900\n[defect]\nloose_hz = 225\nloose_q = 20"
        result = diagnose_time_locked(simulated_groups(tables))
        assert named(result) <= {"road vibration"}
        assert result.unexplained

    def test_noise_of_one_axis_is_no_road(self) -> None:
        rng = np.random.default_rng(3)
        groups = []
        for kmh in (50.0, 90.0):
            group = noisy_group(kmh, rng)
            shaken = np.convolve(rng.standard_normal(group.deviations_mps2[0].shape[1]), np.ones(12), mode="same")
            groups.append(added(group, np.stack([shaken * kmh / 20.0, 0.0 * shaken, 0.0 * shaken])))
        result = diagnose_time_locked(groups)
        assert not named(result)
        assert result.unexplained[0].axis == "circumferential"

    def test_constant_band_is_no_cavity(self) -> None:
        rng = np.random.default_rng(4)
        groups = []
        for kmh in (50.0, 90.0):
            group = noisy_group(kmh, rng)
            length = group.deviations_mps2[0].shape[1]
            spectrum = np.fft.rfft(rng.standard_normal(length))
            away = (np.fft.rfftfreq(length, 1.0 / RATE_HZ) - 222.0) / 3.0
            bell = np.fft.irfft(spectrum / np.sqrt(1.0 + away**2), n=length) * 30.0
            groups.append(added(group, np.stack([0.0 * bell, 0.0 * bell, bell])))
        result = diagnose_time_locked(groups)
        assert not named(result)
        reason = next(finding.reason for finding in result.findings if finding.name == "cavity resonance")
        assert reason is not None
        assert reason.code is DiagnosisCode.IMPLAUSIBLE_PARAMETER
        assert dict(reason.values)["parameter"] == "growth"
        assert values_of(result.unexplained[0].scaling) == CONSTANT

    def test_cavity_may_grow_slowly_with_speed(self) -> None:
        groups = []
        for kmh, rms in ((50.0, 0.6), (80.0, 0.7)):
            groups += simulated_groups(f"[vibration]\ncavity_rms_mps2 = {rms * 65.0 / kmh:.4f}", (kmh,))
        result = diagnose_time_locked(groups)
        assert named(result) == {"cavity resonance"}
        growth, std = values(result, "cavity resonance")["growth"]
        assert abs(growth - math.log(0.7 / 0.6) / math.log(80.0 / 50.0)) < 3.0 * std

    def test_line_moving_with_speed_has_an_order(self) -> None:
        rng = np.random.default_rng(5)
        groups = []
        for kmh in (60.0, 90.0):
            group = noisy_group(kmh, rng)
            time = np.arange(group.deviations_mps2[0].shape[1]) / RATE_HZ
            wheel = group.conditions.omega_radps * 12.4 * time
            groups.append(added(group, np.stack([0.0 * time, 0.0 * time, 2.0 * np.sin(wheel)])))
        line = diagnose_time_locked(groups).unexplained[0]
        assert line.orders is not None
        assert line.orders[0] <= 12.4 <= line.orders[1]
        assert line.rms_mps2 == pytest.approx(math.sqrt(2.0), rel=0.1)

    def test_radial_axis_is_sufficient(self) -> None:
        rng = np.random.default_rng(6)
        assert not diagnose_time_locked([noisy_group(60.0, rng, axes="r")]).findings

    def test_filtered_sensor_noise_is_no_road(self) -> None:
        two = diagnose_time_locked(simulated_groups("[sensor]\nbandwidth_hz = 700"))
        assert not two.findings
        assert not two.unexplained
        assert any(note.code is DiagnosisCode.NOISE_ROLLS_OFF for note in two.notes)
        single = diagnose_time_locked(simulated_groups("[sensor]\nbandwidth_hz = 700", (80.0,)))
        assert not named(single)
        assert not single.unexplained

    def test_broadband_noise_at_one_speed_names_nothing(self) -> None:
        tables = "[road]\nrms_mps2 = 0.9\nbandwidth_hz = 800\n[defect]\nloose_hz = 208.98486\nloose_q = 11.33815"
        result = diagnose_time_locked(simulated_groups(tables, (80.0,), 30.0, 7))
        assert named(result) <= {"road vibration"}
        assert result.unexplained


class TestLock:
    """The lock of unexplained lines."""

    @staticmethod
    def line(kmh: float, hz: float, seed: int = 8) -> Group:
        group = noisy_group(kmh, np.random.default_rng(seed))
        time = np.arange(group.deviations_mps2[0].shape[1]) / RATE_HZ
        fading = np.linspace(-2.0, 2.0, len(time)) * np.sin(2.0 * np.pi * hz * time)
        return added(group, np.stack([0.0 * time, fading, 0.0 * time]))

    def test_multiple_at_one_speed_has_unknown_lock(self) -> None:
        wheel_hz = conditions(80.0).omega_radps / (2.0 * np.pi)
        (entry,) = diagnose_time_locked([self.line(80.0, 2.0 * wheel_hz)]).unexplained
        assert (entry.lock, entry.lock_known, entry.orders) == ("time", False, (2, 2))
        assert entry.speeds is None
        (entry,) = diagnose_time_locked([self.line(80.0, 2.5 * wheel_hz)]).unexplained
        assert entry.lock_known
        assert entry.orders is None

    def test_same_frequency_at_two_speeds_is_time_locked(self) -> None:
        wheel_hz = conditions(80.0).omega_radps / (2.0 * np.pi)
        groups = [self.line(kmh, 2.0 * wheel_hz, seed) for seed, kmh in enumerate((50.0, 80.0))]
        (entry,) = diagnose_time_locked(groups).unexplained
        assert entry.lock_known
        assert entry.speeds == (2, 2)

    def test_same_order_at_two_speeds_has_unknown_lock(self) -> None:
        turns = [2.0 * conditions(kmh).omega_radps / (2.0 * np.pi) for kmh in (50.0, 80.0)]
        groups = [self.line(kmh, hz, seed) for seed, (kmh, hz) in enumerate(zip((50.0, 80.0), turns, strict=True))]
        (entry,) = diagnose_time_locked(groups).unexplained
        assert (entry.lock_known, entry.orders) == (False, (2, 2))
        assert math.isnan(entry.road_m)

    def test_joints_of_the_road_have_their_distance(self) -> None:
        joint_m = 0.57
        groups = []
        for seed, kmh in enumerate((50.0, 80.0)):
            current = conditions(kmh)
            groups.append(self.line(kmh, current.omega_radps * current.radius_m / joint_m, seed))
        (entry,) = diagnose_time_locked(groups).unexplained
        assert entry.lock_known
        assert entry.road_m == pytest.approx(joint_m, rel=0.01)
        assert "but every 0.57" in residual_remarks(entry)[0]

    def test_line_seen_at_one_of_two_speeds(self) -> None:
        rng = np.random.default_rng(9)
        (entry,) = diagnose_time_locked([noisy_group(50.0, rng), self.line(80.0, 321.0)]).unexplained
        assert values_of(entry.scaling) == values_of(Scaling(ScalingStatus.SEEN_AT_ONE_SPEED))
        assert entry.speeds is None

    def test_fading_orders_in_one_band_are_multiples(self) -> None:
        group = noisy_group(80.0, np.random.default_rng(8))
        wheel_hz = group.conditions.omega_radps / (2.0 * np.pi)
        time = np.arange(group.deviations_mps2[0].shape[1]) / RATE_HZ
        comb = sum(np.sin(2.0 * np.pi * wheel_hz * order * time + order) for order in range(3, 15))
        fading = np.linspace(-1.0, 1.0, len(time)) * comb
        result = diagnose_time_locked([added(group, np.stack([0.0 * time, fading, 0.0 * time]))]).unexplained
        assert result
        assert not any(entry.lock_known for entry in result)


def lateral_parts(power: np.ndarray) -> list[Part]:
    """Return the parts above even noise of a spectrum of the lateral axis from 3 Hz on, (1000,)."""
    (single,) = simulated_groups(speeds_kmh=(80.0,))
    spectra = group_spectra(single, 5)
    assert spectra is not None
    frequency, folds = np.arange(3.0, 1003.0), 5
    every = np.ones((folds, 3, 1000))
    every[:, 1] = power
    first = np.arange(1000)
    spectra = dataclasses.replace(
        spectra,
        frequency_hz=frequency,
        power=every,
        freedom=np.full(folds, 6.0),
        first=first,
        count=np.ones_like(first),
    )
    density = np.ones((3, 1000))
    return parts_left(Site.of(0, spectra), density, density, np.ones(3))


@pytest.mark.parametrize(("speeds_kmh", "speeds"), [((90.0, 91.0), None), ((90.0, 91.0, 130.0), (2, 2))])
def test_nearly_equal_speeds_do_not_tell_what_a_line_goes_with(speeds_kmh, speeds):
    """Between 90 and 91 km/h multiples of a twentieth of their logarithm are apart."""
    spectra = group_spectra(noisy_group(80.0, np.random.default_rng(1)), 5)
    assert spectra is not None
    sites = [
        Site.of(index, dataclasses.replace(spectra, conditions=conditions(kmh))) for index, kmh in enumerate(speeds_kmh)
    ]
    lines = [Part(index, 1, 40.2, 44.2, 42.2, 0.5, 0.02) for index in range(len(sites))]
    (entry,) = unexplained(sites, lines)
    assert entry.speeds == speeds


def test_wide_band_keeps_its_width() -> None:
    """The middle of the band alone holds hardly any power."""
    power = np.ones(1000)
    power[500:505] = power[510:515] = 1.6
    power[505:510] = 1.02
    (part,) = lateral_parts(power)
    assert part.rms_mps2 > 3.0 * part.std_mps2
    assert part.low_hz <= 505.0
    assert part.high_hz >= 515.0


def test_line_with_skirts_is_that_line() -> None:
    """A quarter of the power is in sidebands 9 Hz apart, left by resampling each revolution."""
    power = 1.0 + 300.0 * np.exp(-np.abs(np.arange(1000) - 47.0) / 12.0)
    power[46:49] += 6000.0
    power[[38, 56]] += 1000.0
    (part,) = lateral_parts(power)
    assert part.line
    assert part.centre_hz == pytest.approx(50.0, abs=0.1)
    # Its size is that of the whole.
    assert part.rms_mps2 == pytest.approx(math.sqrt(float((power - 1.0).sum())), rel=0.02)


def rung(group: Group, frequency_hz: float, size_mps2: float, every_m: float, decay_s: float = 0.015) -> Group:
    """Add what a sensor reads of a belt that rings, vertically, at each joint of a drum."""
    current = group.conditions
    time_s = np.arange(group.deviations_mps2[0].shape[1]) / RATE_HZ
    since_s = np.mod(time_s, every_m / (current.omega_radps * current.radius_m))
    blow = (
        size_mps2 * current.omega_radps / 60.0 * np.exp(-since_s / decay_s) * np.sin(2 * np.pi * frequency_hz * since_s)
    )
    angle = current.omega_radps * time_s
    return added(group, blow * np.stack((np.sin(angle), np.zeros_like(angle), np.cos(angle))))


def quiet_group(speed_kmh: float, rng: np.random.Generator) -> Group:
    """Add sensor noise of 0.3 m/s^2 rms on each axis to nothing."""
    flat = noisy_group(speed_kmh, rng, seconds=8.0)
    (noise,) = flat.deviations_mps2
    return dataclasses.replace(flat, deviations_mps2=(0.3 * noise / noise.std(axis=1, keepdims=True),))


def test_ringing_at_joints_of_a_drum_is_no_resonance_of_the_cavity() -> None:
    rng = np.random.default_rng(5)
    groups = [rung(quiet_group(kmh, rng), 138.0, 0.7, 6.3) for kmh in (80.0, 90.0, 101.0)]
    result = diagnose_time_locked(groups)
    assert not named(result)
    assert result.unexplained


def test_effect_beside_something_larger_is_undecided() -> None:
    cavity = Finding("cavity resonance", Verdict.NAMED, {}, 1e3, 0.3)
    road = Finding("road vibration", Verdict.NAMED, {}, 1e3, 3.0)
    larger = {"cavity resonance": 2.2, "road vibration": 2.2}
    doubted, remaining = beside_larger((cavity, road), larger, several=False)
    assert doubted.verdict is Verdict.INDISTINGUISHABLE
    assert doubted.rivals == (UNKNOWN,)
    assert doubted.reason == Reason(DiagnosisCode.BESIDE_SOMETHING_LARGER, own_mps2=0.3, larger_mps2=2.2)
    assert doubted.decide_with == Reason(DiagnosisCode.RECORD_AGAIN, how="another_speed")
    assert remaining == road
    (doubted,) = beside_larger((cavity,), larger, several=True)
    assert doubted.decide_with == Reason(DiagnosisCode.RECORD_AGAIN, how="another_road")
    assert beside_larger((cavity, road), dict.fromkeys(larger, 0.0), several=True) == [cavity, road]


def test_undecided_effects_beside_something_larger_are_open_with_it() -> None:
    cavity = Finding("cavity resonance", Verdict.INDISTINGUISHABLE, {}, 1e3, 0.3, rivals=("hub vibration",))
    hub = Finding("hub vibration", Verdict.INDISTINGUISHABLE, {}, 1e3, 3.0, rivals=("cavity resonance",))
    refused = Finding("road vibration", Verdict.REFUSED, {}, 1.0, 0.1)
    larger = {"cavity resonance": 2.2, "hub vibration": 2.2, "road vibration": 2.2}
    result = beside_larger((cavity, hub, refused), larger, several=True)
    assert [item.rivals for item in result] == [("hub vibration", UNKNOWN), ("cavity resonance", UNKNOWN), ()]
    assert result[0].reason == Reason(DiagnosisCode.BESIDE_SOMETHING_LARGER, own_mps2=0.3, larger_mps2=2.2)
    assert result[1].reason is None
    assert result[2] == refused
