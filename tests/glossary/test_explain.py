"""`treadlink explain` knows every declared word, by the name of a screen or of a file."""

import pytest

from gateway.core.errors import ConfigError
from gateway.core.quantity_catalogue import declared
from gateway.core.table_columns import FAILURE_COLUMNS, RECORDING_HEAD, RECORDING_TAIL, RESULT_HEAD, RESULT_TAIL
from gateway.core.text.numbers import plain_name, split_name
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.glossary.entries import entries, matching, reason_codes
from tests.testkit.commands import invoked
from tools.reason_codes import all_codes


def test_every_quantity_is_explained_by_its_name_and_its_label():
    for quantity in declared():
        for name in (quantity.name, split_name(quantity.name)[0].upper()):
            assert any(quantity.name in entry.names for entry in matching(name)), name


def test_names_that_screens_print_are_known():
    printed = {name for entry in entries() for name in entry.names}
    assert {plain_name(quantity.name) for quantity in declared()} <= printed


def test_every_effect_and_reason_has_an_entry():
    names = {(entry.kind, entry.names[0]) for entry in entries()}
    assert {("effect", name) for name in catalogue()} <= names
    assert set(reason_codes()) == set(all_codes())
    assert {("reason", str(code)) for code in all_codes()} <= names


def test_no_line_is_empty_and_no_template_is_left():
    for entry in entries():
        assert entry.lines
        for _, text in entry.lines:
            assert text.strip()
        if entry.kind == "reason":
            assert not set("{}") & set(entry.lines[0][1]), entry


def test_a_quantity_says_what_puts_it_in_doubt():
    shown = invoked("explain", "contact", "length").output
    assert "contact length  (quantity)" in shown
    assert "in files: contact_length_m, m" in shown
    # Of its error that is a small part: the budget says which is the largest.
    assert "rests on: belt radius" in shown
    assert "error contains" not in shown


@pytest.mark.parametrize(
    ("word", "shown"),
    [
        ("settling", "not_settled  (reason)"),
        ("mean speed", "speed_mean_mps  (column)"),
        ("load_source", "load_source  (column)"),
        ("relative_gain_std", "relative_gain_std  (column)"),
    ],
)
def test_words_of_a_table_and_of_the_text_of_a_reason_are_explained(word, shown):
    assert shown in invoked("explain", *word.split()).output


def test_every_column_of_the_tables_of_a_dataset_is_explained():
    names = {name for entry in entries() if entry.kind == "column" for name in entry.names}
    assert {*RESULT_HEAD, *RESULT_TAIL, *RECORDING_HEAD, *RECORDING_TAIL, *FAILURE_COLUMNS} <= names


def test_a_part_of_a_name_lists_what_contains_it():
    lines = invoked("explain", "ply steer").output.splitlines()
    assert "ply steer peak  (quantity)" in lines
    assert len(lines) > 3


def test_an_unknown_word_is_compared_with_the_known_ones():
    error = invoked("explain", "cww").exception
    assert isinstance(error, ConfigError)
    assert "Did you mean Cw?" in error.remedy


@pytest.mark.parametrize("term", ["exact ring", "held-out rms", "Noise floor", "zero-g offset"])
def test_terms_of_the_terminal_are_explained(term):
    assert f"{term.lower()}  (term)" in invoked("explain", *term.split()).output


@pytest.mark.parametrize("status", ["valid", "provisional", "invalid"])
def test_statuses_are_explained(status):
    assert f"{status}  (status)" in invoked("explain", status).output
