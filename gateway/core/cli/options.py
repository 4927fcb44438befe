"""Command-line options that several commands share, each declared once."""

import math
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypedDict

import click

from gateway.core.cli.path_option import path_option
from gateway.core.constants import LONGEST_LATENCY_S
from gateway.core.estimates.registry import DEFAULT_ESTIMATORS, estimator_names
from gateway.core.nearest_name import did_you_mean
from gateway.core.removed_names import replacement

_SPLIT_UNITS: Final = {
    "MB": ("size", 10**6),
    "GB": ("size", 10**9),
    "s": ("time", 10**9),
    "min": ("time", 60 * 10**9),
    "h": ("time", 3600 * 10**9),
}


class FiniteRange(click.FloatRange):
    """A finite number within a range: comparisons alone let NaN pass, and infinity where a side is open."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number; fails with a usage error."""
        number = click.FLOAT.convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return super().convert(value, param, ctx)


class KnownName(click.Choice[str]):
    """One of several names; for another one the most similar is proposed."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name; fails with a usage error."""
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            option = param.opts[0] if param is not None else ""
            if (remedy := replacement(option, str(value))) is not None:
                raise click.BadParameter(f"'{value}' was removed. {remedy}") from error
            raise click.BadParameter(f"{error.message} {did_you_mean(str(value), self.choices)}".rstrip()) from error


def split_limit(text: str | None) -> tuple[str, int] | None:
    """Return the size in bytes or the time in ns of a file of a recording, as `("size", bytes)` or `("time", ns)`.

    Raises:
        BadParameter: it is neither.
    """
    if text is None:
        return None
    match = re.fullmatch(r"(\d+(?:\.\d+)?) ?(MB|GB|s|min|h)", text)
    kind, unit = _SPLIT_UNITS[match[2]] if match is not None else ("", 0)
    limit = round(float(match[1]) * unit) if match is not None else 0
    if limit < (10**6 if kind == "size" else 10**9):
        raise click.BadParameter(
            f"'{text}' is no size and no time. Give 500MB, 2GB, 90s, 30min or 1h, 1 MB or 1 s at least."
        )
    return kind, limit


config_option = path_option(
    "--config", "config_path", help="Vehicle configuration (TOML).  [default: the one in the recording or scenario]"
)
duration_option = click.option(
    "--duration",
    "duration_s",
    type=FiniteRange(min=0.1),
    metavar="SECONDS",
    help="Stop after this many seconds of data: of a recording or a simulation those in it, however fast it is played. "
    "A silent hub is waited for no longer.",
)
effects_option = path_option(
    "--effects",
    "effects_paths",
    multiple=True,
    help="Subtract the effects found by `treadlink diagnose --save-effects`; repeat for several wheels.",
)
estimator_option = click.option(
    "--estimator",
    "estimators",
    multiple=True,
    type=KnownName(estimator_names()),
    metavar="NAME",
    help=f"Estimator to run in place of the default ones; repeat for several: {', '.join(estimator_names())}.  "
    f"[default: {', '.join(DEFAULT_ESTIMATORS)}]",
)
force_option = click.option("--force", is_flag=True, help="Overwrite existing output files.")
keys_option = path_option(
    "--keys", "key_file", help="Sensor signing keys.  [default: the key file of `treadlink keys`]"
)
latency_option = click.option(
    "--latency",
    "latency_s",
    type=FiniteRange(0.0, LONGEST_LATENCY_S),
    default=0.0,
    show_default=True,
    metavar="SECONDS",
    help="Longest time that a result may wait to be computed together with others: 0.5 halves the processor time.",
)
publish_option = click.option(
    "--publish",
    "publish",
    multiple=True,
    metavar="URI",
    help="Publish revolutions and alarms while they arrive; repeat for several receivers. jsonl:- or jsonl:PATH (lines "
    "of JSON), mqtt://HOST/PREFIX or mqtts://, foxglove://127.0.0.1:8765, can:INTERFACE:CHANNEL, web://HOST:PORT, "
    "influx:PATH or influx://HOST/BUCKET (line protocol), prometheus://127.0.0.1:9464, "
    "webhook:https://HOST/PATH (alarms).",
)
web_option = click.option(
    "--web",
    is_flag=True,
    help="Serve a page for browsers on this computer: wheels, trends, orders, links, marks and the recording. The "
    "address is printed. For others on the network: --publish web://0.0.0.0:8780.",
)
PAGE_URI = "web://127.0.0.1:8780"
"""Live output of `--web`."""
split_option = click.option(
    "--split",
    callback=lambda _context, _option, text: split_limit(text),
    metavar="SIZE|TIME",
    help="Go on in a new file at this size or after this time, such as 500MB, 2GB, 30min or 1h. Each file can be used "
    "alone, and no frame is lost or in two of them.",
)
keep_option = click.option(
    "--keep",
    type=click.IntRange(min=2),
    metavar="N",
    help="With --split, keep the last N files of this session and remove older ones.  [default: all]",
)


class SessionOptions(TypedDict):
    """What `--config` and `session_options` give, as `gateway.core.cli.session_setup.start_session` takes it."""

    config_path: Path | None
    duration_s: float | None
    key_file: Path | None
    estimators: tuple[str, ...]
    effects_paths: tuple[Path, ...]


def session_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options of every session, beside `--config`."""
    return duration_option(keys_option(estimator_option(effects_option(command))))


plain_option = click.option(
    "--plain",
    is_flag=True,
    help="Print one line per revolution instead of the screen; the default without a terminal or with TERM=dumb.",
)


def given_command() -> str:
    """Return the command that runs with its arguments and the options that were given, quoted as for a shell."""
    context = click.get_current_context()
    words = context.command_path.split()
    for parameter in context.command.params:
        name = parameter.name or ""
        if (
            context.get_parameter_source(name) is not click.core.ParameterSource.COMMANDLINE
            or name not in context.params
        ):
            continue
        value = context.params[name]
        several = isinstance(value, tuple)
        for argument in value if several else (value,):
            if isinstance(parameter, click.Option):
                words.append(parameter.opts[0])
            if argument is not True:
                words.append(str(argument))
    return shlex.join(words)
