"""Command-line option that takes the path of a file or folder."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

Command = TypeVar("Command", bound=Callable[..., Any])


def path_option(
    *names: str, metavar: str = "FILE", allow_dash: bool = False, **settings: Any
) -> Callable[[Command], Command]:
    """Return an option of `click` whose value is a `Path`.

    Args:
        names: of the option and its parameter, as in `click.option`.
        metavar: what the path is of.
        allow_dash: whether - stands for standard output.
        settings: others of `click.option`, such as `help`.
    """
    return click.option(*names, type=click.Path(path_type=Path, allow_dash=allow_dash), metavar=metavar, **settings)
