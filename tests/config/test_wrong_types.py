"""A value of a wrong type at any key of a vehicle configuration is a message."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any, Final

import pytest
from pydantic import BaseModel

from gateway.config.toml_writer import toml_text
from gateway.config.validation import Location, model_in
from gateway.config.vehicle import VehicleConfig, parse_vehicle, recorded_vehicle
from gateway.errors import ConfigError

# TOML of one value of each type, and numbers beyond those that computers compute with.
WRONG: Final = {
    "text": '"text"',
    "empty text": '""',
    "true": "true",
    "integer": "7",
    "large integer": "1" + 400 * "0",
    "float": "-1.5e300",
    "infinity": "inf",
    "nan": "nan",
    "date": "2026-01-01",
    "time": "2026-01-01T00:00:00Z",
    "list": '["FL"]',
    "nested list": "[[1], [2.5]]",
    "table": '{ FL = "FL" }',
    "list of tables": "[{ FL = [1] }, {}]",
}


def paths(model: type[BaseModel], above: Location = ()) -> Iterator[Location]:
    """Yield the location of every key: those of a list of tables in its first table."""
    for name, field in model.model_fields.items():
        yield (*above, name)
        inner = model_in(field.annotation)
        if inner is not None:
            repeated = "tuple" in str(field.annotation)
            yield from paths(inner, (*above, name, 0) if repeated else (*above, name))


def document(location: Location, marker: str) -> dict[str, Any]:
    """Return a configuration with `marker` at a location; lists that lead there have two such tables."""
    data: dict[str, Any] = {
        "tire": {"radius_mm": 320.0},
        "wheel": [{"position": "FL", "hub": 0, "wheel": 0}, {"position": "FR", "hub": 0, "wheel": 1}],
    }
    inner: Any = data
    for part, following in zip(location, [*location[1:], None], strict=True):
        if isinstance(part, int):
            while len(inner) <= part:
                inner.append({})
            inner = inner[part]
        elif following is None:
            inner[part] = marker
        else:
            inner = inner.setdefault(part, [] if isinstance(following, int) else {})
    first = location[0] if location[0] != "wheel" else None
    if first is not None and isinstance(data[first], list):
        data[first].append(copy.deepcopy(data[first][0]))
    if location[:2] == ("vehicle_signals", "signal") and len(location) > 2:
        data["vehicle_signals"]["signal"] *= 2
    return data


@pytest.mark.parametrize("location", list(paths(VehicleConfig)), ids=lambda location: ".".join(map(str, location)))
def test_wrong_type_at_a_key_is_a_message(location: Location) -> None:
    text = toml_text(document(location, "MARK"))
    assert '"MARK"' in text
    errors = []
    for wrong in WRONG.values():
        for parse in (parse_vehicle, recorded_vehicle):
            try:
                parse(text.replace('"MARK"', wrong), "car.toml")
            except ConfigError as error:
                errors.append(error)
    assert all("car.toml" in str(error) and error.remedy for error in errors)
    # No key takes all types.
    assert len(errors) >= len(WRONG)
