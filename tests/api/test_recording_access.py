"""Recordings as tables, held against the command line and against what the file holds."""

import csv
import dataclasses
import io
import json
import math
import shutil
import traceback

import numpy as np
import pytest

import gateway
from gateway.core.config.vehicle import load_vehicle
from gateway.core.recording.reader import RecordingReader
from gateway.core.revolutions.effect_correction import CorrectedEffect, CorrectionTable, EffectParameter
from gateway.core.revolutions.order_spectrum import order_coefficients
from gateway.core.session.recording_pass import OpenedRecording
from gateway.diagnosis.effects_file import effects_text
from gateway.exporting.recorded_signals import sample_blocks
from tests.testkit.commands import invoked, run


@pytest.fixture(scope="module")
def rows(recorded):
    """Rows of `treadlink estimate --csv`."""
    done = invoked("estimate", recorded, "--csv", "-")
    assert done.exit_code == 0, done.output
    return list(csv.DictReader(io.StringIO(done.stdout)))


def rows_of(rows, wheel):
    return [row for row in rows if row["position"] == wheel]


def numbers(rows, name):
    return np.array([float(row[name]) if row[name] else math.nan for row in rows])


def test_recording_is_a_mapping_of_its_wheels(recording):
    assert recording.wheels == ("FL", "FR")
    assert list(recording) == ["FL", "FR"]
    assert len(recording) == 2
    assert "FL" in recording
    assert recording.get("RL") is None
    assert [wheel.position for wheel in recording.values()] == ["FL", "FR"]


def test_unknown_wheel_names_the_known_ones(recording):
    with pytest.raises(gateway.WheelNotFoundError, match="has no wheel 'FX'") as raised:
        recording["FX"]
    assert isinstance(raised.value, KeyError)
    assert "It has FL, FR." in raised.value.remedy


def test_info_states_origin_length_and_losses(recording, recorded):
    info = recording.info
    assert info.path == recorded
    assert info.sources == ("sim:scenario?seed=7",)
    assert info.duration_s == pytest.approx(5.0, abs=0.05)
    assert info.frames > 500
    assert info.frames_lost > 0
    assert info.crc_errors == 0
    assert (info.finished, info.has_host_time, info.damage) == (True, True, "")


def test_wheel_knows_sensor_and_radius(recording):
    wheel = recording["FR"]
    assert wheel.sensor_id == "0000a002"
    assert wheel.radius_m == 0.32
    assert wheel.heard.rate_hz == 9600.0
    assert repr(wheel).startswith("<Wheel FR of 'drive.mcap': sensor 0000a002, ")


def test_samples_equal_the_blocks_of_the_file(recording, recorded):
    samples = recording["FR"].samples()
    blocks = list(sample_blocks(OpenedRecording(RecordingReader(recorded), recording.vehicle), wheels=("FR",)))
    np.testing.assert_array_equal(samples.axes_mps2, np.concatenate([block.axes_mps2 for block in blocks]))
    np.testing.assert_array_equal(samples.device_s, np.concatenate([block.hub_time_s for block in blocks]))
    host_ns = np.concatenate([block.host_time_ns for block in blocks])
    np.testing.assert_array_equal(samples.host_utc.astype(np.int64), host_ns)
    assert len(samples) == recording["FR"].heard.samples


def test_samples_of_all_wheels_come_in_one_pass(recording):
    together = recording.samples(start_s=1.0)
    assert list(together) == ["FL", "FR"]
    for wheel, samples in together.items():
        np.testing.assert_array_equal(samples.axes_mps2, recording[wheel].samples(start_s=1.0).axes_mps2)


def test_samples_have_their_gaps(recording):
    samples = recording["FL"].samples()
    assert samples.gaps
    assert sum(lost for _, lost in samples.gaps) == samples.number[-1] - samples.number[0] + 1 - len(samples)
    for at_s, lost in samples.gaps:
        index = int(np.flatnonzero(samples.device_s == at_s)[0])
        assert samples.number[index] - samples.number[index - 1] == lost + 1


def test_saturated_samples_are_marked(recording):
    samples = recording["FR"].samples()
    assert samples.saturated.any()
    assert samples.radial_mps2[samples.saturated].min() > 0.99 * samples.radial_mps2.max()
    assert not recording["FL"].samples().saturated.any()


