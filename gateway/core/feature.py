"""Features: packages beside the core, and what each adds to the core's registries.

The core imports no feature. `gateway.features` lists those of this package, each with a declaration; packages of others
add to the same registries by entry points of the same groups (`gateway.core.plugins`). A declaration names objects as
`module:attribute`, and nothing is imported before it is used.
"""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from typing import Any, Final, NamedTuple

_LIST: Final = "gateway.features"


class Registry(StrEnum):
    """Registries of the core and of features, by the group of their entry points."""

    COMMANDS = "treadlink.commands"
    """`click.Command` by its name."""
    SOURCES = "treadlink.sources"
    """`gateway.core.links.source.SourceKind` by the scheme of its URI."""
    ESTIMATORS = "treadlink.estimators"
    """Class that follows `gateway.core.estimates.estimator.Estimator`, by the estimator's name."""
    NUMBERS = "treadlink.numbers"
    """Likewise an estimator of the ring's four numbers, which wear and load can rest on."""
    QUANTITIES = "treadlink.quantities"
    """Tuple of `gateway.core.quantity.Quantity` that an estimator gives, by the estimator's name."""
    VEHICLE_KEYS = "treadlink.vehicle-keys"
    """`gateway.core.config.validation.AddedKey` by its name, as `tire.laminate`."""
    ESTIMATE_OUTPUTS = "treadlink.estimate-outputs"
    """`gateway.core.cli.estimate_outputs.AddedOutput` by its name."""
    PARTS = "treadlink.parts"
    """Part of a session by its name in `gateway.core.session.session_parts`, which says what the core asks of it."""
    WHEEL_WATCHES = "treadlink.wheel-watches"
    """Class that follows `gateway.core.session.wheel_watches.WheelWatch`, called with the vehicle, by any name."""
    EFFECTS = "treadlink.effects"
    SINKS = "treadlink.sinks"
    IMPORTERS = "treadlink.importers"
    PLUGIN_CHECKS = "treadlink.plugin-checks"
    """Function that returns each `PluginStatus` of a feature's registry, by its group; called where it has plug-ins."""
    VEHICLE_CHECKS = "treadlink.vehicle-checks"
    """Function of a `WheelSetup` that yields what `doctor` says of a wheel that a file describes, by any name."""


class CommandLine(NamedTuple):
    """A command of a feature.

    Attributes:
        target: `module:attribute` of the `click.Command`.
        summary: its line in `treadlink --help`.
    """

    target: str
    summary: str


@dataclass(frozen=True, slots=True)
class Feature:
    """Declaration of a feature.

    Attributes:
        commands: by name, in the order of `treadlink --help`.
        adds: objects by name, `module:attribute`, for each registry.
    """

    commands: Mapping[str, CommandLine] = field(default_factory=dict)
    adds: Mapping[Registry, Mapping[str, str]] = field(default_factory=dict)


@cache
def features() -> tuple[Feature, ...]:
    """Return the declarations of this package's features, in their order."""
    names: tuple[str, ...] = importlib.import_module(_LIST).FEATURES
    return tuple(importlib.import_module(name).FEATURE for name in names)


@cache
def added(registry: Registry) -> Mapping[str, str]:
    """Return what this package's features add to a registry, `module:attribute` by name; nothing of it is imported."""
    return {name: target for feature in features() for name, target in feature.adds.get(registry, {}).items()}


def object_of(target: str) -> Any:
    """Return the object of `module:attribute`."""
    module_name, _, attribute = target.partition(":")
    return getattr(importlib.import_module(module_name), attribute)
