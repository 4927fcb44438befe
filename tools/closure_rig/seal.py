"""Label written before the diagnosis and opened after it."""

import base64
import hashlib
import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any


class SealBrokenError(ValueError):
    """The label is not the one that was sealed."""


def seal(label: Mapping[str, Any], path: Path) -> str:
    """Write a label in sealed form; return its digest, to be kept elsewhere.

    Raises:
        FileExistsError: there is a label already; it must not be replaced.
    """
    text = json.dumps(label, sort_keys=True).encode()
    digest = hashlib.sha256(text).hexdigest()
    with path.open("x", encoding="ascii") as file:
        json.dump({"sha256": digest, "sealed": base64.b64encode(zlib.compress(text)).decode()}, file)
    return digest


def open_label(path: Path, digest: str, diagnosis: Path) -> dict[str, Any]:
    """Return a sealed label once the diagnosis to be judged is in a file.

    Args:
        path: of the label.
        digest: that `seal` returned.
        diagnosis: the JSON of the diagnosis.

    Raises:
        FileNotFoundError: there is no diagnosis yet.
        SealBrokenError: the label was changed or exchanged.
    """
    if not diagnosis.is_file() or not diagnosis.stat().st_size:
        raise FileNotFoundError(f"'{diagnosis}' does not exist: the label stays sealed until the diagnosis is made")
    sealed = json.loads(path.read_text(encoding="ascii"))
    try:
        text = zlib.decompress(base64.b64decode(sealed["sealed"], validate=True))
    except (ValueError, zlib.error) as error:
        raise SealBrokenError(f"'{path}' is damaged") from error
    if hashlib.sha256(text).hexdigest() != digest or sealed["sha256"] != digest:
        raise SealBrokenError(f"'{path}' is not the label that was sealed")
    label: dict[str, Any] = json.loads(text)
    return label
