"""Log output of the command line."""

import io
import logging
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.core.cli.logs import configure_logging, held_back
from gateway.core.errors import OutputError
from tests.testkit.commands import run

logger = logging.getLogger("gateway.test")


@pytest.fixture(autouse=True)
def logging_restored() -> Iterator[None]:
    root = logging.getLogger()
    handlers, level = list(root.handlers), logging.getLogger("gateway").level
    yield
    root.handlers[:] = handlers
    logging.getLogger("gateway").setLevel(level)


@pytest.mark.parametrize(("verbosity", "logged"), [(0, "W"), (1, "WI"), (2, "WID"), (5, "WID")])
def test_verbosity_selects_the_level(verbosity: int, logged: str, capsys: pytest.CaptureFixture[str]) -> None:
    configure_logging(verbosity, None)
    logger.warning("W")
    logger.info("I")
    logger.debug("D")
    lines = capsys.readouterr().err.splitlines()
    assert "".join(line[-1] for line in lines) == logged
    assert all("gateway.test" in line for line in lines)


def test_log_file_replaces_standard_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run.log"
    configure_logging(1, path)
    logger.info("to the file")
    assert "to the file" in path.read_text()
    assert capsys.readouterr().err == ""


def test_records_are_held_back_behind_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr("sys.stderr", stream)
    configure_logging(0, None)
    with held_back():
        logger.warning("later")
        assert stream.getvalue() == ""
    assert "later" in stream.getvalue()


def test_a_record_that_repeats_is_counted_and_its_traceback_printed_once(capsys: pytest.CaptureFixture[str]) -> None:
    configure_logging(0, None)
    for number in range(1234):
        try:
            raise ValueError("boom \x1b[2J")
        except ValueError:
            logger.warning("estimator %s failed", "worn", exc_info=True)
        logger.warning("another %d", number % 2)
    printed = capsys.readouterr().err
    assert printed.count("Traceback") == 1
    assert "\x1b" not in printed
    assert "boom \\x1b[2J" in printed
    assert [line.rpartition("failed")[2] for line in printed.splitlines() if "worn" in line] == [
        "", " (10 times)", " (100 times)", " (1000 times)",
    ]  # fmt: skip
    assert sum("another 0" in line for line in printed.splitlines()) == 3


def test_unwritable_log_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot write the log"):
        configure_logging(0, tmp_path / "none" / "run.log")


def test_option_configures_logging(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    out = tmp_path / "lab.mcap"
    arguments = ["-v", "--log", str(path), "simulate", "lab", "--duration", "0.2", "--out", str(out)]
    run(*arguments)
    assert f"INFO    gateway.core.recording.writer: recording to {out}" in path.read_text()