def test_part_of_the_samples_is_chosen_by_device_time(recording):
    whole = recording["FL"].samples()
    part = recording["FL"].samples(start_s=2.0, stop_s=3.0)
    chosen = (whole.device_s >= 2.0) & (whole.device_s < 3.0)
    np.testing.assert_array_equal(part.radial_mps2, whole.radial_mps2[chosen])
    assert sum(lost for _, lost in part.gaps) == whole.lost_before[chosen].sum()
    assert len(recording["FL"].samples(start_s=100.0)) == 0


def test_environment_holds_the_readings(recording):
    readings = recording["FL"].environment()
    assert len(readings) >= 4
    assert readings.pressure_pa == pytest.approx(210e3, rel=0.02)
    assert readings.temperature_degc == pytest.approx(25.0, abs=2.0)


@pytest.mark.parametrize("wheel", ["FL", "FR"])
def test_revolutions_equal_the_rows_of_estimate(recording, rows, wheel):
    table, selected = recording[wheel].revolutions(), rows_of(rows, wheel)
    assert table.revolution.tolist() == [int(row["revolution"]) for row in selected]
    for name in ("device_start_s", "device_end_s", "speed_mps", "pressure_pa", "temperature_degc", "load_n"):
        np.testing.assert_array_equal(getattr(table, name), numbers(selected, name))
    assert table.host_utc.astype(np.int64).tolist() == [int(row["host_ns"]) for row in selected]
    assert table.missing_fraction.tolist() == numbers(selected, "missing_fraction").tolist()
    assert table.faults.tolist() == [row["faults"] for row in selected]
    assert table.usable.tolist() == [not row["faults"] for row in selected]


@pytest.mark.parametrize("wheel", ["FL", "FR"])
def test_estimates_equal_the_rows_of_estimate(recording, rows, wheel):
    selected = rows_of(rows, wheel)
    names = [name.removesuffix("_status") for name in selected[0] if name.endswith("_status")]
    table = recording[wheel].estimates()
    assert set(table.names) == set(names)
    for name in names:
        single = table.select(name)
        np.testing.assert_array_equal(single.value, numbers(selected, name))
        np.testing.assert_array_equal(single.std, numbers(selected, f"{name}_std"))
        assert single.status.tolist() == [row[f"{name}_status"] for row in selected]
        assert single.reasons.tolist() == [row[f"{name}_reason"] for row in selected]


def test_estimates_are_selected_by_status_and_wheel(recording):
    table = recording.estimates()
    assert set(table.select(status="valid").status.tolist()) == {"valid"}
    assert len(table) == sum(len(table.select(status=item)) for item in ("valid", "provisional", "invalid"))
    assert set(table.select("speed_mps", wheel="FL").wheel.tolist()) == {"FL"}
    with pytest.raises(KeyError, match="no estimate has the name 'speed'"):
        table.select("speed")
    with pytest.raises(ValueError, match="good"):
        table.select(status="good")


def test_mean_is_of_the_valid_revolutions_of_one_wheel(recording):
    table = recording.estimates()
    speed = table.select("speed_mps", wheel="FL", status="valid")
    mean = table.mean("speed_mps", wheel="FL")
    assert mean.count == len(speed)
    assert mean.value == pytest.approx(np.average(speed.value, weights=speed.std**-2.0))
    assert speed.std.min() <= mean.constant_std <= mean.std
    with pytest.raises(ValueError, match="several wheels"):
        table.mean("speed_mps")
    with pytest.raises(KeyError, match="no revolution of FL has a valid"):
        dataclasses.replace(table, status=np.full(len(table), "provisional", object)).mean("speed_mps", wheel="FL")


def test_other_estimators_are_chosen_at_the_call(recording):
    assert recording.estimates("kinematic").names[0] == "speed_mps"
    assert "Bs" not in recording.estimates("kinematic").names
    with pytest.raises(gateway.ConfigError, match="unknown estimator 'magic'"):
        recording.estimates(["magic"])


@pytest.fixture(scope="module")
def several_blocks(tmp_path_factory):
    path = tmp_path_factory.mktemp("long") / "long.mcap"
    gateway.simulate("demo", duration_s=12.0, out=path)
    return path


