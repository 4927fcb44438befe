"""Security policies through whole sessions, keys that nobody would use; no socket listens beyond this computer."""

import ast
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Frame, Hello, MessageType, SampleBlock
from firmware_protocol.signing import is_signed
from firmware_protocol.wire import TYPE_OFFSET
from gateway.core.clock import ManualClock
from gateway.core.config.vehicle import VehicleConfig, parse_vehicle
from gateway.core.errors import ConfigError, TreadlinkError
from gateway.core.links.source import Chunk, open_source
from gateway.core.reasons import Code, Level, Notice, Reason
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.core import SessionCore
from gateway.core.session.frame_guard import GuardWatch
from gateway.core.session.missing_results import missing_frames
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recording_pass import RecordingPass, open_recording
from gateway.core.text.wording import notice_text, text
from gateway.security.cmac import SecurityError
from gateway.security.freshness import Ledger
from gateway.security.guard import Verdict, open_guard
from gateway.security.key_file import KeyFile, counters_file
from gateway.security.reasons import SecurityCode
from tests.testkit.agreement import values_of
from tests.testkit.commands import invoked
from tools.generators.security_attacks import Sender, downgraded, forged, guard, hello, with_crc

ROOT = Path(__file__).parents[2]
NAMES = ("0000a001", "0000a002", "0000a003", "0000a004", "0000b001", "5452454144000000")


@pytest.fixture(scope="module")
def key_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = KeyFile(tmp_path_factory.mktemp("keys") / "keys")
    for name in NAMES:
        file.make(name)
    file.save()
    return file.path


@pytest.fixture(scope="module")
def signed(key_file: Path) -> tuple[list[Chunk], str]:
    """Four signed wheels and their configuration."""
    source = open_source(f"sim:demo?speed=max&duration=3&seed=3&keys={key_file}", ManualClock())
    return [item for item in source.items(threading.Event()) if isinstance(item, Chunk)], source.vehicle_toml or ""


def run(
    chunks: list[Chunk], toml: str, key_file: Path | None, **options: object
) -> tuple[SessionCore, list[object], list[Notice]]:
    """Return the session after its end, its results and its notices."""
    vehicle = parse_vehicle(toml, "test")
    core = SessionCore(vehicle, guard=open_guard(vehicle, key_file, remembers=False), **options)
    results = [result for chunk in chunks for result in core.take(chunk)]
    results += core.finish()
    return core, results, core.take_notices()


def codes_of(notices: list[Notice]) -> list[Code]:
    return [notice.reason.code for notice in notices]


def frames_of(chunk: Chunk) -> list[bytes]:
    data, frames = chunk.data, []
    while data:
        size = 20 + data[4]
        frames.append(data[:size])
        data = data[size:]
    return frames


def under_attack(chunks: list[Chunk], seed: int) -> list[Chunk]:
    """Put forged, replayed and downgraded frames between the genuine ones."""
    rng = np.random.default_rng(seed)
    hostile: list[Chunk] = []
    heard: list[bytes] = []
    for chunk in chunks:
        parts: list[bytes] = []
        for frame in frames_of(chunk):
            if len(heard) > 50 and len(frame) > 200:
                parts += [forged(frame, rng), downgraded(frame), heard[rng.integers(len(heard))]]
            parts.append(frame)
            if frame[6] != 255:  # the hub's first frames come before a hello, so they were not accepted yet
                heard.append(frame)
        hostile.append(Chunk(chunk.link, chunk.host_ns, b"".join(parts)))
    return hostile


def test_attacker_does_not_change_estimates(signed: tuple[list[Chunk], str], key_file: Path) -> None:
    chunks, toml = signed
    alone, plain, notices = run(chunks, toml, key_file)
    attacked, remaining, warned = run(under_attack(chunks, 5), toml, key_file)
    assert len(plain) > 40
    assert [(r.position, r.host_ns, values_of(r.estimates)) for r in plain] == [
        (r.position, r.host_ns, values_of(r.estimates)) for r in remaining
    ]
    assert not [notice for notice in notices if notice.level is Level.SECURITY]
    link = attacked.snapshot(1.0).links[0]
    assert link.judged["verified"] == alone.snapshot(1.0).links[0].judged["verified"]
    assert min(link.judged[name] for name in ("wrong tag", "unsigned")) > 1000
    assert link.judged["replayed"] + link.judged["too late"] > 1000
    assert link.frames_lost == link.duplicates == link.reordered == 0
    (alarm,) = [alarm for alarm in attacked.snapshot(1.0).alarms if alarm.name == "security"]
    assert "wrong tag" in text(alarm.reason)
    faults = {n.reason["fault"] for n in warned if n.reason.code is SecurityCode.FRAME_NOT_TRUSTED}
    assert {Verdict.FORGED, Verdict.UNSIGNED} < faults
    assert {Verdict.REPLAYED, Verdict.TOO_LATE} & faults
    assert not [alarm for alarm in alone.snapshot(1.0).alarms if alarm.name == "security"]


