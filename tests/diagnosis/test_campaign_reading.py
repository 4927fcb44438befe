"""Campaigns read from recordings of simulated wheels."""

import math
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

import gateway
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.constants import AXIS_NAMES, STANDARD_GRAVITY_MPS2
from gateway.core.errors import RecordingError
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.reasons import CoreCode, Reason
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.recording_pass import RecordingPass, open_recording
from gateway.core.text.wording import text
from gateway.core.worker_pool import Workers
from gateway.diagnosis.campaign import MAX_GROUPS, SPARE, read_campaign, read_usable, reading_orders
from gateway.diagnosis.data.group_statistics import CUT_OFF, TOO_FEW_REVOLUTIONS
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.importing.import_map import load_map, parse_map
from gateway.importing.importer import import_file
from tests.testkit.campaign_recordings import START_NS, write_recording

MEASURED = Path(__file__).parents[2] / ".." / "shared" / "measured" / "innerliner_drum_80kmh.csv"
MAP = Path(__file__).parents[2] / "examples" / "innerliner_drum_80kmh.map.toml"
LOST = Reason(EstimateCode.SAMPLES_LOST)
AT_60 = "[motion]\nspeed_kmh = 60.0"
AT_90 = "[motion]\nspeed_kmh = 90.0"
LIGHT = "load_n = 3500.0\npressure_kpa = 240.0\ntemperature_degc = 40.0"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("campaign")


@pytest.fixture(scope="module")
def slow(folder):
    return write_recording(folder / "slow.mcap", AT_60, duration_s=16.0)


@pytest.fixture(scope="module")
def fast(folder):
    return write_recording(folder / "fast.mcap", AT_90, wheels=(LIGHT,), seed=2, start_ns=START_NS + 100 * 10**9)


@pytest.fixture(scope="module")
def pair(folder):
    return write_recording(folder / "pair.mcap", AT_60, wheels=("", "load_n = 4000.0"))


@pytest.fixture(scope="module")
def campaign(slow):
    return read_campaign(reading_orders([slow]))


@pytest.fixture(scope="module")
def both(slow, fast):
    return read_campaign(reading_orders([slow, fast]))


def revolutions(path):
    """Return the revolutions that the pipeline finds in a recording."""
    return [result.revolution for result in RecordingPass(open_recording(RecordingReader(path)), ())]


