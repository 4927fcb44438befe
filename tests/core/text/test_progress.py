"""Progress on a terminal: bars, their labels and their end."""

import io
import re

import pytest
from rich.console import Console

from gateway.core.text.progress import ProgressView, progress_bar, progress_view
from gateway.core.text.text import width

WIDTH = 70
ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


@pytest.fixture
def drawn():
    file = io.StringIO()
    return ProgressView(Console(file=file, force_terminal=True, width=WIDTH)), file


def rows(file):
    return [row for row in re.split(r"[\r\n]+", ESCAPES.sub("", file.getvalue())) if row.strip()]


def test_bar_shows_its_label_and_share(drawn):
    view, file = drawn
    with view:
        bar = view.bar("[red]first.mcap")
        bar.show(0.5)
        bar.show(0.25)
        view.bar("second.mcap").show(1.0, "\x1b[31msecond")
    last = rows(file)[-2:]
    assert last[0].startswith("[red]first.mcap")
    assert " 50 %" in last[0]
    assert "[31msecond" in last[1]
    assert "\x1b[31msecond" not in file.getvalue()
    assert "100 %" in last[1]


def test_echo_of_an_interrupt_fits_beside_a_bar(drawn):
    view, file = drawn
    with view:
        view.bar("a recording with a name that is far too long for the label of a bar.mcap").show(0.5)
        view.text("a line of text " * 10)
    assert max(width(row.rstrip()) for row in rows(file)) <= WIDTH - len("^C") - 1


def test_drawing_is_removed_for_other_lines_and_at_the_end(drawn):
    view, file = drawn
    with view:
        view.bar("recording.mcap")
        with view.hidden():
            hidden_at = file.tell()
            assert file.getvalue().endswith("\x1b[1A\x1b[2K")
        assert file.tell() > hidden_at
    assert file.getvalue().endswith("\x1b[1A\x1b[2K")


def test_nothing_is_drawn_without_a_terminal(capfd):
    with progress_bar("recording.mcap") as bar, progress_view() as view:
        bar.show(0.5)
        view.text("text")
        with view.hidden():
            pass
    assert capfd.readouterr() == ("", "")
