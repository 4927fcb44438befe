"""Only new frames of the genuine sensor pass the guard."""

from collections import Counter
from pathlib import Path

import pytest

from firmware_protocol.block_decoder import BatchDecoder
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import HUB_ITSELF
from gateway.core.reasons import Level, Reason
from gateway.core.session.frame_guard import Verdict
from gateway.core.text.wording import notice_text
from gateway.security.cmac import Key
from gateway.security.freshness import WINDOW, Ledger
from gateway.security.guard import ConfiguredWheel, Guard
from gateway.security.key_file import counters_file, hub_identity
from gateway.security.reasons import SecurityCode
from tools.generators.security_attacks import (
    HUB,
    KEYS,
    PLACES,
    SENSORS,
    Sender,
    attacks,
    downgraded,
    forged,
    guard,
    hello,
    with_crc,
)

COUNT = 2000
VERDICTS = {
    "forged": {Verdict.FORGED},
    "changed in flight": {Verdict.FORGED, Verdict.EARLY},
    "replayed": {Verdict.REPLAYED, Verdict.TOO_LATE},
    "replayed from an earlier start": {Verdict.FORGED, Verdict.EARLIER_START},
    "late beyond the window": {Verdict.TOO_LATE},
    "wrong key": {Verdict.FORGED},
    "unsigned": {Verdict.UNSIGNED},
    "tag taken off": {Verdict.UNSIGNED},
}


def test_attacks_are_refused_counted_and_reported() -> None:
    seen = set()
    for name, before, frames in attacks(COUNT, seed=1):
        watching = guard()
        before(watching)
        gate = watching.gate("link")
        genuine = gate.counts[Verdict.VERIFIED]
        watching.take_notices()
        accepted = sum(map(gate, frames))
        assert accepted == 0, name
        assert gate.counts[Verdict.VERIFIED] == genuine
        assert sum(gate.counts.values()) == genuine + COUNT
        assert {verdict for verdict in gate.counts if verdict is not Verdict.VERIFIED} <= VERDICTS[name], (
            name,
            gate.counts,
        )
        notices = watching.take_notices()
        assert notices, name
        assert len(notices) < 12
        assert {notice.level for notice in notices} == {Level.SECURITY}
        assert all(notice.reason["consequence"] == Reason(SecurityCode.FRAMES_IGNORED) for notice in notices)
        seen.add(name)
    assert seen == VERDICTS.keys()


def test_genuine_sensor_passes_during_attacks() -> None:
    for name, before, frames in attacks(300, seed=2):
        watching = guard()
        before(watching)
        # The genuine sensor continues where the recorded session stopped.
        sender = Sender()
        sender.seq = dict.fromkeys(sender.seq, 5000)
        gate = watching.gate("link")
        for frame in frames:
            assert not gate(frame), name
            assert gate(sender.samples()), name


@pytest.mark.parametrize("byte", [*range(2, 32), -13, -12, -5])
def test_every_byte_is_protected(byte: int) -> None:
    sender, watching = Sender(), guard()
    gate = watching.gate("link")
    assert gate(sender.hello())
    frame = bytearray(sender.samples())
    for bit in range(8):
        changed = bytearray(frame)
        changed[byte] ^= 1 << bit
        if byte != 4:  # to a decoder, another length is another frame
            assert not gate(with_crc(bytes(changed)))
    assert gate(bytes(frame))


@pytest.mark.parametrize("order", [[1, 0], [63, *range(63)], [5, 3, 4, 0, 2, 1]])
def test_late_frames_within_the_window_pass_once(order: list[int]) -> None:
    sender, gate = Sender(), guard().gate("link")
    gate(sender.hello())
    frames = [sender.samples() for _ in range(64)]
    assert all(gate(frames[index]) for index in order)
    assert not any(gate(frames[index]) for index in order)