class TestOneRecording:
    def test_one_group_of_five_blocks(self, campaign, slow):
        assert campaign.wheel == "W0"
        assert campaign.states == 1
        assert campaign.sensor_id == 0xB000
        assert campaign.assumed == ()
        (group,) = campaign.groups
        good = [revolution for revolution in revolutions(slow) if not revolution.faults]
        assert sum(block.count for block in group.blocks) + sum(campaign.rejected.values()) == len(good)
        assert len(group.blocks) == campaign.folds == 5
        assert group.load_known
        assert group.pressure_known
        assert text(group.label).startswith("slow.mcap: 60.0 km/h, 5000 N, 210 kPa")

    def test_conditions_match_the_revolutions(self, campaign, slow):
        (group,) = campaign.groups
        current = group.conditions
        assert current.omega_radps == pytest.approx(60 / 3.6 / 0.32, rel=1e-3)
        assert (current.radius_m, current.load_n) == (0.32, 5000.0)
        assert current.pressure_pa == pytest.approx(210e3, rel=0.01)
        assert current.temperature_degc == pytest.approx(25, abs=1) == current.reference_degc
        assert current.rate_hz == pytest.approx(9600, rel=1e-4)
        assert [block.conditions.time_s for block in group.blocks] == sorted(b.conditions.time_s for b in group.blocks)
        assert 0 < group.blocks[0].conditions.time_s < 3
        assert 13 < group.blocks[-1].conditions.time_s < 16

    def test_mean_matches_the_waveforms(self, campaign, slow):
        """Direct projection of the mean waveform; alignment is negligible here."""
        (group,) = campaign.groups
        waves = np.mean([revolution.axes_mps2 for revolution in revolutions(slow) if not revolution.faults], axis=0)
        theta = -math.pi + 2 * math.pi * np.arange(1024) / 1024
        weights = np.array([block.count for block in group.blocks]) / sum(b.count for b in group.blocks)
        mean = sum(weight * block.orders_mps2 for weight, block in zip(weights, group.blocks, strict=True))
        noise = np.sqrt(group.variance / sum(b.count for b in group.blocks))
        for axis in range(3):
            for n in (1, 2, 20, 60, 110):
                direct = 2 / 1024 * (waves[axis] @ np.cos(n * theta) - 1j * (waves[axis] @ np.sin(n * theta)))
                assert abs(mean[axis, n] - direct) < 3 * noise[axis, n]
        assert mean[2, 0].real == pytest.approx(waves[2].mean(), abs=0.1)
        assert abs(mean[0, 1]) == pytest.approx(9.8, abs=0.4)  # gravity is in it

    def test_scatter_is_sensor_noise(self, campaign):
        """5 mg per root Hz: the variance of a coefficient is the density over the period."""
        (group,) = campaign.groups
        density = (5e-3 * STANDARD_GRAVITY_MPS2) ** 2
        expected = density * group.conditions.omega_radps / (2 * math.pi)
        np.testing.assert_allclose(group.variance[:, 5:100].mean(axis=1), expected, rtol=0.1)

    def test_deviations_are_sensor_noise(self, campaign):
        (group,) = campaign.groups
        assert group.deviation_rate_hz == pytest.approx(4000.0)
        spread = np.std(np.concatenate(group.deviations_mps2, axis=1)[2])
        assert spread == pytest.approx(5e-3 * STANDARD_GRAVITY_MPS2 * math.sqrt(0.45 * 4000), rel=0.05)

    def test_the_hubs_clock_is_known(self, campaign):
        error, std = campaign.clock_error
        # The link's slots hide clock differences below their step.
        assert abs(error) < 3 * std < 1e-3

    def test_progress_counts_every_byte_once(self, slow):
        progress = []
        read_campaign(reading_orders([slow]), on_bytes=progress.append)
        assert sum(progress) == slow.stat().st_size
        assert min(progress) >= 0


class TestSeveral:
    def test_each_has_its_own_conditions_and_state(self, both):
        first, other = both.groups
        assert (first.recording, other.recording) == (0, 1)
        assert both.states == 2
        assert (first.state, other.state) == (0, 1)
        assert (first.conditions.load_n, other.conditions.load_n) == (5000, 3500)
        assert other.conditions.temperature_degc == pytest.approx(40, abs=1)
        assert first.conditions.reference_degc == other.conditions.reference_degc
        assert 25 < first.conditions.reference_degc < 40
        assert other.conditions.time_s == pytest.approx(104, abs=2)
        assert both.notes == ()

    def test_processes_give_the_same(self, both, slow, fast):
        progress = []
        with Workers(1) as workers:
            again = read_campaign(reading_orders([slow, fast]), workers=workers, on_bytes=progress.append)
        assert sum(progress) == slow.stat().st_size + fast.stat().st_size
        for first, other in zip(both.groups, again.groups, strict=True):
            assert first.label == other.label
            assert first.conditions == other.conditions
            # The rounding of linear algebra depends on the alignment of arrays in memory.
            np.testing.assert_allclose(first.variance, other.variance, rtol=1e-7)
            for a, b in zip(first.blocks, other.blocks, strict=True):
                np.testing.assert_allclose(a.orders_mps2, b.orders_mps2, rtol=1e-7, atol=1e-7)
        assert again.clock_error == both.clock_error

    def test_overlapping_recordings_are_sequenced(self, slow, folder):
        again = write_recording(folder / "again.mcap", AT_60, seed=5)
        campaign = read_campaign(reading_orders([slow, again]))
        assert campaign.notes[0] == Reason(DiagnosisCode.RECORDING_ORDER_UNKNOWN)
        assert campaign.states == 1
        assert campaign.groups[1].conditions.time_s > campaign.groups[0].blocks[-1].conditions.time_s

    def test_process_error_is_complete(self, slow, folder):
        with pytest.raises(RecordingError, match="does not exist") as caught, Workers(1) as workers:
            read_campaign(reading_orders([slow, folder / "absent.mcap"]), workers=workers)
        assert caught.value.remedy


