"""Export formats, read back by other programs, and layouts that name topics and fields that exist."""

import csv
import json
import math
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from mcap.reader import make_reader

from gateway.core.recording.schemas import schema_of
from gateway.exporting import measured_tables
from gateway.exporting.export_table import WheelTable
from gateway.exporting.formats.mat_file import identifiers
from gateway.exporting.formats.mcap_file import json_schema, topic
from gateway.exporting.formats.tydex_file import NOT_AVAILABLE, channel_keys
from gateway.exporting.measured_tables import Source, measured

NUMBERS = ("circumferential_mps2", "lateral_mps2", "radial_mps2", "device_s")
WHOLE = ("host_ns", "number", "saturated")


def check_samples(read, truth):
    for wheel, columns in truth.items():
        for name in (*NUMBERS, *WHOLE):
            np.testing.assert_array_equal(np.asarray(read[wheel][name]), columns[name], err_msg=name)


def by_wheel(frame):
    return dict(list(frame.groupby("wheel")))


def test_csv_of_samples_reads_in_pandas(export, truth):
    pandas = pytest.importorskip("pandas")
    frame = pandas.read_csv(export("csv", "samples"), comment="#")
    check_samples(by_wheel(frame), truth)


def test_csv_of_samples_reads_in_polars(export, truth):
    polars = pytest.importorskip("polars")
    frame = polars.read_csv(export("csv", "samples"), comment_prefix="#", infer_schema_length=None)
    selected = {wheel: frame.filter(polars.col("wheel") == wheel) for wheel in truth}
    read = {wheel: {name: item[name].to_numpy() for name in item.columns} for wheel, item in selected.items()}
    read["W1"]["lateral_mps2"] = read["W1"]["lateral_mps2"].astype(float)
    check_samples(read, truth)


def test_csv_comments_state_units_and_conditions(export):
    lines = export("csv", "samples").read_text("utf-8").splitlines()
    comments = [line for line in lines if line.startswith("#")]
    assert "# column radial_mps2 [m/s^2]: specific force toward the wheel centre" in comments
    assert "# W0 load_n: 4200.0 N (configuration recorded with it)" in comments
    assert "# W1 axes: circumferential, radial" in comments
    header, first = list(csv.reader(lines[len(comments) :]))[:2]
    assert header[:2] == ["wheel", "time_s"]
    assert first[0] == "W0"


def test_csv_runs_no_formula_of_a_hostile_name(export, recorded, tmp_path):
    evil = tmp_path / "=cmd|x, #1.mcap"
    evil.write_bytes(recorded.read_bytes())
    rows = [
        line
        for line in export("csv", "estimates", recording=evil).read_text("utf-8").splitlines()
        if not line.startswith("#")
    ]
    cells = {row["recording"] for row in csv.DictReader(rows)}
    assert cells == {"'=cmd|x, #1.mcap"}


def test_parquet_of_samples_reads_in_pyarrow(export, truth):
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(export("parquet", "samples"))
    check_samples(by_wheel(table.to_pandas()), truth)
    assert table.schema.field("radial_mps2").metadata[b"unit"] == b"m/s^2"
    conditions = json.loads(table.schema.metadata[b"treadlink.conditions"])
    assert conditions["W0"]["load_n"] == {"value": 4200.0, "unit": "N", "source": "configuration recorded with it"}
    assert conditions["W1"]["sensor_id"]["value"] == "0000b001"


def test_parquet_of_samples_reads_in_duckdb(export, truth):
    duckdb = pytest.importorskip("duckdb")
    path = export("parquet", "samples", name="out.parquet")
    rows = duckdb.sql(f"select wheel, sum(radial_mps2), count(lateral_mps2) from '{path}' group by wheel").fetchall()
    results = {wheel: (total, count) for wheel, total, count in rows}
    assert results["W0"] == (pytest.approx(truth["W0"]["radial_mps2"].sum(), rel=1e-12), len(truth["W0"]["number"]))
    assert results["W1"][1] == 0  # an axis that the sensor lacks is null


