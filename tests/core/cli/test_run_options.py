"""Options of the command line: the description of a run, and numbers, which are finite and within limits."""

import json
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from gateway.core.cli import COMMANDS, treadlink
from gateway.core.cli.options import FiniteRange
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.errors import RecordingError
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.run_description import TireIdentity
from tests.testkit.campaign_recordings import write_recording
from tests.testkit.commands import invoked, run

STATED = '[test]\nname = "from file"\ndriver = "Bo"\ntags = ["track"]\n'


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(
        tmp_path_factory.mktemp("source") / "source.mcap",
        "[sensor]\nrate_hz = 2000\n[motion]\nspeed_kmh = 80\n",
        wheels=("load_n = 4000\n",),
        duration_s=1.6,
        change=lambda toml: (STATED + toml).replace("[wheel.tire]", '[wheel.tire]\nmaker = "Acme"'),
    )


def recorded(source: Path, out: Path, *options: object) -> Path:
    run("record", f"replay:{source}?speed=max", "--out", out, *options)
    return out


def test_options_replace_the_vehicle_file(source: Path, tmp_path: Path) -> None:
    path = recorded(
        source,
        tmp_path / "a.mcap",
        *("--test", "wet braking", "--tag", "wet, wind", "--tag", "wet", "--comment", "first"),
        *("--tire", "W0:dot=3524,wear_mm=1.5", "--tire", "W0:run_in_km=300"),
    )
    info = RecordingReader(path).info
    assert (info.run.test, info.run.driver, info.run.comment) == ("wet braking", "Bo", "first")
    assert info.run.tags == ("track", "wet", "wind")
    assert info.run.tires == {"W0": TireIdentity("Acme", "3524", 0.0015, 300e3)}
    # The estimates use the wear that was given.
    assert info.vehicle_toml is not None
    assert parse_vehicle(info.vehicle_toml, "test").wheel[0].tire.wear_mm == pytest.approx(1.5)


def test_the_description_is_in_inspect_and_exports(source: Path, tmp_path: Path) -> None:
    path = recorded(source, tmp_path / "a.mcap")
    assert invoked("note", path, "--comment", "later", "--tag", "rain").exit_code == 0
    lines = [line.strip() for line in invoked("inspect", path).output.splitlines()]
    assert {"test: from file", "driver: Bo", "tags: track, rain", "tire W0: Acme", "comment: later"} <= set(lines)
    stated = json.loads(invoked("inspect", path, "--json").stdout)["run"]
    assert stated["tags"] == ["track", "rain"]
    assert stated["tires"] == {"W0": {"maker": "Acme"}}
    assert invoked("export", path, tmp_path / "a.csv").exit_code == 0
    head = (tmp_path / "a.csv").read_text(encoding="utf-8").split("\ntime")[0]
    assert "# W0 test: from file" in head
    assert "# W0 tags: track, rain" in head
    assert "# W0 tire_maker: Acme" in head


def test_a_campaign_and_trends_select_runs(source: Path, tmp_path: Path) -> None:
    folder, dataset = tmp_path / "recordings", tmp_path / "dataset"
    folder.mkdir()
    wet = recorded(source, folder / "wet.mcap", "--test", "wet braking 1")
    recorded(source, folder / "dry.mcap", "--test", "dry braking 1")
    options = ("--out", dataset, "--jobs", 1, "--estimator", "kinematic")
    done = invoked("campaign", folder, *options, "--where", "test=wet*")
    assert "1 recording estimated" in done.output
    done = invoked("campaign", folder, *options, "--where", "test=ice*")
    assert isinstance(done.exception, RecordingError)
    assert "dry braking 1, wet braking 1" in done.exception.remedy
    done = invoked("campaign", folder, *options, "--where", "tag=ice", "--where", "dot=1*")
    assert isinstance(done.exception, RecordingError)
    assert done.exception.remedy == "They have tag: track. None states its dot."
    assert "1 recording estimated" in invoked("campaign", folder, *options).output
    assert "1 recording," in invoked("trends", dataset, "--where", "test=dry*").output
    assert invoked("trends", dataset, "--where", "tag=puddle").exit_code == 1
    invoked("note", wet, "--tag", "puddle")
    # The note is later than the dataset.
    assert "1 recording," in invoked("trends", dataset, "--where", "tag=puddle").output


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--tire", "W0"), "is not POSITION:KEY=VALUE"),
        (("--tire", "W0:color=red"), "a tire has no key 'color'"),
        (("--tire", "W0:mker=x"), "Did you mean maker?"),
        (("--tire", "W0:wear_mm=nan"), "no number from 0 to 60"),
        (("--tire", "W1:maker=x"), "no such wheel"),
        (("--comment", "x" * 2001), "at most 2000"),
    ],
)
def test_wrong_options_are_named(source: Path, tmp_path: Path, options: tuple[str, ...], words: str) -> None:
    done = invoked("record", f"replay:{source}?speed=max", "--out", tmp_path / "a.mcap", *options)
    assert done.exit_code
    assert words in f"{done.output}{done.exception}"
    assert not (tmp_path / "a.mcap").exists()