class TestWheels:
    def test_several_need_a_choice(self, pair):
        with pytest.raises(RecordingError, match="W0, W1") as caught:
            read_campaign(reading_orders([pair]))
        assert "--wheel" in caught.value.remedy
        assert read_campaign(reading_orders([pair], wheel="W1")).groups[0].conditions.load_n == 4000

    def test_absent_wheel_is_an_error(self, pair, fast):
        with pytest.raises(RecordingError, match=r"fast.mcap' contains no revolution of wheel W1") as caught:
            read_campaign(reading_orders([pair, fast], wheel="W1"))
        assert "it contains W0" in str(caught.value)
        assert caught.value.remedy == "Choose another wheel: --wheel W0. Or leave this recording out."

    def test_unrecorded_wheel_lists_the_others(self, pair):
        with pytest.raises(RecordingError, match="no revolution of wheel fl; it contains W0, W1") as caught:
            read_campaign(reading_orders([pair], wheel="fl"))
        assert caught.value.remedy == "Choose another wheel: --wheel W0 or --wheel W1."

    def test_unconfigured_wheel_uses_assumptions(self, folder):
        path = write_recording(folder / "bare.mcap", AT_60, configured=False, duration_s=16.0)
        campaign = read_campaign(reading_orders([path]))
        assert campaign.wheel == "hub0.wheel0"
        assert Reason(CoreCode.ASSUMED_RADIUS, radius_m=0.32) in campaign.assumed
        assert Reason(DiagnosisCode.ASSUMED, quantity="load_n", value=4000.0) in campaign.assumed
        assert not campaign.groups[0].load_known
        assert campaign.groups[0].pressure_known  # the sensor tells it
        assert math.isfinite(campaign.clock_error[0])

    def test_given_configuration_takes_precedence(self, slow):
        text = RecordingReader(slow).vehicle_toml.replace("5000", "4600")
        vehicle = parse_vehicle(text, "test")
        assert read_campaign(reading_orders([slow], vehicle=vehicle)).groups[0].conditions.load_n == 4600