def test_frames_later_than_the_window_are_refused() -> None:
    sender, gate = Sender(), guard().gate("link")
    gate(sender.hello())
    late = [sender.samples() for _ in range(2)]
    for _ in range(WINDOW - 2):
        gate(sender.samples())
    assert gate(sender.samples())
    assert not gate(late[0])
    assert gate.counts[Verdict.TOO_LATE] == 1
    assert gate(late[1])


def test_restart_is_followed_without_its_hello() -> None:
    gate = guard().gate("link")
    for boot_count in (7, 8, 20):
        sender = Sender(boot_count)
        assert gate(sender.hello())
        assert gate(sender.samples())
        assert gate(sender.status())
    following = Sender(21)
    following.hello()
    assert gate(following.samples())
    assert not gate(Sender(20).hello())


def test_counters_persist_after_session(tmp_path: Path) -> None:
    path = tmp_path / "counters"
    sender = Sender()
    heard = [sender.hello(), *(sender.samples() for _ in range(100))]
    first = guard(Ledger(path))
    assert all(map(first.gate("link"), heard))
    first.ledger.save()
    assert path.stat().st_mode & 0o777 == 0o600
    second = guard(Ledger(path))
    gate = second.gate("link")
    assert not any(map(gate, heard))
    # The sensor is recognised during its start, before its next hello.
    assert gate(sender.samples())
    assert gate(sender.hello())
    second.ledger.save()
    assert not any(map(guard(Ledger(path)).gate("other link"), heard))


def replaced_hub(boot_count: int) -> Sender:
    """Return a hub of another serial number that took over the sensors."""
    keys = {**KEYS, hub_identity(HUB + 1): Key(bytes(range(48, 64)))}
    sender = Sender(boot_count, keys)
    sender.hello = lambda wheel=0: sender.send(  # type: ignore[method-assign]
        wheel, hello(SENSORS[wheel], boot_count)._replace(hub_id=HUB + 1)
    )
    return sender


def heard_before(path: Path, boot_count: int = 41) -> list[bytes]:
    """Return the frames of a session that the gateway accepted and whose counters it saved."""
    sender = Sender(boot_count)
    session = [sender.hello(), *(sender.samples() for _ in range(50))]
    watching = guard(Ledger(path))
    assert all(map(watching.gate("link"), session))
    watching.ledger.save()
    return session


def test_replaced_hub_with_lower_boot_count_is_named(tmp_path: Path) -> None:
    heard_before(tmp_path / "counters")
    watching = guard(Ledger(tmp_path / "counters"))
    gate = watching.gate("link")
    sender = replaced_hub(3)
    assert not any(map(gate, [sender.hello(), sender.samples(), sender.samples()]))
    assert gate.counts == {Verdict.EARLIER_START: 3}
    (notice,) = watching.take_notices()
    position = Reason(
        SecurityCode.SIGNER,
        who="sensor_at_hub",
        signer=Reason(SecurityCode.SIGNER, who="sensor", identity="0000a001"),
        hub=hub_identity(HUB + 1),
    )
    ignored = Reason(SecurityCode.FRAMES_IGNORED)
    assert notice.reason == Reason(
        SecurityCode.FRAME_EARLIER_START,
        signer=position,
        start=3,
        latest=41,
        identity="0000a001",
        count=1,
        consequence=ignored,
    )
    assert "treadlink keys new 0000a001 --replace" in notice_text(notice)


def test_replaced_hub_passes_above_the_last_boot_count(tmp_path: Path) -> None:
    session = heard_before(tmp_path / "counters")
    gate = guard(Ledger(tmp_path / "counters")).gate("link")
    sender = replaced_hub(42)
    assert gate(sender.hello())
    assert gate(sender.samples())
    assert not any(map(gate, session))


def test_replaced_hub_passes_with_a_new_key(tmp_path: Path) -> None:
    session = heard_before(tmp_path / "counters")
    keys = {**KEYS, "0000a001": Key(bytes(range(64, 80)))}
    gate = Guard(PLACES, keys, Ledger(tmp_path / "counters"), requires=True).gate("link")
    sender = Sender(3, keys)
    assert gate(sender.hello())
    assert gate(sender.samples())
    assert not any(map(gate, session))


