"""Tables survive pandas, Arrow and Parquet with values, units and conditions."""

import json
import sys

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gateway
from gateway.api.column_table import METADATA_KEY, unit_of
from gateway.api.estimate_tables import Alarms, EstimateRows
from gateway.api.signal_tables import AngleWaveforms, AverageWaveform, Environment, OrderSpectra, Revolutions, Samples
from gateway.core.estimates.results import AlarmRecord
from gateway.core.links.reasons import LinkCode
from gateway.core.reasons import Reason

TABLES = ("samples", "environment", "revolutions", "angle", "average", "orders")


@pytest.fixture(scope="module", params=TABLES)
def table(request, recording):
    return getattr(recording["FL"], request.param)()


def empty_tables():
    wheel = {"recording": "none.mcap", "wheel": "FL"}
    return [
        Samples.of([], **wheel, start_s=0.0, stop_s=1.0),
        Environment.of([], **wheel),
        Revolutions.of([], **wheel, has_host_time=True),
        AngleWaveforms.of([], **wheel),
        OrderSpectra.of([], **wheel, axis="radial"),
        EstimateRows(has_host_time=True).table("none.mcap"),
        Alarms.of([], recording="none.mcap"),
    ]


def test_every_column_with_a_unit_states_it(table):
    for name, unit in table.units.items():
        assert unit == unit_of(name)
        assert table.descriptions[name]
        assert len(table[name]) == len(table)
    assert table.units["device_s" if "device_s" in table.columns else table.columns[0]] in ("s", "rad", "")


def test_unit_is_the_suffix_of_the_name():
    units = {
        "radial_mps2": "m/s^2",
        "speed_mps": "m/s",
        "load_n": "N",
        "wear_mm": "mm",
        "Bs": "",
        "gain_per_degc": "1/K",
    }
    assert {name: unit_of(name) for name in units} == units


def test_arrow_round_trip_keeps_values_and_units(table, tmp_path):
    path = tmp_path / "table.parquet"
    pq.write_table(table.to_arrow(), path)
    back = pq.read_table(path)
    assert back.column_names == list(table.columns)
    for name in table.columns:
        field = back.schema.field(name)
        assert field.metadata[b"unit"].decode() == table.units[name]
        assert field.metadata[b"description"].decode() == table.descriptions[name]
        expected = table[name]
        if expected.dtype.kind == "M":
            expected = expected.astype(np.int64)
            result = back[name].cast(pa.int64()).to_numpy()
        elif expected.dtype.kind == "c":
            flat = np.array(back[name].to_pylist())
            result = flat[..., 0] + 1j * flat[..., 1]
        elif expected.ndim > 1:
            result = np.array(back[name].to_pylist())
        else:
            result = back[name].to_numpy(zero_copy_only=False)
        np.testing.assert_array_equal(result, expected)
    assert json.loads(back.schema.metadata[METADATA_KEY])["wheel"] == "FL"


@pytest.mark.parametrize("name", ["samples", "environment", "revolutions", "average"])
def test_pandas_round_trip_keeps_values_and_units(recording, name, tmp_path):
    table = getattr(recording["FL"], name)()
    frame = table.to_pandas()
    frame.to_parquet(tmp_path / "frame.parquet")
    back = pd.read_parquet(tmp_path / "frame.parquet")
    assert back.attrs["units"] == table.units
    assert back.attrs["wheel"] == "FL"
    pd.testing.assert_frame_equal(back, frame)
    for column in table.columns:
        if table[column].dtype.kind == "M":
            np.testing.assert_array_equal(frame[column].dt.tz_localize(None).to_numpy(), table[column])
        else:
            np.testing.assert_array_equal(frame[column].to_numpy(), table[column])


def test_waveforms_become_frames_over_angle(recording):
    angle = recording["FL"].angle()
    frame = angle.to_pandas("lateral")
    assert frame.shape == angle.lateral_mps2.shape
    assert frame.columns.name == "angle_rad"
    assert frame.index.tolist() == angle.revolution.tolist()
    assert frame.attrs["unit"] == "m/s^2"
    with pytest.raises(ValueError, match="no axis 'up'"):
        angle.to_pandas("up")


def test_orders_become_frames_over_order(recording):
    orders = recording["FL"].orders()
    frame = orders.to_pandas()
    assert frame.columns.tolist() == list(range(61))
    np.testing.assert_allclose(frame[3].abs(), orders.amplitude_mps2[:, 3])


def test_estimates_become_long_and_wide_frames(recording):
    table = recording.estimates()
    long = table.to_pandas()
    assert len(long) == len(table)
    assert long["status"].dtype == "category"
    assert long.attrs["units"]["device_start_s"] == "s"
    wide = table.to_pandas(wide=True)
    assert len(wide) == sum(len(recording[wheel].revolutions()) for wheel in recording)
    for wheel in recording:
        selected = wide[wide["wheel"] == wheel]
        np.testing.assert_array_equal(selected["speed_mps"], table.select("speed_mps", wheel=wheel).value)
        np.testing.assert_array_equal(selected["Bs/Cw_std"], table.select("Bs/Cw", wheel=wheel).std)
        assert selected["Cw_status"].tolist() == table.select("Cw", wheel=wheel).status.tolist()
    assert wide.attrs["units"]["speed_mps_std"] == "m/s"
    assert wide["host_utc"].dt.tz is not None


def test_estimates_keep_their_units_in_arrow(recording):
    arrow = recording.estimates().to_arrow()
    loads = arrow.filter(pa.compute.equal(arrow["name"], "speed_mps"))
    assert set(loads["unit"].to_pylist()) == {"m/s"}
    assert json.loads(arrow.schema.metadata[METADATA_KEY]) == {"recording": "drive.mcap"}


@pytest.mark.parametrize("table", empty_tables(), ids=lambda table: type(table).__name__)
def test_empty_table_converts_and_shows(table):
    assert len(table) == 0
    assert type(table).__name__ in repr(table)
    assert table._repr_html_()
    assert len(table.to_pandas()) == 0
    assert table.to_arrow().num_rows == 0


def test_average_of_nothing_is_none():
    assert AverageWaveform.of([], recording="none.mcap", wheel="FL") is None


def test_alarms_have_words_and_times():
    reason = Reason(LinkCode.LINK_DISCONNECTED)
    record = AlarmRecord("<b>FL", "link", reason, count=2, total_s=3.5, first_s=1.0, last_s=6.0, is_standing=True)
    table = Alarms.of([record], recording="drive.mcap")
    assert table.total_s.tolist() == [3.5]
    assert table.standing.tolist() == [True]
    assert table.to_pandas()["subject"].tolist() == ["<b>FL"]
    assert "<b>FL" not in table._repr_html_()


def test_unknown_column_names_the_known_ones(recording):
    with pytest.raises(KeyError, match="the columns are device_s, host_utc, pressure_pa"):
        recording["FL"].environment()["speed"]


@pytest.mark.parametrize(("package", "extra"), [("pandas", "pandas"), ("pyarrow", "parquet")])
def test_missing_package_names_the_extra(recording, monkeypatch, package, extra):
    monkeypatch.setitem(sys.modules, package, None)
    convert = {"pandas": "to_pandas", "pyarrow": "to_arrow"}[package]
    with pytest.raises(gateway.OutputError, match=package) as raised:
        getattr(recording["FL"].environment(), convert)()
    assert f"treadlink[{extra}]" in raised.value.remedy


def test_text_without_a_row_is_text_in_arrow():
    table = Alarms.of([], recording="r.mcap").to_arrow()
    assert [str(table.schema.field(name).type) for name in ("subject", "name", "reason")] == ["string"] * 3
