"""Every command on every kind of damage: what docs/reference/exit-status.md states, and a word about it."""

from collections.abc import Callable

import pytest

from gateway.core.errors import TreadlinkError
from gateway.core.recording.mcap_records import MAGIC, RECORD_HEAD
from tests.testkit.campaign_recordings import write_recording
from tests.testkit.commands import invoked

CHUNK = 0x06


def chunks(data: bytes) -> list[tuple[int, int]]:
    """Return begin and end of the chunks."""
    offset, result = len(MAGIC), []
    while offset + RECORD_HEAD.size < len(data):
        opcode, length = RECORD_HEAD.unpack_from(data, offset)
        if opcode == CHUNK:
            result.append((offset, offset + RECORD_HEAD.size + length))
        offset += RECORD_HEAD.size + length
    return result


def cut(data: bytes) -> bytes:
    begin, end = chunks(data)[-3]
    return data[: (begin + end) // 2]


def changed(data: bytes) -> bytes:
    begin, end = chunks(data)[len(chunks(data)) // 2]
    middle = (begin + end) // 2
    return data[:middle] + bytes(byte ^ 0xFF for byte in data[middle : middle + 64]) + data[middle + 64 :]


def zeros(data: bytes) -> bytes:
    begin, _ = chunks(data)[-3]
    return data[:begin] + bytes(len(data) - begin)


def unfinished(data: bytes) -> bytes:
    """As of a recorder that was killed between two chunks, or still records: nothing is lost."""
    return data[: chunks(data)[-1][1]]


DAMAGES: dict[str, Callable[[bytes], bytes]] = {"cut": cut, "changed": changed, "zeros": zeros}
# What each prints of the damage, in its summary, its table or an error.
COMMANDS = {
    "inspect {path}": "DAMAGED",
    "inspect {path} --json": "damage",
    "estimate {path}": "repair",
    "export {path} {folder}/out.csv": "repair",
    "orders {path}": "repair",
    "orders {path} --json {folder}/orders.json": "repair",
    "replay {path} --plain --speed max": "repair",
    "live replay:{path}?speed=max --plain": "repair",
    "campaign {path} --out {folder}/dataset --jobs 1 --estimator kinematic": "repair",
    "diagnose {path} --jobs 1 --budget 1": "repair",
}


LINES = [pytest.param(line, marks=pytest.mark.slow if line.startswith("campaign") else ()) for line in COMMANDS]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return write_recording(
        tmp_path_factory.mktemp("whole") / "drive.mcap",
        "[sensor]\nrate_hz = 2000\n[motion]\nspeed_kmh = 80\n",
        wheels=("load_n = 4000\n",),
        duration_s=3.0,
    ).read_bytes()


def run(line: str) -> tuple[int, str]:
    result = invoked(line)
    error = result.exception
    assert error is None or isinstance(error, (SystemExit, TreadlinkError)), repr(error)
    remedy = error.remedy if isinstance(error, TreadlinkError) else ""
    return result.exit_code, f"{result.output}{error or ''}{remedy}"


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("line", LINES)
def test_a_damaged_recording_is_told_by_word_and_status(whole, tmp_path, line, damage):
    path = tmp_path / "damaged.mcap"
    path.write_bytes(DAMAGES[damage](whole))
    status, printed = run(line.format(path=path, folder=tmp_path))
    assert status == (0 if line.startswith("diagnose") else 1), printed
    assert COMMANDS[line] in printed


@pytest.mark.parametrize("line", [item for item in LINES if not item.values[0].startswith("diagnose")])
def test_a_recording_without_damage_is_status_0(whole, tmp_path, line):
    path = tmp_path / "unfinished.mcap"
    for data in (whole, unfinished(whole)):
        path.write_bytes(data)
        status, printed = run(line.format(path=path, folder=tmp_path) + (" --force" if "{folder}/o" in line else ""))
        assert status == 0, printed


@pytest.mark.parametrize("damage", [*DAMAGES, "unfinished"])
def test_repair_and_compact_say_what_they_find(whole, tmp_path, damage):
    path = tmp_path / "damaged.mcap"
    path.write_bytes({**DAMAGES, "unfinished": unfinished}[damage](whole))
    status, printed = run(f"repair {path} --out {tmp_path}/repaired.mcap")
    assert status == 0, printed
    assert run(f"estimate {tmp_path}/repaired.mcap")[0] == 0
    status, printed = run(f"compact {path} --out {tmp_path}/compact.mcap")
    assert status == 1, printed


def test_what_was_recorded_from_a_damaged_recording_is_whole(whole, tmp_path):
    (tmp_path / "damaged.mcap").write_bytes(cut(whole))
    assert run(f"record replay:{tmp_path}/damaged.mcap?speed=max --out {tmp_path}/new.mcap")[0] == 1
    assert run(f"replay {tmp_path}/new.mcap --plain --speed max")[0] == 0
