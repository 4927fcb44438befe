"""A loop of symbolic links given to any command is a message that names it."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from gateway.cli import treadlink
from gateway.errors import TreadlinkError

INPUTS = [
    "inspect {loop}",
    "estimate {loop}",
    "estimate {loop} {other}",
    "orders {loop}",
    "export {loop} {folder}/out.csv",
    "replay {loop} --plain",
    "repair {loop}",
    "compact {loop}",
    "diagnose {loop}",
    "diagnose {loop} {other}",
    "campaign {loop} --out {folder}/dataset",
    "import {loop} {folder}/out.mcap --map {other}",
    "plan {loop}",
    "plan lab --sensors {loop}",
    "doctor --config {loop}",
]
OUTPUTS = ["plan lab --sensor ADXL382 --json {loop} --force", "plan lab --sensor ADXL382 --figure {loop}.svg --force"]


@pytest.mark.parametrize("line", [*INPUTS, *OUTPUTS])
def test_loop_is_a_message(tmp_path: Path, line: str) -> None:
    for name in ("loop", "loop.svg"):
        (tmp_path / name).symlink_to(tmp_path / name)
    (tmp_path / "other").write_text("")
    words = line.format(loop=tmp_path / "loop", other=tmp_path / "other", folder=tmp_path)
    result = CliRunner().invoke(treadlink, words)
    assert result.exit_code == 1
    assert isinstance(result.exception, (SystemExit, TreadlinkError)), repr(result.exception)
    assert "loop" in f"{result.output}{result.exception}"
    assert (tmp_path / "loop").is_symlink()
