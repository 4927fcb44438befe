"""The generated C code compiles without a warning and passes the test vectors under the sanitizers."""

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

import firmware_protocol
from firmware_protocol.cgen import ENCODER_NAME, HEADER_NAME, c_encoder, c_header
from firmware_protocol.codec import encode_raw
from firmware_protocol.messages import COMMANDS, MessageType

VECTORS = Path(firmware_protocol.__file__).parent / "vectors"
FLAGS = ["-std=c11", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fsanitize=address,undefined"]
FLAGS += ["-fno-sanitize-recover=all", "-g"]

HARNESS = Path(__file__).with_name("harness.c").read_text()


@pytest.fixture(scope="module")
def compiler() -> str:
    result = shutil.which("gcc")
    if result is None:
        if os.environ.get("CI"):
            pytest.fail("gcc is missing; CI must have it")
        pytest.skip("gcc is not installed")
    return result


@pytest.fixture
def code(tmp_path: Path) -> Path:
    (tmp_path / HEADER_NAME).write_text(c_header(), "utf-8")
    (tmp_path / ENCODER_NAME).write_text(c_encoder(), "utf-8")
    return tmp_path


def run_harness(compiler: str, code: Path, body: str) -> str:
    (code / "harness.c").write_text(HARNESS.format(header=HEADER_NAME, body=body), "utf-8")
    sources = [code / "harness.c", code / ENCODER_NAME]
    built = subprocess.run(
        [compiler, *FLAGS, *sources, "-o", code / "harness"], capture_output=True, text=True, check=False
    )
    assert built.returncode == 0, built.stderr
    result = subprocess.run([code / "harness"], capture_output=True, text=True, check=False)
    assert result.returncode in (0, 1), result.stderr
    return result.stdout


def c_bytes(data: bytes) -> str:
    return "(const uint8_t[]){" + ", ".join(map(str, data or b"\0")) + "}"


def c_value(value: Any) -> str:
    if isinstance(value, list):
        return "{" + ", ".join(map(c_value, value)) + "}"
    if isinstance(value, float):
        return f"{value!r}f"
    if value == -(2**31):
        return "(-2147483647 - 1)"
    return f"{value}u" if 0 <= value < 2**32 else f"{value}ull" if value > 0 else f"{value}"


def c_message(type_: int, payload: dict[str, Any]) -> str:
    values = {name: c_value(value) for name, value in payload.items() if name not in ("counts", "text")}
    if "counts" in payload:
        values["counts"] = "(const int16_t[])" + "{" + ", ".join(map(str, payload["counts"])) + "}"
    if "text" in payload:
        text = payload["text"].encode()
        values["text"] = "(const char[]){" + ", ".join(f"(char){byte}" for byte in text or b"\0") + "}"
        values["text_size"] = f"{len(text)}u"
    name = MessageType(type_).name.lower()
    return f"(tl_{name})" + "{" + ", ".join(f".{field} = {value}" for field, value in values.items()) + "}"


def encode_call(vector: dict[str, Any]) -> str:
    name = MessageType(vector["type"]).name.lower()
    return f"tl_encode_{name}(frame, &source, {vector['tick_us']}u, &message)"


def test_c_passes_the_vectors(compiler: str, code: Path) -> None:
    body = []
    for vector in json.loads((VECTORS / "frames.json").read_text("utf-8"))["frames"]:
        data = bytes.fromhex(vector["hex"])
        body.append(f"""    {{
        tl_source source = {{{vector["hub"]}u, {vector["wheel"]}u, {vector["seq"]}u}};
        tl_{MessageType(vector["type"]).name.lower()} message = {c_message(vector["type"], vector["payload"])};
        size_t size = {encode_call(vector)};
        expect_frame("{vector["name"]}", frame, size, {c_bytes(data)}, {len(data)}u);
        expect("counter", source.seq == {(vector["seq"] + 1) % 2**32}u);
    }}""")
    for vector in json.loads((VECTORS / "streams.json").read_text("utf-8"))["streams"]:
        data = bytes.fromhex(vector["hex"])
        expected = ", ".join(
            str(vector["counters"][name]) for name in ("intact", "crc_errors", "noise_bytes", "truncated")
        )
        body.append(
            f'    expect_stream("{vector["name"]}", {c_bytes(data)}, {len(data)}u, (const size_t[4]){{{expected}}});'
        )
    assert run_harness(compiler, code, "\n".join(body)) == ""


def test_the_harness_notices_a_difference(compiler: str, code: Path) -> None:
    vector = json.loads((VECTORS / "frames.json").read_text("utf-8"))["frames"][0]
    data = bytearray.fromhex(vector["hex"])
    data[20] ^= 1
    body = f"""    {{
        tl_source source = {{0u, 3u, 7u}};
        tl_samples message = {c_message(vector["type"], vector["payload"])};
        size_t size = {encode_call(vector)};
        expect_frame("changed", frame, size, {c_bytes(bytes(data))}, {len(data)}u);
    }}"""
    assert "FAILED changed" in run_harness(compiler, code, body)


REFUSED = {
    "hello.axes = 0u;": "hello",
    "hello.axes = 8u;": "hello",
    "hello.coupling = 2u;": "hello",
    "hello.rate_hz = 1999.0f;": "hello",
    "hello.rate_hz = zero / zero;": "hello",
    "hello.scale_mps2[2] = 1.0f / zero;": "hello",
    "hello.range_mps2[1] = -1.0f;": "hello",
    "hello.saturation_counts = 0u;": "hello",
    "hello.scale_mps2[2] = 0.0f;": "hello",
    "hello.coupling = 0u; hello.highpass_hz = 2.5f;": "hello",
    "samples.axes = 7u;": "samples",
    "samples.n = 0u;": "samples",
    "hub_status.battery_percent = 101u;": "hub_status",
    "log_text.text_size = 224u;": "log_text",
    "set_stream.running = 2u;": "set_stream",
    "set_rate.rate_hz = 1999.0f;": "set_rate",
    "set_rate.rate_hz = zero / zero;": "set_rate",
}


def test_c_rejects_values_out_of_range(compiler: str, code: Path) -> None:
    frames = {
        MessageType(vector["type"]): vector
        for vector in json.loads((VECTORS / "frames.json").read_text("utf-8"))["frames"]
    }
    radial = {"first_sample": 0, "axes": 4, "n": 109, "counts": [0] * 327}
    good = {
        "hello": c_message(1, frames[MessageType.HELLO]["payload"]),
        "samples": c_message(2, radial),
        "hub_status": c_message(4, frames[MessageType.HUB_STATUS]["payload"]),
        "log_text": c_message(6, {"level": 1, "text": "x" * 224}),
        "set_stream": c_message(32, {"running": 1}),
        "set_rate": c_message(33, {"rate_hz": 9600.0}),
    }
    body = ["    volatile float zero = 0.0f;"]
    for change, name in REFUSED.items():
        body.append(f"""    {{
        tl_source source = {{0u, 0u, 5u}};
        tl_{name} {name} = {good[name]};
        {change}
        frame[0] = 1;
        expect("{change}", tl_encode_{name}(frame, &source, 0u, &{name}) == 0);
        expect("{change} counts", source.seq == 5u && frame[0] == 1);
    }}""")
    assert run_harness(compiler, code, "\n".join(body)) == ""


def test_c_reads_commands(compiler: str, code: Path) -> None:
    vectors = json.loads((VECTORS / "frames.json").read_text("utf-8"))
    body = []
    for vector in vectors["frames"]:
        for type_ in COMMANDS:
            name = type_.name.lower()
            frame = c_bytes(bytes.fromhex(vector["hex"]))
            if vector["type"] != type_:
                body.append(f"""    {{
        tl_{name} message;
        expect("not {name}: {vector["name"]}", !tl_decode_{name}({frame}, &message));
    }}""")
                continue
            holds = " && ".join(f"message.{key} == {c_value(value)}" for key, value in vector["payload"].items())
            changed = [bytearray.fromhex(vector["hex"]) for _ in range(3)]
            for data, position in zip(changed, (2, 4, 7), strict=True):
                data[position] += 1
            body.append(f"""    {{
        tl_{name} message = {{0}};
        expect("{vector["name"]}", tl_decode_{name}({frame}, &message) && {holds});
        expect("newer {name}", !tl_decode_{name}({c_bytes(bytes(changed[0]))}, &message));
        expect("long {name}", !tl_decode_{name}({c_bytes(bytes(changed[1]))}, &message));
        expect("flagged {name}", !tl_decode_{name}({c_bytes(bytes(changed[2]))}, &message));
    }}""")
    for vector in vectors["refused_payloads"]:
        if vector["type"] in COMMANDS:
            name = MessageType(vector["type"]).name.lower()
            frame = encode_raw(vector["type"], bytes.fromhex(vector["payload_hex"]), 255, 255, 0, 0)
            body.append(f"""    {{
        tl_{name} message;
        expect("{vector["name"]}", !tl_decode_{name}({c_bytes(frame)}, &message));
    }}""")
    assert len(body) > len(vectors["frames"])
    assert run_harness(compiler, code, "\n".join(body)) == ""


def test_c_signatures_match_the_vectors(compiler: str, code: Path) -> None:
    vectors = json.loads((VECTORS / "signed.json").read_text("utf-8"))
    body = ["    tl_signer signer;", "    uint8_t mac[16];"]
    for vector in vectors["macs"]:
        message = bytes.fromhex(vector["message"])
        body.append(f"""    tl_signer_init(&signer, {c_bytes(bytes.fromhex(vector["key"]))}, 0u, 0u);
    tl_cmac(&signer, {c_bytes(message)}, {len(message)}u, mac);
    expect("{vector["name"]}", memcmp(mac, {c_bytes(bytes.fromhex(vector["mac"]))}, 16) == 0);""")
    for vector in vectors["signed"]:
        unsigned, signed = bytes.fromhex(vector["unsigned"]), bytes.fromhex(vector["signed"])
        body.append(f"""    tl_signer_init(&signer, {c_bytes(bytes.fromhex(vector["key"]))}, 0x{vector["identity"]}ull,
                   {vector["boot_count"]}u);
    memcpy(frame, {c_bytes(unsigned)}, {len(unsigned)}u);
    expect("{vector["name"]}", tl_sign(frame, &signer) == {len(signed)}u);
    expect_frame("{vector["name"]}", frame, {len(signed)}u, {c_bytes(signed)}, {len(signed)}u);
    expect("{vector["name"]} twice", tl_sign(frame, &signer) == 0);
    expect_frame("{vector["name"]} twice", frame, {len(signed)}u, {c_bytes(signed)}, {len(signed)}u);""")
    long = encode_raw(6, b"\1" + bytes(216), 0, 0, 0, 0)
    body.append(f"""    memcpy(frame, {c_bytes(long)}, {len(long)}u);
    expect("no room", tl_sign(frame, &signer) == 0);
    expect_frame("no room", frame, {len(long)}u, {c_bytes(long)}, {len(long)}u);""")
    assert len(vectors["macs"]) == 4
    assert len(vectors["signed"]) >= 5
    assert run_harness(compiler, code, "\n".join(body)) == ""


@pytest.mark.parametrize("part", ["key", "message", "identity", "boot_count"])
def test_the_harness_notices_another_signature(compiler: str, code: Path, part: str) -> None:
    vector = json.loads((VECTORS / "signed.json").read_text("utf-8"))["signed"][0]
    key, unsigned = bytearray.fromhex(vector["key"]), bytearray.fromhex(vector["unsigned"])
    key[0] ^= part == "key"
    unsigned[20] ^= part == "message"
    identity = int(vector["identity"], 16) ^ (part == "identity")
    boot_count = vector["boot_count"] ^ (part == "boot_count")
    signed = bytes.fromhex(vector["signed"])
    body = f"""    tl_signer signer;
    tl_signer_init(&signer, {c_bytes(bytes(key))}, {identity}ull, {boot_count}u);
    memcpy(frame, {c_bytes(bytes(unsigned))}, {len(unsigned)}u);
    size_t size = tl_sign(frame, &signer);
    expect("tag", memcmp(frame + size - 12, {c_bytes(signed[-12:-4])}, 8) == 0);"""
    assert "FAILED tag" in run_harness(compiler, code, body)


def test_header_compiles_on_its_own_and_as_cpp(compiler: str, code: Path) -> None:
    for language in ("c", "c++"):
        standard = "-std=c11" if language == "c" else "-std=c++11"
        checked = subprocess.run(
            [compiler, "-x", language, standard, "-Wall", "-Wextra", "-Werror", "-fsyntax-only", code / HEADER_NAME],
            capture_output=True,
            text=True,
            check=False,
        )
        if "cc1plus" in checked.stderr:
            continue  # a gcc without C++
        assert checked.returncode == 0, checked.stderr
