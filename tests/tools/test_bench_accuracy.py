"""Benches of accuracy, validity and of the independent tire: they judge by the truth and repeat themselves."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from accuracy.cases import MEASURED_WAVES, RADIUS_M, Case, grid_cases
from accuracy.measure import Effort, Outcome, Sample, measure
from accuracy.signals import samples_of
from accuracy.tables import grid_tables
from bench_independent import campaign_of, read, wave_table
from bench_validity import main as bench_validity
from independent_tire.tires import TIRES
from pydantic import Field
from validity import ranges
from validity.bench import Order, ToldRun, judge_tire, told_runs
from validity.cases import CASES, drawn, named
from validity.judging import Judged
from validity.later_spoils import EVERY_SPOIL
from validity.left_out import add_counts, count_left_out, left_out_table
from validity.ranges import declared, derived, listed, spans
from validity.spoils import Signal
from validity.statements import NotApplicableError, draw_statement
from validity.summary import kind_table, quantity_table, share, well_table
from validity.tires import draw_world

from gateway.core.config.validation import within
from gateway.core.errors import ConfigError
from gateway.core.estimates.doubt_rules import DoubtRule
from gateway.core.estimates.estimator import Estimate, Status
from gateway.diagnosis.effects.belt_dispersion import BlockTread, belt_wave
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, LATERAL, RADIAL
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.scenario_tables import Sensor

SMALL = Effort(clean=6, single=8, single_slow=0, runs=2)
NAMES = ("kinematic", "weak-form", "load", "wear")


@pytest.fixture(scope="module")
def base() -> Outcome:
    return measure(Case("noise", "base"), NAMES, SMALL)


def test_targets_of_the_weak_form_and_of_speed(base: Outcome) -> None:
    """The study's targets at 5000 N: bias without noise, spread of one revolution against the bound."""
    for name, bias in (("Bs", 0.006), ("Cw", 0.004), ("Rs", 0.004), ("Ts", 0.03)):
        assert abs(base.clean["weak-form", name].bias) < bias
        assert 0.4 < base.single["weak-form", name].std / base.bound[name] < 4.0
    assert abs(base.clean["kinematic", "speed_mps"].bias) < 1e-5
    assert base.single["kinematic", "speed_mps"].std < 5e-5
    assert abs(base.clean["kinematic", "half_angle_rad"].bias) < 0.025
    assert abs(base.clean["wear", "wear_mm"].bias) < 0.02
    assert abs(base.clean["load", "load_by_width_n"].bias) < 0.003


def test_averaging_helps_by_the_root_of_the_count(base: Outcome) -> None:
    many, single = base.long["weak-form", "Cw"], base.single["weak-form", "Cw"]
    assert many.rms < 0.4 * single.rms
    assert len(many.errors) == 2
    assert len(single.errors) == 8


