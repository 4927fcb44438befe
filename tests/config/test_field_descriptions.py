"""Every field of a user's file is described: error messages and the reference page use the descriptions."""

from collections.abc import Iterator

import pytest
from pydantic import BaseModel

from gateway.config.slip_runs import SlipRunsFile
from gateway.config.validation import model_in
from gateway.config.vehicle import VehicleConfig
from gateway.importing.import_map import ImportMap
from gateway.simulator.scenario_model import Scenario

# Unit in a key -> its name in the description.
UNITS = {
    "mm": "mm",
    "kpa": "kPa",
    "n": " N",
    "kg": "kg",
    "hz": "Hz",
    "deg": "degrees",
    "rad": "rad",
    "degc": "degrees Celsius",
    "kmh": "km/h",
    "percent": "percent",
    "mps2": "m/s^2",
    "ms": "ms",
    "s": " s",
    "g": " g",
    "ppm": "ppm",
    "dbm": "dBm",
}


def fields(model: type[BaseModel]) -> Iterator[tuple[str, str]]:
    """Yield (key, description) of every field of a document."""
    for name, field in model.model_fields.items():
        yield f"{model.__name__}.{name}", field.description or ""
        inner = model_in(field.annotation)
        if inner is not None:
            yield from fields(inner)


@pytest.mark.parametrize("model", [VehicleConfig, ImportMap, Scenario, SlipRunsFile])
def test_every_field_has_a_description_with_its_unit(model: type[BaseModel]) -> None:
    for key, description in fields(model):
        assert description, key
        unit = UNITS.get(key.rsplit("_", 1)[-1]) if "_" in key else None
        assert unit is None or unit in f" {description}", f"{key}: {description}"
