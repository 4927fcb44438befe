"""The shipped unit and udev rule call the program as it is."""

import configparser
import re
import shlex
from pathlib import Path

import click

from gateway.cli import treadlink
from gateway.io.source import is_live

FOLDER = Path(__file__).parents[2] / "examples" / "gateway-service"


def unit() -> configparser.ConfigParser:
    parser = configparser.ConfigParser(strict=True, interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(FOLDER / "treadlink.service", "utf-8")
    return parser


def test_unit_calls_record_with_options_that_exist() -> None:
    program, command, *arguments = shlex.split(unit()["Service"]["ExecStart"])
    assert Path(program).name == "treadlink"
    result = treadlink.get_command(click.Context(treadlink), command)
    assert result is not None
    context = result.make_context(command, arguments)
    assert context.params["sources"] == ("serial:///dev/treadlink",)
    assert is_live(context.params["sources"][0])
    # A folder takes a new file at every start: nothing is overwritten.
    assert str(context.params["out"]).startswith(f"/var/lib/{unit()['Service']['StateDirectory']}")


def test_unit_starts_again_and_ends_recordings() -> None:
    service = unit()["Service"]
    assert service["Restart"] == "always"
    # The program finishes its recording on SIGTERM, which systemd sends unless the unit says otherwise.
    assert "KillSignal" not in service
    assert float(service["TimeoutStopSec"]) >= 10


def test_udev_rule_makes_the_name_that_the_unit_uses() -> None:
    rule = (FOLDER / "99-treadlink.rules").read_text("utf-8").splitlines()[-1]
    parts = dict(re.findall(r'([A-Z]+(?:\{\w+\})?)(?:==|\+=|=)"([^"]*)"', rule))
    assert f"serial:///dev/{parts['SYMLINK']}" in unit()["Service"]["ExecStart"]
    assert parts["ENV{SYSTEMD_WANTS}"] == "treadlink.service"
    assert parts["GROUP"] in unit()["Service"]["SupplementaryGroups"].split()
