"""API reference: one page per package, filled from docstrings when the site is built."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from tools.docs_site.markdown import sentence

# Package -> what a reader finds in it. The commands and the texts have references of their own.
PACKAGES: Final[dict[str, str]] = {
    "gateway": "names for programs, loaded on first use",
    "gateway.api": "recordings, live estimates, simulation and diagnosis for programs",
    "firmware_protocol": "wire protocol: messages, encoder, stream decoder",
    "gateway.core": "types, constants, errors, clock and reasons that every room shares",
    "gateway.core.links": "byte sources: serial, TCP, Bluetooth LE",
    "gateway.core.recording": "recordings: writer, reader, replay",
    "gateway.core.wheels": "from frames of a hub to the samples and revolutions of its wheels",
    "gateway.core.contacts": "contacts of a wheel with the road, and their times",
    "gateway.core.revolutions": "angle resampling, averages, orders, contact edges",
    "gateway.core.estimates": "estimators, one interface",
    "gateway.core.trust": "what speaks against a number",
    "gateway.core.session": "live sessions and passes over recordings",
    "gateway.core.config": "vehicle configuration",
    "gateway.diagnosis": "diagnosis of model error: effects, fits, probabilities",
    "gateway.forces": "ply steer, slip, side and longitudinal force, road",
    "gateway.ring": "flexible ring: belt, contact, tread",
    "gateway.vehicle": "signals of the vehicle: CAN, NMEA",
    "gateway.simulator": "simulated tires, hubs and link faults",
    "gateway.importing": "import of foreign measurements",
    "gateway.exporting": "export of measurements to the files of other programs",
    "gateway.publishing": "live outputs: JSON lines, MQTT, Foxglove, CAN",
    "gateway.fleet": "campaigns over thousands of recordings, their dataset and its trends",
    "gateway.compare": "comparison of recordings",
    "gateway.viewer": "recordings in a browser: samples, revolutions, orders",
    "gateway.glossary": "words of the program",
    "gateway.inflation": "warning of low pressure",
    "gateway.security": "signed frames and their keys, commands to hubs",
    "gateway.makers": "check of a firmware against the protocol",
    "gateway.bench": "set-up of hubs and sensors",
    "gateway.upkeep": "repair, compression and merging of recordings",
    "gateway.planner": "what a sensor will be able to measure, before it is bought",
}
NOT_IN_API: Final = frozenset(
    {"gateway.core.cli", "gateway.core.compiled", "gateway.core.text", "gateway.console", "gateway.papers"}
)
"""Packages without a page: commands, texts and what draws."""

IN_SEARCH: Final = frozenset({"gateway", "gateway.api", "firmware_protocol"})
"""Packages that programs of others import: names within the others would stand before the pages that explain a word."""

_ROOT: Final = Path(__file__).parents[2]
_NOT_IN_SEARCH: Final = ("---", "search:", "  exclude: true", "---")


def api_markdown() -> dict[str, Callable[[], str]]:
    """Return file name -> what writes the page of every package, and an index."""
    return {"index.md": _index, **{_file(package): partial(_page, package) for package in PACKAGES}}


def _file(package: str) -> str:
    return f"{package.replace('.', '-')}.md"


def _index() -> str:
    lines = ["# API", "", "Python modules by package. Types are part of every signature; units are in the names.", ""]
    lines += [f"- [`{package}`]({_file(package)}): {meaning}" for package, meaning in PACKAGES.items()]
    return "\n".join(lines) + "\n"


def _page(package: str) -> str:
    head = () if package in IN_SEARCH else _NOT_IN_SEARCH
    lines = [*head, f"# {package}", "", sentence(PACKAGES[package]), ""]
    for module in _modules(package):
        lines += [f"::: {module}", ""]
    return "\n".join(lines)


def _modules(package: str) -> list[str]:
    """Return the public modules of a package, those of its subpackages included, except for those that hold rooms."""
    folder = _ROOT / package.replace(".", "/")
    paths = sorted(folder.glob("*.py") if package in ("gateway", "gateway.core") else folder.rglob("*.py"))
    modules = [str(path.relative_to(_ROOT).with_suffix("")).replace("/", ".") for path in paths]
    return [name for name in modules if not name.rpartition(".")[2].startswith("_")]
