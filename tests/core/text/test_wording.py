"""Reasons are made with the values that their templates need, and only views fill templates."""

import ast
import itertools
import math
import re
import string
from pathlib import Path

import pytest

import treadlink
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.registry import ESTIMATORS
from gateway.core.reasons import Code, CoreCode, Reason
from gateway.core.session.reasons import SessionCode
from gateway.core.shown_units import ShownUnits, shown_in
from gateway.core.text.wording import as_json, fields, joined, text
from gateway.core.trust.reasons import TrustCode
from tools.reason_codes import all_codes

GATEWAY = Path(__file__).parents[3] / "gateway"
GOLDEN = Path(__file__).parents[2] / "golden" / "data"
# Any finding may say when it began.
DATES = {"since_s", "since_std_s"}
NO_NUMBER = re.compile(r"\b(nan|inf)\b [a-z]")


@pytest.mark.parametrize(("late_s", "words"), [(0.39e-3, "0.39 ms later"), (-0.39e-3, "0.39 ms earlier")])
def test_negative_lateness_is_said_to_be_earlier(late_s, words) -> None:
    alone = text(Reason(TrustCode.AXIS_LATE, axis="lateral", late_s=late_s))
    assert alone == f"the lateral axis is {words} than the radial one"
    size, word = words.rsplit(" ", 1)
    among = text(Reason(TrustCode.AXIS_LATER_THAN_OTHERS, axis="lateral", late_s=late_s, std_s=5e-5))
    assert among == f"the lateral axis is {size} ± 0.05 ms {word} against the radial one than on the other wheels"


def test_only_wording_reads_templates() -> None:
    readers = {
        str(path.relative_to(GATEWAY))
        for path in GATEWAY.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Attribute) and node.attr == "text_template" and isinstance(node.ctx, ast.Load)
    }
    # The glossary shows templates; it fills none.
    assert readers == {"core/text/wording.py", "glossary/entries.py"}


def test_reasons_have_the_values_of_their_template():
    wrong, by_name = [], {code.name: code for code in all_codes()}
    for path in sorted(GATEWAY.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Reason"):
                continue
            code = node.args[0]
            named = {keyword.arg for keyword in node.keywords}
            if isinstance(code, ast.Attribute) and None not in named and not _fit(by_name[code.attr], node.keywords):
                wrong.append(f"{path.relative_to(GATEWAY)}:{node.lineno} {code.attr}: {named}")
    assert wrong == []


def _fit(code: Code, given: list[ast.keyword]) -> bool:
    """Return whether values are those of the template, and of the kinds that may be meant."""
    named = {keyword.arg for keyword in given} - DATES
    said = {keyword.arg: keyword.value.value for keyword in given if isinstance(keyword.value, ast.Constant)}
    meant = [
        [_named(template) for kind, template in kinds.items() if said.get(name, kind) == kind] or [set()]
        for name, kinds in code.words.items()
    ]
    needed = _named(code.text_template) | set(code.words)
    return any(named == needed.union(*of_kinds) for of_kinds in itertools.product(*meant))


def _named(template: str) -> set[str]:
    parts = list(string.Formatter().parse(template))
    inner = {name for _, _, form, _ in parts if form for name in _named(form)}
    return inner | {name for _, name, _, _ in parts if name}


@pytest.mark.parametrize("code", all_codes())
def test_every_template_prints_its_values(code: Code) -> None:
    values = dict.fromkeys(fields(code), 1)
    assert text(Reason(code, **values)) != str(code)
    for name, kinds in code.words.items():
        shown = {text(Reason(code, **{**values, name: kind})) for kind in kinds}
        assert len(shown | {str(code)}) == len(kinds) + 1


def test_non_finite_values_are_null_in_json() -> None:
    values = as_json(Reason(CoreCode.NOT_DETERMINED, relative_error=math.inf))["values"]
    assert values == {"relative_error": None}


def test_joined_reasons_are_not_repeated():
    lost = Reason(EstimateCode.SAMPLES_LOST)
    assert joined([lost, lost]) == text(lost)
    assert as_json(lost) == {"code": "samples_lost", "values": {}, "text": text(lost)}


def test_an_unknown_value_is_an_error():
    with pytest.raises(KeyError):
        Reason(EstimateCode.SAMPLES_LOST)["depth_m"]


def test_zero_has_no_sign() -> None:
    reason = Reason(TrustCode.COUPLING_CONTRADICTED, share=-0.0001, std=0.04)
    assert "is 0.00 ± 0.04 times" in text(reason)


@pytest.mark.parametrize(("error", "shown"), [(3.4, "3.4 times"), (1.1e4, "more than 10 times")])
def test_large_relative_error_has_no_size(error: float, shown: str) -> None:
    assert shown in text(Reason(CoreCode.NOT_DETERMINED, relative_error=error))


def test_no_reason_of_a_drive_says_that_a_number_is_none() -> None:
    estimates = treadlink.simulate("slip", duration_s=2.5, faults=["drop:rate=0.05"]).estimates(
        # The numbers of the slower ones have the same reasons as those of the others.
        [name for name in ESTIMATORS if name not in ("forward", "ring-modal", "ring-paper")]
    )
    texts = {*estimates.reasons.tolist()}
    assert any(text(Reason(EstimateCode.SIGN_NOT_DETERMINED, why="no_error")) in said for said in texts)
    assert [said for said in texts if NO_NUMBER.search(said)] == []


def test_no_stored_result_says_that_a_number_is_none() -> None:
    stored = [line for path in GOLDEN.glob("*.json") for line in path.read_text(encoding="utf-8").splitlines()]
    assert len(stored) > 10_000
    assert [line for line in stored if "reason" in line and NO_NUMBER.search(line)] == []


def test_a_share_is_written_as_every_percentage() -> None:
    reason = Reason(TrustCode.MAY_CHANGE_BY, effect=0.0204, why=Reason(CoreCode.NO_STEADY_VALUE))
    assert text(reason).startswith("may be wrong by 2.0 %: ")


@pytest.mark.parametrize("code", [code for code in all_codes() if re.search(r":[^{}]*%\}", code.text_template)])
def test_no_template_writes_a_percent_sign_twice(code: Code) -> None:
    assert "%} %" not in code.text_template
    assert "%}%" not in code.text_template


@pytest.mark.parametrize(
    ("units", "sentence"),
    [
        ("si", "pressure 210 kPa is below 230 kPa"),
        ("bar", "pressure 2.10 bar is below 2.30 bar"),
        ("us", "pressure 30.5 psi is below 33.4 psi"),
    ],
)
def test_reason_is_in_the_shown_units_and_in_its_own_in_json(units: str, sentence: str) -> None:
    low = Reason(SessionCode.VALUE_BELOW_LIMIT, quantity="pressure_pa", value=210e3, limit=230e3)
    with shown_in(ShownUnits(units)):
        assert text(low) == sentence
    assert as_json(low)["text"] == "pressure 210 kPa is below 230 kPa"
