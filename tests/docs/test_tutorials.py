"""The tutorials work as they stand: every command of them, in their order, in one folder."""

import re
import shlex
import sys
from pathlib import Path

import pytest

from tests.testkit.commands import invoked
from tools.docs_site.staging import DOCS

FILE = r"<!-- file: (?P<name>.+?) -->\n```\w*\n(?P<content>.*?)^```$"
TYPED = r"```sh\n(?P<typed>.*?)^```$"
SHOWN = r"<!-- output(?:\(slow\))?: (?P<shown>.+?) -->$"
STEP = re.compile(rf"^(?:{FILE}|{TYPED}|{SHOWN})", re.MULTILINE | re.DOTALL)
# Sessions are as long as the page says, and a diagnosis takes a minute.
SLOW = ("watch", "why-does-the-model-not-fit")
PAGES = [pytest.param(name, marks=pytest.mark.slow) for name in SLOW]


@pytest.mark.parametrize("page", ["look-back", *PAGES])
def test_every_command_of_a_tutorial_succeeds(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["treadlink"])
    done = 0
    for step in STEP.finditer((DOCS / "tutorials" / f"{page}.md").read_text("utf-8")):
        if step["name"]:
            Path(step["name"]).write_text(step["content"], "utf-8")
            continue
        for line in (step["typed"] or step["shown"]).replace("\\\n", " ").splitlines():
            program, *words = shlex.split(line, comments=True)
            assert program == "treadlink"
            result = invoked(*words)
            assert result.exit_code == 0, f"{line}: {result.output}"
            done += 1
    assert done >= 4
