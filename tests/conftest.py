"""Settings of every test run: threads of numpy, hypothesis, SIGINT of children, options for stored results.

Fixtures: a TCP hub, a thread that reads a source, and a browser.
"""

from __future__ import annotations

import ctypes
import functools
import gc
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from gateway.core.links.source import Source
    from tests.testkit.hub_ends import Reader, TcpHub
    from tools.browser import Browser

# Small matrices everywhere: a thread for each product costs more than the product. Set before numpy is imported.
for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

# Children find this program compiled.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# jsonschema imports it where it is installed, and it compiles a grammar of IRIs for 1.3 s; no schema has an IRI.
sys.modules.setdefault("rfc3987_syntax", None)  # type: ignore[arg-type]

# The same examples everywhere and every time, and no limit of time: a busy computer is no failure. `make nightly` runs
# with fresh seeds and prints what repeats a failure.
settings.register_profile(
    "usual", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
settings.register_profile("nightly", settings.get_profile("usual"), derandomize=False)
settings.load_profile("usual")

# A parent that ignores SIGINT, as a shell does in the background, hands that on. Children need the default for Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


# Commands find the running sessions of their user: not those of another test run, or of another process of this one.
_RUNTIME_FOLDER = tempfile.mkdtemp(prefix="treadlink-tests-")
os.environ["XDG_RUNTIME_DIR"] = _RUNTIME_FOLDER


def pytest_unconfigure():
    """Remove the folder of running sessions."""
    shutil.rmtree(_RUNTIME_FOLDER, ignore_errors=True)


def pytest_addoption(parser):
    """Add the option that accepts changed results; see tests/golden."""
    parser.addoption("--update-golden", action="store_true", help="store changed results and print them")
    parser.addoption("--golden-numbers", action="store_true", help="compare the numbers of stored results only")


def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None):
    """Free what a module has cached when its tests are over, and what helpers have when the folder changes.

    A worker that keeps the recordings and diagnoses of every module grows beyond 1.8 GB.
    """
    if nextitem is not None and nextitem.path == item.path:
        return
    module = getattr(getattr(item, "module", None), "__name__", "")
    is_room_over = nextitem is None or nextitem.path.parent != item.path.parent
    for name, loaded in list(sys.modules.items()):
        if name == module or (is_room_over and name.startswith(("tests.testkit.", "tools."))):
            for value in list(vars(loaded).values()):
                if isinstance(value, functools._lru_cache_wrapper):
                    value.cache_clear()
    if is_room_over:
        gc.collect()
        # What is free stays with the process otherwise.
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


@pytest.fixture
def tcp_hub() -> Iterator[TcpHub]:
    from tests.testkit.hub_ends import TcpHub

    hub = TcpHub()
    yield hub
    hub.close()


@pytest.fixture
def read() -> Iterator[Callable[[Source], Reader]]:
    from tests.testkit.hub_ends import Reader

    readers: list[Reader] = []

    def start(source: Source) -> Reader:
        readers.append(Reader(source))
        return readers[-1]

    yield start
    for reader in readers:
        reader.finish()
        reader.source.close()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    from tools.browser import CHROMIUM, Browser

    if CHROMIUM is None:
        if os.environ.get("CI"):
            pytest.fail("chromium is missing; CI must have it")
        pytest.skip("no chromium is installed")
    browser = Browser(tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()
