"""The interface for programs under the name of the project: `import treadlink` offers all of `import gateway`."""

import gateway
from gateway import *  # noqa: F403 - what type checkers see; nothing is loaded here
from gateway import __version__ as __version__


def __getattr__(name: str) -> object:
    """Load a name on first use, as `gateway` does (PEP 562)."""
    if name in gateway.names():
        return getattr(gateway, name)
    raise AttributeError(f"module 'treadlink' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *gateway.names()})