def test_stream_is_whole_where_nothing_was_asked_before(several_blocks):
    with gateway.open(several_blocks) as fresh:
        streamed = sum(1 for _ in fresh.stream("kinematic"))
        assert streamed == sum(len(fresh[wheel].revolutions()) for wheel in fresh.wheels)


def test_passes_over_one_recording_may_overlap(several_blocks):
    with gateway.open(several_blocks) as fresh:
        streamed = 0
        for _ in fresh.stream("kinematic"):
            streamed += 1
            if streamed == 5:
                samples = fresh["FL"].samples()
        assert streamed == sum(len(fresh[wheel].revolutions()) for wheel in fresh.wheels)
        assert len(samples) == len(fresh["FL"].samples())
        together = zip(fresh.sample_blocks(), fresh.sample_blocks(), strict=True)
        assert all(first.wheel == second.wheel for first, second in together)


def test_uncertainties_agree_with_the_files(recording, recorded, tmp_path):
    out = tmp_path / "rows.csv"
    run("estimate", recorded, "--csv", out, "--coverage", "0.95")
    with out.open(newline="") as file:
        written = rows_of(list(csv.DictReader(file)), "FL")
    estimates = recording.estimates()
    speed = estimates.select("speed_mps", wheel="FL")
    expanded, factor = speed.expanded(0.95)
    assert numbers(written, "coverage_factor") == pytest.approx(factor)
    assert numbers(written, "speed_mps_expanded") == pytest.approx(expanded)
    assert numbers(written, "speed_mps_scatter_std") == pytest.approx(speed.scatter_std)
    assert np.hypot(speed.constant_std, speed.scatter_std) == pytest.approx(speed.std)
    both = estimates.covariance("speed_mps", "contact_length_m", wheel="FL")
    last = [estimates.select(name, wheel="FL", status="valid") for name in ("speed_mps", "contact_length_m")]
    shared = float(last[0].shared_std[0, 0]) ** 2 * last[0].value[-1] * last[1].value[-1]
    assert both[0, 1] == pytest.approx(shared, rel=0.02)
    with pytest.raises(KeyError, match="valid values of all"):
        estimates.covariance("speed_mps", wheel="FL", revolution=10_000)


def test_stream_equals_the_tables(recording, rows):
    streamed = list(recording.stream("kinematic"))
    assert len(streamed) == len(rows)
    for wheel in recording:
        selected = [revolution for revolution in streamed if revolution.wheel == wheel]
        values = [revolution["contact_length_m"].value for revolution in selected]
        expected = recording[wheel].estimates("kinematic").select("contact_length_m").value
        np.testing.assert_array_equal(values, expected)
        assert [revolution.device_start_s for revolution in selected] == recording[
            wheel
        ].revolutions().device_start_s.tolist()
    with pytest.raises(KeyError, match="no estimate 'Bs'"):
        streamed[0]["Bs"]


def test_alarms_equal_those_of_estimate(recorded, tmp_path):
    config = tmp_path / "car.toml"
    vehicle = RecordingReader(recorded).vehicle_toml
    config.write_text(f"{vehicle}\n[thresholds]\nspeed_max_kmh = 60\n")
    opened = gateway.open(recorded, config=config, estimators="kinematic")
    options = ["--config", str(config), "--estimator", "kinematic", "--json", "-"]
    done = invoked("estimate", recorded, *options)
    records = [json.loads(line).get("alarm_record") for line in done.stdout.splitlines()]
    expected = [record for record in records if record]
    result = opened.alarms()
    assert result.name.tolist() == [record["name"] for record in expected]
    assert result.reason.tolist() == [record["text"] for record in expected]
    assert result.total_s.tolist() == [record["total_s"] for record in expected]
    assert any("60" in text for text in result.reason.tolist())
    assert opened.vehicle == load_vehicle(config)
    assert gateway.open(recorded, config=load_vehicle(config)).vehicle == opened.vehicle
    tables = opened.vehicle.model_dump(mode="json")
    assert gateway.open(recorded, config=tables).vehicle == opened.vehicle