class TestConditions:
    def test_small_groups_of_a_ramp_are_left_out(self, folder):
        tables = "[motion]\nspeed_kmh = [[0.0, 50.0], [6.0, 50.0], [18.0, 70.0]]"
        campaign = read_campaign(reading_orders([write_recording(folder / "ramp.mcap", tables, duration_s=18.0)]))
        counts = [sum(block.count for block in group.blocks) for group in campaign.groups]
        assert max(counts) > 40
        assert min(counts) >= 4
        assert len(counts) > 5
        assert campaign.rejected.get(TOO_FEW_REVOLUTIONS, 0) > 0
        assert (
            Reason(
                DiagnosisCode.REVOLUTIONS_LEFT_OUT,
                revolutions=campaign.rejected[TOO_FEW_REVOLUTIONS],
                reason=TOO_FEW_REVOLUTIONS,
            )
            in campaign.notes
        )
        for group in campaign.groups:
            speeds = [block.conditions.omega_radps for block in group.blocks]
            assert max(speeds) / min(speeds) < 1.031
        ramp = [group for group in campaign.groups if group.conditions.omega_dot_radps2 > 0.7]
        assert ramp
        assert ramp[0].conditions.omega_dot_radps2 == pytest.approx(20 / 12 / 3.6 / 0.32, rel=0.2)

    def test_most_informative_speeds_are_kept(self, folder):
        tables = "[motion]\nspeed_kmh = [[0.0, 40.0], [4.0, 40.0], [28.0, 100.0]]"
        campaign = read_campaign(reading_orders([write_recording(folder / "drive.mcap", tables, duration_s=28.0)]))
        assert len(campaign.groups) == MAX_GROUPS
        assert campaign.rejected[SPARE] > 20
        assert (
            Reason(DiagnosisCode.REVOLUTIONS_LEFT_OUT, revolutions=campaign.rejected[SPARE], reason=SPARE)
            in campaign.notes
        )
        speeds = [3.6 * 0.32 * group.conditions.omega_radps for group in campaign.groups]
        assert min(speeds) < 45
        assert max(speeds) > 88

    def test_short_recording_has_single_revolution_blocks(self, folder):
        campaign = read_campaign(reading_orders([write_recording(folder / "short.mcap", AT_60, duration_s=1.2)]))
        assert {block.count for block in campaign.groups[0].blocks} == {1}
        assert len(campaign.groups[0].blocks) >= 3

    @pytest.mark.parametrize(
        ("tables", "duration_s", "result", "remedy"),
        [
            ("[motion]\nspeed_kmh = 0.0", 6.0, r"6\.0 s of samples", "Did the wheel roll"),
            ("[motion]\nspeed_kmh = 5.0", 0.5, r"0\.5 s of samples", "Record longer"),
        ],
        ids=["still", "short"],
    )
    def test_recording_without_revolutions_is_an_error(self, tmp_path, tables, duration_s, result, remedy):
        path = write_recording(tmp_path / "none.mcap", tables, duration_s=duration_s)
        with pytest.raises(RecordingError, match=f"no whole revolution in .*none.mcap': {result}(\n|$)") as caught:
            read_campaign(reading_orders([path]))
        assert remedy in caught.value.remedy

    def test_recording_without_samples_is_an_error(self, tmp_path):
        path = tmp_path / "empty.mcap"
        RecordingWriter(path, start_ns=START_NS).close()
        with pytest.raises(RecordingError, match=r"no sample(\n|$)") as caught:
            read_campaign(reading_orders([path]))
        assert "inspect" in caught.value.remedy

    def test_reverse_flips_circumferential_axis_and_pitch(self, folder):
        path = write_recording(
            folder / "back.mcap", AT_60 + "\ndirection = 'reverse'", wheels=("[wheel.stated]\npitch_deg = 2.0",)
        )
        (plain,), (turned,) = (read_campaign(reading_orders([path], reverse=which)).groups for which in ((), (path,)))
        assert not plain.conditions.reverse
        assert turned.conditions.reverse
        assert "reverse" in text(turned.label)
        first, other = plain.blocks[0].orders_mps2, turned.blocks[0].orders_mps2
        np.testing.assert_allclose(first[0], -other[0], rtol=1e-3, atol=1e-3)
        np.testing.assert_allclose(first[1:], other[1:], rtol=1e-3, atol=1e-3)
        assert turned.declared_pitch_rad == -plain.declared_pitch_rad == pytest.approx(math.radians(-2))

    def test_unlisted_recording_cannot_be_reverse(self, slow, fast):
        with pytest.raises(RecordingError, match="not among"):
            read_campaign(reading_orders([slow], reverse=[fast]))

    def test_recording_path_is_normalized(self, slow, tmp_path, monkeypatch):
        monkeypatch.chdir(slow.parent)
        (tmp_path / "link.mcap").symlink_to(slow)
        for other in (Path(slow.name), tmp_path / "link.mcap"):
            for item, reverse in ((slow, other), (other, slow)):
                assert read_campaign(reading_orders([item], reverse=[reverse])).groups[0].conditions.reverse


class TestRepetition:
    def test_the_same_revolutions_count_once(self, folder, slow):
        """The same drive under another name, with other times and without its last fifth of a second."""
        later = START_NS + 300 * 10**9
        copy = write_recording(folder / "copy.mcap", AT_60, duration_s=15.8, start_ns=later)
        with pytest.raises(RecordingError, match=r"copy\.mcap' holds the same revolutions as '.*slow\.mcap'"):
            read_campaign(reading_orders([slow, copy]))
        used, refused = read_usable([slow, copy], "W0")
        assert len(used) == 1
        assert {number: (why.code, why["other"]) for number, why in refused.items()} == {
            1: (DiagnosisCode.RECORDING_REPEATS, str(slow))
        }

    def test_another_drive_at_the_same_speed_is_no_repetition(self, folder, slow):
        again = write_recording(folder / "other.mcap", AT_60, seed=7, start_ns=START_NS + 300 * 10**9)
        assert len(read_campaign(reading_orders([slow, again])).groups) == 2


