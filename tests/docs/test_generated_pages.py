"""Generated references name every command, configuration key, effect and reason."""

import ast
import re
import typing
from collections.abc import Iterator

import click
import pytest
from pydantic import BaseModel

from gateway.core.cli import treadlink
from gateway.core.quantity import Quantity
from gateway.core.quantity_catalogue import declared
from gateway.core.table_columns import typeset_unit
from gateway.core.text.wording import fields
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.views.effect_catalogue import effects_markdown
from gateway.planner.accelerometer import shipped_accelerometers
from tests.test_import_rules import dotted, modules
from tools.docs_site.accelerometer_pages import accelerometers_markdown
from tools.docs_site.api_pages import NOT_IN_API, PACKAGES
from tools.docs_site.command_pages import commands_markdown
from tools.docs_site.configuration_pages import DOCUMENTS, configuration_markdown
from tools.docs_site.markdown import escaped
from tools.docs_site.quantity_pages import quantities_markdown
from tools.docs_site.reason_pages import reasons_markdown
from tools.docs_site.staging import generated_pages
from tools.reason_codes import all_codes


def commands(command: click.Command, path: str) -> Iterator[tuple[str, click.Command]]:
    yield path, command
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            assert inner is not None
            yield from commands(inner, f"{path} {name}")


def tables(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    yield model
    for field in model.model_fields.values():
        for part in (field.annotation, *typing.get_args(field.annotation)):
            if isinstance(part, type) and issubclass(part, BaseModel):
                yield from tables(part)


def test_every_command_and_option_is_listed():
    page = commands_markdown()
    for path, command in commands(treadlink, "treadlink"):
        assert path == "treadlink" or f"# {path}\n" in page
        for parameter in command.params:
            if isinstance(parameter, click.Option) and not parameter.hidden:
                assert parameter.opts[0] in page


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda document: document[0])
def test_every_configuration_key_is_explained(document):
    title, top, _ = document
    page = configuration_markdown().partition(f"\n## {title}\n")[2].partition("\n## ")[0]
    rows = [line for line in page.splitlines() if line.startswith("| `")]
    for model in tables(top):
        inner = {name for name, field in model.model_fields.items() if list(models_in(field.annotation))}
        for name in set(model.model_fields) - inner:
            assert any(row.startswith(f"| `{name}` |") for row in rows), name
            assert model.model_fields[name].description, f"{model.__name__}.{name} has no description"


def models_in(annotation: object) -> Iterator[type[BaseModel]]:
    for part in (annotation, *typing.get_args(annotation)):
        if isinstance(part, type) and issubclass(part, BaseModel):
            yield part


def test_every_accelerometer_is_listed_with_what_it_can_do():
    page = accelerometers_markdown()
    for part in shipped_accelerometers().sensor:
        ability, sheet = (line for line in page.splitlines() if line.startswith(f"| {escaped(part.name)} |"))
        assert ability.count("yes") + ability.count("no:") == 3
        assert escaped(part.source) in sheet
    assert "| ADXL1004 | 108 | 116 | 129 | no: missing | no: missing | no: range, missing |" in page


def test_every_effect_is_listed():
    page = effects_markdown()
    assert [effect.name for effect in catalogue().values() if effect.name not in page] == []


def test_every_quantity_is_listed_with_its_unit_equation_and_sign():
    page = quantities_markdown()
    for quantity in declared():
        assert quantity.equation, quantity.name
        assert quantity.sign or quantity.possible[0] >= 0.0, quantity.name
        (row,) = (line for line in page.splitlines() if line.startswith(f"| `{quantity.name}` | {unit(quantity)} |"))
        assert f" | {escaped(quantity.equation)} | {quantity.sign} | " in row


def unit(quantity: Quantity) -> str:
    return typeset_unit(quantity.name) or "1"


def test_every_reason_is_listed_with_its_values():
    page = reasons_markdown()
    for reason in all_codes():
        row = next(line for line in page.splitlines() if line.startswith(f"| `{reason}` |"))
        assert all(f"`{name}`" in row for name in fields(reason))


def test_every_room_has_an_api_page():
    packages = {name.rpartition(".")[0] for name in map(dotted, (name for name, _ in modules()))}
    rooms = {".".join(name.split(".")[: 3 if name.startswith("gateway.core.") else 2]) for name in packages}
    assert set(PACKAGES) == rooms - NOT_IN_API - {""} | {"firmware_protocol"}
    assert {f"reference/api/{name.replace('.', '-')}.md" for name in PACKAGES} < set(generated_pages())


def test_docstrings_hold_no_accidental_cross_references():
    """`[a] [b]` is a link to b in Markdown: formulas with brackets are code."""
    results = []
    for name, path in modules():
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                text = re.sub(r"`[^`]*`|^ {4,}.*$", "", ast.get_docstring(node) or "", flags=re.MULTILINE)
                results += [f"{name}: {link}" for link in re.findall(r"\] ?\[[^\[\]]+\]", text)]
    assert results == []