def test_replayed_earlier_start_does_not_displace_the_sensor(tmp_path: Path) -> None:
    old = heard_before(tmp_path / "counters", 7)
    heard_before(tmp_path / "counters", 8)
    gate = guard(Ledger(tmp_path / "counters")).gate("link")
    assert not any(map(gate, old))
    sender = Sender(8)
    sender.seq = dict.fromkeys(sender.seq, 5000)
    # The sensor is in the same start as in the last session, and no hello of it has come yet.
    assert gate(sender.samples())
    assert not any(map(gate, old))
    assert gate(sender.hello())


def test_earlier_start_on_another_link_is_refused() -> None:
    watching = guard()
    first, other = watching.gate("one"), watching.gate("other")
    old, new = Sender(7), Sender(8)
    assert first(old.hello())
    assert other(new.hello())
    assert not first(old.samples())
    assert first.counts[Verdict.EARLIER_START] == 1
    assert [notice.reason.code for notice in watching.take_notices()] == [SecurityCode.FRAME_EARLIER_START]


def test_two_sessions_keep_the_higher_counter(tmp_path: Path) -> None:
    path = tmp_path / "counters"
    first, other = Ledger(path), Ledger(path)
    first.counter("0000a001", "c0ffee").take(1000)
    other.counter("0000a001", "c0ffee").take(10)
    other.counter("0000a002", "c0ffee").take(5)
    first.save()
    other.save()
    assert Ledger(path).counter("0000a001", "c0ffee").highest == 1000
    assert Ledger(path).counter("0000a002", "c0ffee").highest == 5


def test_frame_of_one_link_is_old_on_another() -> None:
    sender, watching = Sender(), guard()
    frames = [sender.hello(), sender.samples()]
    assert all(map(watching.gate("one"), frames))
    assert not any(map(watching.gate("other"), frames))


def test_swapped_sensors_are_reported_and_ignored() -> None:
    swapped = Sender(sensors={0: SENSORS[1], 1: SENSORS[0]})
    watching = guard()
    gate = watching.gate("link")
    frames = [swapped.hello(0), swapped.hello(1), swapped.samples(0), swapped.samples(1)]
    assert not any(map(gate, frames))
    assert gate.counts == {Verdict.NOT_ADMITTED: 4}
    notices = {notice.subject: notice.reason for notice in watching.take_notices()}
    ignored = Reason(SecurityCode.FRAMES_IGNORED)
    for position, sensor, owner in (("FL", "0000a002", "FR"), ("FR", "0000a001", "FL")):
        assert notices[f"link, {position}"] == Reason(
            SecurityCode.SENSOR_NOT_ADMITTED, how="swapped", sensor=sensor, owner=owner, count=1, consequence=ignored
        )


def test_unknown_sensor_is_ignored_until_admitted() -> None:
    unknown = Sender(sensors={0: 0xBEEF}, keys={**KEYS, "0000beef": KEYS["0000a001"]})
    watching = guard()
    gate = watching.gate("link")
    assert not any(map(gate, [unknown.hello(), unknown.samples()]))
    assert gate.counts == {Verdict.NO_KEY: 2}
    (notice,) = watching.take_notices()
    assert notice.reason["signer"] == Reason(SecurityCode.SIGNER, who="sensor", identity="0000beef")
    with_key = Guard(PLACES, {**KEYS, "0000beef": KEYS["0000a001"]}, Ledger(), requires=True)
    assert not any(map(with_key.gate("link"), [unknown.hello(), unknown.samples()]))
    (notice,) = with_key.take_notices()
    assert notice.reason.kind == (SecurityCode.SENSOR_NOT_ADMITTED, "other")
    assert (notice.reason["sensor"], notice.reason["expected"]) == ("0000beef", "0000a001")
    admitted = Guard(
        {(0, 0): ConfiguredWheel("FL", "0000beef")}, {**KEYS, "0000beef": KEYS["0000a001"]}, Ledger(), requires=True
    )
    assert all(map(admitted.gate("link"), [unknown.hello(), unknown.samples()]))