def test_angle_average_and_orders_belong_together(recording):
    wheel = recording["FL"]
    angle, average = wheel.angle(), wheel.average()
    usable = angle.usable
    assert angle.radial_mps2.shape == (len(wheel.revolutions()), len(angle.angle_rad))
    assert average.count == usable.sum()
    np.testing.assert_allclose(average.lateral_mps2, angle.lateral_mps2[usable].mean(axis=0), atol=1e-9)
    np.testing.assert_allclose(average.radial_scatter_mps2, angle.radial_mps2[usable].std(axis=0, ddof=1), rtol=1e-6)
    for axis in ("radial", "circumferential"):
        expected = order_coefficients(angle[f"{axis}_mps2"])
        np.testing.assert_allclose(wheel.orders(axis).orders_mps2[:, :30], expected[:, :30], atol=1e-9)
    normalised = wheel.orders()
    np.testing.assert_allclose(normalised.orders_mps2[:, 0].real, angle.normalised_mps2.mean(axis=1))
    assert normalised.frequency_hz[0, 1] == pytest.approx(70 / 3.6 / 0.32 / (2 * math.pi), rel=1e-3)
    with pytest.raises(ValueError, match="no axis 'up'"):
        wheel.orders("up")


def test_waveforms_are_chosen_by_device_time(recording):
    wheel = recording["FL"]
    part = wheel.angle(start_s=2.0, stop_s=3.0)
    assert 0 < len(part) < len(wheel.angle())
    assert part.device_start_s.min() >= 2.0
    assert part.device_start_s.max() < 3.0
    assert wheel.average(start_s=2.0, stop_s=3.0).count == part.usable.sum()
    with pytest.raises(gateway.RecordingError, match="no usable revolution"):
        wheel.average(start_s=100.0)


def test_long_recording_keeps_no_revolutions(recorded, recording, monkeypatch):
    monkeypatch.setattr("gateway.api.recording_access._KEPT_REVOLUTIONS", 10)
    opened = gateway.open(recorded)
    for _ in range(2):
        np.testing.assert_array_equal(opened["FR"].angle().radial_mps2, recording["FR"].angle().radial_mps2)
    assert opened._cached is None


def test_revolutions_are_read_once(recorded, monkeypatch):
    opened = gateway.open(recorded)
    opened["FL"].revolutions()
    monkeypatch.setattr("gateway.api.recording_access.RecordingPass", lambda *_, **__: pytest.fail("read again"))
    opened["FR"].angle()
    opened["FL"].average()


def test_progress_runs_from_zero_to_one(recorded):
    shares = []
    gateway.open(recorded, progress=shares.append)["FL"].revolutions()
    assert 0.0 < shares[0] < 0.5
    assert shares[-1] == pytest.approx(1.0, abs=0.02)


def test_closed_recording_reads_no_more(recorded):
    with gateway.open(recorded) as opened:
        samples = opened["FL"].samples()
    assert len(samples)
    with pytest.raises(gateway.RecordingError, match="is closed"):
        opened["FL"].samples()
    opened.close()


def test_dump_of_a_link_opens_without_host_times(recorded, recording, tmp_path):
    path = tmp_path / "link.bin"
    items = RecordingReader(recorded).items()
    path.write_bytes(b"".join(item.data for item in items if hasattr(item, "data")))
    opened = gateway.open(path, config=_written(recording, tmp_path))
    assert opened.wheels == ("FL", "FR")
    assert not opened.info.has_host_time
    assert opened.info.duration_s == pytest.approx(5.0, abs=0.1)
    np.testing.assert_array_equal(opened["FL"].samples().radial_mps2, recording["FL"].samples().radial_mps2)
    assert np.isnat(opened["FL"].samples().host_utc).all()
    assert np.isnat(opened["FL"].revolutions().host_utc).all()
    assert np.isnat(opened.estimates("kinematic").host_utc).all()
    assert np.isnat(next(opened.stream("kinematic")).host_utc)


def _written(recording, folder):
    path = folder / "vehicle.toml"
    path.write_text(recording.vehicle.to_toml())
    return path


