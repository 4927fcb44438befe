"""Fields of a user's files: a value of a wrong type names its field, and every field is described."""

import copy
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import pytest
from pydantic import BaseModel

from gateway.core.config.toml_writer import toml_text
from gateway.core.config.validation import Location, model_in
from gateway.core.config.vehicle import VehicleConfig, parse_vehicle, recorded_vehicle
from gateway.core.errors import ConfigError
from gateway.forces.known_runs import ForceRunsFile, KnownRunsFile, SlipRunsFile, load_runs
from gateway.importing.import_map import ImportMap, parse_map
from gateway.planner.accelerometer import AccelerometerList, parse_accelerometers
from gateway.simulator.scenario import parse_scenario
from gateway.simulator.scenario_model import Scenario

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
    placed(data, location, marker)
    first = location[0] if location[0] != "wheel" else None
    if first is not None and isinstance(data[first], list):
        data[first].append(copy.deepcopy(data[first][0]))
    if location[:2] == ("vehicle_signals", "signal") and len(location) > 2:
        data["vehicle_signals"]["signal"] *= 2
    return data


def placed(data: dict[str, Any], location: Location, marker: str) -> None:
    """Put `marker` at a location of a document, in tables that are made where there are none."""
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


RUNS: Final = [
    {"recording": "a.mcap", "slip_deg": -1.0, "side_force_n": -900.0, "load_n": 4000.0},
    {"recording": "b.mcap", "slip_deg": 1.0, "side_force_n": 900.0, "load_n": 4000.0},
]


def of_runs(kind: type[KnownRunsFile], folder: Path) -> Callable[[str], object]:
    """Return a function that reads a text as a runs file."""

    def parse(text: str) -> object:
        (folder / "runs.toml").write_text(text)
        return load_runs(kind, folder / "runs.toml")

    return parse


def runs_with(*keys: str) -> dict[str, Any]:
    return {"run": [{key: run[key] for key in ("recording", *keys)} for run in RUNS]}


# Model, its parser and a valid document: checks between keys run only when all else is right.
OTHERS: Final[dict[str, tuple[type[BaseModel], Callable[[str, Path], object], dict[str, Any]]]] = {
    "scenario": (
        Scenario,
        lambda text, _: parse_scenario(text, "file.toml"),
        {"wheel": [{"position": "FL", "wheel": 0}]},
    ),
    "accelerometers": (
        AccelerometerList,
        lambda text, _: parse_accelerometers(text, "file.toml"),
        {"sensor": [{"name": "mine", "range_g": 100.0, "rate_hz": 4000.0}]},
    ),
    "import map": (
        ImportMap,
        lambda text, _: parse_map(text, "file.toml"),
        {
            "sampling": {"rate_hz": 4000.0},
            "sensor": {"coupling": "DC"},
            "axis": {"radial": {"column": "a", "unit": "g"}},
        },
    ),
    "slip runs": (
        SlipRunsFile,
        lambda text, folder: of_runs(SlipRunsFile, folder)(text),
        runs_with("slip_deg"),
    ),
    "force runs": (
        ForceRunsFile,
        lambda text, folder: of_runs(ForceRunsFile, folder)(text),
        runs_with("side_force_n"),
    ),
}


@pytest.mark.parametrize("kind", OTHERS)
def test_wrong_type_at_a_key_of_another_file_is_a_message(kind: str, tmp_path: Path) -> None:
    model, parse, valid = OTHERS[kind]
    parse(toml_text(valid), tmp_path)
    errors = []
    for location in paths(model):
        data = copy.deepcopy(valid)
        placed(data, location, "MARK")
        text = toml_text(data)
        for wrong in WRONG.values():
            try:
                parse(text.replace('"MARK"', wrong), tmp_path)
            except ConfigError as error:
                errors.append(error)
    assert all(".toml" in str(error) and error.remedy for error in errors)
    assert len(errors) > 5 * len(list(paths(model)))


def test_a_list_that_is_too_short_is_named(tmp_path: Path) -> None:
    (tmp_path / "runs.toml").write_text('[[run]]\nrecording = "a.mcap"\nslip_deg = 1.0\n')
    with pytest.raises(ConfigError, match="run: a list of 1 found, allowed: .*at least two runs") as caught:
        load_runs(SlipRunsFile, tmp_path / "runs.toml")
    assert "Correct 1 fault" in caught.value.remedy


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
