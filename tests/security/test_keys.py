"""Key files: private, complete and never shown."""

import subprocess
import sys
from pathlib import Path

import pytest

from firmware_protocol.reference_cmac import aes_cmac
from gateway.core.errors import TreadlinkError
from gateway.security import cmac, private_file
from gateway.security.cmac import Key, SecurityError, mac
from gateway.security.freshness import Ledger
from gateway.security.key_file import KeyFile, counters_file, parse_identity
from gateway.security.private_file import locked, write_private
from tests.testkit.commands import invoked

SECRET = "00112233445566778899aabbccddeeff"


def run(*arguments: str | Path, text: str | None = None, fails: bool = False) -> str:
    result = invoked("keys", *arguments, input=text)
    if fails:
        assert isinstance(result.exception, TreadlinkError), result.output
        return f"{result.exception} {result.exception.remedy}"
    assert result.exception is None, result.exception
    return result.output


def test_new_list_show_remove(tmp_path: Path) -> None:
    path = tmp_path / "sub" / "keys"
    made = run("new", "a001", "0123456789ABCDEF", "--keys", path)
    file = KeyFile(path)
    assert set(file.keys) == {"0000a001", "0123456789abcdef"}
    assert path.stat().st_mode & 0o777 == 0o600
    assert path.parent.stat().st_mode & 0o777 == 0o700
    listed = run("list", "--keys", path)
    for key in file.keys.values():
        assert key.secret.hex() not in made + listed
        assert key.check_value() in made
        assert key.check_value() in listed
    shown = run("new", "b", "--show", "--keys", path)
    assert shown.split() == ["0000000b", KeyFile(path).keys["0000000b"].secret.hex()]
    assert "already" in run("new", "A001", "--keys", path, fails=True)
    assert KeyFile(path).keys["0000a001"] == file.keys["0000a001"]
    run("new", "a001", "--replace", "--keys", path)
    assert KeyFile(path).keys["0000a001"] != file.keys["0000a001"]
    run("remove", "a001", "--keys", path)
    assert "0000a001" not in KeyFile(path).keys
    assert "no key" in run("remove", "a001", "--keys", path, fails=True)
    assert path.stat().st_mode & 0o777 == 0o600


def test_import(tmp_path: Path) -> None:
    path = tmp_path / "keys"
    assert "1 key in" in run("import", "-", "--keys", path, text=f"# theirs\n A001\t{SECRET.upper()}  # FL\n\n")
    assert KeyFile(path).keys["0000a001"].secret.hex() == SECRET
    run("import", "-", "--keys", path, text=f"a001 {SECRET}")
    other = f"a001 {'0' * 32}"
    assert "already" in run("import", "-", "--keys", path, text=other, fails=True)
    run("import", "-", "--replace", "--keys", path, text=other)
    assert KeyFile(path).keys["0000a001"].secret == bytes(16)
    assert "does not exist" in run("import", tmp_path / "none", "--keys", path, fails=True)


def test_key_file_with_a_byte_order_mark_is_read(tmp_path: Path) -> None:
    theirs = tmp_path / "theirs"
    write_private(theirs, f"\ufeffa001 {SECRET}\r\n")
    run("import", theirs, "--keys", tmp_path / "keys")
    for path in (theirs, tmp_path / "keys"):
        assert KeyFile(path).keys["0000a001"].secret.hex() == SECRET


@pytest.mark.parametrize("line", [f"a001 {SECRET}0", f"a001{SECRET}", f"xyz {SECRET}", SECRET, f"123456789 {SECRET}"])
def test_wrong_lines_are_refused_without_showing_them(tmp_path: Path, line: str) -> None:
    printed = run("import", "-", "--keys", tmp_path / "keys", text=f"\n{line}\n", fails=True)
    assert SECRET not in printed
    assert not (tmp_path / "keys").exists()


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o620, 0o604, 0o601])
def test_readable_key_file_is_refused(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "keys"
    run("new", "1", "--keys", path)
    path.chmod(mode)
    for command in (["list"], ["new", "2"], ["remove", "1"]):
        printed = run(*command, "--keys", path, fails=True)
        assert f"mode {mode:04o}" in printed
        assert "chmod 600" in printed
    path.chmod(0o600)
    counters = counters_file(path)
    write_private(counters, "{}")
    counters.chmod(mode)
    with pytest.raises(SecurityError, match="by others"):
        Ledger(counters)


def test_other_files_are_refused(tmp_path: Path) -> None:
    import os

    os.mkfifo(tmp_path / "pipe", 0o600)
    for path in (tmp_path, tmp_path / "pipe"):
        with pytest.raises(SecurityError):
            KeyFile(path)
    write_private(tmp_path / "text", "hello")
    with pytest.raises(SecurityError, match="line 1"):
        KeyFile(tmp_path / "text")


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"format":2,"highest":{}}', '{"format":1,"highest":{"a":"-1"}}', "[" * 100_000]
)
def test_invalid_counters_are_an_error(tmp_path: Path, text: str) -> None:
    write_private(tmp_path / "counters", text)
    with pytest.raises(SecurityError, match="counters"):
        Ledger(tmp_path / "counters")


