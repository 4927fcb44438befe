"""The Wireshark dissector in the real tshark, on captures of TCP streams."""

import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
import pytest

import firmware_protocol
from firmware_protocol.messages import MessageType
from firmware_protocol.wireshark import DISSECTOR_NAME, wireshark_dissector

VECTORS = Path(firmware_protocol.__file__).parent / "vectors"
FRAMES = json.loads((VECTORS / "frames.json").read_text("utf-8"))["frames"]
STREAMS = {v["name"]: v for v in json.loads((VECTORS / "streams.json").read_text("utf-8"))["streams"]}
SIGNED = json.loads((VECTORS / "signed.json").read_text("utf-8"))["signed"]
EVERY_FRAME = b"".join(bytes.fromhex(vector["hex"]) for vector in FRAMES)

Dissected = list[tuple[str, Any]]
Dissect = Callable[..., list[Dissected]]


@pytest.fixture
def dissect(tmp_path: Path) -> Dissect:
    if shutil.which("tshark") is None or shutil.which("text2pcap") is None:
        if os.environ.get("CI"):
            pytest.fail("CI must have tshark")
        pytest.skip("not installed: tshark")
    script = tmp_path / DISSECTOR_NAME
    script.write_text(wireshark_dissector(), "utf-8")

    def run(data: bytes, segments: list[int], *options: str, port: int = 5005) -> list[Dissected]:
        """Return name and value of what tshark shows of each frame of a TCP stream, cut before the given bytes."""
        dump = tmp_path / "dump.txt"
        edges = [0, *segments, len(data)]
        rows = [
            f"{index - begin:06x} {data[index : min(index + 16, end)].hex(' ')}" + ("\n" if index + 16 >= end else "")
            for begin, end in zip(edges, edges[1:], strict=False)
            for index in range(begin, end, 16)
        ]
        dump.write_text("\n".join(rows) + "\n")
        capture = tmp_path / "capture.pcap"
        subprocess.run(["text2pcap", "-q", "-T", f"{port},40000", str(dump), str(capture)], check=True)
        command = ["tshark", "-r", str(capture), "-X", f"lua_script:{script}", "-T", "json", "-J", "treadlink"]
        shown = subprocess.run([*command, *options], capture_output=True, text=True, check=True)
        assert "Lua" not in shown.stderr.replace("Lua: ", ""), shown.stderr
        packets = json.loads(shown.stdout, object_pairs_hook=list)
        return [tree for packet in packets for tree in trees(packet)]

    return run


def trees(node: Any) -> list[Dissected]:
    """Return the fields of every tree named "treadlink" in the JSON of a packet."""
    results: list[Dissected] = []
    for name, value in node:
        if name == "treadlink" and isinstance(value, list):
            results.append(flat(value))
        elif isinstance(value, list) and value and isinstance(value[0], list | tuple):
            results += trees(value)
    return results


def flat(node: Any) -> Dissected:
    pairs: Dissected = []
    for name, value in node:
        if isinstance(value, list):
            pairs += flat(value)
        else:
            pairs.append((name.removeprefix("treadlink."), value))
    return pairs


def all_of(tree: Dissected, name: str) -> list[str]:
    return [value for key, value in tree if key == name]


def test_fields_equal_those_of_the_vectors(dissect: Dissect) -> None:
    rng = np.random.default_rng(7)
    segments = sorted(rng.choice(np.arange(1, len(EVERY_FRAME)), 12, replace=False).tolist())
    shown = dissect(EVERY_FRAME, segments)
    assert len(shown) == len(FRAMES)
    for tree, vector in zip(shown, FRAMES, strict=True):
        for name in ("type", "hub", "wheel", "seq", "tick_us"):
            assert all_of(tree, name) == [str(vector[name])]
        assert all_of(tree, "crc_ok") == ["1"]
        assert not [name for name, _ in tree if name.startswith("_ws.expert")]
        part = MessageType(vector["type"]).name.lower()
        for name, value in vector["payload"].items():
            result = all_of(tree, f"{part}.{name}")
            if name == "text":
                assert bytes.fromhex("".join(result).replace(":", "")).decode() == value
                continue
            wanted = value if isinstance(value, list) else [value]
            np.testing.assert_allclose(np.array(result, float), wanted, rtol=1e-5, err_msg=f"{vector['name']}: {name}")


def test_stream_may_be_cut_anywhere(dissect: Dissect) -> None:
    data = b"".join(bytes.fromhex(vector["hex"]) for vector in FRAMES[:4])
    whole = dissect(data, [])
    assert len(whole) == 4
    for cut in (1, 4, 5, 16, 29, 31, 60):
        assert dissect(data, [cut], "-d", "tcp.port==5005,treadlink") == whole, cut
    assert dissect(data, [5, 16, 60]) == whole


def test_damaged_frame_has_its_verdict(dissect: Dissect) -> None:
    stream = STREAMS["one bit flipped: only this frame is lost"]
    shown = dissect(bytes.fromhex(stream["hex"]), [])
    verdicts = [all_of(tree, "crc_ok") for tree in shown]
    assert verdicts.count(["0"]) == stream["counters"]["crc_errors"] == 1
    assert verdicts.count(["1"]) == len(stream["frames"])
    bad = shown[verdicts.index(["0"])]
    assert "_ws.expert" in "".join(name for name, _ in bad)


def test_bytes_between_frames_are_marked(dissect: Dissect) -> None:
    single = bytes.fromhex(FRAMES[0]["hex"])
    shown = dissect(single + b"noise" + single, [], "-d", "tcp.port==5005,treadlink")
    assert [all_of(tree, "noise") for tree in shown] == [[], ["6e:6f:69:73:65"], []]
    assert [all_of(tree, "seq") for tree in shown] == [["7"], [], ["7"]]


def test_port_is_a_preference(dissect: Dissect) -> None:
    behind_noise = b"noise" + bytes.fromhex(FRAMES[0]["hex"])
    assert dissect(behind_noise, [], port=5600) == []
    shown = dissect(behind_noise, [], "-o", "treadlink.port:5600", port=5600)
    assert [all_of(tree, "seq") for tree in shown] == [[], ["7"]]


def test_tag_of_a_signed_frame_is_shown(dissect: Dissect) -> None:
    (tree,) = dissect(bytes.fromhex(SIGNED[0]["signed"]), [])
    assert all_of(tree, "tag") == [bytes.fromhex(SIGNED[0]["signed"])[-12:-4].hex(":")]
    assert all_of(tree, "samples.counts") == all_of(
        dissect(bytes.fromhex(SIGNED[0]["unsigned"]), [])[0], "samples.counts"
    )


def test_value_out_of_range_is_marked(dissect: Dissect) -> None:
    frame = bytearray.fromhex(next(v["hex"] for v in FRAMES if v["type"] == MessageType.SET_STREAM))
    frame[16] = 2
    frame[-4:] = crc32(frame[:-4]).to_bytes(4, "little")
    (tree,) = dissect(bytes(frame), [])
    assert all_of(tree, "set_stream.running") == ["2"]
    assert any(name.endswith("out_of_range") or value == "value out of range" for name, value in tree)
