"""Effects files: JSON files with the effects that `diagnose` found, for `live`, `replay` and `estimate` to subtract."""

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from pydantic import Field, ValidationError

from gateway.core.config.validation import Section, read_text
from gateway.core.config.vehicle import POSITION_PATTERN
from gateway.core.errors import ConfigError
from gateway.core.estimates.wheel_setup import CorrectedEffect, CorrectionTable, EffectParameter
from gateway.core.storable_text import storable

VERSION: Final = 3
"""Of files that are written and read. Earlier ones have no digest, so that nothing shows whether they were edited."""

_KEY: Final = "treadlink_effects"
_DIGEST: Final = "digest"
_LISTED_FAULTS: Final = 8
_MAX_BYTES: Final = 16 << 20
_SIGNIFICANT_DIGITS: Final = 7

Range = tuple[float, float]


class _Parameter(Section):
    name: str = Field(min_length=1, max_length=80)
    value: float
    std: float | None = Field(default=None, ge=0)
    unit: str = Field(default="", max_length=40)


class _Effect(Section):
    name: str = Field(min_length=1, max_length=80)
    parameters: tuple[_Parameter, ...] = Field(default=(), max_length=40)


class _Valid(Section):
    omega_radps: Range
    load_n: Range | None = None
    pressure_kpa: Range | None = None


class _Table(Section):
    omega_radps: tuple[float, ...] = Field(min_length=1, max_length=1000)
    cosine_mps2: tuple[tuple[tuple[float, ...], ...], ...]
    sine_mps2: tuple[tuple[tuple[float, ...], ...], ...]


class _EffectsFile(Section):
    treadlink_effects: Literal[3]
    vehicle: str
    tire: str
    wheel: str = Field(pattern=POSITION_PATTERN)
    sensor_id: str | None = Field(default=None, pattern=r"^[0-9a-fA-F]{1,8}$")
    radius_mm: float = Field(ge=100, le=1200)
    sensor_offset_mm: float = Field(ge=-20, le=80)
    found_in: tuple[str, ...] = ()
    valid: _Valid
    effects: tuple[_Effect, ...] = Field(min_length=1, max_length=100)
    table: _Table
    digest: str

    def correction(self) -> CorrectionTable:
        """Return the table in SI; raises ValueError when it is inconsistent."""
        pressure, table = self.valid.pressure_kpa, self.table
        cosine, sine = np.array(table.cosine_mps2, dtype=np.float64), np.array(table.sine_mps2, dtype=np.float64)
        if cosine.shape != sine.shape:
            raise ValueError(f"table: the shapes of cosine_mps2 {cosine.shape} and sine_mps2 {sine.shape} differ")
        for name, limits in self.valid:
            if limits is not None and not limits[0] <= limits[1]:
                raise ValueError(f"valid.{name}: {limits[0]:g} to {limits[1]:g} is not a range")
        return CorrectionTable(
            position=self.wheel,
            omega_radps=np.array(table.omega_radps, dtype=np.float64),
            orders_mps2=cosine - 1j * sine,
            effects=tuple(
                CorrectedEffect(
                    effect.name,
                    tuple(
                        EffectParameter(
                            parameter.name,
                            parameter.value,
                            math.nan if parameter.std is None else parameter.std,
                            parameter.unit,
                        )
                        for parameter in effect.parameters
                    ),
                )
                for effect in self.effects
            ),
            radius_m=self.radius_mm * 1e-3,
            omega_range_radps=self.valid.omega_radps,
            load_range_n=self.valid.load_n,
            pressure_range_pa=None if pressure is None else (pressure[0] * 1e3, pressure[1] * 1e3),
            sensor_offset_m=self.sensor_offset_mm * 1e-3,
            sensor_id=None if self.sensor_id is None else int(self.sensor_id, 16),
            sources=self.found_in,
            vehicle=self.vehicle,
            tire=self.tire,
        )


