"""Policies other than `require`, keys that nobody would use, and what a killed process leaves."""

import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Frame, Hello, MessageType, SampleBlock
from firmware_protocol.signing import is_signed
from gateway.config.vehicle import VehicleConfig, parse_vehicle
from gateway.reasons import Code, Reason
from gateway.security.cmac import SecurityError
from gateway.security.freshness import Ledger
from gateway.security.guard import open_guard
from gateway.security.key_file import KeyFile
from gateway.session.security_watch import SecurityWatch
from tools.generators.security_attacks import Sender, downgraded, guard, hello

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
    for k, (genuine, forged) in enumerate(zip(STREAM, hostile, strict=True)):
        got += decoder.feed(genuine)
        heard = STREAM[: k + 1]
        for frame in forged:
            if not is_signed(frame) or frame in heard:
                got += decoder.feed(frame)
    assert seqs(got) == [(k % 2, 1 + k // 2) for k in range(len(STREAM))]
    assert not [f for f in got if isinstance(f.message, Hello) and f.wheel in (0, 1) and f.message.sensor_id == 0xBAD]


def test_before_and_beside_a_verified_source_warn_lets_unsigned_frames_pass() -> None:
    watching = guard(requires=False)
    gate = watching.gate("link")
    unsigned = Sender()
    assert gate(downgraded(unsigned.hello(0)))
    assert watching.take_notices()[-1].reason["consequence"] == Reason(Code.FRAMES_USED)
    assert gate(HELLOS[0])
    assert not gate(downgraded(STREAM[0]))
    assert watching.take_notices()[-1].reason["consequence"] == Reason(Code.FRAMES_IGNORED)
    assert gate(downgraded(unsigned.hello(1)))


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
    assert Code.NO_KEYS in [notice.reason.code for notice in opened.take_notices()]


def test_the_first_frame_of_every_start_is_stored_at_once(tmp_path: Path) -> None:
    path = tmp_path / "counters"
    watching = guard(Ledger(path))
    watch = SecurityWatch(watching)
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
