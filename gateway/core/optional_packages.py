"""Packages of the extras: an error that says what to install where one is missing."""

from importlib.util import find_spec

from gateway.core.errors import OutputError


def require_packages(what: str, extra: str, *names: str) -> None:
    """Raise OutputError, naming the extra to install, when a package is missing.

    Args:
        what: needs them, such as `the HTML report`.
        extra: of treadlink, which brings them.
        names: of the packages.
    """
    missing = [name for name in names if find_spec(name) is None]
    if missing:
        note = "which is not installed" if len(missing) == 1 else "which are not installed"
        raise OutputError(f"{what} needs {' and '.join(missing)}, {note}", f"Install: pip install 'treadlink[{extra}]'")
