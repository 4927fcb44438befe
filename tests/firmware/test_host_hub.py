"""The collector as a hub of this computer, and the whole port of its README: built by their own lines, run, checked."""

import re
import shlex
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from firmware_protocol.messages import Hello, SampleBlock
from gateway.cli import treadlink
from gateway.cli.protocol_check import check_link
from gateway.clock import SystemClock
from gateway.io.source import Chunk, open_source
from gateway.session.bringup.clauses import Clause, Verdict
from gateway.session.bringup.command_trial import CLAUSES
from gateway.session.bringup.firmware_check import FirmwareCheck
from gateway.simulator.firmware.firmware_build import COLLECTOR, WARNINGS
from tests.firmware.conftest import require

README = (COLLECTOR / "README.md").read_text("utf-8")


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    require("cc", "gcc")
    folder = tmp_path_factory.mktemp("written")
    assert CliRunner().invoke(treadlink, ["protocol", "collector", "--out", str(folder / "hub")]).exit_code == 0
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


@pytest.fixture
def uri(program: Path, written: Path, tmp_path: Path) -> Iterator[str]:
    sensor = written / "hub/ports/host/wheel.csv"
    command = [program, "--tcp", "0", "--sensor", sensor, "--flash", tmp_path / "flash"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as hub:
        assert hub.stdout is not None
        yield hub.stdout.readline().strip()
        hub.kill()


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
        sensor = written / "hub/ports/host/wheel.csv"
        command = [program, "--tcp", "0", "--sensor", sensor, "--flash", tmp_path / "flash"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as hub:
            assert hub.stdout is not None
            check = FirmwareCheck("tcp:hub", {})
            seen = check.chunk(Chunk("tcp:hub", 0, first_bytes(hub.stdout.readline().strip(), 100)))
            hub.kill()
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


@pytest.mark.slow
def test_hub_passes_the_check_with_its_commands(uri: str) -> None:
    [report] = check_link(uri, for_s=14.0, keys={}, radius_m=0.32, sends_commands=True, clock=SystemClock(), say=print)
    verdicts = {result.clause: result.verdict for result in report.clauses}
    assert Verdict.FAILED not in verdicts.values()
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
