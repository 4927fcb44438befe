import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from gateway.console.styled_rows import Role, beside, fill_while_fitting, fit, row_width, spread
from gateway.core.text.text import clean, crop, crop_middle, pad, width

printable = st.text(st.characters(min_codepoint=32, max_codepoint=0x2FFF), max_size=30)
rows = st.lists(st.tuples(printable, st.sampled_from(Role)), max_size=6).map(tuple)


def plain(row):
    return "".join(text for text, _ in row)


@given(rows, st.integers(0, 60))
def test_fit_is_exact_and_keeps_the_beginning(row, cells):
    fitted = fit(row, cells)
    assert row_width(fitted) == cells
    if row_width(row) <= cells:
        assert plain(fitted).startswith(plain(row))


@given(printable, st.integers(0, 40))
def test_crop_and_pad_keep_to_their_cells(text, cells):
    assert width(crop(text, cells)) <= cells
    assert width(crop_middle(text, cells)) <= cells
    assert width(pad(text, cells)) == cells


@given(st.text(st.characters(min_codepoint=32, max_codepoint=0x5FF, categories=["L", "N", "P", "S", "Zs"])))
def test_width_agrees_with_the_toolkit(text):
    assert width(text) == cell_len(text)


@pytest.mark.parametrize("text", ["左前輪", "FL", "Bs ± ² ° µ", "⠤⢸⡇", "┌─╔═▲", "é"])
def test_width_of_what_is_shown(text):
    assert width(text) == cell_len(text)


@given(st.text())
def test_nothing_that_commands_a_terminal_passes(text):
    assert clean(text).isprintable()
    assert len(clean(text)) == len(text)


def test_middle_crop_keeps_the_distinguishing_end():
    assert crop_middle("recordings/long/path/drive-7.mcap", 16) == "recordi…e-7.mcap"
    assert crop_middle("short", 16) == "short"


def test_spread_right_aligns_the_right_part():
    row = spread((("left part", Role.TEXT),), (("END", Role.ALARM),), 20)
    assert plain(row) == "left part        END"
    assert plain(spread((("left part", Role.TEXT),), (("END", Role.ALARM),), 8)) == "left…END"


def test_fields_are_dropped_whole_from_the_least_important():
    fields = [("bb", Role.TEXT), ("cccc", Role.TEXT), ("d", Role.TEXT)]
    assert plain(fill_while_fitting((("a", Role.TEXT),), fields, 10)) == "a  bb"
    assert plain(fill_while_fitting((("a", Role.TEXT),), fields, 11)) == "a  bb  cccc"


def test_blocks_of_different_height_stand_beside_each_other():
    rows = beside([(("a", Role.TEXT),)], 3, [(("x", Role.TEXT),), (("y", Role.TEXT),)], 3)
    assert [plain(row) for row in rows] == ["a  x", "   y", "   "]