def test_new_key_has_new_counters(tmp_path: Path) -> None:
    path = tmp_path / "keys"
    run("new", "a001", "b", "--keys", path)
    ledger = Ledger(counters_file(path))
    for identity in ("0000a001", "0000000b"):
        ledger.counter(identity, KeyFile(path).keys[identity].check_value()).take(10**10)
    ledger.save()
    run("new", "a001", "--replace", "--keys", path)
    after = Ledger(counters_file(path))
    checks = {name: key.check_value() for name, key in KeyFile(path).keys.items()}
    assert after.counter("0000a001", checks["0000a001"]).highest == -1
    assert after.counter("0000000b", checks["0000000b"]).highest == 10**10


def test_failed_write_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "keys"
    run("new", "1", "--keys", path)
    before = path.read_bytes()

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    assert "No space left" in run("new", "2", "--keys", path, fails=True)
    assert path.read_bytes() == before
    assert [result.name for result in tmp_path.iterdir()] == ["keys"]


_MAKER = """
import sys
from gateway.security.commands.keys import keys
for number in range(6):
    keys.main(["new", f"{sys.argv[1]}{number}", "--keys", sys.argv[2]], standalone_mode=False)
"""


def test_eight_processes_keep_every_key(tmp_path: Path) -> None:
    path = tmp_path / "keys"
    makers = [subprocess.Popen([sys.executable, "-c", _MAKER, f"{number:x}", path]) for number in range(8)]
    assert [maker.wait() for maker in makers] == [0] * 8
    assert set(KeyFile(path).keys) == {f"{maker:x}{number}".rjust(8, "0") for maker in range(8) for number in range(6)}
    assert [result.name for result in tmp_path.iterdir()] == ["keys"]


def test_lock_held_for_long_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "keys"
    run("new", "1", "--keys", path)
    before = path.read_bytes()
    monkeypatch.setattr(private_file, "_LOCK_WAIT_NS", 0)
    with locked(path):
        printed = run("new", "2", "--keys", path, fails=True)
    assert "another process" in printed
    assert "keys.lock" in printed
    assert path.read_bytes() == before


def test_symbolic_link_stays_and_its_target_changes(tmp_path: Path) -> None:
    target, link = tmp_path / "vault" / "real", tmp_path / "keys"
    target.parent.mkdir()
    link.symlink_to(Path("vault") / "real")
    run("new", "1", "--keys", link)
    run("new", "2", "--keys", target)
    run("new", "3", "--keys", link)
    assert link.is_symlink()
    assert not target.is_symlink()
    assert set(KeyFile(target).keys) == {"00000001", "00000002", "00000003"}
    assert target.stat().st_mode & 0o777 == 0o600
    assert {result.name for result in target.parent.iterdir()} == {"real"}


@pytest.mark.parametrize("mode", [0o400, 0o600, 0o700])
def test_change_keeps_the_mode(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "keys"
    run("new", "1", "--keys", path)
    path.chmod(mode)
    run("new", "2", "--keys", path)
    assert path.stat().st_mode & 0o777 == mode
    assert len(KeyFile(path).keys) == 2


def test_running_session_does_not_age_a_new_key(tmp_path: Path) -> None:
    path = tmp_path / "keys"
    run("new", "a001", "--keys", path)
    old = KeyFile(path).keys["0000a001"].check_value()
    session = Ledger(counters_file(path))
    session.counter("0000a001", old).take(41 << 32)
    session.save()
    assert "last boot count 41" in run("list", "--keys", path)
    run("new", "a001", "--replace", "--keys", path)
    session.counter("0000a001", old).take(42 << 32)
    session.save()
    assert "not heard yet" in run("list", "--keys", path)
    assert Ledger(counters_file(path)).counter("0000a001", old).boot_count == 42


def test_counters_of_earlier_versions_hold(tmp_path: Path) -> None:
    path = tmp_path / "counters"
    write_private(path, '{"format": 1, "highest": {"0000a001": "176093659136"}}')
    ledger = Ledger(path)
    assert ledger.counter("0000a001", "c0ffee").boot_count == 41
    ledger.forget("0000a001")
    assert Ledger(path).counter("0000a001", "c0ffee").boot_count == -1


def test_repr_hides_the_key() -> None:
    key = Key(bytes.fromhex(SECRET))
    for text in (repr(key), str(key), f"{key}", repr({"a": key})):
        assert SECRET not in text
        assert "\\x" not in text


@pytest.mark.parametrize("identity", ["", "x", "123456789", "0" * 15, "0" * 17, "-1", "a001\n"])
def test_identities_are_serial_numbers(identity: str) -> None:
    with pytest.raises(SecurityError):
        parse_identity(identity)


@pytest.mark.parametrize("size", [0, 1, 15, 16, 17, 31, 32, 33, 64, 252])
def test_mac_matches_reference(size: int) -> None:
    key, data = bytes.fromhex(SECRET), bytes(range(size % 251)) + bytes(max(0, size - 251))
    assert mac(Key(key), data) == aes_cmac(key, data)


def test_missing_package_has_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("cryptography")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "cryptography", None)
    with pytest.raises(SecurityError) as caught:
        cmac.begin_mac(Key(bytes(16)))
    assert "treadlink[auth]" in caught.value.remedy
