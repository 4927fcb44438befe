"""No output passes on characters of names that control the terminal or turn the text around."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from gateway.cli import treadlink
from tests.testkit.campaign_recordings import write_recording

# An escape sequence, an override of the direction, one of C1, an invisible mark and a backspace.
NAMES = ("\x1b[31mx", "\u202ex", "\x9b31mx", "\u200bx", "\x08x")
CONFIG = '[tire]\nradius_mm = 320\n[[wheel]]\nposition = "W1"\nhub = 0\nwheel = 0\n'


def unprintable(text: str) -> set[str]:
    return {character for character in text if not character.isprintable()} - {"\n", "\r"}


def without_colours(text: str) -> str:
    for code in (0, 31, 32, 33):
        text = text.replace(f"\x1b[{code}m", "")
    return text


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("plain") / "r.mcap"
    write_recording(path)
    return path.read_bytes()


@pytest.mark.parametrize("name", NAMES)
def test_estimate_and_orders_escape_the_name_of_the_recording(tmp_path: Path, recording: bytes, name: str) -> None:
    path = tmp_path / f"{name}.mcap"
    path.write_bytes(recording)
    table, orders, page = (tmp_path / f"{name}{end}" for end in (".csv", ".orders.csv", ".html"))
    for words in (
        ["estimate", str(path), "--csv", str(table)],
        ["orders", str(path), "--csv", str(orders), "--figure", str(page)],
    ):
        result = CliRunner().invoke(treadlink, words, catch_exceptions=False, color=True)
        assert result.exit_code == 0, result.output
        assert "x" in result.output
        assert not unprintable(result.output)
    for written in (table, orders, page):
        content = written.read_bytes().decode()
        assert "x.mcap" in content
        assert not unprintable(content)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("text", [CONFIG, CONFIG + '"\\u001b\\u202e" = 1', CONFIG + "[["])
def test_doctor_escapes_the_name_of_the_configuration(tmp_path: Path, name: str, text: str) -> None:
    path = tmp_path / f"{name}.toml"
    path.write_text(text)
    result = CliRunner().invoke(treadlink, ["doctor", "--config", str(path)], color=True)
    assert "x.toml" in result.output
    assert name not in result.output
    assert not unprintable(without_colours(result.output))