def test_samples_are_repeatable_and_as_requested() -> None:
    case = Case("noise", "base", waves=(MEASURED_WAVES,), road_rms_mps2=2.0, hub_rms_mps2=1.0, jitter_m=0.002)
    first, again = (samples_of(case, 3, np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(first.counts, again.counts)
    radial = first.counts[:, 2] * first.range_mps2 / 32767
    revolution = 2.0 * math.pi / case.omega_radps * case.rate_hz
    assert len(radial) >= 5 * revolution
    assert radial.mean() == pytest.approx(RADIUS_M * case.omega_radps**2, rel=0.02)
    quiet = samples_of(Case("noise", "base"), 3, np.random.default_rng(5), noise=False)
    assert np.abs(quiet.counts).max() > 30000  # as fine as 16 bit go


def test_errors_are_relative_except_for_values_near_zero() -> None:
    sample = Sample()
    sample.add(Estimate("Bs", 2.2, 0.1, Status.VALID), 2.0)
    sample.add(Estimate("Bs", math.nan, math.nan, Status.INVALID, "no"), 2.0)
    assert (sample.bias, sample.valid, sample.asked) == (pytest.approx(0.1), 1, 2)
    assert sample.worth == pytest.approx(2.0)
    wear = Sample()
    wear.add(Estimate("wear_mm", 0.3, 0.1, Status.VALID), 0.0)
    assert wear.bias == pytest.approx(0.3)


def test_tables_of_the_grid_count_the_conditions_with_a_value() -> None:
    key, given, none = ("kinematic", "speed_mps"), Sample([0.1, 0.2, 0.3], [0.1] * 3), Sample()
    outcomes = [
        Outcome(case, {key: clean}, {key: single}, {key: long}, {"speed_mps": 0.1})
        for case, clean, single, long in zip(
            grid_cases(), [given] * 27, [none, *[given] * 26], [none, none, *[given] * 25], strict=True
        )
    ]
    cells = [table.rows[0][1] for table in grid_tables(outcomes, NAMES)]
    assert [cell.partition(" [")[2] for cell in cells] == ["", "26 of 27]", "25 of 27]"]


QUICK = ("kinematic", "weak-form")
RADIUS = "states:tire.radius_mm"


def order_of(tire: int) -> Order:
    return Order(1, tire, (RADIUS,), QUICK)


@pytest.fixture(scope="module")
def told() -> list[ToldRun]:
    return [run for tire in (0, 1) for run in told_runs(order_of(tire))]


@pytest.fixture(scope="module")
def judged(told: list[ToldRun]) -> list[Judged]:
    return [item for run in told for item in run.judged()]


def test_misstated_radius_is_judged_by_the_true_one(judged: list[Judged]) -> None:
    for tire in (0, 1):
        speeds = [item for item in judged if item.tire == tire and item.quantity == "speed_mps"]
        assert len(speeds) > 25
        for speed in speeds:
            assert speed.truth == pytest.approx(draw_world(1, tire).speed_kmh / 3.6, rel=1e-9)
            # The statement is off by its own error too, 1 % at most three times.
            assert speed.value / speed.truth == pytest.approx(1.0 + 0.01 * speed.size, rel=0.03)


def test_same_seed_gives_same_judgement(judged: list[Judged]) -> None:
    again = judge_tire(order_of(0))
    first = [item for item in judged if item.tire == 0]
    assert [repr(item) for item in again] == [repr(item) for item in first]


def test_every_estimate_of_the_estimators_is_judged(judged: list[Judged]) -> None:
    assert {item.estimator for item in judged} == set(QUICK)
    last = [item for item in judged if item.last and item.estimator == "weak-form"]
    assert {item.quantity for item in last} == {"Bs", "Cw", "Rs", "Ts", "Bs/Cw", "Rs/Cw", "Ts/Cw"}
    assert all(math.isfinite(item.truth) for item in last)


def test_rule_left_out_makes_falsely_valid_what_it_doubts(told: list[ToldRun]) -> None:
    """A radius that the steady value alone contradicts."""
    counts = count_left_out(told[-1:], (DoubtRule.STEADY_VALUE, DoubtRule.GRAVITY))
    assert counts["none"].false["one"] == 0
    assert counts["none"].still_valid == counts["none"].valid
    without, other = counts[DoubtRule.STEADY_VALUE], counts[DoubtRule.GRAVITY]
    assert without.false["one"] > 25
    assert without.still_valid["one"] < without.valid["one"]
    assert other.false == counts["none"].false
    twice = add_counts(counts, counts)
    assert twice[DoubtRule.STEADY_VALUE].false["one"] == 2 * without.false["one"]
    rows = {row[0]: row for row in left_out_table(twice).rows}
    assert float(rows["steady value"][1]) > float(rows["none"][1])


def test_share_counts_false_and_missing_estimates() -> None:
    right = Judged("plain", "true", 0.0, 0, "car", 40, True, "weak-form", "Bs", 1.1, 0.1, 0.0, 1.0, "valid", True, ())
    wrong = replace(right, value=1.5)
    missing = replace(right, value=math.nan, std=math.nan, status="invalid")
    result = share([right, wrong, missing, replace(missing, determinable=False)])
    assert (result.judged, result.valid, result.falsely_valid) == (4, 2, 1)
    assert (result.able, result.falsely_invalid) == (3, 1)
    assert result.largest == pytest.approx(5.0)
    assert replace(right, std=0.0).falsely_valid
    assert well_table([right, wrong, missing]).rows


def test_every_parameter_has_sizes_or_a_reason_for_none() -> None:
    keys = {key for key, _ in declared()}
    tables = {name[:-1] for name in listed() if name.endswith(".*")}
    kinds = ("conditions:", "stranger:")
    assert {name for name in listed() if not name.endswith(".*") and not name.startswith(kinds)} <= keys
    assert all(any(key.startswith(table) for key in keys) for table in tables)
    assert all(span.source for span in listed().values())
    known = {span.key for span in spans()}
    for key, field in declared():
        row = listed().get(key)
        if row is None and not key.startswith(tuple(tables)):
            assert key in known or derived(key, field) is None
    assert {"sensor.yaw_deg", "sensor.roll_deg", "states:tire.radius_mm", "hello:rate_hz", "link:drop"} <= known
    assert all(span.way == "choice" or span.sizes[0] <= span.sizes[1] for span in spans())


class NewSensor(Sensor):
    hysteresis_percent: tuple[float, float, float] = Field(default=(0.0, 0.0, 0.0))
    creep_percent: float = within(0.0, 0.0, 40.0, "creep in percent")
    mode: Literal["slow", "fast"] = Field(default="slow")


class NewScenario(Scenario):
    sensor: NewSensor = Field(default=NewSensor())


def test_new_parameter_is_in_the_benchmark_without_a_word(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ranges, "Scenario", NewScenario)
    new = {span.name: span for span in spans()}.items() - {case.name: case.span for case in CASES}.items()
    sizes = {name: span.sizes for name, span in new}
    assert sizes["sensor.creep_percent"] == pytest.approx((0.04, 4.0))
    assert sizes["sensor.mode"] == ("fast",)
    assert {f"sensor.hysteresis_percent.{axis}" for axis in ranges.AXES} < sizes.keys()


def test_every_case_makes_a_scenario_and_a_vehicle_file() -> None:
    """Each by itself: what it does not name stays as it was."""
    changed = set()
    for tire in range(3):
        plain = draw_world(4, tire)
        said = draw_statement(plain, np.random.default_rng(1))
        before = plain.plan(), said.vehicle(plain)
        for case in (*CASES, *drawn(2, 4, tire)):
            try:
                world, statement = case.change(plain, said, case.size(4, tire), np.random.default_rng(2))
                after = world.plan(), statement.vehicle(world)
            except (NotApplicableError, ConfigError):
                continue
            messages = (statement.told, statement.spoils, statement.lost[0], statement.wander[0], world.link)
            changed |= {case.name} if after != before or any(messages) else set()
            changed |= {case.name} if (statement.axes, statement.rate_factor) != ((0, 1, 2), 1.0) else set()
    assert sum(name.startswith("normal + ") for name in changed) >= 4
    # Without a calibration there is nothing to misstate of it, nor an error of what is not stated.
    never = {case.name for case in CASES} - changed - {"plain"}
    assert {name for name in never if "load_calibration" not in name and "_std" not in name} == set()
    rng = np.random.default_rng(2)
    by_yaw, by_gain = named(["sensor.yaw_deg", "sensor.gain_error_percent.lateral"])
    yaw, _ = by_yaw.change(plain, said, 9.0, rng)
    assert yaw.tilt_deg == (*plain.tilt_deg[:2], 9.0)
    gain, _ = by_gain.change(plain, said, 9.0, rng)
    assert gain.gain_error == (plain.gain_error[0], 0.09, plain.gain_error[2])


def test_what_a_sensor_does_to_its_samples_is_seen_in_them() -> None:
    time_s = np.arange(8000) / 4000.0
    angle = 40.0 * time_s
    values = np.stack([120.0 * np.sin(angle) ** 5, 20.0 * np.cos(3.0 * angle), 500.0 - 400.0 * np.cos(angle) ** 20], 1)
    signal = Signal(time_s, angle, values, 4000.0)
    for name, spoil in EVERY_SPOIL.items():
        size = 1e-5 if name == "nonlinear" else named([name])[0].span.sizes[1]
        spoiled = spoil(signal, size, np.random.default_rng(1))
        assert spoiled.shape == values.shape
        assert np.isfinite(spoiled).all()
        assert np.abs(spoiled - values).max() > 1e-3, name


def test_run_goes_on_where_its_file_ends(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "kept.jsonl"
    options = ["--case", "known", "--estimator", "kinematic", "--json", str(path)]
    bench_validity([*options, "--count", "1"])
    first = capsys.readouterr().out
    assert "1 tires, 1 runs" in first
    size = len(path.read_text(encoding="utf-8").splitlines())
    bench_validity([*options, "--count", "2", "--minutes", "0"])
    assert capsys.readouterr().out == first
    bench_validity([*options, "--count", "2"])
    assert "2 tires, 2 runs" in capsys.readouterr().out
    assert len(path.read_text(encoding="utf-8").splitlines()) == size + 1


def test_tables_show_aims_and_the_worst_quantity_first() -> None:
    right = Judged("plain", "true", 0.0, 0, "car", 40, True, "weak-form", "Bs", 1.1, 0.1, 0.0, 1.0, "valid", True, ())
    wrong = replace(right, table="one", quantity="Cw", value=1.7)
    rows = {row[0]: row for row in kind_table([right, wrong]).rows}
    assert rows["one"][5:8] == ("100.00 %", "100.00 %", "0.3 %")
    assert rows["true"][5] == "0.00 %"
    assert [row[1] for row in quantity_table([right, wrong]).rows] == ["Cw", "Bs"]


def test_referee_has_tires_of_other_sizes_and_is_right_where_all_is_true() -> None:
    """Finite elements with friction, through the same chain."""
    result = judge_tire(Order(1, 9, ("known",), QUICK, refereed=True))
    valid = [item for item in result if item.valid]
    assert {item.kind for item in result} == {"motorcycle"}
    assert len(valid) > 0.8 * len(result)
    assert not any(item.falsely_valid for item in valid)


BELT = next(belt for belt in TIRES if belt.blocks)


def write_orders(folder: Path, orders: tuple[float, float]) -> None:
    """Write a tire that is round but for a wave on either side of its contact."""
    theta = -math.pi + 2.0 * math.pi / 2048 * np.arange(2048)
    shape = np.zeros((6, 2, 2048))
    shape[0] = BELT.radius_m
    for order, edge, ahead in zip(orders, (-0.2, 0.2), (True, False), strict=True):
        there = theta < edge if ahead else theta > edge
        shape[0] += there * 0.01 * np.cos(order * (theta - edge))
    names = ("name", "radius_m", "pressure_pa", "tension_width_m", "bending_nm2", "mass_kgpm", "speed_mps", "blocks")
    about = {name: getattr(BELT, name) for name in (*names, "sidewall_damping_nspm2", "bending_damping_nm2s")}
    about |= {"load_n": 4000.0, "edges_rad": [-0.2, 0.2], "numbers": [3e-3, 0.2, 3.0, 2.5]}
    np.savez(folder / f"{BELT.name}.npz", description=json.dumps(about), shape_0=shape, shape_4=shape)


def test_wave_table_reads_the_orders(tmp_path: Path) -> None:
    mass = BELT.mass_kgpm
    tension = BELT.pressure_pa * BELT.tension_width_m * BELT.radius_m / mass
    tread = BlockTread(BELT.blocks, BELT.bending_nm2 / mass, tension, 0.0, 0.0)
    orders = tuple(belt_wave(tread, side, BELT.omega_radps, BELT.radius_m).order for side in (0, 1))
    write_orders(tmp_path, (orders[0], orders[1]))
    for row in wave_table(tmp_path).rows:
        assert float(row[2]) == pytest.approx(float(row[3]), abs=0.5)


def test_campaign_has_the_tires_orders(tmp_path: Path) -> None:
    write_orders(tmp_path, (80.0, 55.0))
    tire = read(tmp_path / f"{BELT.name}.npz", 4)
    (group,) = campaign_of([tire], 4, 1e-6, 1).groups
    orders = group.blocks[0].orders_mps2
    assert orders[RADIAL, 0].real == pytest.approx(tire.signal_mps2[RADIAL].mean(), rel=1e-6)
    assert np.isnan(orders[LATERAL]).all()
    assert np.abs(orders[CIRCUMFERENTIAL]).max() < 1e-4
    assert group.declared_offset_m == 4e-3


def test_missing_tire_is_reported(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="is missing: make it with"):
        read(tmp_path / "none.npz", 4)