def test_conditions_and_notes_are_checked(source: Path, tmp_path: Path) -> None:
    assert "Did you mean test?" in invoked("trends", tmp_path, "--where", "tset=x").output
    assert "Give --comment or --tag" in invoked("note", source).output
    assert invoked("note", tmp_path / "none.mcap", "--tag", "x").exit_code == 1
    assert "give --record" in invoked("live", "sim:demo", "--test", "x").output


def test_a_copy_has_the_notes(source: Path, tmp_path: Path) -> None:
    path = recorded(source, tmp_path / "a.mcap")
    invoked("note", path, "--tag", "rain")
    assert invoked("compact", path).exit_code == 0
    assert RecordingReader(tmp_path / "a.compact.mcap").info.described_run().tags == ("track", "rain")


def commands_below(command: click.Command, words: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    if not isinstance(command, click.Group):
        yield words, command
        return
    for name, other in command.commands.items():
        yield from commands_below(other, (*words, name))


def float_parameters() -> dict[str, click.Parameter]:
    context = click.Context(treadlink)
    results: dict[str, click.Parameter] = {}
    for name in COMMANDS:
        command = treadlink.get_command(context, name)
        assert command is not None
        for words, leaf in commands_below(command, (name,)):
            for parameter in leaf.params:
                if isinstance(parameter.type, click.types.FloatParamType):
                    results[f"{' '.join(words)} {parameter.name}"] = parameter
    return results


def test_every_float_refuses_nan_and_infinity() -> None:
    result = float_parameters()
    assert {"diagnose budget_s", "simulate duration_s", "command rate rate_hz"} <= result.keys()
    for name, parameter in result.items():
        assert isinstance(parameter.type, FiniteRange), name
        for text in ("nan", "-nan", "inf", "-inf", "1e999", "NaN", "Infinity"):
            with pytest.raises(click.BadParameter, match="not a finite number"):
                parameter.type.convert(text, parameter, None)


@pytest.mark.parametrize(
    "arguments",
    [
        ("diagnose", "a.mcap", "--budget", "nan"),
        ("simulate", "lab", "--duration", "inf"),
        ("live", "sim:lab", "--duration", "nan"),
        ("orders", "a.mcap", "--speed-step", "nan"),
        ("scan", "--timeout", "nan"),
        ("campaign", "folder", "--out", "x.dataset", "--memory", "nan"),
        ("command", "rate", "tcp://127.0.0.1:1", "nan"),
    ],
)
def test_nan_is_a_wrong_command_line(arguments: tuple[str, ...]) -> None:
    result = CliRunner().invoke(treadlink, arguments)
    assert result.exit_code == 2, result.output
    assert "is not a finite number" in result.output


def test_numbers_outside_the_range_are_refused_as_before() -> None:
    result = invoked("scan", "--timeout", "1000")
    assert result.exit_code == 2
    assert "0.1<=x<=120.0" in result.output
    assert "not a valid float" in invoked("scan", "--timeout", "x").output