def test_npz_of_samples_reads_in_numpy(export, truth):
    with np.load(export("npz", "samples"), allow_pickle=False) as archive:
        read = {wheel: {name: archive[f"{wheel}/{name}"] for name in (*NUMBERS, *WHOLE)} for wheel in truth}
        about = json.loads(str(archive["about"]))
    check_samples(read, truth)
    assert about["columns"]["radial_mps2"]["unit"] == "m/s^2"
    assert about["conditions"]["W0"]["load_n"]["value"] == 4200.0


def test_npz_of_estimates_keeps_every_text(export, results):
    with np.load(export("npz", "estimates"), allow_pickle=False) as archive:
        statuses, reasons = archive["W0/Bs_status"].tolist(), archive["W0/Bs_reason"].tolist()
    selected = [result for result in results if result.position == "W0"]
    estimates = [next(estimate for estimate in result.estimates if estimate.name == "Bs") for result in selected]
    assert statuses == [str(estimate.status) for estimate in estimates]
    assert any(len(reason) > 20 for reason in reasons)


def test_mat_of_samples_reads_in_scipy(export, truth):
    read = scipy.io.loadmat(export("mat", "samples"), simplify_cells=True, mat_dtype=True)
    check_samples({wheel: read[wheel]["Data"] for wheel in truth}, truth)
    np.testing.assert_array_equal(np.diff(read["W0"]["Time"]) > 0, True)
    assert read["W0"]["Units"]["radial_mps2"] == "m/s^2"
    assert read["W0"]["Conditions"]["load_n"] == 4200.0
    assert read["W0"]["Conditions"]["start_ns"] == 1_700_000_000_000_000_000
    assert read["W0"]["Sources"]["load_n"] == "configuration recorded with it"
    assert read["W0"]["Data"]["saturated"].dtype == bool


def test_mat_of_estimates_keeps_texts_as_cells(export, results):
    read = scipy.io.loadmat(export("mat", "estimates"), simplify_cells=True)["W0"]["Data"]
    selected = [result for result in results if result.position == "W0"]
    estimates = [next(estimate for estimate in result.estimates if estimate.name == "Bs/Cw") for result in selected]
    np.testing.assert_array_equal(read["Bs_over_Cw"], [estimate.value for estimate in estimates])
    assert [str(text) for text in read["Bs_over_Cw_status"]] == [str(estimate.status) for estimate in estimates]


def test_mat_states_the_length_of_names_as_octave_reads_it(export):
    # Type and size of the element in one word; Octave skips no padding after a long one.
    assert b"\x05\x00\x04\x00\x40\x00\x00\x00" in export("mat", "average").read_bytes()


def test_mat_names_are_valid_and_distinct():
    long = "a" * 80
    names = identifiers(["hub0.wheel2", "hub0_wheel2", "4x", "ring-paper:Bs", long, long + "b", "é"])
    assert list(names.values())[:4] == ["hub0_wheel2", "hub0_wheel2_2", "x4x", "ring_paper_Bs"]
    assert len(set(names.values())) == len(names)
    assert all(len(name) <= 63 and name.isascii() and name.isidentifier() for name in names.values())


def test_mf4_of_samples_reads_in_asammdf(export, truth):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(export("mf4", "samples", name="out.mf4")) as mdf:
        read = {}
        for wheel in truth:
            read[wheel] = {name: mdf.get(f"{wheel}.{name}").samples for name in (*NUMBERS, *WHOLE)}
        radial = mdf.get("W0.radial_mps2")
        comment = mdf.groups[0].channel_group.comment
        start = mdf.header.start_time
    check_samples(read, truth)
    assert (radial.unit, radial.comment) == ("m/s^2", "specific force toward the wheel centre")
    assert (radial.timestamps[1:] > radial.timestamps[:-1]).all()
    assert '<e name="load_n" desc="configuration recorded with it" unit="N">4200.0</e>' in comment
    assert start.timestamp() == pytest.approx(1_700_000_000, abs=1.0)


