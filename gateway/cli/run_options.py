"""Options that describe a test run, and those that select runs by their description."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, Final

import click

from gateway.nearest_name import did_you_mean
from gateway.recording.run_description import KEYS, MAX_TEXT_CHARS, RunDescription, RunFilter, TireIdentity

# Key of --tire -> field, and factor to SI; None for a text.
_TIRE_KEYS: Final[dict[str, tuple[str, float | None, float]]] = {
    "maker": ("maker", None, 0.0),
    "dot": ("dot", None, 0.0),
    "wear_mm": ("wear_m", 1e-3, 60.0),
    "run_in_km": ("run_in_m", 1e3, 1e6),
}


def run_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options that describe a run; the command gets them as one `run`, a `RunDescription`."""

    @functools.wraps(command)
    def with_run(
        *args: Any, test: str, driver: str, comment: str, tags: tuple[str, ...], tires: tuple[Any, ...], **rest: Any
    ) -> None:
        run = RunDescription(test, driver, comment, tuple(dict.fromkeys(tags)))
        for position, tire in tires:
            run = run.overridden_by(RunDescription(tires={position: tire}))
        return command(*args, run=run, **rest)

    texts: dict[str, Any] = {"default": "", "callback": checked_text}
    for option in (
        click.option(
            "--tire",
            "tires",
            multiple=True,
            metavar="POSITION:KEY=VALUE,...",
            callback=lambda _context, _option, values: tuple(map(_tire, values)),
            help="Tire at a wheel, such as FL:maker=Acme Grip,dot=3524,wear_mm=1.5,run_in_km=300; repeat for several.",
        ),
        click.option(
            "--tag", "tags", multiple=True, metavar="WORD", callback=checked_texts, help="Tag, also several: a,b."
        ),
        click.option("--comment", metavar="TEXT", **texts, help="Comment on the run."),
        click.option("--driver", metavar="NAME", **texts, help="Who drives."),
        click.option(
            "--test",
            metavar="NAME",
            **texts,
            help="Name of the test. It, driver, tires, comment and tags stand in the recording; what is not given is "
            "that of [test] in the vehicle configuration.",
        ),
    ):
        with_run = option(with_run)
    return with_run


def checked_text(_context: click.Context, _option: click.Parameter, value: str) -> str:
    """Return a text of a description without surrounding space; fails with a usage error for one that is too long."""
    if len(value) > MAX_TEXT_CHARS:
        raise click.BadParameter(f"it has {len(value)} characters; at most {MAX_TEXT_CHARS} are kept.")
    return value.strip()


def checked_texts(context: click.Context, option: click.Parameter, values: tuple[str, ...]) -> tuple[str, ...]:
    """Return texts likewise, without empty ones; a comma separates two, as it does where they are shown."""
    texts = ",".join(values).split(",")
    return tuple(filter(None, (checked_text(context, option, text) for text in texts)))


def _tire(text: str) -> tuple[str, TireIdentity]:
    position, colon, entries = text.partition(":")
    if not colon or not position.strip():
        raise click.BadParameter(f"'{text}' is not POSITION:KEY=VALUE. Give for example FL:maker=Acme,dot=3524.")
    values: dict[str, Any] = {}
    for entry in entries.split(","):
        key, equals, value = (part.strip() for part in entry.partition("="))
        if key not in _TIRE_KEYS or not value:
            fault = f"a tire has no key '{key}'" if equals and value else f"'{entry}' is not KEY=VALUE"
            raise click.BadParameter(f"{fault}. {did_you_mean(key, _TIRE_KEYS)}Keys: {', '.join(_TIRE_KEYS)}.")
        name, factor, largest = _TIRE_KEYS[key]
        values[name] = value[:MAX_TEXT_CHARS] if factor is None else _number(entry, value, largest) * factor
    return position.strip(), TireIdentity(**values)


def _number(entry: str, text: str, largest: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= largest:
        raise click.BadParameter(f"'{entry}' is no number from 0 to {largest:g}.")
    return value


def _filter(_context: click.Context, _option: click.Parameter, values: tuple[str, ...]) -> RunFilter:
    conditions = []
    for text in values:
        key, equals, pattern = (part.strip() for part in text.partition("="))
        if key not in KEYS or not equals:
            raise click.BadParameter(f"'{text}' is no KEY=PATTERN. {did_you_mean(key, KEYS)}Keys: {', '.join(KEYS)}.")
        conditions.append((key, pattern))
    return RunFilter(tuple(conditions))


where_option = click.option(
    "--where",
    "where",
    multiple=True,
    metavar="KEY=PATTERN",
    callback=_filter,
    help=f"Only runs whose description fits, such as test=braking* or tag=wet; repeat for several, which must all fit. "
    f"Keys: {', '.join(KEYS)}.",
)
