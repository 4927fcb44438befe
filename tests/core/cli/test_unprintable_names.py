"""Output that a terminal cannot show: control characters of names, and characters outside its encoding."""

import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

import gateway
from gateway.core.cli import treadlink
from gateway.core.cli.stream_encoding import ShownText, nearest_text
from gateway.core.text.text import json_text
from tests.testkit.campaign_recordings import write_recording
from tests.testkit.commands import program, run

# An escape sequence, an override of the direction, one of C1, an invisible mark and a backspace.
NAMES = ("\x1b[31mx", "\u202ex", "\x9b31mx", "\u200bx", "\x08x")
EVERY_ONE = "".join(NAMES)
CONFIG = '[tire]\nradius_mm = 320\n[[wheel]]\nposition = "W1"\nhub = 0\nwheel = 0\n'


def unprintable(text: str) -> set[str]:
    return {character for character in text if not character.isprintable()} - {"\n", "\r"}


def without_colours(text: str) -> str:
    for code in (0, 31, 32, 33):
        text = text.replace(f"\x1b[{code}m", "")
    return text


def strings(value: Any) -> Iterator[str]:
    for each in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from strings(each)
    if isinstance(value, str):
        yield value


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("plain") / "r.mcap"
    write_recording(path)
    return path.read_bytes()


def test_estimate_and_orders_escape_the_name_of_the_recording(tmp_path: Path, recording: bytes) -> None:
    path = tmp_path / f"{EVERY_ONE}.mcap"
    path.write_bytes(recording)
    table, orders, page = (tmp_path / f"{EVERY_ONE}{end}" for end in (".csv", ".orders.csv", ".html"))
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


def test_json_escapes_names_and_keeps_them(tmp_path: Path, recording: bytes) -> None:
    path, config, orders = (tmp_path / f"{EVERY_ONE}{end}" for end in (".mcap", ".toml", ".json"))
    path.write_bytes(recording)
    config.write_text(CONFIG)
    for words in (
        ["estimate", str(path), "--json", "-"],
        ["orders", str(path), "--json", str(orders)],
        ["doctor", "--config", str(config), "--json"],
    ):
        result = CliRunner().invoke(treadlink, words, catch_exceptions=False)
        text = orders.read_text() if words[0] == "orders" else result.stdout
        assert not unprintable(text)
        lines = text.splitlines() if words[0] == "estimate" else [text]
        assert any(EVERY_ONE in each for line in lines for each in strings(json.loads(line)))


@pytest.mark.skipif(sys.platform != "linux", reason="other file systems refuse the name")
def test_every_table_escapes_a_name_that_is_not_utf8(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / os.fsdecode(b"gr\xf6.mcap")
    write_recording(path, duration_s=0.6)
    few = ("--estimator", "kinematic")
    run("estimate", path, *few, "--parquet", tmp_path / "e.parquet", "--json", tmp_path / "e.jsonl")
    rows = [json.loads(line) for line in (tmp_path / "e.jsonl").read_text().splitlines()]
    in_parquet = parquet.read_table(tmp_path / "e.parquet").column("recording").to_pylist()
    assert {*in_parquet, *(row["recording"] for row in rows)} == {r"gr\udcf6.mcap"}
    run("export", path, tmp_path / "x.npz", "--what", "estimates", *few)
    assert np.load(tmp_path / "x.npz")["W0/recording"][0] == r"gr\udcf6.mcap"


@given(st.dictionaries(st.text(), st.text() | st.lists(st.text())))
def test_json_is_printable_and_means_the_same(document: dict[str, object]) -> None:
    for text in (json_text(document), json_text(document, indent=2), json_text(document, compact=True)):
        assert not unprintable(text)
        assert json.loads(text) == document


@given(st.text() | st.sampled_from(NAMES))
def test_streams_print_nothing_that_controls_the_terminal(text: str) -> None:
    data = io.BytesIO()
    stream = ShownText(data, "utf-8", "backslashreplace", newline="")
    assert stream.write(text) == len(text)
    stream.flush()
    written = data.getvalue().decode()
    assert not unprintable(re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", written)) - {"\t"}
    if text.isprintable():
        assert written == text


def test_messages_escape_the_paths_that_they_name(tmp_path: Path, recording: bytes) -> None:
    paths = [tmp_path / f"{name}.mcap" for name in NAMES[1:3]]
    for path in paths:
        path.write_bytes(recording)
    command = [sys.executable, "-X", "dev", "-m", "gateway.core.cli", "note", *map(str, paths), "--comment", "c"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parents[3], check=True)
    assert r"\u202ex.mcap" in done.stdout
    assert r"\x9b31mx.mcap" in done.stdout
    assert not unprintable(done.stdout + done.stderr)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("encoding") / "Reifen ü №1.mcap"
    gateway.simulate("lab", duration_s=2.0, out=path)
    return path


@pytest.mark.parametrize("encoding", ["cp1252", "cp437", "latin-1"])
@pytest.mark.parametrize(("command", "word"), [("inspect", "Reifen"), ("orders", "W1")])
def test_every_code_page_takes_the_output(recorded, command, word, encoding):
    done = program(command, recorded, encoding=encoding)
    assert done.status == 0, done.stderr
    assert word in done.stdout
    assert "Traceback" not in done.stderr


def test_nearest_text_keeps_the_meaning():
    assert nearest_text("3.1 ± 0.2 m/s², −12 °C, Größe, №") == "3.1 +- 0.2 m/s^2, -12  degC, Gro?e, No"
    assert nearest_text("⣿").isascii()
