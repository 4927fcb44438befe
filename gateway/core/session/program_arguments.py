"""Arguments of functions for programs: paths, names and configurations in the forms that programs have."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gateway.core.config.document_tables import document_text
from gateway.core.config.vehicle import VehicleConfig, choose_vehicle, parse_vehicle

PathLike = Path | str
Config = VehicleConfig | Mapping[str, Any] | Path | str

_CONFIGURATION: Final = "the configuration"


def paths(one_or_several: PathLike | Sequence[PathLike]) -> list[Path]:
    """Return one or several paths as a list."""
    return [Path(path) for path in ([one_or_several] if isinstance(one_or_several, str | Path) else one_or_several)]


def several_names(one_or_several: str | Sequence[str]) -> tuple[str, ...]:
    """Return one or several names of estimators as a tuple."""
    return (one_or_several,) if isinstance(one_or_several, str) else tuple(one_or_several)


def chosen_vehicle(config: Config | None, provided: Sequence[str | None], origin: str) -> VehicleConfig | None:
    """Return a configuration as given, else the first that sources provide, else None.

    Raises:
        ConfigError: it cannot be read, or has faults.
    """
    if isinstance(config, Mapping):
        config = parse_vehicle(document_text(config, _CONFIGURATION), _CONFIGURATION)
    elif isinstance(config, str):
        config = Path(config)
    return choose_vehicle(config, provided, origin)
