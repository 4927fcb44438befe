"""The option that replaces stored results by those of this version, printing every difference."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.golden.comparison import OF_A_DIAGNOSIS, OF_A_REPORT, OF_ESTIMATES, differences

DATA = Path(__file__).parent / "data"
# Enough to see what happened; the count tells the rest.
SHOWN = 40

Compare = Callable[[str, Any], None]


def by_wheel(result: Any) -> Any:
    """Return the rows of a table by wheel and revolution: how wheels take turns is no result; other results as is."""
    if not isinstance(result, list) or not all(isinstance(row, dict) and "revolution" in row for row in result):
        return result
    return sorted(result, key=lambda row: (str(row["recording"]), str(row["position"]), row["revolution"] or 0.0))


@pytest.fixture
def compare(request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]) -> Compare:
    """Return a function that holds a result against the stored one of a name."""

    def run(name: str, made: Any) -> None:
        path = DATA / f"{name}.json"
        made = json.loads(json.dumps(made))
        stored = json.loads(path.read_text("utf-8")) if path.exists() else None
        tolerance = {"diagnose": OF_A_DIAGNOSIS, "report": OF_A_REPORT}.get(name.partition("-")[0], OF_ESTIMATES)
        texts = not request.config.getoption("--golden-numbers")
        results = sorted(differences(by_wheel(stored), by_wheel(made), texts=texts, tolerance=tolerance))
        if results and request.config.getoption("--update-golden"):
            path.write_text(json.dumps(made, indent=0, ensure_ascii=False) + "\n", "utf-8")
            with capsys.disabled():
                print(f"\n{name}: {len(results)} fields changed", *results[:SHOWN], sep="\n  ")
            return
        assert not results, "\n".join(
            [f"{name}: {len(results)} fields differ; accept them with --update-golden", *results[:SHOWN]]
        )

    return run
