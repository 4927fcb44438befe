"""`treadlink figures --from` and `--grid`: the papers' figures of recordings and datasets."""

import csv
import importlib.util
import math
from dataclasses import replace

import numpy as np
import pytest

import gateway
from gateway.core.errors import ConfigError, RecordingError
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.tire_data import TireData
from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.forces.lateral_shape import LATERAL, RADIAL
from gateway.forces.ply_steer import ROLL_NAME
from gateway.papers.figure_registry import chosen
from gateway.papers.figure_sources import FigureSource, measured_tires, read_grid, table_csv
from gateway.papers.measured_figures import measured_figures
from gateway.papers.measured_tires import GridConditions, MeasuredWheel
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.ring_series import signal_orders, signal_waveform
from tests.testkit.campaign_recordings import write_recording
from tests.testkit.commands import invoked, run
from tests.testkit.exact_ring import solution
from tests.testkit.revolution_data import CONDITIONS, OMEGA, exact_wave, make_revolution

pytestmark = pytest.mark.skipif(importlib.util.find_spec("matplotlib") is None, reason="needs matplotlib")

LOADS_N = (3000.0, 5000.0)
WAVEFORMS = ("ring-fig-7", "ring-fig-11", "ring-fig-12", "ply-steer-fig-11", "ply-steer-fig-13")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("grid")
    lines = ["recording, wheel, load_n, wear_mm, speed_kmh"]
    for index, load_n in enumerate(LOADS_N):
        keys = f"load_n = {load_n}\npressure_kpa = {210 + 20 * index}"
        path = write_recording(folder / f"{index}.mcap", "[motion]\nspeed_kmh = 65.0", wheels=(keys,), duration_s=4.0)
        lines.append(f"{path.name}, W0, {load_n}, {3 * index}, {65 + 20 * index}")
    (folder / "grid.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture(scope="module")
def tires(folder):
    return measured_tires(read_grid(folder / "grid.csv"), None, lambda _: None)


def test_conditions_are_those_of_table_and_recording(tires):
    assert [tire.load_n for tire in tires] == list(LOADS_N)
    assert [tire.wear_mm for tire in tires] == [0.0, 3.0]
    assert [tire.pressure_pa for tire in tires] == pytest.approx([210e3, 230e3], rel=0.02)
    assert [tire.speed_kmh for tire in tires] == pytest.approx([65.0, 65.0], rel=0.01)


def test_weak_form_of_the_average_agrees_with_that_of_the_revolutions(folder, tires, tmp_path):
    out = tmp_path / "rows.csv"
    run("estimate", folder / "1.mcap", "--csv", out)
    last = list(csv.DictReader(out.open()))[-1]
    values, stds = tires[1].numbers["weak-form"]
    for name, value, std in zip(RING_NUMBERS, values, stds, strict=True):
        assert value == pytest.approx(float(last[name]), abs=2.0 * std), name
        assert 0.0 < std < abs(value)


def test_stated_load_scales_what_rests_on_it(folder, tires):
    """Eq. 28 has the load as a factor of the force, which divides every number."""
    source = FigureSource(folder / "1.mcap")
    (recorded,) = measured_tires([source], None, lambda _: None)
    assert recorded.load_n == pytest.approx(LOADS_N[1])
    assert recorded.numbers["ring-paper"][0] == pytest.approx(tires[1].numbers["ring-paper"][0])
    assert math.isnan(recorded.wear_mm)


def test_stated_pressure_replaces_that_of_the_recording(folder, tmp_path):
    table = tmp_path / "grid.csv"
    table.write_text(f"recording, wheel, pressure_kpa\n{folder / '1.mcap'}, W0, 250\n")
    (tire,) = measured_tires(read_grid(table), None, lambda _: None)
    assert tire.pressure_pa == pytest.approx(250e3)
    assert tire.load_n == pytest.approx(LOADS_N[1])


def test_command_draws_tabulates_and_warns_of_another_speed(folder, tmp_path):
    out = tmp_path / "out"
    result = run("figures", "--grid", folder / "grid.csv", "--out", out)
    rows = list(csv.DictReader((out / "conditions.csv").open()))
    assert [float(row["load_n"]) for row in rows] == list(LOADS_N)
    assert all(float(row["weak-form_Bs_std"]) > 0.0 for row in rows)
    assert len(list(out.glob("*.svg"))) == 10
    assert "the table states 85.0 km/h" in result
    assert "Drawn from measurements" in (out / "index.html").read_text(encoding="utf-8")
    with pytest.raises(gateway.OutputError, match="already exists"):
        gateway.figures(out, grid=folder / "grid.csv")


def test_one_condition_has_no_trends(tires):
    figures, missing = measured_figures(tires[:1])
    assert set(figures) == set(WAVEFORMS)
    assert missing["ring-fig-13"] == "all wheels have the same wear"
    with pytest.raises(ConfigError, match="cannot be drawn: all wheels have the same load"):
        measured_figures(tires[:1], ["ply-steer-fig-15"])


def test_lateral_waveform_has_no_roll_although_it_is_doubtful():
    roll_rad, wave = math.radians(2.0), exact_wave(solution())
    axes = np.zeros((3, len(wave)))
    axes[LATERAL], axes[RADIAL] = math.sin(roll_rad) * wave, math.cos(roll_rad) * wave
    wheel = MeasuredWheel("W0", GridConditions())
    for index, known_rad in enumerate((math.nan, 0.01, roll_rad, math.nan)):
        status = Status.INVALID if math.isnan(known_rad) else Status.PROVISIONAL
        revolution = replace(make_revolution(wave), index=index, axes_mps2=axes)
        wheel.add(revolution, CONDITIONS, [Estimate(ROLL_NAME, known_rad, 0.001, status)])
    assert wheel.tire().waveforms.lateral_m == pytest.approx(0.0, abs=1e-9)


def points_of(tires, name: str) -> list[float]:
    """Return the abscissae that a figure of the ply steer shows."""
    from matplotlib.figure import Figure

    figure = Figure()
    measured_figures(tires, [name])[0][name](figure)
    return sorted(set(figure.axes[0].containers[0].lines[0].get_xdata()))


def test_pressure_and_load_of_one_set_are_parted(tires):
    # Tables I and II of the ply steer paper: the load is the same in four, the pressure in three.
    conditions = [(4000.0, 1.8), (4000.0, 2.1), (4000.0, 2.4), (4000.0, 2.7), (3000.0, 2.1), (5000.0, 2.1)]
    slopes = dict.fromkeys(tires[0].slopes_rad, (0.003, 0.0001))
    grid = [replace(tires[0], load_n=load, pressure_pa=1e5 * bar, slopes_rad=slopes) for load, bar in conditions]
    assert points_of(grid, "ply-steer-fig-14") == pytest.approx([1.8, 2.1, 2.4, 2.7])
    assert points_of(grid, "ply-steer-fig-15") == pytest.approx([3000.0, 4000.0, 5000.0])
    with pytest.raises(ConfigError, match="no two wheels of one pressure differ in load"):
        measured_figures([grid[0], grid[4]], ["ply-steer-fig-15"])


def test_wheel_without_pressure_is_in_the_table_and_in_no_trend(tires):
    slopes = dict.fromkeys(tires[0].slopes_rad, (0.003, 0.0001))
    flat, *others = [
        replace(tires[0], load_n=load_n, pressure_pa=pressure_pa, slopes_rad=slopes)
        for load_n, pressure_pa in ((3000.0, 0.0), (3000.0, 2e5), (5000.0, 2e5), (3000.0, 3e5))
    ]
    row, *_ = csv.DictReader(table_csv([flat]).decode().splitlines())
    assert (row["pressure_kpa"], row["pressure_number"]) == ("0.0", "")
    assert points_of([flat, *others], "ply-steer-fig-14") == pytest.approx([2.0, 3.0])
    assert points_of([flat, *others], "ply-steer-fig-15") == pytest.approx([3000.0, 5000.0])


def test_waveforms_of_all_recordings_are_drawn(tires):
    from matplotlib.figure import Figure

    figures, _ = measured_figures(tires)
    for name in ("ring-fig-7", "ring-fig-11", "ring-fig-12", "ply-steer-fig-2", "ply-steer-fig-11"):
        figure = Figure()
        caption = figures[name](figure)
        assert all(tire.name in caption for tire in tires), name
        if "11" in name or "12" in name:
            assert len(figure.subfigs) == len(tires)


def test_orders_are_fitted_at_the_stated_contact_angle():
    from matplotlib.figure import Figure

    half_rad = 0.24
    condition = {"load_n": CONDITIONS.load_n, "pressure_pa": CONDITIONS.pressure_pa, "radius_m": CONDITIONS.radius_m}
    orders = signal_orders(np.arange(1, 61), TABLE_3_NUMBERS, half_angle_rad=half_rad, **condition)
    revolution = make_revolution(signal_waveform(angle_grid(), OMEGA, CONDITIONS.radius_m, orders))
    wheel = MeasuredWheel("W0", GridConditions())
    wheel.add(revolution, replace(CONDITIONS, tire=TireData(half_angle_rad=half_rad)), [])
    tire = wheel.tire()
    assert abs(tire.half_angle_rad - half_rad) > 0.002
    figures, _ = measured_figures([tire], ["ring-fig-11"])
    assert "Eq. 28: 0 % of W0" in figures["ring-fig-11"](Figure())


def test_figures_of_few_revolutions_say_how_many():
    from matplotlib.figure import Figure

    revolution = make_revolution(exact_wave(solution()))
    revolution = replace(revolution, axes_mps2=np.tile(revolution.radial_mps2, (3, 1)))
    tires = []
    for count in (3, 5):
        wheel = MeasuredWheel(f"W{count}", GridConditions())
        for index in range(count):
            wheel.add(replace(revolution, index=index, follows=True), CONDITIONS, [])
        tires.append(wheel.tire())
    caption = measured_figures(tires, ["ring-fig-7"])[0]["ring-fig-7"](Figure())
    assert "over 5 revolutions, where white noise alone has 20.0 %" in caption
    with pytest.raises(ConfigError, match="no recording has four revolutions"):
        measured_figures(tires[:1], ["ring-fig-7"])
    figure = Figure()
    measured_figures(tires, ["ply-steer-fig-11"])[0]["ply-steer-fig-11"](figure)
    assert [len(axes.lines) for axes in figure.axes] == [1, 2]


def test_name_of_a_recording_is_printable(tmp_path):
    path = write_recording(tmp_path / "caf\udce9.mcap", "[motion]\nspeed_kmh = 65.0", duration_s=0.4)
    (tire,) = measured_tires([FigureSource(path)], None, lambda _: None)
    assert tire.name == "caf· W0"


def test_slope_ahead_is_a_trend_and_no_line_in_the_contact(tires):
    from matplotlib.figure import Figure

    wheels = [replace(tires[0], load_n=load, slopes_rad={"ahead": (load / 1e6, 1e-4)}) for load in LOADS_N]
    figures, _ = measured_figures(wheels, ["ply-steer-fig-13", "ply-steer-fig-15"])
    trend, lines = Figure(), Figure()
    figures["ply-steer-fig-15"](trend)
    assert "no valid slope" in figures["ply-steer-fig-13"](lines)
    points = trend.axes[0].containers[0].lines[0].get_xydata()
    assert points.tolist() == pytest.approx(np.array([(load, math.degrees(load / 1e6)) for load in LOADS_N]))


def test_forces_are_beside_the_angles_in_the_table(tires):
    with_force = replace(tires[0], side_force_n=(-36.9, 1.2))
    first, second = csv.DictReader(table_csv([with_force, tires[1]]).decode().splitlines())
    assert (float(first["side_force_n"]), float(first["side_force_n_std"])) == (-36.9, 1.2)
    assert not second["side_force_n"]


def test_unknown_figure_is_named(tires):
    for choose in (lambda names: measured_figures(tires, names), chosen):
        with pytest.raises(ConfigError) as caught:
            choose(["ring-fig-71"])
        assert "Did you mean ring-fig-7" in caught.value.remedy


def test_no_figure_at_all_is_no_result(folder, tmp_path, monkeypatch):
    nothing = ({}, {"ring-fig-11": "no value"})
    monkeypatch.setattr("gateway.papers.paper_figures.measured_figures", lambda *_: nothing)
    recording = next(folder.glob("*.mcap"))
    done = invoked("figures", "--from", recording, "--out", tmp_path / "out")
    assert done.exit_code == 1
    assert "allow no figure" in str(done.exception)
    assert (tmp_path / "out" / "conditions.csv").exists()
    assert not (tmp_path / "out" / "index.html").exists()


def test_dataset_gives_trends_without_waveforms(folder, tmp_path):
    pytest.importorskip("pyarrow")
    pytest.importorskip("psutil")
    dataset = tmp_path / "a.dataset"
    recordings = [str(folder / f"{index}.mcap") for index in range(2)]
    run("campaign", *recordings, "--out", dataset, "--jobs", "1")
    tires = measured_tires([FigureSource(dataset)], None, lambda _: None)
    assert [tire.load_n for tire in tires] == pytest.approx(LOADS_N)
    figures, missing = measured_figures(tires)
    assert {"ring-fig-14", "ring-fig-15", "ring-fig-16"} <= set(figures)
    assert missing["ply-steer-fig-15"] == "no two wheels of one pressure differ in load"
    assert {missing[name] for name in WAVEFORMS} == {"a dataset has no waveforms"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("load_n\n3\n", "no column 'recording'"),
        ("recording,laod_n\na,3\n", "a column 'laod_n'"),
        ("recording,load_n\na,-3\n", "line 2: load_n is '-3'"),
        ("recording,wear_mm\na,x\n", "line 2: wear_mm is 'x'"),
        ("recording,load_n\na,3,4\n", "line 2 does not fit"),
        ("recording,load_n\n,3\n", "line 2 does not fit"),
        ("recording\n", "has no recording"),
        (f"recording\n{'a' * 200_000}\n", "line 1: field larger"),
        ("recording;laod_n\na;3\n", "a column 'laod_n'"),
    ],
)
def test_faults_of_a_table_are_named(tmp_path, text, message):
    path = tmp_path / "grid.csv"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        read_grid(path)


@pytest.mark.parametrize("cells", ["recording,load_n\na.dataset,3000\n", "recording,wheel\na.dataset,FL\n"])
def test_table_states_nothing_of_a_dataset(tmp_path, cells):
    (tmp_path / "a.dataset").mkdir()
    path = tmp_path / "grid.csv"
    path.write_text(cells)
    with pytest.raises(ConfigError, match="line 2: .*a.dataset' is a folder"):
        read_grid(path)
    path.write_text("recording\na.dataset\n")
    assert [source.path.name for source in read_grid(path)] == ["a.dataset"]


def test_semicolons_separate_cells_too(tmp_path):
    path = tmp_path / "grid.csv"
    path.write_text("recording; wheel; load_n\na.mcap; FL; 4000\n")
    (source,) = read_grid(path)
    assert (source.path.name, source.wheel, source.stated.load_n) == ("a.mcap", "FL", 4000.0)


def test_wheel_that_is_not_there_is_named(folder):
    with pytest.raises(RecordingError, match="wheel 'FL' has no revolution"):
        measured_tires([FigureSource(folder / "0.mcap", "FL")], None, lambda _: None)