def test_mf4_of_average_has_angle_as_master(export):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(export("mf4", "average", name="out.mf4")) as mdf:
        curve = mdf.get("W0.normalised_mps2")
    assert curve.master_metadata == ("W0.angle_rad", 2)
    assert curve.timestamps[0] == -math.pi
    assert len(curve.timestamps) == 1024


def test_mcap_of_samples_and_estimates_reads_in_mcap(export, truth, results, monkeypatch):
    # Results are looked at before the samples are read.
    monkeypatch.setattr(measured_tables, "_LOOKED_AT", 2)
    path = export("mcap", "samples", "estimates")
    read = {"W0": [], "W1": []}
    speeds = []
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for _, channel, message in reader.iter_messages():
            row = json.loads(message.data)
            if channel.topic == "/wheel/W0/revolution":
                speeds.append(row["speed_mps"])
            elif channel.topic.endswith("/samples"):
                read[channel.topic.split("/")[2]].append((message.log_time, row))
        conditions = [record.metadata for record in reader.iter_metadata()]
    for wheel, rows in read.items():
        assert [time for time, _ in rows] == truth[wheel]["host_ns"].tolist()
        radial = [row["radial_mps2"] for _, row in rows]
        np.testing.assert_allclose(radial, truth[wheel]["radial_mps2"], rtol=1e-8)
    assert "lateral_mps2" not in read["W1"][0][1]
    selected = [result.estimates[0].value for result in results if result.position == "W0"]
    np.testing.assert_allclose(speeds, selected, rtol=1e-8)
    assert json.loads(conditions[0]["load_n"])["value"] == 4200.0


def parsed_tydex(text):
    """Return header, constants, channels and data of a TYDEX file, by the columns of its manual."""
    parts, part = {}, ""
    for line in text.splitlines():
        if line.startswith("**"):
            part = line[2:]
        elif line:
            parts.setdefault(part, []).append(line)
    head = {line[:10].strip(): line[50:] for line in parts["HEADER"]}
    constants = {line[:10].strip(): (line[40:50].strip(), line[50:]) for line in parts["CONSTANTS"]}
    channels = [line[:10].strip() for line in parts["MEASURCHANNELS"]]
    factors = [tuple(map(float, (line[50:60], line[60:70], line[70:]))) for line in parts["MEASURCHANNELS"]]
    data = [
        [math.nan if cell == NOT_AVAILABLE else float(cell) for cell in line.split()] for line in parts["MEASURDATA"]
    ]
    return head, constants, channels, factors, np.array(data)


def test_tydex_of_estimates_follows_the_columns_of_the_manual(export, results):
    text = export("tydex", "estimates", wheels=["W0"]).read_bytes().decode("ascii")
    head, constants, channels, factors, data = parsed_tydex(text)
    selected = [result for result in results if result.position == "W0"]
    assert head["RELEASE"] == "1.3"
    assert head["DATE"] == "14.11.2023"
    assert constants["FZW"] == ("N", "4200.0")
    assert set(factors) == {(1.0, 0.0, 0.0)}
    assert data.shape == (len(selected), len(channels))
    assert all(key.isalnum() and key == key.upper() and len(key) <= 8 for key in channels)
    np.testing.assert_array_equal(data[:, channels.index("MEASNUMB")], [item.revolution.index for item in selected])
    np.testing.assert_array_equal(data[:, channels.index("LONGVEL")], [item.estimates[0].value for item in selected])
    assert f"channel {channels[channels.index('LONGVEL')]}: speed_mps" in text
    assert "left out: Bs_status" in text


def test_tydex_keys_are_short_and_distinct():
    keys = channel_keys(["time_s", "speed_mps", "radial_mps2", "radial_mps2_x", "ring-paper:Bs"])
    assert list(keys.values()) == ["RUNTIME", "LONGVEL", "RADIALMP", "RADIALM2", "RINGPAPE"]


