"""Identity of paths, and of the settings and the code that estimate recordings."""

import hashlib
import json
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Final

SETTINGS_DIGITS: Final = 12
PATH_DIGITS: Final = 12

# Packages and modules whose code decides about the rows.
_ESTIMATING: Final = (
    "firmware_protocol",
    "gateway.core.contacts",
    "gateway.core.estimates",
    "gateway.core.recording",
    "gateway.core.revolutions",
    "gateway.core.trust",
    "gateway.core.wheels",
    "gateway.forces",
    "gateway.ring",
    "gateway.vehicle",
    "gateway.core:constants.py",
    "gateway.core:quantity.py",
    "gateway.core:quantity_catalogue.py",
    "gateway.core:ring_quantities.py",
)
_ROWS: Final = (
    "gateway.core.session",
    "gateway.fleet:recording_estimation.py",
    "gateway.core.text:wheel_rows.py",
    "gateway.core:table_columns.py",
)
_DIAGNOSING: Final = ("gateway.diagnosis",)


def path_key(path: Path) -> str:
    """Return the identity of a path."""
    return hashlib.sha256(str(path).encode("utf-8", "surrogateescape")).hexdigest()[:PATH_DIGITS]


def settings_key(settings: Any) -> str:
    """Return the identity of settings that JSON can hold."""
    text = json.dumps(settings, sort_keys=True, ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()[:SETTINGS_DIGITS]


@cache
def estimators_version() -> str:
    """Return the identity of the code that estimates: it changes when a file of it changes, not with a release."""
    return _code_digest((*_ESTIMATING, *_ROWS))


@cache
def diagnosis_version() -> str:
    """Return the identity of the code that diagnoses."""
    return _code_digest((*_ESTIMATING, *_DIAGNOSING))


def _code_digest(packages: tuple[str, ...]) -> str:
    digest = hashlib.sha256()
    for name in packages:
        package, _, file = name.partition(":")
        root = Path(str(resources.files(package)))
        paths = (
            [root / file] if file else sorted(root.rglob("*.py"), key=lambda path: path.relative_to(root).as_posix())
        )
        # The wording of a reason decides about no row.
        for path in (path for path in paths if path.name != "reasons.py"):
            digest.update(f"{package}/{path.relative_to(root).as_posix()}\n".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:SETTINGS_DIGITS]
