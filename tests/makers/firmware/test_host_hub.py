"""The collector as a hub of this computer, and the whole port of its README: built by their own lines, run, checked."""

import re
import shlex
import socket
import subprocess
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import CommandResult, Hello, HubStatus, Outcome, SampleBlock, SetStream
from gateway.core.clock import SystemClock
from gateway.core.errors import SourceError
from gateway.core.links.source import Chunk, LinkItem, TwoWaySource, open_source
from gateway.makers.check.clauses import Clause, Verdict
from gateway.makers.check.command_trial import CLAUSES
from gateway.makers.check.firmware_check import FirmwareCheck
from gateway.makers.commands.protocol_check import check_link
from gateway.security.cmac import Key
from gateway.security.hub_commands import execute
from tests.makers.firmware.conftest import require
from tests.testkit.collector_bench import command_bytes
from tests.testkit.commands import run
from tests.testkit.emulated_firmware.firmware_build import COLLECTOR, WARNINGS
from tests.testkit.hub_ends import TcpHub

README = (COLLECTOR / "README.md").read_text("utf-8")


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    require("cc", "gcc")
    folder = tmp_path_factory.mktemp("written")
    run("protocol", "collector", "--out", folder / "hub")
    return folder


def build(folder: Path, program: str) -> Path:
    """Build by the README's line, with all warnings as errors."""
    line = next(line for line in README.splitlines() if line.startswith("cc ") and line.endswith(f" -o {program}"))
    warnings = shlex.join(option for option in WARNINGS if not option.startswith("-std="))
    shown = subprocess.run(f"{line} {warnings}", shell=True, cwd=folder, capture_output=True, text=True, check=False)
    assert shown.returncode == 0, shown.stderr
    return folder / program


@pytest.fixture(scope="module")
def program(written: Path) -> Path:
    return build(written, "host_collector")


