"""Options that describe a test run, and those that select runs by their description."""

import functools
from collections.abc import Callable
from typing import Any

import click

from gateway.core.nearest_name import did_you_mean
from gateway.core.recording.run_description import (
    KEYS,
    MAX_TEXT_CHARS,
    RunDescription,
    RunFilter,
    TireIdentity,
    parse_tire,
)


def run_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options that describe a run; the command gets them as one `run`, a `RunDescription`."""

    @functools.wraps(command)
    def with_run(
        *args: Any, test: str, driver: str, comment: str, tags: tuple[str, ...], tires: tuple[Any, ...], **kwargs: Any
    ) -> None:
        run = RunDescription(test, driver, comment, tuple(dict.fromkeys(tags)))
        for position, tire in tires:
            run = run.overridden_by(RunDescription(tires={position: tire}))
        return command(*args, run=run, **kwargs)

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
    try:
        return parse_tire(text)
    except ValueError as error:
        raise click.BadParameter(str(error)) from error


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
