"""Sources as people write them: ports and hosts without a scheme, any name of a file, and typing errors."""

import os
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from gateway.core.cli import treadlink
from gateway.core.clock import ManualClock
from gateway.core.errors import ConfigError, SourceError
from gateway.core.estimates.registry import make_estimator
from gateway.core.links.serial_link import explain_open_error
from gateway.core.links.source import is_live, open_source, parse_source_uri
from gateway.publishing.sink import SinkError, SinkSetting, open_sink, parse_sink_uri
from tests.testkit.commands import invoked


@pytest.mark.parametrize(
    ("uri", "scheme", "target", "options"),
    [
        ("/dev/ttyUSB0", "serial", "/dev/ttyUSB0", {}),
        ("/dev/ttyUSB0:921600", "serial", "/dev/ttyUSB0", {"baudrate": "921600"}),
        ("/dev/ttyUSB0:921600?rate=9600", "serial", "/dev/ttyUSB0", {"rate": "9600", "baudrate": "921600"}),
        ("/dev/serial/by-path/pci-0:1:1.0-port0", "serial", "/dev/serial/by-path/pci-0:1:1.0-port0", {}),
        ("/dev/serial/by-id/usb-A#7-if00", "serial", "/dev/serial/by-id/usb-A#7-if00", {}),
        ("COM3", "serial", "COM3", {}),
        ("com12:115200", "serial", "com12", {"baudrate": "115200"}),
        ("192.168.4.1:5000", "tcp", "192.168.4.1:5000", {}),
        ("hub.local:5000?rate=9600", "tcp", "hub.local:5000", {"rate": "9600"}),
        ("localhost:5000", "tcp", "localhost:5000", {}),
        ("[::1]:5000", "tcp", "[::1]:5000", {}),
        ("serial:COM3", "serial", "COM3", {}),
        ("serial:COM3:115200", "serial", "COM3", {"baudrate": "115200"}),
        ("COM3:921600", "serial", "COM3", {"baudrate": "921600"}),
        ("serial:PORT:921600", "serial", "PORT", {"baudrate": "921600"}),
        ("serial:ttyUSB0:921600?rate=4800", "serial", "ttyUSB0", {"rate": "4800", "baudrate": "921600"}),
        ("serial:/dev/ttyUSB0:115200", "serial", "/dev/ttyUSB0", {"baudrate": "115200"}),
        ("serial:///dev/ttyUSB0:115200?rate=4800", "serial", "/dev/ttyUSB0", {"rate": "4800", "baudrate": "115200"}),
        ("replay:run #3 100%.mcap?speed=max", "replay", "run #3 100%.mcap", {"speed": "max"}),
        ("replay:dr%FC%20%231.mcap", "replay", "dr\udcfc #1.mcap", {}),
        ("can:a+b#1.blf?dbc=c+d %23.dbc", "can", "a+b#1.blf", {"dbc": "c+d #.dbc"}),
        ("sim:demo?fault=gap+flip:rate=0.1", "sim", "demo", {"fault": "gap+flip:rate=0.1"}),
    ],
)
def test_source_is_split_as_it_is_written(uri: str, scheme: str, target: str, options: dict[str, str]) -> None:
    address = parse_source_uri(uri)
    assert (address.scheme, address.target, dict(address.options)) == (scheme, target, options)
    assert address.uri == uri


def test_port_without_a_scheme_is_a_live_link() -> None:
    assert is_live("COM3:921600")
    assert open_source("/dev/ttyNOSUCH:115200", ManualClock()).link == "serial:/dev/ttyNOSUCH"
    assert open_source("192.168.4.1:5000", ManualClock()).link == "tcp:192.168.4.1:5000"


@pytest.mark.parametrize(
    ("uri", "system", "words"),
    [
        ("COM3:921600", "posix", "COM3 is a name of Windows; here ports are named /dev/..."),
        ("serial:PORT:921600", "posix", "A port is given with its folder: /dev/PORT."),
        ("COM3:921600", "nt", "No serial port is present"),
        ("/dev/ttyUSB0:921600", "nt", "/dev/ttyUSB0 is a name of Linux or macOS; here ports are named COM3."),
    ],
)
def test_port_of_another_system_is_named_as_that(uri: str, system: str, words: str, monkeypatch) -> None:
    address = parse_source_uri(uri)
    assert address.options["baudrate"] == "921600"
    monkeypatch.setattr("gateway.core.links.serial_link.os", SimpleNamespace(name=system, path=os.path))
    error = explain_open_error(address.target, FileNotFoundError(2, "not there"), [])
    assert str(error) == f"there is no port {address.target}"
    assert words in error.remedy


@pytest.mark.parametrize(("uri", "meant"), [("sreial:/dev/ttyUSB0", "serial:"), ("repaly:x.mcap", "replay:")])
def test_scheme_is_proposed(uri: str, meant: str) -> None:
    with pytest.raises(SourceError) as caught:
        parse_source_uri(uri)
    assert f"Did you mean {meant}?" in caught.value.remedy


def test_options_estimators_and_outputs_are_proposed() -> None:
    for uri, meant in (
        ("sim:demo?sped=2", "speed"),
        ("replay:x.bin?sped=2", "speed"),
        ("tcp:h:1?silense=2", "silence"),
    ):
        with pytest.raises(SourceError) as caught:
            open_source(uri, ManualClock())
        assert f"Did you mean {meant}?" in caught.value.remedy
    with pytest.raises(ConfigError) as wrong_name:
        make_estimator("ring-papr")
    assert "Did you mean ring-paper?" in wrong_name.value.remedy
    for uri, meant in (("mqt://host/x", "mqtt:"), ("webb", "web:"), ("jsonl:-?apend=yes", "append")):
        with pytest.raises(SinkError) as wrong_output:
            open_sink(uri, SinkSetting())
        assert f"Did you mean {meant}?" in wrong_output.value.remedy


def test_replay_looks_for_the_file_whose_name_is_no_utf8(tmp_path: Path) -> None:
    done = invoked("replay", tmp_path / "dr\udcfc #1.mcap")
    assert r"dr\udcfc #1.mcap' does not exist" in str(done.exception)


def test_file_without_a_scheme_has_its_commands(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.touch()
    with pytest.raises(SourceError) as caught:
        parse_source_uri(str(path))
    assert f"treadlink import --guess {path}" in caught.value.remedy


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (["estimate", "x.mcap", "--estimator", "weak-fom"], "weak-form"),
        (["export", "x.mcap", "x.csv", "--what", "sample"], "samples"),
        (["diagnose", "x.mcap", "--model", "exat"], "exact"),
    ],
)
def test_value_of_an_option_is_proposed(arguments: list[str], meant: str) -> None:
    done = CliRunner().invoke(treadlink, arguments)
    assert done.exit_code == 2
    assert f"Did you mean {meant}?" in " ".join(done.output.split())


def test_output_file_may_have_any_name() -> None:
    assert parse_sink_uri("jsonl:drive #3 50%.jsonl?append=yes").target == "drive #3 50%.jsonl"


@pytest.mark.parametrize(("word", "meant"), [("estimat", "estimate"), ("inpsect", "inspect"), ("recrod", "record")])
def test_command_is_proposed(word: str, meant: str) -> None:
    done = invoked(word, "x")
    assert done.exit_code == 2
    assert f"Did you mean {meant}?" in done.output


def test_command_unlike_any_other_is_named_alone() -> None:
    done = invoked("qqqq")
    assert "No such command 'qqqq'." in done.output
    assert "Did you mean" not in done.output
