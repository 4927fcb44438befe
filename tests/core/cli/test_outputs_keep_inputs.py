"""No command overwrites a file that it reads, even with --force."""

import os
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from gateway.core.cli import COMMANDS, treadlink
from gateway.core.errors import TreadlinkError
from tests.testkit.commands import invoked, run

# Commands that can overwrite, with each input given as an output.
OVERWRITING = [
    f"{command} rec.mcap {more} {out}"
    for command, outs in {
        "diagnose": ("--json", "--html", "--save-effects"),
        "estimate": ("--csv", "--json", "--parquet", "--metadata", "--html"),
        "compare rec.mcap": ("--csv",),
        "calibrate load": ("--out",),
    }.items()
    for option in outs
    for more, out in (
        ("", f"{option} rec.mcap"),
        ("", f"{option} ./folder/../rec.mcap"),
        ("", f"{option} symbolic.mcap"),
        ("", f"{option} hard.mcap"),
        ("--config car.toml", f"{option} car.toml"),
        *((("--keys keys", f"{option} keys"),) if command != "calibrate load" else ()),
        *((("--effects effects.json", f"{option} effects.json"),) if command == "estimate" else ()),
    )
]
OVERWRITING += [
    *(
        f"calibrate {name} {name}.toml --config car.toml --out {out}"
        for name in ("slip", "side-force")
        for out in (f"{name}.toml", "car.toml", "hard.mcap")
    ),
    "import --guess rec.csv --out rec.csv",
    "plan scenario.toml --sensors car.toml --json car.toml",
    "plan scenario.toml --json scenario.toml",
    "protocol check rec.mcap --junit rec.mcap",
    "protocol check rec.mcap --junit hard.mcap",
    "export rec.mcap rec.mcap",
    "export rec.mcap car.toml --format csv --config car.toml",
    "orders rec.mcap --csv rec.mcap",
    "orders rec.mcap --json hard.mcap",
    "orders rec.mcap --figure car.toml --config car.toml",
    "figures --grid conditions.csv --out .",
    "figures --from rec.mcap --config conditions.csv --out .",
    "trends data --odometer rec.csv --csv rec.csv",
    "trends data --odometer rec.csv --html ./folder/../rec.csv",
]
OVERWRITING_LIVE = [
    f"replay rec.mcap --speed max --plain {more} --publish jsonl:{out}?append=yes"
    for more, out in (
        ("", "rec.mcap"),
        ("", "./folder/../rec.mcap"),
        ("", "symbolic.mcap"),
        ("", "hard.mcap"),
        ("--config car.toml", "car.toml"),
        ("--keys keys", "keys"),
        ("--effects effects.json", "effects.json"),
        ("--publish jsonl:new", "new"),
    )
]
OVERWRITING_LIVE += [
    "live sim:scenario.toml --plain --duration 1 --publish jsonl:scenario.toml?append=yes",
    "live replay:rec.mcap?speed=max --plain --publish jsonl:hard.mcap?append=yes",
    "live replay:rec.mcap?speed=max --plain --record new --publish jsonl:new?append=yes",
    "live can:bus.log?dbc=rec.csv --plain --publish jsonl:rec.csv?append=yes",
    "live replay:rec.mcap?speed=max --plain --publish influx:hard.mcap?append=yes",
    "live replay:rec.mcap?speed=max --plain --record new --publish influx:new?append=yes",
]
# Commands that write only new files.
NEVER = [
    "import rec.csv --map car.toml --out rec.csv",
    "import rec.csv --map car.toml --out car.toml",
    "repair rec.mcap --force --out rec.mcap",
    "compact rec.mcap --out rec.mcap",
    "merge rec.mcap hard.mcap --out rec.mcap",
    "merge rec.mcap hard.mcap --out car.toml",
    "simulate scenario.toml --out scenario.toml",
    "simulate scenario.toml --duration 1 --out new.mcap --vehicle scenario.toml",
    "record replay:rec.mcap?speed=max --out rec.mcap",
    "live replay:rec.mcap?speed=max --plain --record rec.mcap",
]


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    Path("scenario.toml").write_text("[[wheel]]\nposition = 'FL'\nwheel = 0\n")
    run("simulate scenario.toml --duration 0.5 --out rec.mcap --vehicle car.toml")
    for name in ("keys", "effects.json", "rec.csv", "conditions.csv"):
        Path(name).write_text("kept")
    for name, key in (("slip", "slip_deg"), ("side-force", "side_force_n")):
        runs = (
            f"[[run]]\nrecording = 'rec.mcap'\nfrom_s = {index}\nto_s = {index + 1}\n{key} = 0\n" for index in range(3)
        )
        Path(f"{name}.toml").write_text("".join(runs))
    Path("symbolic.mcap").symlink_to("rec.mcap")
    os.link("rec.mcap", "hard.mcap")
    return tmp_path


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize("force", ["", " --force"], ids=["plain", "forced"])
@pytest.mark.parametrize("line", OVERWRITING)
def test_input_is_never_overwritten(files: Path, line: str, force: str) -> None:
    before = contents(files)
    result = invoked(line + force)
    assert isinstance(result.exception, TreadlinkError), result.output
    assert "is an input" in str(result.exception)
    assert result.exception.remedy
    assert contents(files) == before