def test_unconfigured_wheel_is_ignored() -> None:
    elsewhere = Sender(sensors={9: SENSORS[0]})
    watching = guard()
    assert not any(map(watching.gate("link"), [elsewhere.hello(9), elsewhere.samples(9)]))
    (notice,) = watching.take_notices()
    assert notice.subject == "link, hub 0 wheel 9"
    assert (notice.reason["how"], notice.reason["owner"]) == ("swapped", "FL")


def test_hub_passes_after_a_genuine_sensor_hello() -> None:
    sender, watching = Sender(), guard()
    gate = watching.gate("link")
    assert not gate(sender.status())
    assert gate.counts == {Verdict.EARLY: 1}
    assert gate(sender.hello())
    assert gate(sender.status())
    assert not gate(downgraded(sender.status()))


def test_policy_warn_passes_and_reports() -> None:
    sender, watching = Sender(), guard(requires=False)
    gate = watching.gate("link")
    assert gate(sender.samples(signed=False))
    assert gate(sender.samples(signed=False))
    assert gate(sender.hello())
    assert gate.counts == {Verdict.VERIFIED: 1, Verdict.UNSIGNED: 2}
    (notice,) = watching.take_notices()
    assert notice.reason == Reason(
        SecurityCode.FRAME_NOT_TRUSTED, fault="unsigned", count=1, consequence=Reason(SecurityCode.FRAMES_USED)
    )


def test_missing_keys_are_reported_at_the_start() -> None:
    watching = Guard(PLACES, {}, Ledger(), requires=True)
    assert len(watching.take_notices()) == 2
    assert watching.take_notices() == []


def test_identity_flood_keeps_state_bounded() -> None:
    import numpy as np

    rng = np.random.default_rng(3)
    watching = guard()
    gate = watching.gate("link")
    sender = Sender()
    gate(sender.hello())
    notices = 0
    for number in range(3000):
        impostor = Sender(sensors={0: number + 10}, keys={**KEYS, f"{number + 10:08x}": KEYS["0000a001"]})
        assert not gate(impostor.hello())
        notices += len(watching.take_notices())
        assert not gate(forged(sender.samples(), rng))
    assert notices < 8
    assert gate(sender.samples())


def test_forged_frames_do_not_displace_genuine_ones() -> None:
    import numpy as np

    rng = np.random.default_rng(4)
    sender = Sender()
    stream, genuine = [], 0
    for _ in range(300):
        frame = sender.samples() if genuine else sender.hello()
        genuine += 1
        # The attacker is faster: its frame with the counter of the next genuine one comes first.
        stream += [forged(frame, rng), with_crc(frame[:-12] + rng.bytes(8) + frame[-4:]), frame]
    data = b"".join(stream)
    streaming, batch = FrameDecoder(guard().gate("a")), BatchDecoder(1 << 14, guard().gate("a"))
    frames = streaming.feed(data) + streaming.finish()
    assert len(frames) == genuine
    assert [frame.seq for frame in frames] == list(range(genuine))
    assert [frame.seq for frame in batch.feed(data).frames()] == list(range(genuine))
    for counters in (streaming.counters, batch.counters):
        assert counters.refused == 2 * genuine
        assert (counters.lost, counters.duplicates, counters.reordered, counters.restarts) == (0, 0, 0, 0)


def test_hub_hello_admits_no_sensor() -> None:
    sender, gate = Sender(), guard().gate("link")
    gate(sender.hello())
    assert not gate(with_crc(sender.send(HUB_ITSELF, hello(SENSORS[0], 7))[:-12] + bytes(12)))


def test_counters_file_is_next_to_the_keys() -> None:
    assert counters_file(Path("a/keys")) == Path("a/keys.counters")
    assert isinstance(guard().gate("x").counts, Counter)
