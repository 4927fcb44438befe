"""Measured speeds, rotations and angles: kept in the recording and compared with the revolutions."""

import tomllib
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from gateway.core.cli.estimate import estimate
from gateway.core.errors import ConfigError
from gateway.core.recording.reader import RecordingReader
from gateway.importing.commands.import_measurement import import_
from gateway.importing.import_map import ReferenceColumn, parse_map
from gateway.importing.importer import import_file
from gateway.importing.map_guess import guess_map
from gateway.importing.reference_channels import ReferenceChannel
from gateway.importing.reference_comparison import ReferenceComparison, TurnLog, turn_means
from gateway.importing.reference_topic import RecordedReferences
from gateway.importing.views.reference_lines import reference_lines
from tests.importing.measurements import simple_map, write_csv
from tests.importing.rolling_wheel import RADIUS_M, RollingWheel, rolling

RATE_HZ = 9600.0
REFERENCES = {
    "speed": 'column = "v"\nquantity = "speed"\nunit = "km/h"\nstd = 0.01',
    "rpm": 'column = "n"\nquantity = "rotation"\nunit = "rpm"',
    "tacho": 'column = "pulse"\nquantity = "pulses"',
    "encoder": 'column = "phi"\nquantity = "angle"\nunit = "deg"',
}


@cache
def wheel() -> RollingWheel:
    return rolling(RATE_HZ)


def measured(folder: Path, speed_factor: float = 1.002) -> tuple[Path, Path]:
    """Return a file whose reference speed is off by a factor, and its map."""
    turns = wheel().angle_rad / (2 * np.pi)
    columns = {
        "z": wheel().axes_mps2[:, 2],
        "v": wheel().speed_mps * 3.6 * speed_factor,
        "n": wheel().speed_mps / RADIUS_M / (2 * np.pi) * 60,
        "pulse": np.where(turns % 1 < 0.05, 5.0, 0.0) + np.random.default_rng(2).normal(size=len(turns)) * 0.1,
        "phi": (turns * 360 + 40.0) % 360,
    }
    text = simple_map(
        sampling=f"rate_hz = {RATE_HZ}",
        conditions="radius_mm = 320",
        **{"axis.circumferential": "", "axis.lateral": "", "axis.radial": 'column = "z"\nunit = "m/s^2"'},
    )
    text += "".join(f'\n[[reference]]\nname = "{name}"\n{keys}\n' for name, keys in REFERENCES.items())
    path, map_path = write_csv(folder / "run.csv", columns), folder / "run.map.toml"
    map_path.write_text(text, encoding="utf-8")
    return path, map_path


