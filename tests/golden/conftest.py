"""The option that replaces stored results by those of this version, printing every difference."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.golden.comparison import RELATIVE, RELATIVE_OF_A_DIAGNOSIS, differences

DATA = Path(__file__).parent / "data"
# Enough to see what happened; the count tells the rest.
SHOWN = 40

Compare = Callable[[str, Any], None]


@pytest.fixture
def compare(request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]) -> Compare:
    """Return a function that holds a result against the stored one of a name."""

    def run(name: str, made: Any) -> None:
        path = DATA / f"{name}.json"
        made = json.loads(json.dumps(made))
        stored = json.loads(path.read_text("utf-8")) if path.exists() else None
        relative = RELATIVE_OF_A_DIAGNOSIS if name.startswith(("diagnose", "report")) else RELATIVE
        texts = not request.config.getoption("--golden-numbers")
        found = sorted(differences(stored, made, texts=texts, relative=relative))
        if found and request.config.getoption("--update-golden"):
            path.write_text(json.dumps(made, indent=0, ensure_ascii=False) + "\n", "utf-8")
            with capsys.disabled():
                print(f"\n{name}: {len(found)} fields changed", *found[:SHOWN], sep="\n  ")
            return
        assert not found, "\n".join(
            [f"{name}: {len(found)} fields differ; accept them with --update-golden", *found[:SHOWN]]
        )

    return run