def test_recording_keeps_refused_frames_but_no_key(
    signed: tuple[list[Chunk], str], key_file: Path, tmp_path: Path
) -> None:
    chunks, toml = signed
    hostile = under_attack(chunks, 6)
    path = tmp_path / "r.mcap"
    writer = RecordingWriter(path, start_ns=1, vehicle_toml=toml, sources=[f"sim:demo?keys={key_file}"])
    _, live, _ = run(hostile, toml, key_file, recorder=writer)
    recorded = [item for item in RecordingReader(path).items() if isinstance(item, Chunk)]
    assert b"".join(item.data for item in recorded) == b"".join(chunk.data for chunk in hostile)
    content = path.read_bytes()
    assert b"SECURITY" in content
    for name, key in KeyFile(key_file).keys.items():
        assert key.secret not in content, name
        assert key.secret.hex().encode() not in content.lower()
    # The recording gives the same results as the session.
    batch = RecordingPass(open_recording(RecordingReader(path), key_file=key_file))
    again = list(batch)

    def order(results: list[object]) -> list[object]:
        return sorted((r.position, r.host_ns, r.revolution.index) for r in results)

    assert order(again) == order(live)
    assert next(iter(batch.links.values())).refused > 3000
    assert not counters_file(key_file).exists()


def test_counters_are_saved_and_stop_a_replay(signed: tuple[list[Chunk], str], key_file: Path, tmp_path: Path) -> None:
    chunks, toml = signed
    selected = KeyFile(tmp_path / "keys")
    selected.add(KeyFile(key_file).keys)
    selected.save()
    vehicle = parse_vehicle(toml, "test")

    def session() -> tuple[SessionCore, int]:
        core = SessionCore(vehicle, guard=open_guard(vehicle, selected.path, remembers=True))
        for chunk in chunks[:100]:
            core.take(chunk)
            core.tick(chunk.host_ns)
        core.finish()
        return core, core.snapshot(1.0).links[0].judged.get("verified", 0)

    assert session()[1] > 500
    assert counters_file(selected.path).stat().st_mode & 0o777 == 0o600
    assert session()[1] == 0
    counters_file(selected.path).unlink()
    assert session()[1] > 500


