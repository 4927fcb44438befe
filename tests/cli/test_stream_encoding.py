"""Output that cannot encode a character says the nearest text, and never ends with a traceback."""

import os
import subprocess
import sys

import pytest

import gateway
from gateway.cli.stream_encoding import nearest_text


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("encoding") / "Reifen ü №1.mcap"
    gateway.simulate("lab", duration_s=2.0, out=path)
    return path


@pytest.mark.parametrize("encoding", ["cp1252", "cp437", "latin-1"])
@pytest.mark.parametrize(("command", "word"), [("inspect", "Reifen"), ("orders", "W1")])
def test_every_code_page_takes_the_output(recorded, command, word, encoding):
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    done = subprocess.run(
        [sys.executable, "-m", "gateway.cli", command, str(recorded)], capture_output=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr.decode(encoding)
    assert word in done.stdout.decode(encoding)
    assert b"Traceback" not in done.stderr


def test_nearest_text_keeps_the_meaning():
    assert nearest_text("3.1 ± 0.2 m/s², −12 °C, Größe, №") == "3.1 +- 0.2 m/s^2, -12  degC, Gro?e, No"
    assert nearest_text("⣿").isascii()
