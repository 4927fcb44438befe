"""Listing of the effect catalogue: every effect with its equation, units, ranges and confounders."""

import json
import re

import pytest

from gateway.core.constants import AXIS_NAMES
from gateway.core.text.text import width
from gateway.diagnosis.effects.catalogue import catalogue, group_of
from gateway.diagnosis.views.effect_catalogue import effect_lines, effects_json, effects_markdown, find_effects
from gateway.diagnosis.views.quantities import typeset

PAGE = effects_markdown()
SECTION = re.compile(r"^### [^\n]*\n\n`(?P<name>[^`]+)`: (?P<body>.*?)(?=^#{2,3} |\Z)", re.M | re.S)
SECTIONS = {result["name"]: result["body"] for result in SECTION.finditer(PAGE)}


def words(text: str) -> str:
    """Return a text with Markdown escapes and line breaks removed."""
    return " ".join(re.sub(r"\\(.)", r"\1", text).split())


def test_page_has_a_section_for_every_effect() -> None:
    assert set(SECTIONS) == set(catalogue())
    headings = re.findall(r"^#{1,3} (.*)$", PAGE, re.M)
    assert len(set(headings)) == len(headings)


@pytest.mark.parametrize("name", catalogue())
def test_section_has_equation_ranges_and_confounders(name: str) -> None:
    effect, body = catalogue()[name], words(SECTIONS[name])
    assert words(typeset(effect.summary)) in body
    assert words(typeset(effect.equation)) in body
    assert words(typeset(effect.source)) in body
    assert all(AXIS_NAMES[axis] in body for axis in effect.axes)
    ranges = re.findall(r"^\| [^|\n]+ \| ([^|\n]*(?: to |or more)[^|\n]*) \|$", SECTIONS[name], re.M)
    assert len(ranges) == len(effect.parameters)
    for confounder in effect.confounders:
        for other in confounder.names:
            title = catalogue()[other].display_title if other in catalogue() else typeset(other)
            assert title in body
        assert words(typeset(confounder.distinction)) in body


def test_every_link_leads_to_a_heading() -> None:
    slugs = {re.sub(r"\W+", "-", re.sub(r"[^\w\s-]", "", h)).lower() for h in re.findall(r"^### (.*)$", PAGE, re.M)}
    links = set(re.findall(r"\]\(#([^)]*)\)", PAGE))
    assert links
    assert links <= slugs


def test_parameters_are_in_the_units_of_reports() -> None:
    assert "| offset | -30 to 40 mm |" in SECTIONS["mounting offset"]
    assert "| limit | 10.2 g or more |" in SECTIONS["clipping"]
    assert "| corner | 150 Hz or more |" in SECTIONS["anti-alias filter"]
    assert "| P2 | -1.3 to 0.5 |" in SECTIONS["pressure shape"]


def test_terms_of_the_field_are_display_titles() -> None:
    assert catalogue()["contact edge scatter"].display_title == "contact-edge jitter"
    assert catalogue()["speed drift"].display_title == "angular acceleration"
    assert "### Contact-edge jitter\n\n`contact edge scatter`" in PAGE
    assert "  angular acceleration (key: speed drift)" in list(effect_lines(find_effects("angular"), 80))


@pytest.mark.parametrize("columns", [60, 80, 120])
def test_lines_fit_the_terminal(columns: int) -> None:
    lines = list(effect_lines(find_effects(), columns))
    assert max(map(width, lines)) <= columns
    assert [line for line in lines if line.isupper() and not line.startswith(" ")] == [
        group.upper() for group in dict.fromkeys(group_of(effect) for effect in catalogue().values())
    ]


def test_effects_are_found_by_partial_key_or_title() -> None:
    assert [effect.name for effect in find_effects("TILT")] == ["yaw tilt", "roll tilt", "pitch tilt"]
    assert [effect.name for effect in find_effects("wheel hop")] == ["hub vibration"]
    assert [effect.name for effect in find_effects("nail")] == ["local tread height"]
    assert [effect.name for effect in find_effects("Splice")] == ["local bending stiffness"]
    assert find_effects("nonsense") == []


def test_json_has_every_effect_with_values() -> None:
    entries = {entry["name"]: entry for entry in json.loads(json.dumps(effects_json(find_effects())))}
    assert set(entries) == set(catalogue())
    yaw = entries["yaw tilt"]
    assert yaw["group"] == "mounting"
    assert yaw["kind"] == "signal"
    assert yaw["axes"] == ["circumferential", "lateral"]
    assert yaw["baseline_models"] == ["paper", "exact"]
    (parameter,) = yaw["parameters"]
    assert (parameter["unit"], parameter["low"], parameter["high"]) == ("rad", -0.35, 0.35)
    assert parameter["range"] == "-20.1 to 20.1 deg"
    (confounder,) = yaw["confounders"]
    assert confounder["names"] == ["ply steer"]
    assert confounder["similarity"] == "0.97"
