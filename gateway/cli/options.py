"""Command-line options that several commands share, each declared once."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

from gateway.estimators.registry import DEFAULT_ESTIMATORS, estimator_names


class FiniteRange(click.FloatRange):
    """A finite number within a range: comparisons alone let NaN pass, and infinity where a side is open."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number; fails with a usage error."""
        number = click.FLOAT.convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return super().convert(value, param, ctx)


config_option = click.option(
    "--config",
    "config_path",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Vehicle configuration (TOML).  [default: the one in the recording or scenario]",
)
duration_option = click.option(
    "--duration",
    "duration_s",
    type=FiniteRange(min=0.1),
    metavar="SECONDS",
    help="Stop after this many seconds of data. They are the seconds of a recording or a simulation, however fast it "
    "is played, and of the arrival of data from a hub; a silent hub is waited for no longer.",
)
effects_option = click.option(
    "--effects",
    "effects_paths",
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Subtract the effects found by `treadlink diagnose --save-effects`; repeat for several wheels.",
)
estimator_option = click.option(
    "--estimator",
    "estimators",
    multiple=True,
    type=click.Choice(estimator_names()),
    help=f"Estimator to run; repeat for several.  [default: {', '.join(DEFAULT_ESTIMATORS)}]",
)
force_option = click.option("--force", is_flag=True, help="Overwrite existing output files.")
keys_option = click.option(
    "--keys",
    "key_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Sensor signing keys.  [default: the key file of `treadlink keys`]",
)
publish_option = click.option(
    "--publish",
    "publish",
    multiple=True,
    metavar="URI",
    help="Publish revolutions and alarms while they arrive; repeat for several receivers. jsonl:- or jsonl:PATH (lines "
    "of JSON), mqtt://HOST/PREFIX or mqtts://, foxglove://127.0.0.1:8765, can:INTERFACE:CHANNEL, web://HOST:PORT.",
)
web_option = click.option(
    "--web",
    is_flag=True,
    help="Serve a page for browsers on this computer: wheels, trends, orders, links, marks and the recording. The "
    "address is printed. For others on the network: --publish web://0.0.0.0:8780.",
)
PAGE_URI = "web://127.0.0.1:8780"
"""Live output of `--web`."""
plain_option = click.option(
    "--plain",
    is_flag=True,
    help="Print one line per revolution instead of the screen; the default without a terminal or with TERM=dumb.",
)
