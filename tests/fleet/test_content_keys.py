"""The identity of the code that made a row."""

from pathlib import Path

import pytest

import gateway
from gateway.fleet import content_keys

ROOT = Path(gateway.__file__).parent


@pytest.mark.parametrize("module", ["quantity.py", "quantity_catalogue.py", "table_columns.py", "text/wheel_rows.py"])
def test_code_that_decides_about_rows_is_part_of_their_identity(module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A quantity's limits, what it rests on and its memory are declared; a changed declaration makes other rows."""
    read: list[Path] = []
    content = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: read.append(path) or content(path))
    content_keys.estimators_version.__wrapped__()
    assert ROOT / "core" / module in read


def test_module_that_is_gone_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(content_keys, "_ROWS", ("gateway:gone.py",))
    with pytest.raises(FileNotFoundError):
        content_keys.estimators_version.__wrapped__()