@contextmanager
def running(program: Path, written: Path, tmp_path: Path, *options: str | Path) -> Iterator[str]:
    """Run the hub with a wheel of its file as its sensor; yield its address."""
    sensor = written / "hub/ports/host/wheel.csv"
    command = [program, "--tcp", "0", "--sensor", sensor, "--flash", tmp_path / "flash", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as hub:
        assert hub.stdout is not None
        try:
            yield hub.stdout.readline().strip()
        finally:
            hub.kill()


@pytest.fixture
def uri(program: Path, written: Path, tmp_path: Path) -> Iterator[str]:
    with running(program, written, tmp_path) as address:
        yield address


def checked(link: str, data: bytes) -> dict[Clause, Verdict]:
    check = FirmwareCheck(link, {})
    check.chunk(Chunk(link, 0, data))
    return {result.clause: result.verdict for result in check.finish().clauses}


def first_bytes(uri: str, size: int) -> bytes:
    source, data = open_source(uri, SystemClock()), b""
    for item in source.items(threading.Event()):
        data += item.data if isinstance(item, Chunk) else b""
        if len(data) >= size:
            break
    source.close()
    return data


def test_hub_sends_hello_and_the_samples_of_its_file(uri: str, written: Path) -> None:
    check = FirmwareCheck("tcp:hub", {})
    seen = check.chunk(Chunk("tcp:hub", 0, first_bytes(uri, 20_000)))
    assert isinstance(seen[0].message, Hello)
    assert (seen[0].message.rate_hz, seen[0].message.axes) == (4000.0, 7)
    block = next(frame.message for frame in seen if isinstance(frame.message, SampleBlock))
    text = (written / "hub/ports/host/wheel.csv").read_text("utf-8").splitlines()
    rows = [[int(word) for word in line.split(",")] for line in text if not line.startswith("#")]
    places = [(block.first_sample + k) % len(rows) for k in range(len(block.counts))]
    assert block.counts.tolist() == [rows[position] for position in places]


def test_every_start_has_a_higher_boot_count(program: Path, written: Path, tmp_path: Path) -> None:
    counts = []
    for _ in range(2):
        check = FirmwareCheck("tcp:hub", {})
        with running(program, written, tmp_path) as uri:
            seen = check.chunk(Chunk("tcp:hub", 0, first_bytes(uri, 100)))
        counts += [frame.message.boot_count for frame in seen if isinstance(frame.message, Hello)][:1]
    assert counts == [1, 2]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1,2,3\n1,2\n", "line 2 of"),
        ("# axes 4\n70000\n", "line 2 of"),
        ("# rate_hz 4000\n", "there is no sample in"),
        ("# rate_hz 5\n1,2,3\n", "does not take rate"),
        (None, "cannot open the sensor's file"),
    ],
)
def test_a_bad_sensor_file_is_named(program: Path, tmp_path: Path, text: str | None, said: str) -> None:
    name = tmp_path / "sensor.csv"
    if text is not None:
        name.write_text(text)
    command = [program, "--tcp", "0", "--sensor", name, "--flash", tmp_path / "flash"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert said in done.stderr
    assert str(name) in done.stderr


HUB, SENSOR = "0000000000007ead", "0000a001"
KEYS = {HUB: Key(bytes(range(16))), SENSOR: Key(bytes(range(16, 32)))}
KEY_LINES = "".join(f"{identity} {key.secret.hex()}\n" for identity, key in KEYS.items())


class Overheard:
    """The link of a hub, with someone who writes down what goes over it."""

    vehicle_toml = None
    rate_hz: float | None = None

    def __init__(self, uri: str) -> None:
        self._source = open_source(uri, SystemClock())
        self.link = self._source.link
        self.from_hub: list[bytes] = []
        self.to_hub: list[bytes] = []

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        for item in self._source.items(stop):
            if isinstance(item, Chunk):
                self.from_hub.append(item.data)
            yield item

    def send(self, data: bytes) -> None:
        assert isinstance(self._source, TwoWaySource)
        self.to_hub.append(data)
        self._source.send(data)

    def close(self) -> None:
        self._source.close()


def replies(uri: str, sent: Sequence[bytes]) -> list[Outcome]:
    """Send bytes to a hub as they are, and return the outcomes that it replies before its third status."""
    host, port = uri.removeprefix("tcp://").split(":")
    decoder, outcomes, statuses = FrameDecoder(), [], 0
    with socket.create_connection((host, int(port)), 30) as link:
        link.settimeout(30)
        for data in sent:
            link.sendall(data)
        while statuses < 3:
            for frame in decoder.feed(link.recv(4096)):
                statuses += isinstance(frame.message, HubStatus)
                outcomes += [frame.message.outcome] if isinstance(frame.message, CommandResult) else []
    return outcomes


def test_signed_command_over_the_link_and_every_replay_of_it(
    program: Path, written: Path, tmp_path: Path, tcp_hub: TcpHub
) -> None:
    keys = tmp_path / "keys"
    keys.write_text(KEY_LINES)
    with running(program, written, tmp_path, "--keys", keys) as uri:
        link = Overheard(uri)
        assert execute(link, SetStream(False), SystemClock(), keys=KEYS, timeout_s=60.0).signed
        link.close()
        command = next(data for data in link.to_hub if is_command(data))
        damaged = bytes((*command[:-6], command[-6] ^ 1, *command[-5:]))
        attacks = [command, *link.to_hub, *reversed(link.to_hub), damaged, command_bytes(SetStream(True), 10**6)]
        outcomes = replies(uri, attacks)
        assert Outcome.REPEATED in outcomes
        assert Outcome.NOT_VERIFIED in outcomes
        assert Outcome.DONE not in outcomes
    with running(program, written, tmp_path, "--keys", keys) as uri:
        assert Outcome.DONE not in replies(uri, link.to_hub)
    # The hub is off, and someone plays what it sent.
    tcp_hub.greet(b"".join(link.from_hub))
    with pytest.raises(SourceError):
        execute(Overheard(f"tcp://127.0.0.1:{tcp_hub.port}"), SetStream(False), SystemClock(), keys=KEYS, timeout_s=2.0)


def is_command(data: bytes) -> bool:
    return any(isinstance(frame.message, SetStream) for frame in FrameDecoder().feed(data))


@pytest.mark.parametrize(("text", "said"), [("", "there are no keys"), (KEY_LINES + "x\n", "line 3 of")])
def test_a_bad_file_of_keys_is_named(program: Path, written: Path, tmp_path: Path, text: str, said: str) -> None:
    keys = tmp_path / "keys"
    keys.write_text(text)
    command = [program, "--tcp", "0", "--sensor", written / "hub/ports/host/wheel.csv", "--keys", keys]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert said in done.stderr


@pytest.mark.slow
def test_hub_passes_the_check_with_its_commands(uri: str) -> None:
    [report] = check_link(uri, for_s=14.0, keys={}, radius_m=0.32, sends_commands=True, clock=SystemClock(), say=print)
    verdicts = {result.clause: result.verdict for result in report.clauses}
    assert [result for result in report.clauses if result.verdict is Verdict.FAILED] == []
    assert {clause for clause in CLAUSES if verdicts[clause] is not Verdict.PASSED} == {Clause.COMMAND_VERIFIED}


def test_the_port_of_the_readme_is_short_and_runs(written: Path) -> None:
    [code] = re.findall(r"<!-- file: port.c -->\n```c\n(.*?)```", README, re.DOTALL)
    assert code.count("\n") < 60
    (written / "port.c").write_text(code, "utf-8")
    with subprocess.Popen([build(written, "port")], stdout=subprocess.PIPE) as port:
        assert port.stdout is not None
        data = port.stdout.read(15_000)
        port.kill()
    verdicts = checked("dump:first.bin", data)
    assert Verdict.FAILED not in verdicts.values()
    assert all(verdicts[clause] is Verdict.PASSED for clause in (Clause.CRC, Clause.SEQ, Clause.NUMBERS, Clause.START))