@pytest.mark.parametrize("content", ["angle", "orders", "average"])
def test_contents_in_angle_agree_with_the_revolutions(export, results, content):
    with np.load(export("npz", content), allow_pickle=False) as archive:
        read = {name.removeprefix("W0/"): archive[name] for name in archive.files if name.startswith("W0/")}
    selected = [result.revolution for result in results if result.position == "W0"]
    if content == "angle":
        turned = np.concatenate([np.roll(item.radial_mps2, -512) for item in selected])
        np.testing.assert_array_equal(read["normalised_mps2"], turned)
        np.testing.assert_allclose(read["angle_rad"][[0, 512]], [0.0, -math.pi])
        assert (np.diff(read["time_s"].reshape(len(selected), -1), axis=1) > 0.0).all()
    elif content == "orders":
        actual = read["order_07_cosine_mps2"] - 1j * read["order_07_sine_mps2"]
        np.testing.assert_array_equal(actual, [item.orders_mps2[7] for item in selected])
    else:
        usable = np.array([item.radial_mps2 / item.omega_radps**2 for item in selected if not item.faults])
        mean = usable.mean(axis=0) * read["omega_radps"] ** 2
        np.testing.assert_allclose(read["normalised_mps2"], mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(read["revolutions"], len(usable))


LAYOUTS = Path(__file__).parents[2] / "examples/layouts"
ESTIMATORS = ("kinematic", "weak-form", "wear", "ply-steer")


@pytest.fixture(scope="module")
def exported():
    """Fields of each topic of an exported file."""
    source = Source(lambda: iter(()), lambda _: iter(()), "x.mcap", 0, ESTIMATORS)
    fields = {}
    for content in (measured("samples", source), measured("estimates", source)):
        for wheel in ("FL", "FR", "RL", "RR"):
            table = WheelTable(content.what, wheel, content.columns)
            fields[topic(table)] = json_schema(table)["properties"]
    return fields


def recorded(name):
    try:
        return schema_of(name).schema["properties"]
    except ValueError:
        return {}


def foxglove_fields():
    layout = json.loads((LAYOUTS / "foxglove.json").read_text("utf-8"))
    for panel in layout["configById"].values():
        paths = [*panel.get("paths", ()), *([panel["xAxisPath"]] if "xAxisPath" in panel else ())]
        for path in paths:
            result = re.fullmatch(r"(/[^.]+)\.(\w+)(\[:\])?", path["value"])
            assert result is not None, path
            yield result[1], result[2]


def plotjuggler_fields():
    root = ElementTree.parse(LAYOUTS / "plotjuggler.xml").getroot()
    for curve in root.iter("curve"):
        yield tuple(curve.attrib["name"].rsplit("/", 1))


@pytest.mark.parametrize("fields", [foxglove_fields, plotjuggler_fields])
def test_every_field_of_a_layout_exists(exported, fields):
    named = list(fields())
    assert len(named) > 20
    for name, field in named:
        places = [schema for schema in (exported.get(name, {}), recorded(name)) if schema]
        assert places, name
        assert all(field in schema for schema in places), (name, field)


def test_every_panel_of_the_foxglove_layout_is_placed():
    layout = json.loads((LAYOUTS / "foxglove.json").read_text("utf-8"))
    placed = re.findall(r'"(\w+!\w+)"', json.dumps(layout["layout"]))
    assert sorted(placed) == sorted(layout["configById"])


def test_splitters_of_the_plotjuggler_layout_count_their_plots():
    root = ElementTree.parse(LAYOUTS / "plotjuggler.xml").getroot()
    splitters = list(root.iter("DockSplitter"))
    assert len(splitters) == 3
    for splitter in splitters:
        sizes = [float(size) for size in splitter.attrib["sizes"].split(";")]
        assert len(splitter) == int(splitter.attrib["count"]) == len(sizes)
        assert sum(sizes) == pytest.approx(1.0, abs=1e-3)