@pytest.mark.parametrize("line", OVERWRITING_LIVE)
def test_live_output_is_not_appended_to_a_file_of_the_session(files: Path, line: str) -> None:
    before = contents(files)
    result = invoked(line)
    assert isinstance(result.exception, TreadlinkError), result.output
    assert "is an input" in str(result.exception) or "two outputs" in str(result.exception)
    assert contents(files) == before


@pytest.mark.parametrize("line", NEVER)
def test_existing_files_are_never_overwritten(files: Path, line: str) -> None:
    before = contents(files)
    result = invoked(line)
    assert isinstance(result.exception, TreadlinkError), result.output
    after = contents(files)
    assert {name: after[name] for name in before} == before


@pytest.mark.parametrize("command", ["diagnose", "estimate"])
def test_default_key_file_is_never_overwritten(files: Path, command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # A command asks for it in its own module or where it runs.
    for position in (
        "gateway.diagnosis.commands.diagnose",
        "gateway.security.key_file",
        "gateway.core.session.session_parts",
    ):
        monkeypatch.setattr(f"{position}.default_key_file", lambda: Path("keys").resolve())
    result = invoked(f"{command} rec.mcap --json keys --force")
    assert "is an input" in str(result.exception)
    assert Path("keys").read_text() == "kept"


def test_outputs_must_be_different_files(files: Path) -> None:
    result = invoked("estimate rec.mcap --csv a --json ./folder/../a --force")
    assert "two outputs" in str(result.exception)
    assert not Path("a").exists()


def test_every_command_with_force_is_covered() -> None:
    """The commands figures, protocol, repair and setup read no file that they could overwrite, or never overwrite."""
    forcing = {name for name, command in _commands() if any(option.name == "force" for option in command.params)}
    covered = {
        " ".join(line.split()[: 2 if line.startswith(("calibrate ", "protocol ")) else 1]) for line in OVERWRITING
    }
    assert forcing == covered | {
        "figures", "repair", "protocol collector", "protocol dbc", "protocol encoder", "protocol header",
        "protocol schema", "protocol vectors", "protocol wireshark", "setup",
    }  # fmt: skip


def _commands() -> Iterator[tuple[str, click.Command]]:
    context = click.Context(treadlink)
    for name in COMMANDS:
        command = treadlink.get_command(context, name)
        assert command is not None
        yield name, command
        if isinstance(command, click.Group):
            yield from ((f"{name} {under}", item) for under, item in command.commands.items())
