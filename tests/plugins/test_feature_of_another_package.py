"""A package of others adds a command and an output of `estimate`, as the features of this package do."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.testkit.commands import run

MODULE = """
import click

from gateway.core.cli.estimate_outputs import AddedOutput
from gateway.core.cli.path_option import path_option


@click.command()
def weigh():
    click.echo("1200 kg")


class Lines:
    def __init__(self):
        self.revolutions = 0

    def add(self, result):
        self.revolutions += 1

    def finish(self, states, alarms, notices):
        return [f"weighed {self.revolutions} revolutions of {len(states)} wheels"]


class Output:
    def __init__(self, path):
        self.path = path

    def begin(self, file, vehicle):
        return Lines()

    def write(self):
        self.path.write_text("done")


def open_weights(path, *, force):
    return None if path is None else Output(path)


WEIGHTS = AddedOutput("scales:open_weights", "weights_path", path_option("--weights", "weights_path", help="Weigh."))
NO_OUTPUT = 7
"""
ENTRIES = """
[treadlink.commands]
weigh = scales:weigh
live = scales:weigh
absent = scales:NO_OUTPUT
[treadlink.estimate-outputs]
weights = scales:WEIGHTS
page = scales:WEIGHTS
number = scales:NO_OUTPUT
"""


@pytest.fixture
def site(tmp_path: Path) -> Path:
    (tmp_path / "scales.py").write_text(MODULE)
    folder = tmp_path / "scales-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: scales\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(ENTRIES)
    return tmp_path


def treadlink(site: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(site), str(Path(__file__).parents[2])))}
    command = [sys.executable, "-m", "gateway.core.cli", *words]
    return subprocess.run(command, capture_output=True, text=True, cwd=site, check=False, env=environment)


def test_a_command_of_another_package_is_listed_and_runs(site: Path) -> None:
    listed = treadlink(site, "--help").stdout
    assert "weigh       Command of the package scales." in listed
    assert "Show live estimates" in listed
    assert treadlink(site, "weigh").stdout == "1200 kg\n"
    assert "weigh" in treadlink(site, "wiegh").stderr
    refused = treadlink(site, "absent")
    assert refused.returncode != 0
    assert "absent" in refused.stderr


def test_an_output_of_another_package_has_its_option_and_lines(site: Path) -> None:
    run("simulate", "demo", "--duration", 1, "--out", site / "drive.mcap")
    done = treadlink(site, "estimate", "drive.mcap", "--weights", "weights.txt")
    assert done.returncode == 0, done.stderr
    (line,) = (line for line in (done.stdout + done.stderr).splitlines() if "weighed" in line)
    assert int(line.split()[1]) > 0
    assert (site / "weights.txt").read_text() == "done"
    assert "--html" in treadlink(site, "estimate", "--help").stdout