class TestSensors:
    def test_ac_coupling_leaves_order_zero_unknown(self, folder):
        path = write_recording(folder / "ac.mcap", AT_60, wheels=("[wheel.sensor]\ncoupling = 'ac'",))
        (group,) = read_campaign(reading_orders([path])).groups
        assert group.conditions.ac_coupled
        assert np.isnan(group.blocks[0].orders_mps2[:, 0]).all()
        assert np.isfinite(group.blocks[0].orders_mps2[:, 1:]).all()

    def test_absent_axes_and_a_low_rate_stay_unknown(self, folder):
        path = write_recording(
            folder / "one.mcap", AT_60, wheels=("[wheel.sensor]\naxes = ['radial']\nrate_hz = 2400.0",)
        )
        (group,) = read_campaign(reading_orders([path])).groups
        orders = group.blocks[0].orders_mps2
        assert np.isnan(orders[:2]).all()
        last = int(np.flatnonzero(np.isfinite(orders[2]))[-1])
        assert last == pytest.approx(0.28 * 2400 * 2 * math.pi / group.conditions.omega_radps, abs=2)
        assert 0 < group.deviation_rate_hz < 1600

    def test_dead_axis_is_left_out(self, folder):
        path = write_recording(
            folder / "dead.mcap", AT_60, wheels=("[wheel.defect]\naxes = ['lateral']\ndead_from_s = 0.0",)
        )
        campaign = read_campaign(reading_orders([path]))
        assert np.isnan(campaign.groups[0].blocks[0].orders_mps2[1]).all()
        assert np.isfinite(campaign.groups[0].blocks[0].orders_mps2[[0, 2]]).all()
        assert any(
            note["recording"] == "dead.mcap" and note["reason"].code is DiagnosisCode.AXIS_CONSTANT
            for note in campaign.notes
        )

    def test_only_the_radial_axis_is_kept_where_gravity_is_elsewhere(self, folder):
        path = write_recording(folder / "turned.mcap", AT_60, wheels=("[wheel.sensor]\nyaw_deg = 90.0",))
        campaign = read_campaign(reading_orders([path]))
        (group,) = campaign.groups
        assert np.isnan(group.blocks[0].orders_mps2[:2]).all()
        assert np.isfinite(group.blocks[0].orders_mps2[2]).all()
        assert not group.sensor_doubted
        codes = [note["reason"].code for note in campaign.notes if note.code is DiagnosisCode.ABOUT_RECORDING]
        assert DiagnosisCode.AXES_LEFT_OUT in codes
        assert DiagnosisCode.SENSOR_ALARM in codes

    def test_clipped_revolutions_are_used_if_all_are(self, folder):
        """Up to 140 g at 60 km/h are cut at 95 g."""
        path = write_recording(folder / "cut.mcap", AT_60, wheels=("[wheel.defect]\nclip_g = 95.0",))
        campaign = read_campaign(reading_orders([path]))
        assert sum(block.count for block in campaign.groups[0].blocks) > 40
        assert CUT_OFF not in campaign.rejected

    def test_occasional_clipping_is_left_out(self, folder):
        tables = "[motion]\nspeed_kmh = 60.0\n[road]\nrms_mps2 = 8.0"
        loud = read_campaign(reading_orders([write_recording(folder / "wide.mcap", tables)]))
        peaks = [
            revolution.axes_mps2[2].max() / STANDARD_GRAVITY_MPS2 for revolution in revolutions(folder / "wide.mcap")
        ]
        edge = float(np.quantile(peaks, 0.85))
        path = write_recording(folder / "narrow.mcap", tables, wheels=(f"[wheel.sensor]\nrange_g = {edge}",))
        campaign = read_campaign(reading_orders([path]))
        assert 0 < campaign.rejected[CUT_OFF] < 0.3 * len(peaks)
        assert CUT_OFF not in loud.rejected
        assert all(text(Reason(EstimateCode.RADIAL_SATURATED)) not in reason for reason in campaign.rejected)


