"""Reason codes: each is declared once, in the room that gives it, and stays the same object in copies."""

import copy
import pickle
import re
from collections import Counter
from pathlib import Path

import pytest

from gateway.core.reasons import Code, Codes
from gateway.diagnosis.reasons import DiagnosisCode
from tools import rooms
from tools.reason_codes import all_codes, rooms_of_codes

ROOT = Path(__file__).parents[2]


class ScaleCode(Codes):
    """Reasons of a package of others."""

    TOO_HEAVY = Code("{load_n:.0f N} is too heavy")
    TOO_LIGHT = Code("too light")


class Scale:
    """Uses a code as the default of an attribute, which does not name it again."""

    worst = ScaleCode.TOO_HEAVY


def test_codes_are_named_where_they_are_declared() -> None:
    assert ScaleCode.members() == (ScaleCode.TOO_HEAVY, ScaleCode.TOO_LIGHT)
    assert [str(code) for code in ScaleCode.members()] == ["too_heavy", "too_light"]
    assert ScaleCode.TOO_HEAVY < ScaleCode.TOO_LIGHT
    assert repr(Scale.worst) == "<ScaleCode.TOO_HEAVY>"


@pytest.mark.parametrize("code", [ScaleCode.TOO_LIGHT, DiagnosisCode.ONE_SPEED])
def test_codes_are_the_same_in_copies_and_other_processes(code: Code) -> None:
    assert pickle.loads(pickle.dumps(code)) is code
    assert copy.deepcopy({code: [code]}) == {code: [code]}


def test_each_code_is_declared_once() -> None:
    assert [name for name, count in Counter(map(str, all_codes())).items() if count > 1] == []


def test_each_room_uses_its_codes_and_the_core_those_of_no_feature() -> None:
    """A code that only another room uses belongs there."""
    users: dict[str, set[str]] = {}
    for module, path in rooms.modules().items():
        for codes, name in re.findall(r"\b(\w+Code)\.([A-Z][A-Z0-9_]*)\b", path.read_text("utf-8")):
            users.setdefault(f"{codes}.{name}", set()).add(rooms.room_of(module))
    wrong = {}
    for codes in rooms_of_codes():
        room = rooms.room_of(codes.__module__)
        for code in codes.members():
            of = users.get(f"{codes.__name__}.{code.name}", set())
            # Those of the core's own modules are used by several rooms.
            if not (room in of or (room == rooms.CORE and of)) or any(map(rooms.is_core, of)) > rooms.is_core(room):
                wrong[code] = of
    assert wrong == {}
