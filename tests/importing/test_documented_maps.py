import re
from pathlib import Path

from gateway.config.vehicle import parse_vehicle
from gateway.importing.import_map import parse_map

DOCS = Path(__file__).parents[2] / "docs"


def toml_of(page: str) -> str:
    match = re.search(r"```toml\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL)
    assert match is not None
    return match[1]


def test_documented_configuration_is_valid() -> None:
    config = parse_vehicle(toml_of("how-to/describe-a-vehicle.md"), "describe-a-vehicle.md")
    assert [setup.position for setup in config.wheel_setups()] == ["FL", "FR", "RL"]


def test_documented_map_is_valid() -> None:
    assert parse_map(toml_of("how-to/import-measurements.md"), "map.md").columns() == (
        "acc x",
        "acc y",
        "acc z",
        "p",
        "T",
    )


def test_example_vehicle_is_valid() -> None:
    path = Path(__file__).parents[2] / "examples" / "vehicle.toml"
    config = parse_vehicle(path.read_text(encoding="utf-8"), str(path))
    setups = config.wheel_setups()
    assert [setup.position for setup in setups] == ["FL", "FR", "RL", "RR"]
    assert all(setup.load_n is not None and setup.pressure_pa is not None for setup in setups)
