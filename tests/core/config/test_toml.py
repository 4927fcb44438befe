"""TOML that no user writes: read with an error in words, and written as it is read."""

import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.config.toml_writer import toml_text
from gateway.core.config.validation import MAX_TOML_BYTES, parse_toml
from gateway.core.config.vehicle import load_vehicle, parse_vehicle
from gateway.core.errors import ConfigError, RecordingError
from gateway.core.recording.recorded_file import open_recorded_file
from gateway.diagnosis.effects_file import load_effects


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = " + "[" * 100_000, "nested deeper than 32 levels"),
        ("a = " + "{a = " * 50_000, "nested deeper than 32 levels"),
        ("a = " + "[" * 40 + "]" * 40, "nested deeper than 32 levels"),
        ("b = 1\n" + "a." * 100_000 + "a = 1", "nested deeper than 32 levels, line 2"),
        ("[" + "a." * 100_000 + "a]", "nested deeper than 32 levels, line 1"),
        ('"a b". ' * 50_000 + "a = 1", "nested deeper than 32 levels, line 1"),
        ("\n\na = " + "9" * 20_000, "a number in line 3 is too long"),
        ("a = -" + "1_" * 9000 + "1", "a number in line 1 is too long"),
        ("a = " + "9" * 4000, "the number of 'a' needs more than 64 bits"),
        ("a = [1, 0x" + "f" * 20_000 + "]", "the number of 'a' needs more than 64 bits"),
        ("#" * (MAX_TOML_BYTES + 1), "too many for a configuration"),
        ("a = 1\na = 2", "Cannot overwrite a value"),
    ],
)
def test_hostile_text_is_rejected(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        parse_toml(text, "x.toml")
    assert str(caught.value).startswith("x.toml: ")
    assert caught.value.remedy


def test_sound_text_is_returned_as_it_is() -> None:
    assert parse_toml("a = 9223372036854775807\nb.c = [[1.5]]\n", "x") == {"a": 2**63 - 1, "b": {"c": [[1.5]]}}


def test_faults_of_a_foreign_file_are_limited() -> None:
    with pytest.raises(ConfigError) as caught:
        parse_vehicle("".join(f"key{number} = 1\n" for number in range(20_000)), "x.toml")
    assert len(str(caught.value).splitlines()) == 101
    assert str(caught.value).endswith("x.toml: and more")


def test_too_many_wheels_are_rejected() -> None:
    wheels = [f"[[wheel]]\nposition = 'w{n}'\nhub = {n // 250}\nwheel = {n % 250}\n" for n in range(1500)]
    with pytest.raises(ConfigError, match="wheel: a list of 1500 found, allowed: at most 1000 tables"):
        parse_vehicle("[tire]\nradius_mm = 320\n" + "".join(wheels), "x.toml")


@pytest.mark.parametrize(
    ("data", "message", "remedy"),
    [
        (None, "no such file", "path"),
        (b"\x89MCAP0\r\n\0\0", "not UTF-8", "This is not a text file. Give the configuration."),
        ("[tire]\nsize = 'ä'".encode("latin-1"), "byte 15 is not UTF-8", "Save the file as UTF-8"),
        (b"#" * (MAX_TOML_BYTES + 1), "larger than 512 KiB", "right file"),
    ],
)
def test_remedy_fits_the_unreadable_file(tmp_path: Path, data: bytes | None, message: str, remedy: str) -> None:
    path = tmp_path / "v.toml"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(ConfigError, match=message) as caught:
        load_vehicle(path)
    assert remedy in caught.value.remedy


def test_folder_is_no_configuration(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="this is a folder") as caught:
        load_vehicle(tmp_path)
    assert caught.value.remedy == "Give a file in this folder."


def test_remedy_of_a_path_that_is_not_read_fits_the_path(tmp_path: Path) -> None:
    loop, text = tmp_path / "loop", tmp_path / "text"
    loop.symlink_to(loop)
    text.write_text("")
    paths = {loop: "lead back", text / "v.toml": "a file stands where", tmp_path / ("v" * 300): "shorter path"}
    for path, remedy in paths.items():
        for read, error in ((load_vehicle, ConfigError), (open_recorded_file, RecordingError)):
            with pytest.raises(error) as caught:
                read(path)
            assert remedy in caught.value.remedy


def test_byte_order_mark_is_allowed(tmp_path: Path) -> None:
    path = tmp_path / "v.toml"
    path.write_bytes(
        b"\xef\xbb\xbf[tire]\r\nradius_mm = 320\r\n[[wheel]]\r\nposition = 'A'\r\nhub = 0\r\nwheel = 0\r\n"
    )
    assert load_vehicle(path).tire.radius_mm == 320


@pytest.mark.parametrize("text", ["[" * 100_000, '{"treadlink_effects": ' + "9" * 20_000 + "}"])
def test_hostile_effects_file_is_rejected(tmp_path: Path, text: str) -> None:
    path = tmp_path / "e.json"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"e\.json: not valid JSON"):
        load_effects(path)


SCALARS = (
    st.text() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False, allow_infinity=False) | st.booleans()
)
VALUES = SCALARS | st.lists(SCALARS, max_size=3)
TABLES = st.dictionaries(st.text(), VALUES, min_size=1, max_size=3)
NESTED = st.recursive(
    TABLES,
    lambda inner: st.dictionaries(st.text(), VALUES | inner | st.lists(inner, min_size=1, max_size=3), min_size=1),
    max_leaves=8,
)


@given(NESTED)
def test_written_values_read_back(document: dict[str, Any]) -> None:
    assert tomllib.loads(toml_text(document)) == document


def test_empty_tables_are_left_out() -> None:
    assert tomllib.loads(toml_text({"a": 1, "b": {}, "c": {"d": {}}})) == {"a": 1}


def test_values_without_toml_form_are_rejected() -> None:
    with pytest.raises(TypeError, match="NoneType"):
        toml_text({"a": None})
