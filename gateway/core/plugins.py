"""Plug-ins: entries of registries that installed packages add through entry points."""

import importlib
import importlib.metadata
import logging
import opcode
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Final

from gateway.core.errors import PluginError
from gateway.core.feature import Registry
from gateway.core.reasons import CoreCode, Reason

_logger = logging.getLogger(__name__)

# Reasons are stored with every revolution.
_LONGEST_TEXT: Final = 300
_RAISE: Final = opcode.opmap["RAISE_VARARGS"]


@dataclass(frozen=True, slots=True)
class Plugin:
    """An entry point of an installed package.

    Attributes:
        group: the registry that it adds to.
        name: key of the entry.
        package: name of the package.
        version: of the package.
        target: object that the entry point names, `module:attribute`.
    """

    group: Registry
    name: str
    package: str
    version: str
    target: str


@dataclass(frozen=True, slots=True)
class PluginStatus:
    """A plug-in and the reason for its refusal.

    Attributes:
        plugin: the plug-in.
        refusal: why it is not used; None when it is.
    """

    plugin: Plugin
    refusal: Reason | None


Check = Callable[[Plugin, object], Reason | None]
"""Returns why an object does not fit a registry, None when it fits."""


@cache
def installed(group: Registry) -> tuple[Plugin, ...]:
    """Return the plug-ins of a group by name; nothing is imported."""
    plugins = []
    for entry in importlib.metadata.entry_points(group=group):
        package, version = (entry.dist.name, entry.dist.version) if entry.dist is not None else ("?", "?")
        plugins.append(Plugin(group, entry.name, package, version, entry.value))
    # The same package may be found twice, as in an editable installation.
    return tuple(sorted(set(plugins), key=lambda plugin: (plugin.name, plugin.package)))


def names(group: Registry, taken: Collection[str]) -> list[str]:
    """Return the names that plug-ins add to a registry which has the names `taken`; nothing is imported."""
    return [plugin.name for plugin in installed(group) if _name_refusal(plugin, taken) is None]


def load(group: Registry, name: str, taken: Collection[str], check: Check) -> object | None:
    """Return the object of a plug-in; None where no package adds this name.

    Raises:
        PluginError: the plug-in cannot be imported or does not fit.
    """
    for plugin in installed(group):
        if plugin.name == name and _name_refusal(plugin, taken) is None:
            loaded, refusal = _examined(plugin, check)
            if refusal is not None:
                raise PluginError(
                    plugin.name,
                    plugin.package,
                    {name: value for name, value in refusal.values if name not in refusal.code.words},
                )
            return loaded
    return None


def load_all(group: Registry, taken: Collection[str], check: Check) -> Mapping[str, object]:
    """Return the objects of all plug-ins of a group that fit, by name; the others are logged."""
    by_name = {}
    for plugin in installed(group):
        refusal = _name_refusal(plugin, taken)
        if refusal is None:
            loaded, refusal = _examined(plugin, check)
            if refusal is None:
                by_name[plugin.name] = loaded
                continue
        _logger.warning("plug-in %s of %s refused: %s", plugin.name, plugin.package, refusal.code)
    return by_name


def statuses(group: Registry, taken: Collection[str], check: Check) -> list[PluginStatus]:
    """Return every plug-in of a group with the verdict; imports them."""
    return [
        PluginStatus(plugin, _name_refusal(plugin, taken) or _examined(plugin, check)[1]) for plugin in installed(group)
    ]


def imported(plugin: Plugin) -> object | None:
    """Return the object of a plug-in as it is, None when it cannot be imported."""
    return _loaded(plugin)[0]


def missing_members(loaded: object, members: Collection[str]) -> Reason | None:
    """Return the reason that an object lacks callable members, None when it has them all."""
    missing = [member for member in members if not callable(getattr(loaded, member, None))]
    return Reason(CoreCode.PLUGIN_REFUSED, why="lacks_members", members=", ".join(missing)) if missing else None


def missing_factory(factory: str) -> Reason | None:
    """Return the reason that `module:function` names no function, None when it does; imports the module."""
    module_name, _, name = factory.partition(":")
    if callable(getattr(importlib.import_module(module_name), name, None)):
        return None
    return Reason(CoreCode.PLUGIN_REFUSED, why="lacks_members", members=factory)


def short_text(text: str) -> str:
    """Return a text of a plug-in, cut where it is too long to be stored again and again."""
    return text[:_LONGEST_TEXT] if len(text) <= _LONGEST_TEXT else f"{text[: _LONGEST_TEXT - 3]}..."


def error_text(error: BaseException) -> str:
    """Return kind and message of an error that a plug-in raised, cut to a bounded length."""
    try:
        message = str(error)
    except BaseException as inner:  # its class is the plug-in's too
        if is_from_user(inner):
            raise
        message = "its message cannot be read"
    return short_text(f"{type(error).__name__}: {message}" if message else type(error).__name__)


def is_from_user(error: BaseException) -> bool:
    """Return whether Ctrl-C or another signal caused an error that came out of a plug-in's code.

    A signal interrupts that code at any instruction, or raises in a handler of this package. A plug-in that raises
    KeyboardInterrupt itself does so in a `raise` statement of its own.
    """
    if not isinstance(error, KeyboardInterrupt):
        return False
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is None or str(trace.tb_frame.f_globals.get("__name__")).startswith("gateway."):
        return True
    return trace.tb_frame.f_code.co_code[trace.tb_lasti] != _RAISE


def _name_refusal(plugin: Plugin, taken_names: Collection[str]) -> Reason | None:
    if plugin.name in taken_names:
        return Reason(CoreCode.PLUGIN_REFUSED, why="name_taken", by="treadlink")
    packages = [rival.package for rival in installed(plugin.group) if rival.name == plugin.name and rival != plugin]
    return Reason(CoreCode.PLUGIN_REFUSED, why="name_taken", by=", ".join(packages)) if packages else None


@cache
def _loaded(plugin: Plugin) -> tuple[object, Reason | None]:
    entry = importlib.metadata.EntryPoint(plugin.name, plugin.target, plugin.group)
    try:
        return entry.load(), None
    except BaseException as error:  # code of others may raise anything, also SystemExit, and must not end the program
        if is_from_user(error):
            raise
        _logger.debug("plug-in %s of %s cannot be imported", plugin.name, plugin.package, exc_info=True)
        return None, Reason(CoreCode.PLUGIN_REFUSED, why="not_imported", error=error_text(error))


def _examined(plugin: Plugin, check: Check) -> tuple[object, Reason | None]:
    loaded, refusal = _loaded(plugin)
    if refusal is not None:
        return None, refusal
    try:
        return loaded, check(plugin, loaded)
    except BaseException as error:  # likewise
        if is_from_user(error):
            raise
        return None, Reason(CoreCode.PLUGIN_REFUSED, why="not_imported", error=error_text(error))
