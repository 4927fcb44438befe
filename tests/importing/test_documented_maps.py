import re
from pathlib import Path

from gateway.core.config.vehicle import parse_vehicle
from gateway.importing.import_map import parse_map

DOCS = Path(__file__).parents[2] / "docs"


def toml_of(page: str, number: int = 0) -> str:
    return re.findall(r"```toml\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL)[number]


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


def test_documented_map_of_several_wheels_is_valid() -> None:
    result = parse_map(toml_of("how-to/import-measurements.md", 1), "map.md")
    assert result.columns() == ("FL z", "FR z", "FR p", "v drum")


def test_example_vehicle_is_valid() -> None:
    path = Path(__file__).parents[2] / "examples" / "vehicle.toml"
    config = parse_vehicle(path.read_text(encoding="utf-8"), str(path))
    setups = config.wheel_setups()
    assert [setup.position for setup in setups] == ["FL", "FR", "RL", "RR"]
    assert all(setup.load_n is not None and setup.pressure_pa is not None for setup in setups)
