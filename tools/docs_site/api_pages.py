"""API reference: one page per package, filled from docstrings when the site is built."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from tools.docs_site.markdown import sentence

# Package -> what a reader finds in it. The commands and the views have references of their own.
PACKAGES: Final[dict[str, str]] = {
    "firmware_protocol": "wire protocol: messages, encoder, stream decoder",
    "gateway": "types, constants, errors, clock and reasons that every layer shares",
    "gateway.ring": "belt, contact, laminate and tread models",
    "gateway.core.revolutions": "signal processing: contacts, angle resampling, averages, spectra",
    "gateway.core.estimates": "estimators, one interface",
    "gateway.core.wheels": "from samples of one wheel to revolutions and estimates",
    "gateway.diagnosis": "diagnosis of model error: effects, fits, probabilities",
    "gateway.core.config": "vehicle configuration and effects files",
    "gateway.core.links": "byte sources: serial, TCP, Bluetooth LE",
    "gateway.security": "signed frames and their keys",
    "gateway.core.recording": "recordings: writer, reader, replay, repair",
    "gateway.simulator": "simulated tires, hubs and link faults",
    "gateway.importing": "import of foreign measurements",
    "gateway.exporting": "export of measurements to the files of other programs",
    "gateway.core.session": "live, batch and campaign sessions",
    "gateway.api": "recordings, live estimates, simulation and diagnosis for programs",
    "gateway.planner": "what a sensor will be able to measure, before it is bought",
    "gateway.publishing": "live outputs: JSON lines, MQTT, Foxglove, CAN",
    "gateway.fleet.trends": "trends of tires: regression, steps, outliers",
    "gateway.fleet": "campaigns over thousands of recordings and their dataset",
}

_ROOT: Final = Path(__file__).parents[2]


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
    lines = [f"# {package}", "", sentence(PACKAGES[package]), ""]
    for module in _modules(package):
        lines += [f"::: {module}", ""]
    return "\n".join(lines)


def _modules(package: str) -> list[str]:
    """Return the public modules of a package, those of its subpackages included, except for the top package's."""
    folder = _ROOT / package.replace(".", "/")
    paths = sorted(folder.glob("*.py") if package == "gateway" else folder.rglob("*.py"))
    modules = [str(path.relative_to(_ROOT).with_suffix("")).replace("/", ".") for path in paths]
    return [name for name in modules if not name.rpartition(".")[2].startswith("_")]
