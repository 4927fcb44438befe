"""`treadlink protocol` writes what the generators make and overwrites nothing unasked."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from firmware_protocol.cgen import c_encoder, c_header
from firmware_protocol.conformance import make_vectors
from firmware_protocol.kaitai import kaitai_description
from firmware_protocol.wireshark import wireshark_dissector
from gateway.cli import treadlink
from gateway.errors import TreadlinkError


def run(*arguments: str) -> str:
    result = CliRunner().invoke(treadlink, ["protocol", *arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


@pytest.mark.parametrize(
    ("command", "text"),
    [
        ("header", c_header),
        ("encoder", c_encoder),
        ("kaitai", kaitai_description),
        ("wireshark", wireshark_dissector),
    ],
)
def test_prints_without_a_directory(command: str, text) -> None:
    assert run(command) == text()


def test_writes_all_files_to_a_new_directory(tmp_path: Path) -> None:
    out = tmp_path / "firmware" / "protocol"
    for command in ("header", "encoder", "vectors"):
        run(command, "--out", str(out))
    written = {path.name: path.read_text("utf-8") for path in out.iterdir()}
    assert written == make_vectors() | {"treadlink_protocol.h": c_header(), "treadlink_protocol.c": c_encoder()}


def test_overwrites_only_with_force(tmp_path: Path) -> None:
    (tmp_path / "streams.json").write_text("mine")
    result = CliRunner().invoke(treadlink, ["protocol", "vectors", "--out", str(tmp_path)])
    assert isinstance(result.exception, TreadlinkError)
    assert "streams.json" in str(result.exception)
    assert "--force" in result.exception.remedy
    assert {path.name for path in tmp_path.iterdir()} == {"streams.json"}
    assert (tmp_path / "streams.json").read_text() == "mine"
    run("vectors", "--out", str(tmp_path), "--force")
    assert (tmp_path / "streams.json").read_text("utf-8") == make_vectors()["streams.json"]


def test_directory_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    result = CliRunner().invoke(treadlink, ["protocol", "header", "--out", str(tmp_path / "file" / "below")])
    assert isinstance(result.exception, TreadlinkError)
    assert "below" in str(result.exception)


def test_tables_update_a_page(tmp_path: Path) -> None:
    page = tmp_path / "protocol.md"
    page.write_text("before\n<!-- generated: frame -->\nold\n<!-- end -->\nafter\n")
    run("tables", str(page))
    text = page.read_text("utf-8")
    assert text.startswith("before\n<!-- generated: frame -->\n| offset |")
    assert "old" not in text
    assert text.endswith("<!-- end -->\nafter\n")