def test_recording_without_configuration_assumes_the_radius(recorded, tmp_path):
    path = tmp_path / "link.bin"
    items = RecordingReader(recorded).items()
    path.write_bytes(b"".join(item.data for item in items if hasattr(item, "data")))
    opened = gateway.open(path)
    assert opened.vehicle is None
    assert opened.wheels == ("hub0.wheel0", "hub0.wheel1")
    assert opened["hub0.wheel0"].radius_m == 0.32


def test_notices_are_the_warnings_of_estimate(recorded, tmp_path):
    vehicle = RecordingReader(recorded).vehicle_toml.replace("0000a001", "0000a0ff")
    config = tmp_path / "swapped.toml"
    config.write_text(vehicle)
    options = ["--config", str(config), "--estimator", "kinematic"]
    done = invoked("estimate", recorded, *options)
    notices = gateway.open(recorded, config=config, estimators=("kinematic",)).notices()
    assert len(notices) == 1
    assert notices[0] in done.output


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [("none.mcap", None, "does not exist"), ("text.mcap", b"hello", "is not a recording")],
)
def test_unreadable_file_is_a_recording_error(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(gateway.Error, match=message):
        gateway.open(tmp_path / name)


def test_damaged_recording_states_its_damage(recorded, tmp_path):
    path = tmp_path / "cut.mcap"
    path.write_bytes(recorded.read_bytes()[:200_000])
    opened = gateway.open(path)
    assert not opened.info.finished
    assert "cut off" in opened.info.damage
    assert len(opened["FL"].samples()) > 1000


def test_effects_of_another_wheel_are_refused(recorded, tmp_path):
    path = tmp_path / "rl.json"
    path.write_text(effects_text(correction("RL")))
    with pytest.raises(gateway.ConfigError, match="belong to wheel RL"):
        gateway.open(recorded, effects=path)


def test_effects_are_subtracted_from_the_axes(recorded, recording, tmp_path):
    path = tmp_path / "fl.json"
    path.write_text(effects_text(correction("FL")))
    corrected, plain = gateway.open(recorded, effects=[path])["FL"].angle(), recording["FL"].angle()
    shown = np.abs(order_coefficients((plain.radial_mps2 - corrected.radial_mps2)[plain.usable])[:, 3])
    assert shown == pytest.approx(20.0, rel=1e-6)


def correction(position):
    """Return a contribution of 20 m/s^2 to the third order of the radial axis."""
    orders = np.zeros((2, 3, 8), complex)
    orders[:, 2, 3] = 20.0
    return CorrectionTable(
        position=position,
        omega_radps=np.array([10.0, 100.0]),
        orders_mps2=orders,
        effects=(CorrectedEffect("mounting offset", (EffectParameter("offset_m", 0.004, 1e-6, "m"),)),),
        radius_m=0.32,
        omega_range_radps=(10.0, 100.0),
        sensor_id=0xA001,
    )


def test_traceback_shows_the_remedy(tmp_path):
    with pytest.raises(gateway.Error) as raised:
        gateway.open(tmp_path / "none.mcap")
    assert raised.value.remedy in "".join(traceback.format_exception(raised.value))


def test_text_forms_state_units(recording):
    assert repr(recording).startswith("<Recording 'drive.mcap': FL, FR, 5.0 s, ")
    shown = repr(recording["FL"].samples())
    assert "samples of FL, " in shown
    assert "radial_mps2           m/s^2" in shown
    assert "<td>0000a002</td>" in recording._repr_html_()
    revolution = next(recording.stream("kinematic"))
    assert repr(revolution).startswith("<Revolution 0 of FL: speed ")
    assert "km/h" in revolution._repr_html_()


def test_page_is_that_of_estimate(recorded, tmp_path):
    by_command, by_program = tmp_path / "command.html", tmp_path / "program.html"
    described = shutil.copy(recorded, tmp_path / "described.mcap")
    run("note", described, "--comment", "wet track")
    words = ["estimate", str(described), "--estimator", "kinematic", "--html", str(by_command)]
    run(*words)
    with gateway.open(described, estimators="kinematic") as recording:
        assert recording.report_html(by_program) == by_command.read_text(encoding="utf-8")
        assert by_program.read_bytes() == by_command.read_bytes()
        assert "wet track" in by_program.read_text(encoding="utf-8")
        with pytest.raises(gateway.OutputError, match="already exists"):
            recording.report_html(by_program)
