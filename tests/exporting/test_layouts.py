"""Layouts for Foxglove and PlotJuggler name topics and fields that exist."""

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from gateway.exporting.export_table import WheelTable
from gateway.exporting.formats.mcap_file import json_schema, topic
from gateway.exporting.measured_tables import Source, measured
from gateway.recording.schemas import schema_of

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