def effects_text(table: CorrectionTable) -> str:
    """Return a table as the text of an effects file."""
    pressure = table.pressure_range_pa

    def rounded(values: Any) -> Any:
        if isinstance(values, list | tuple):
            return [rounded(value) for value in values]
        return float(f"{values:.{_SIGNIFICANT_DIGITS}g}")

    document = {
        _KEY: VERSION,
        "vehicle": table.vehicle,
        "tire": table.tire,
        "wheel": table.position,
        "sensor_id": None if table.sensor_id is None else f"{table.sensor_id:08x}",
        "radius_mm": rounded(table.radius_m * 1e3),
        "sensor_offset_mm": rounded(table.sensor_offset_m * 1e3),
        "found_in": [storable(source) for source in table.sources],
        "valid": {
            "omega_radps": list(table.omega_range_radps),
            "load_n": None if table.load_range_n is None else list(table.load_range_n),
            "pressure_kpa": None if pressure is None else [pressure[0] * 1e-3, pressure[1] * 1e-3],
        },
        "effects": [
            {
                "name": effect.name,
                "parameters": [
                    {
                        "name": parameter.name,
                        "value": rounded(parameter.value),
                        "std": rounded(parameter.std) if math.isfinite(parameter.std) else None,
                        "unit": parameter.unit,
                    }
                    for parameter in effect.parameters
                ],
            }
            for effect in table.effects
        ],
        "table": {
            "omega_radps": table.omega_radps.tolist(),
            "cosine_mps2": rounded(table.orders_mps2.real.tolist()),
            "sine_mps2": rounded((-table.orders_mps2.imag).tolist()),
        },
    }
    document[_DIGEST] = _digest(document)
    head = json.dumps({key: value for key, value in document.items() if key != "table"}, indent=2, ensure_ascii=False)
    # Indented, each number of the table would take a line.
    return head[:-2] + ',\n  "table": ' + json.dumps(document["table"], allow_nan=False) + "\n}\n"


def load_effects(path: Path) -> CorrectionTable:
    """Return the table of an effects file; `gateway.diagnosis.effects_opening` also checks its effects.

    Raises:
        ConfigError: the file cannot be read, is not an effects file of this version, or was edited.
    """
    text = read_text(path, "the effects file", max_bytes=_MAX_BYTES)
    document = _document(text, path)
    version = document[_KEY]
    remedy = "Create the file again with `treadlink diagnose --save-effects`."
    if version in (1, 2):
        raise ConfigError(f"{path}: effects file of version {version}, which has no digest against edits", remedy)
    if version != VERSION:
        raise ConfigError(
            f"{path}: effects file of version {version}, but this treadlink supports version {VERSION}",
            f"Update treadlink, or do without: {remedy[0].lower()}{remedy[1:]}",
        )
    try:
        file = _EffectsFile.model_validate_json(text)
        if file.digest != _digest(document):
            raise ConfigError(
                f"{path} was edited after diagnose wrote it: its digest does not match",
                "Run `treadlink diagnose --save-effects` again.",
            )
        return file.correction()
    except ValidationError as error:
        faults = [f"{path}: {_key(fault['loc'])}: {fault['msg'].lower()}" for fault in error.errors()]
        more = [f"{path}: and {len(faults) - _LISTED_FAULTS} more"] if len(faults) > _LISTED_FAULTS else []
        raise ConfigError("\n".join(faults[:_LISTED_FAULTS] + more), remedy) from error
    except ValueError as error:
        raise ConfigError(f"{path}: {error}", remedy) from error


def _digest(document: Mapping[str, Any]) -> str:
    """Return the SHA-256 of all that a file states, whatever its line breaks and the order of its keys."""
    content = {key: value for key, value in document.items() if key != _DIGEST}
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _document(text: str, path: Path) -> dict[str, Any]:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigError(
            f"{path}: not valid JSON: {error}", "Give a file created by `treadlink diagnose --save-effects`."
        ) from error
    if not isinstance(document, dict) or _KEY not in document:
        raise ConfigError(
            f"{path}: not an effects file: the key '{_KEY}' is missing",
            "Give a file created by `treadlink diagnose --save-effects`.",
        )
    return document


def _key(location: tuple[int | str, ...]) -> str:
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location).lstrip(".")