def measurement(folder: Path, name: str, bridged: bool) -> Path:
    """Write a measurement of 9 s, with lines over 30 gaps of 40 samples or with empty cells, and return its import."""
    wheel = {"position": "W1", "wheel": 0, "sensor_id": "0000b001", "load_n": 4200.0, "pressure_kpa": 210.0}
    scenario = {"scenario": {"seed": 1, "name": "x"}, "motion": {"speed_kmh": 60.0}, "wheel": [wheel]}
    samples = gateway.simulate(scenario, duration_s=9.0)["W1"].samples()
    columns = {name: np.array(samples[f"{axis}_mps2"]) for name, axis in zip("clr", AXIS_NAMES, strict=True)}
    for values in columns.values():
        for index in range(2000, len(values) - 100, len(values) // 30):
            values[index : index + 40] = (
                np.linspace(values[index - 1], values[index + 40], 42)[1:-1] if bridged else np.nan
            )
    pyarrow.parquet.write_table(pyarrow.table(columns), folder / f"{name}.parquet")
    axes = "".join(
        f'[axis.{axis}]\ncolumn = "{name}"\nunit = "m/s^2"\n' for name, axis in zip("clr", AXIS_NAMES, strict=True)
    )
    conditions = (
        '[conditions]\nposition = "W1"\nradius_mm = 320.0\nload_n = 4200.0\npressure_kpa = 210.0\n'
        "temperature_degc = 30.0\n"
    )
    text_of_map = (
        f'[file]\nformat = "parquet"\n[sampling]\nrate_hz = 9600.0\n{axes}[sensor]\ncoupling = "DC"\n{conditions}'
    )
    path = folder / f"{name}.mcap"
    import_file(folder / f"{name}.parquet", parse_map(text_of_map, "map"), path, lambda _: None)
    return path


def remarks(campaign):
    return [note["reason"] for note in campaign.notes if note.code is DiagnosisCode.ABOUT_RECORDING]


def test_revolutions_with_bridged_gaps_are_left_out_as_those_with_gaps(tmp_path):
    lost = read_campaign(reading_orders([measurement(tmp_path, "lost", bridged=False)]))
    bridged = read_campaign(reading_orders([measurement(tmp_path, "bridged", bridged=True)]))
    assert lost.rejected[LOST] > 20
    assert bridged.rejected == lost.rejected
    assert DiagnosisCode.DATA_FAULT not in [reason.code for reason in remarks(bridged)]


def test_bridged_gaps_in_a_recording_are_reported(tmp_path, monkeypatch):
    monkeypatch.setattr("gateway.importing.importer._bridges", lambda _: (np.empty((0, 2), dtype=int), ()))
    campaign = read_campaign(reading_orders([measurement(tmp_path, "bridged", bridged=True)]))
    (note,) = remarks(campaign)
    assert note.kind == (DiagnosisCode.DATA_FAULT, "bridged")
    assert note["lines"] > 25
    assert note["samples"] == pytest.approx(40 * note["lines"], rel=0.05)


@pytest.mark.skipif(not MEASURED.exists(), reason="the measured recording is not here")
def test_measured_recording_has_five_revolutions(tmp_path):
    path = tmp_path / "drum.mcap"
    import_file(MEASURED, load_map(MAP), path, lambda _: None)
    campaign = read_campaign(reading_orders([path]))
    (group,) = campaign.groups
    assert [block.count for block in group.blocks] == [1] * 5
    assert all(map(math.isnan, campaign.clock_error))
    assert not group.load_known
    assert group.conditions.ac_coupled
    assert any("radius" in remark for remark in campaign.assumed if isinstance(remark, str))
    assert len(campaign.assumed) >= 6
