"""From Python as from the commands: import, export, plot, calibrate, campaign and trends."""

import json
import subprocess
import sys
from html import unescape

import numpy as np
import pytest

import gateway
import treadlink
from tests.importing.measurements import write_csv
from tests.importing.rolling_wheel import rolling
from tests.testkit.commands import program

WHEEL = rolling(9600.0, 2.0)
MAP = {
    "sampling": {"time_column": "t"},
    "axis": {name: {"column": f"a_{name}", "unit": "m/s^2"} for name in ("radial", "lateral", "circumferential")},
    "sensor": {"coupling": "DC"},
    "conditions": {"position": "FL", "load_n": 4000.0, "radius_mm": 320.0},
}


@pytest.fixture(scope="module")
def measurement(tmp_path_factory):
    axes = dict(zip(("a_circumferential", "a_lateral", "a_radial"), WHEEL.axes_mps2.T, strict=True))
    return write_csv(tmp_path_factory.mktemp("python") / "drum.csv", {"t": WHEEL.times_s, **axes})


def test_measurement_becomes_an_open_recording(measurement, tmp_path):
    recording = gateway.import_measurement(measurement, MAP, out=tmp_path / "drum.mcap")
    assert recording.wheels == ("FL",)
    assert np.abs(recording["FL"].samples().axes_mps2 - WHEEL.axes_mps2).max() < 0.1
    with pytest.raises(gateway.RecordingError, match="exists"):
        gateway.import_measurement(measurement, MAP, out=tmp_path / "drum.mcap")
    with pytest.raises(gateway.ConfigError, match="radial"):
        gateway.import_measurement(measurement, {**MAP, "axis": {}}, out=tmp_path / "other.mcap")


def test_first_map_is_text_that_can_be_used(measurement, tmp_path):
    path = tmp_path / "map.toml"
    path.write_text(gateway.guess_map(measurement), encoding="utf-8")
    assert gateway.import_measurement(measurement, path, out=tmp_path / "drum.mcap").wheels == ("W1",)


def test_export_writes_what_the_command_writes(recorded, tmp_path):
    with gateway.open(recorded) as recording:
        out = recording.export(tmp_path / "drive.npz", what="estimates", wheels=["FL"])
        assert np.load(out)
        with pytest.raises(gateway.OutputError, match="exists"):
            recording.export(out, what="estimates")
        with pytest.raises(gateway.OutputError) as caught:
            recording.export(tmp_path / "other.npz", what="estimtes")
        assert "Did you mean estimates?" in caught.value.remedy
    with pytest.raises(gateway.OutputError, match="in memory"):
        gateway.simulate("lab", duration_s=0.1).export(tmp_path / "x.csv")


def test_tables_are_drawn_with_an_axis_for_each_unit(recording):
    matplotlib = pytest.importorskip("matplotlib")
    figure = recording["FL"].revolutions().plot("speed_mps", "leading_edge_rad")
    assert isinstance(figure, matplotlib.figure.Figure)
    assert [axis.get_ylabel() for axis in figure.axes] == ["m/s", "rad"]
    # The edge has the band of its error, the speed has none.
    assert [len(axis.collections) for axis in figure.axes] == [0, 1]
    average = recording["FL"].average().plot()
    assert {line.get_label() for line in average.axes[0].lines} >= {"radial_mps2", "lateral_mps2"}
    assert average.axes[0].get_xlabel() == "angle_rad (rad)"
    with pytest.raises(KeyError, match="no column 'x'"):
        recording["FL"].revolutions().plot("x")


def test_waveforms_are_an_array_with_named_axes(recording):
    pytest.importorskip("xarray")
    table = recording["FL"].angle()
    array = table.to_xarray()
    assert dict(array.sizes) == {"revolution": len(table), "axis": 4, "angle_rad": len(table.angle_rad)}
    np.testing.assert_array_equal(array.sel(axis="radial"), table.radial_mps2)
    np.testing.assert_array_equal(array.usable, table.usable)
    assert (array.attrs["units"], array.attrs["wheel"], array.omega_radps.attrs["units"]) == ("m/s^2", "FL", "rad/s")


def test_estimates_are_drawn_by_wheel_without_invalid_ones(recording):
    pytest.importorskip("matplotlib")
    estimates = recording.estimates()
    figure = estimates.plot("speed_mps", "Bs")
    assert [axis.get_ylabel() for axis in figure.axes] == ["m/s", estimates.select("Bs").unit[0] or "1"]
    assert {line.get_label() for line in figure.axes[0].lines} == {"FL speed_mps", "FR speed_mps"}
    drawn = next(line for line in figure.axes[1].lines if line.get_label() == "FL Bs")
    rows = estimates.select("Bs", wheel="FL")
    assert len(drawn.get_xdata()) == int(np.count_nonzero(rows.status != "invalid"))
    with pytest.raises(KeyError, match=r"Did you mean speed_mps\?"):
        estimates.plot("sped_mps")
    with pytest.raises(ValueError, match=r"Did you mean valid\?"):
        estimates.select(status="vaild")


def test_calibration_is_that_of_the_command(tmp_path):
    paths = []
    for load_n in (3000, 3800, 4600, 5400):
        scenario = {
            "motion": {"speed_kmh": 80},
            "wheel": [{"position": "W1", "wheel": 0, "load_n": load_n}],
            "scenario": {"seed": load_n},
        }
        paths.append(tmp_path / f"{load_n}.mcap")
        gateway.simulate(scenario, duration_s=4.0, out=paths[-1])
    result = gateway.calibrate(paths)
    assert [point.load_n for point in result.points] == [3000.0, 3800.0, 4600.0, 5400.0]
    result.save(tmp_path / "tables.toml")
    done = program("calibrate", *paths, "--out", "-")
    assert done.status == 0
    assert (tmp_path / "tables.toml").read_text("utf-8") == done.stdout
    assert "[tire.load_calibration]" in result.toml
    assert str(result) in done.stderr
    reasons: list[str] = []
    with pytest.raises(gateway.Error, match="no wheel"):
        gateway.calibrate(paths[:1], wheels=["FL"], on_left_out=reasons.append)
    assert reasons == ["3000.mcap FL: no revolution of this wheel; wheels with revolutions: W1"]


def test_campaign_and_trends(recorded, tmp_path):
    pytest.importorskip("dask")
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(b"no recording")
    result = gateway.campaign([recorded, broken], tmp_path / "fleet.dataset")
    assert (result.estimated, result.done_before) == (1, 0)
    assert [path for path, _ in result.failures] == [broken]
    trends = result.trends()
    assert {tire["position"] for tire in trends.to_dict()["tires"]} == {"FL", "FR"}
    trends.save(tmp_path / "trends.json")
    assert json.loads((tmp_path / "trends.json").read_text("utf-8")) == trends.to_dict()
    assert unescape(gateway.tire_trends(tmp_path / "fleet.dataset")._repr_html_()) == f"<pre>{trends}</pre>"
    with pytest.raises(ValueError, match=r"\.html, \.json or \.csv"):
        trends.save(tmp_path / "trends.txt")


def test_project_name_gives_the_same_interface():
    assert set(gateway.names()) <= set(dir(treadlink))
    for name in gateway.names():
        assert getattr(treadlink, name) is getattr(gateway, name)
    assert treadlink.__version__ == gateway.__version__
    with pytest.raises(AttributeError, match="'treadlink' has no attribute 'opne'"):
        _ = treadlink.opne
    code = "import sys; before = set(sys.modules); import treadlink; print(sorted(set(sys.modules) - before))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['gateway', 'treadlink']"
