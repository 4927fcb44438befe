"""The Kaitai Struct description, compiled by the real compiler, reads the test vectors."""

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import firmware_protocol
from firmware_protocol.kaitai import kaitai_description

VECTORS = Path(firmware_protocol.__file__).parent / "vectors"
FRAMES = json.loads((VECTORS / "frames.json").read_text("utf-8"))
SIGNED = json.loads((VECTORS / "signed.json").read_text("utf-8"))["signed"]
COMPILER = Path(__file__).parents[1] / "kaitai"
HEADER = bytes.fromhex("a55a1000000000000000000000000000")

Parser = Callable[[bytes], Any]


@pytest.fixture(scope="module")
def parse() -> Parser:
    if shutil.which("node") is None or not (COMPILER / "node_modules").is_dir():
        pytest.skip("the Kaitai Struct compiler is not installed: npm ci --prefix tests/kaitai")
    compiled = subprocess.run(
        ["node", str(COMPILER / "compile.js")],
        input=json.dumps(yaml.safe_load(kaitai_description())),
        capture_output=True,
        text=True,
        check=False,
    )
    assert compiled.returncode == 0, compiled.stderr
    module: dict[str, Any] = {}
    exec(json.loads(compiled.stdout)["treadlink.py"], module)
    return module["Treadlink"].from_bytes


def framed(type_: int, payload: bytes) -> bytes:
    head = bytearray(HEADER)
    head[3], head[4] = type_, len(payload)
    return bytes(head) + payload + bytes(4)


def values_of(payload: Any, names: list[str]) -> dict[str, Any]:
    return {name: getattr(payload, name) for name in names}


@pytest.mark.parametrize("vector", FRAMES["frames"], ids=lambda vector: vector["name"].replace(" ", "_"))
def test_fields_equal_those_of_the_vector(parse: Parser, vector: dict[str, Any]) -> None:
    (frame,) = parse(bytes.fromhex(vector["hex"])).frames
    assert values_of(frame, ["type", "hub", "wheel", "seq", "tick_us"]) == {
        name: vector[name] for name in ("type", "hub", "wheel", "seq", "tick_us")
    }
    assert (frame.version_major, frame.version_minor, frame.is_signed) == (1, 0, False)
    expected = dict(vector["payload"])
    if "text" in expected:
        expected["text"] = expected["text"].encode()
    result = values_of(frame.payload, list(expected))
    for name, value in expected.items():
        if isinstance(value, float) or (isinstance(value, list) and value and isinstance(value[0], float)):
            assert np.array_equal(np.float32(value), np.float32(result[name])), name
        else:
            assert result[name] == value, name


def test_all_vectors_are_one_stream(parse: Parser) -> None:
    frames = parse(b"".join(bytes.fromhex(vector["hex"]) for vector in FRAMES["frames"])).frames
    assert [frame.seq for frame in frames] == [vector["seq"] for vector in FRAMES["frames"]]


@pytest.mark.parametrize("vector", FRAMES["refused_payloads"], ids=lambda vector: vector["name"].replace(" ", "_"))
def test_refused_payload_is_an_error(parse: Parser, vector: dict[str, Any]) -> None:
    from kaitaistruct import ValidationFailedError

    with pytest.raises((ValidationFailedError, EOFError)):
        parse(framed(vector["type"], bytes.fromhex(vector["payload_hex"])))


@pytest.mark.parametrize("vector", FRAMES["tolerated_payloads"], ids=lambda vector: vector["name"].replace(" ", "_"))
def test_tolerated_payload_is_read(parse: Parser, vector: dict[str, Any]) -> None:
    (frame,) = parse(framed(vector["type"], bytes.fromhex(vector["payload_hex"]))).frames
    assert frame.payload.beyond_layout == b""


@pytest.mark.parametrize("vector", SIGNED, ids=lambda vector: vector["name"].replace(" ", "_"))
def test_tag_of_a_signed_frame_is_separated(parse: Parser, vector: dict[str, Any]) -> None:
    (plain,) = parse(bytes.fromhex(vector["unsigned"])).frames
    (signed,) = parse(bytes.fromhex(vector["signed"])).frames
    assert signed.is_signed
    assert signed.tag == bytes.fromhex(vector["signed"])[-12:-4]
    assert signed._raw_payload == plain._raw_payload


def test_payload_of_an_unknown_type_stays_bytes(parse: Parser) -> None:
    assert parse(framed(99, b"abc")).frames[0].payload == b"abc"