def test_import_and_estimate_print_the_differences(tmp_path: Path) -> None:
    path, map_path = measured(tmp_path)
    out = tmp_path / "out.mcap"
    result = CliRunner().invoke(import_, [str(path), "--map", str(map_path), "--out", str(out)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    lines = [line for line in result.output.splitlines() if line.startswith("W1, reference")]
    (radius,) = [line for line in lines if "belt radius" in line]
    value, _, error, unit = radius.split("radius of ")[1].split(maxsplit=3)
    assert float(value) == pytest.approx(320.64, abs=0.1)
    # The map states the rate without an error, which is then 1 %.
    assert (float(error), unit) == (pytest.approx(3.2, abs=0.1), "mm")
    for name, percent in (("speed", -0.2), ("rpm", 0.0), ("tacho", 0.0), ("encoder", 0.0)):
        (line,) = [line for line in lines if f"reference {name}: " in line and "difference" in line]
        shown = line.rsplit("(", 1)[1] if "e-" not in line.rsplit(" (", 1)[1] else "0 "
        assert float(shown.split()[0]) == pytest.approx(percent, abs=0.02), line
        assert int(line.split(": ")[1].split()[0]) >= 30
    (contact,) = [line for line in lines if "reference encoder: the contact centre" in line]
    assert float(contact.split("at ")[1].split()[0]) == pytest.approx(40.0, abs=0.5)
    again = CliRunner().invoke(estimate, [str(out)], catch_exceptions=False)
    assert [line.strip() for line in again.output.splitlines() if "W1, reference" in line] == lines


def test_recording_keeps_the_values_with_their_errors(tmp_path: Path) -> None:
    path, map_path = measured(tmp_path)
    result = CliRunner().invoke(import_, [str(path), "--map", str(map_path), "--out", str(tmp_path / "o.mcap")])
    assert result.exit_code == 0
    reader = RecordingReader(tmp_path / "o.mcap")
    references = RecordedReferences(reader)
    assert list(reader.items())
    results = {reference.name: reference for reference in references.references()}
    assert set(results) == set(REFERENCES)
    speed = results["speed"]
    assert (speed.position, speed.quantity) == ("W1", "speed")
    assert speed.value_std == pytest.approx(0.01 / 3.6)
    expected = np.interp(speed.times_s, wheel().times_s, wheel().speed_mps * 1.002)
    np.testing.assert_allclose(speed.values, expected, rtol=1e-4)
    turned = np.interp(results["tacho"].times_s, wheel().times_s, wheel().angle_rad / (2 * np.pi))
    np.testing.assert_allclose(turned - np.rint(turned), 0.0, atol=2e-3)
    np.testing.assert_allclose(np.diff(results["tacho"].values), 1.0)


def channel(**keys: object) -> ReferenceChannel:
    column = ReferenceColumn(name="r", column="c", **keys)  # type: ignore[arg-type]
    return ReferenceChannel(column, 1000.0, 0.0, 5.0)


@pytest.mark.parametrize("cuts", [(), (1, 2, 100, 101, 500)])
def test_values_do_not_depend_on_blocks(cuts: tuple[int, ...]) -> None:
    rng = np.random.default_rng(3)
    times = np.arange(1000) / 1000.0
    signal = 2.5 + 2.5 * np.tanh(20 * np.sin(2 * np.pi * 12.3 * times)) + rng.normal(size=1000) * 0.05
    signal[300:310] = np.nan
    for keys in ({"quantity": "pulses"}, {"quantity": "speed", "unit": "m/s"}, {"quantity": "angle", "unit": "turns"}):
        whole = list(channel(**keys).feed(signal))
        split = channel(**keys)
        results = [value for part in np.split(signal, cuts) for value in split.feed(part)]
        np.testing.assert_allclose(results, whole)


def test_noise_at_the_threshold_makes_no_pulses() -> None:
    rng = np.random.default_rng(4)
    times = np.arange(2000) / 1000.0
    slow = 2.5 + 2.5 * np.sin(2 * np.pi * 5.0 * times) + rng.normal(size=2000) * 0.2
    assert len(list(channel(quantity="pulses", pulses_per_turn=2.0).feed(slow))) in (9, 10)


def test_encoder_that_runs_backward_counts_the_same_turns() -> None:
    angle = (-np.arange(1000) * 7.2) % 360
    results = list(channel(quantity="angle", unit="deg").feed(angle))
    assert results[-1][1] - results[0][1] == pytest.approx(-7.2 / 360 * (results[-1][0] - results[0][0]) * 1000)


@pytest.mark.parametrize(
    ("keys", "fault"),
    [
        ('quantity = "speed"', r"reference\[#1\].unit: missing, one of m/s"),
        ('quantity = "speed"\nunit = "rpm"', r'unit: "rpm" found, one of m/s'),
        ('quantity = "pulses"\nunit = "V"', "pulses have no unit"),
        ('quantity = "angle"\nunit = "deg"\nthreshold = 1.0', 'only for quantity = "pulses"'),
        ('quantity = "sped"', "did you mean speed"),
        ('quantity = "pulses"\nwheels = ["FL"]', "the wheels are W1"),
    ],
)
def test_faults_of_references_are_named(keys: str, fault: str) -> None:
    with pytest.raises(ConfigError, match=fault):
        parse_map(simple_map() + f'\n[[reference]]\nname = "r"\ncolumn = "c"\n{keys}\n', "map")


def test_reference_without_revolutions_is_named() -> None:
    (line,) = reference_lines([ReferenceComparison("FL", "drum", "speed", 0)])
    assert line == "FL, reference drum: fewer than 3 revolutions have a reference; nothing to compare"


@pytest.mark.parametrize("value_std", [0.0, 0.018])
def test_belt_radius_is_no_better_known_than_the_rate_and_the_reference(value_std: float) -> None:
    turns, period_s, speed_mps = TurnLog(), 0.1, 18.0
    for k in range(40):
        turns.add(SimpleNamespace(faults=(), period_s=period_s, start_s=k * period_s))  # type: ignore[arg-type]
    times_s = np.arange(0.0, 5.0, 0.1)
    reference = "FL", "drum", "speed", times_s, np.full(len(times_s), speed_mps), value_std
    compared = turns.compare(*reference, 0.3, 1e-4)
    share = compared.radius_std_m / compared.radius_m
    assert share == pytest.approx(np.hypot(1e-4, value_std / (0.6 * np.pi / period_s)), rel=1e-6)
    assert ("if the reference is exact" in reference_lines([compared])[1]) == (value_std == 0.0)


def test_channels_of_a_rig_vary_and_state_the_load(tmp_path: Path) -> None:
    times_s = wheel().times_s
    columns = {
        "time_s": times_s, "az (m/s^2)": wheel().axes_mps2[:, 2], "Fz [kN]": 4.0 + 0.2 * np.sin(0.5 * np.pi * times_s),
        "slip angle [deg]": 2.0 * np.sin(times_s), "camber [deg]": 0.5 + 0.1 * times_s, "My [Nm]": 30.0 + times_s,
    }  # fmt: skip
    path = write_csv(tmp_path / "rig.csv", columns)
    text = guess_map(path)
    quantities = [reference["quantity"] for reference in tomllib.loads(text)["reference"]]
    assert text.count("# std = 0.1   # ? standard error of the column, in its unit") == 4
    assert quantities == ["load", "slip_angle", "camber", "torque"]
    (tmp_path / "rig.map.toml").write_text(text)
    out = tmp_path / "o.mcap"
    result = CliRunner().invoke(import_, [str(path), "--map", str(tmp_path / "rig.map.toml"), "--out", str(out)])
    assert result.exit_code == 0, result.output
    recording = RecordingReader(out)
    reader = RecordedReferences(recording)
    assert list(recording.items())
    load, slip, *_ = reader.references()
    expected = np.interp(load.times_s, times_s, columns["Fz [kN]"]) * 1e3
    np.testing.assert_allclose(load.values, expected, atol=10.0)
    np.testing.assert_allclose(
        slip.values, np.deg2rad(np.interp(slip.times_s, times_s, columns["slip angle [deg]"])), atol=2e-3
    )
    vehicle = tomllib.loads(recording.vehicle_toml or "")["wheel"][0]
    assert vehicle["load_n"] == pytest.approx(1e3 * columns["Fz [kN]"].mean(), rel=1e-6)
    assert vehicle["load_std_n"] == pytest.approx(1e3 * columns["Fz [kN]"].std(), rel=1e-6)
    told = {line.split("reference ")[1].split(":")[0]: line for line in result.output.splitlines() if " mean " in line}
    assert len(told) == 4
    assert float(told["camber_deg_3"].split("mean ")[1].split()[0]) == pytest.approx(0.7, abs=0.02)


def test_load_that_a_rig_has_for_a_small_part_is_known_to_no_more_than_itself(tmp_path: Path) -> None:
    load_n = np.repeat([4000.0, 0.0], [400, 1600])
    path = write_csv(tmp_path / "rig.csv", {"z": np.sin(np.arange(2000.0)), "Fz": load_n})
    text = simple_map(**{"axis.circumferential": "", "axis.lateral": ""})
    text += '\n[[reference]]\nname = "load"\ncolumn = "Fz"\nquantity = "load"\nunit = "N"\n'
    report = import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")
    (wheel,) = tomllib.loads(RecordingReader(report.recording).vehicle_toml or "")["wheel"]
    assert wheel["load_std_n"] == wheel["load_n"] == pytest.approx(800.0)


def test_reference_of_a_sensor_that_starts_later_is_in_time(tmp_path: Path) -> None:
    rows = zip(wheel().times_s, wheel().axes_mps2[:, 2], wheel().speed_mps, strict=True)
    texts = [f"{time_s!r},{z!r},{v!r}" for time_s, z, v in np.array(list(rows)).tolist()]
    path = tmp_path / "two.csv"
    path.write_text("\n".join(["node,t,z,v", *(f"1,{s}" for s in texts), *(f"2,{s}" for s in texts[9600:])]) + "\n")
    text = '[file]\nsensor_column = "node"\n[sampling]\ntime_column = "t"\n[sensor]\ncoupling = "DC"\n'
    for node, position in (("1", "FL"), ("2", "FR")):
        text += f'[[wheel]]\nposition = "{position}"\nsensor = "{node}"\n'
        text += '[wheel.axis.radial]\ncolumn = "z"\nunit = "m/s^2"\n'
    text += '[[reference]]\nname = "v"\ncolumn = "v"\nquantity = "speed"\nunit = "m/s"\n'
    recording = RecordingReader(import_file(path, parse_map(text, "map"), tmp_path / "o.mcap").recording)
    references = RecordedReferences(recording)
    assert list(recording.items())
    results = {reference.position: reference for reference in references.references()}
    assert results["FR"].times_s[0] == pytest.approx(1.05, abs=1e-3)
    for reference in results.values():
        expected = np.interp(reference.times_s, wheel().times_s, wheel().speed_mps)
        np.testing.assert_allclose(reference.values, expected, rtol=1e-6)


def test_values_in_some_rows_only_are_taken_at_their_times() -> None:
    column = np.full(1000, np.nan)
    column[7::30] = np.arange(1000)[7::30] / 1000.0
    times_s, values = np.array(list(channel(quantity="speed", unit="m/s").feed(column))).T
    assert len(values) == 10
    np.testing.assert_allclose(values, times_s, atol=1e-12)


@pytest.mark.parametrize("rate_hz", [9.3, -9.3])
def test_turns_that_an_encoder_has_not_counted_are_a_gap(rate_hz: float) -> None:
    turns = rate_hz * np.arange(2000) / 1000.0
    turns[800:1080] = np.nan
    times_s, values = np.array(list(channel(quantity="angle", unit="turns").feed(turns % 1))).T
    starts_s = np.arange(0.1, 1.8, 0.1)
    means = turn_means(times_s, values, starts_s, np.full(len(starts_s), 1 / 9.3), is_turns=True)
    assert np.flatnonzero(np.isnan(means)).tolist() == [6, 7, 8, 9]
    np.testing.assert_allclose(means[np.isfinite(means)], rate_hz)
    # An estimate of half the period is wrong by its factor, not without a reference.
    halved = turn_means(times_s, values, starts_s[:5], np.full(5, 0.5 / 9.3), is_turns=True)
    np.testing.assert_allclose(halved, rate_hz)