def test_unsaved_counters_are_reported_once(
    signed: tuple[list[Chunk], str], key_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chunks, toml = signed
    selected = KeyFile(tmp_path / "keys")
    selected.add(KeyFile(key_file).keys)
    selected.save()
    vehicle = parse_vehicle(toml, "test")
    core = SessionCore(vehicle, guard=open_guard(vehicle, selected.path, remembers=True))

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    for number, chunk in enumerate(chunks[:100]):
        core.take(chunk)
        core.tick(number * 10**10)
    core.finish()
    assert codes_of(core.take_notices()).count(SessionCode.COUNTERS_NOT_SAVED) == 1
    assert core.snapshot(1.0).links[0].judged["verified"] > 500


def test_counters_that_a_slow_disk_saves_late_are_named(
    signed: tuple[list[Chunk], str], key_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chunks, toml = signed
    selected = KeyFile(tmp_path / "keys")
    selected.add(KeyFile(key_file).keys)
    selected.save()
    vehicle, disk = parse_vehicle(toml, "test"), threading.Event()
    core = SessionCore(vehicle, guard=open_guard(vehicle, selected.path, remembers=True))
    monkeypatch.setattr("gateway.core.session.frame_guard._JOIN_S", 0.05)
    monkeypatch.setattr("os.fsync", lambda _: disk.wait(20.0))
    try:
        for number, chunk in enumerate(chunks[:100]):
            core.take(chunk)
            core.tick(number * 10**10)
        saving = [thread for thread in threading.enumerate() if thread.name == "save counters"]
        core.finish()
    finally:
        disk.set()
    assert len(saving) == 1, "one at a time"
    saving[0].join(20.0)
    assert Reason(SessionCode.COUNTERS_NOT_SAVED, how="late") in [notice.reason for notice in core.take_notices()]
    assert core.snapshot(1.0).links[0].judged["verified"] > 500


def test_missing_keys_stop_estimates_with_a_reason(signed: tuple[list[Chunk], str], tmp_path: Path) -> None:
    chunks, toml = signed
    (tmp_path / "none").touch(0o600)
    core, results, notices = run(chunks, toml, tmp_path / "none")
    assert results == []
    assert core.snapshot(1.0).links[0].judged.keys() == {"no key", "before hello"}
    assert codes_of(notices).count(SecurityCode.KEY_MISSING) == 4


@pytest.mark.parametrize("policy", ["off", "warn"])
def test_other_policies_pass_all_frames(signed: tuple[list[Chunk], str], key_file: Path, policy: str) -> None:
    chunks, toml = signed
    bare = [Chunk(c.link, c.host_ns, b"".join(map(downgraded, frames_of(c)))) for c in chunks]
    core, results, notices = run(bare, toml.replace('"require"', f'"{policy}"'), key_file if policy == "warn" else None)
    assert len(results) > 40
    judged = core.snapshot(1.0).links[0].judged
    assert set(judged) == ({"unsigned"} if policy == "warn" else set())
    assert (SecurityCode.FRAME_NOT_TRUSTED in codes_of(notices)) == (policy == "warn")
    assert run(bare, toml, key_file)[1] == []


def test_frames_that_warn_lets_pass_beside_verified_ones_are_never_called_rejected(
    signed: tuple[list[Chunk], str], key_file: Path
) -> None:
    chunks, toml = signed
    mixed = [
        replace(chunk, data=b"".join(downgraded(part) if part[6] in (2, 3) else part for part in frames_of(chunk)))
        for chunk in chunks
    ]
    toml = toml.replace('policy = "require"', 'policy = "warn"')
    assert 'policy = "warn"' in toml
    core, results, notices = run(mixed, toml, key_file)
    assert len({result.position for result in results}) == 4
    said = [notice.reason for notice in notices if "consequence" in dict(notice.reason.values)]
    assert {reason["consequence"] for reason in said} == {Reason(SecurityCode.FRAMES_USED)}
    judged = core.snapshot(3.0).links[0].judged
    assert judged["verified"] > 500
    assert sum(judged.values()) - judged["verified"] > 500
    assert missing_frames(core.frame_counts()) == ()


def test_signed_frames_carry_the_same_samples(signed: tuple[list[Chunk], str], key_file: Path) -> None:
    chunks, toml = signed
    off = toml.replace('"require"', '"off"')
    _, verified, _ = run(chunks, toml, key_file)
    _, looked_over, _ = run(chunks, off, None)
    assert [values_of(r.estimates) for r in verified] == [values_of(r.estimates) for r in looked_over]


def test_swapped_wheels_are_reported(signed: tuple[list[Chunk], str], key_file: Path) -> None:
    chunks, toml = signed
    swapped = toml.replace("0000a001", "x").replace("0000a002", "0000a001").replace('"x"', '"0000a002"')
    _, results, notices = run(chunks, swapped, key_file)
    assert {result.position for result in results} == {"RL", "RR"}
    assert any("sensor 0000a001 of FR is here (" in notice_text(notice) for notice in notices)


def test_live_command_end_to_end(key_file: Path, tmp_path: Path) -> None:
    def call(*arguments: str) -> str:
        result = invoked(*arguments)
        assert result.exception is None, (result.output, result.exception)
        return result.output

    path = tmp_path / "r.mcap"
    uri = f"sim:lab?speed=max&duration=2&keys={key_file}"
    shown = call("live", uri, "--plain", "--keys", str(key_file), "--record", str(path))
    assert "verified" in shown
    assert "rejected because not verified" in call("estimate", str(path), "--keys", str(key_file))
    assert not counters_file(key_file).exists()
    result = invoked("live", f"{uri}&fault=reboot", "--plain")
    assert isinstance(result.exception, TreadlinkError)


def test_require_needs_every_sensor_id() -> None:
    toml = '[security]\npolicy = "require"\n[tire]\nradius_mm = 300.0\n[[wheel]]\nposition = "FL"\nhub = 0\nwheel = 0\n'
    with pytest.raises(ConfigError, match=r"wheel\[FL\].sensor_id"):
        parse_vehicle(toml, "test")
    with pytest.raises(ConfigError, match=r"security.policy"):
        parse_vehicle(toml.replace("require", "always"), "test")
    vehicle = parse_vehicle(toml.replace("require", "warn"), "test")
    assert 'policy = "warn"' in vehicle.to_toml()
    assert parse_vehicle(vehicle.to_toml(), "again") == vehicle
    assert open_guard(parse_vehicle(toml.replace("require", "off"), "test"), None, remembers=True) is None


# The addresses of these servers are those that the user gives after foxglove:// and web://, or loopback ones.
STATED_ADDRESSES = (
    "gateway/publishing/foxglove_server.py: foxglove.start_server(",
    "gateway/publishing/origin_gate.py: socket.create_server(",
    # A Unix socket in a folder of the user's own.
    "gateway/security/control_socket.py: listener.bind(str(path))",
    "gateway/publishing/page_listener.py: socket.create_server((host, port)",
)
LISTENERS = {"bind", "create_server", "start_server", "start_unix_server", "HTTPServer", "TCPServer", "run_app"}


def test_sockets_listen_on_loopback_only() -> None:
    """Every call that could open a listening socket must give the loopback address."""
    results = []
    for path in [*(ROOT / "gateway").rglob("*.py"), *(ROOT / "firmware_protocol").rglob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call):
                name = getattr(node.func, "attr", getattr(node.func, "id", ""))
                text = ast.unparse(node)
                if name in LISTENERS and "127.0.0.1" not in text and "::1" not in text:
                    results.append(f"{path.relative_to(ROOT)}: {text}")
            if isinstance(node, ast.Constant) and node.value in ("0.0.0.0", "::"):
                results.append(f"{path.relative_to(ROOT)}: {node.value}")
    assert [item for item in results if not item.startswith(STATED_ADDRESSES)] == []


GENUINE = Sender()
HELLOS = [GENUINE.hello(0), GENUINE.hello(1)]
STREAM = [GENUINE.samples(k % 2) for k in range(60)]
PLAIN = FrameDecoder().feed(b"".join(map(downgraded, (HELLOS[0], STREAM[0]))))[1]
HOSTILE = st.one_of(
    st.sampled_from([downgraded(frame) for frame in STREAM]),
    st.sampled_from([downgraded(frame) for frame in HELLOS]),
    st.sampled_from(STREAM),
    st.builds(
        lambda wheel, seq: encode_frame(Frame(MessageType.HELLO, 0, wheel, seq, 0, hello(0xBAD, 99))),
        st.integers(0, 9),
        st.integers(0, 2**32 - 1),
    ),
    st.integers(0, 2**32 - 1).map(lambda seq: encode_frame(PLAIN._replace(seq=seq))),
)


def seqs(frames: list[Frame]) -> list[tuple[int, int]]:
    return [(f.wheel, f.seq) for f in frames if isinstance(f.message, SampleBlock) and f.wheel in (0, 1)]


@settings(max_examples=100)
@given(st.lists(st.lists(HOSTILE, max_size=3), min_size=len(STREAM), max_size=len(STREAM)))
def test_a_verified_source_loses_nothing_to_unverified_frames(hostile: list[list[bytes]]) -> None:
    decoder = FrameDecoder(guard(requires=False).gate("link"))
    decoder.feed(b"".join(HELLOS))
    got: list[Frame] = []
    for k, (genuine, forgeries) in enumerate(zip(STREAM, hostile, strict=True)):
        got += decoder.feed(genuine)
        heard = STREAM[: k + 1]
        for frame in forgeries:
            if not is_signed(frame) or frame in heard:
                got += decoder.feed(frame)
    assert seqs(got) == [(k % 2, 1 + k // 2) for k in range(len(STREAM))]
    assert not [f for f in got if isinstance(f.message, Hello) and f.wheel in (0, 1) and f.message.sensor_id == 0xBAD]


def test_before_and_beside_a_verified_source_warn_lets_unsigned_frames_pass() -> None:
    watching = guard(requires=False)
    gate = watching.gate("link")
    unsigned = Sender()
    assert gate(downgraded(unsigned.hello(0)))
    assert watching.take_notices()[-1].reason["consequence"] == Reason(SecurityCode.FRAMES_USED)
    assert gate(HELLOS[0])
    assert not gate(downgraded(STREAM[0]))
    assert watching.take_notices()[-1].reason["consequence"] == Reason(SecurityCode.FRAMES_IGNORED)
    assert gate(downgraded(unsigned.hello(1)))


@pytest.mark.parametrize(
    ("policy", "consequence", "missing"),
    [
        ("warn", SecurityCode.FRAMES_USED, Reason(SessionCode.NO_FRAME_RECEIVED)),
        ("require", SecurityCode.FRAMES_IGNORED, Reason(SessionCode.ALL_FRAMES_REFUSED, count=40)),
    ],
)
def test_frames_without_use_are_called_rejected_only_where_they_were(
    policy: str, consequence: Code, missing: Reason, tmp_path: Path
) -> None:
    keys = KeyFile(tmp_path / "keys")
    keys.make("0000a001")
    keys.save()
    config = vehicle(policy)
    core = SessionCore(config, guard=open_guard(config, tmp_path / "keys", remembers=False))
    # Unsigned, and of a type that this version does not know.
    plain = bytearray(downgraded(STREAM[0]))
    plain[TYPE_OFFSET] = 0x7F
    core.take(Chunk("link", 1, 40 * with_crc(bytes(plain))))
    core.finish()
    said = [notice.reason for notice in core.take_notices() if "consequence" in dict(notice.reason.values)]
    assert {reason["consequence"] for reason in said} == {Reason(consequence)}
    assert [notice.reason for notice in missing_frames(core.frame_counts())] == [missing]


def vehicle(policy: str) -> VehicleConfig:
    wheel = '[[wheel]]\nposition = "FL"\nhub = 0\nwheel = 0\nsensor_id = "0000a001"\n[tire]\nradius_mm = 300.0\n'
    return parse_vehicle(f'{wheel}[security]\npolicy = "{policy}"\n', "test")


@pytest.mark.parametrize("policy", [None, "off", "warn", "require"])
def test_a_key_file_that_is_given_must_exist_and_be_of_use(tmp_path: Path, policy: str | None) -> None:
    config = None if policy is None else vehicle(policy)
    with pytest.raises(SecurityError, match="does not exist"):
        open_guard(config, tmp_path / "none", remembers=False)
    keys = KeyFile(tmp_path / "keys")
    keys.make("0000a001")
    keys.save()
    if policy in ("warn", "require"):
        opened = open_guard(config, tmp_path / "keys", remembers=False)
        assert opened is not None
        assert opened.take_notices() == []
    else:
        with pytest.raises(SecurityError, match="would verify nothing"):
            open_guard(config, tmp_path / "keys", remembers=False)
        assert open_guard(config, None, remembers=False) is None


@pytest.mark.parametrize("policy", ["warn", "require"])
def test_a_policy_without_keys_is_reported(tmp_path: Path, policy: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.security.key_file.default_key_file", lambda: tmp_path / "keys")
    opened = open_guard(vehicle(policy), None, remembers=False)
    assert opened is not None
    assert SecurityCode.NO_KEYS in [notice.reason.code for notice in opened.take_notices()]


def test_the_first_frame_of_every_start_is_stored_at_once(tmp_path: Path) -> None:
    path = tmp_path / "counters"
    watching = guard(Ledger(path))
    watch = GuardWatch(watching)
    for step, boot_count in enumerate((7, 8)):
        watch.tick(1 + step)  # nothing new yet
        assert watch._saving is not None
        watch._saving.join()  # while it runs, no other begins
        sender = Sender(boot_count=boot_count)
        assert watching.gate("link")(sender.hello(0))
        watch.tick(2 + step)
        watch._saving.join()
        again = guard(Ledger(path)).gate("link")
        assert not again(Sender(boot_count=boot_count).hello(0))


@pytest.mark.skipif(sys.platform == "win32", reason="core files are of POSIX")
def test_a_process_with_keys_leaves_no_core_file(tmp_path: Path) -> None:
    program = (
        "import resource, sys; from pathlib import Path; from gateway.security.key_file import KeyFile\n"
        "hard = resource.getrlimit(resource.RLIMIT_CORE)[1]; resource.setrlimit(resource.RLIMIT_CORE, (hard, hard))\n"
        "KeyFile(Path(sys.argv[1])); print(resource.getrlimit(resource.RLIMIT_CORE)[0])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, tmp_path / "keys"], capture_output=True, text=True, check=True
    )
    assert done.stdout == "0\n"
