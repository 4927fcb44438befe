"""The collector, built once: for this computer with sanitizers and coverage, and for the emulated board."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.testkit.collector_bench import HostCollector
from tests.testkit.emulated_firmware.firmware_build import build_board, build_host, missing_packages

CHECKED = (
    "-O1",
    "-g",
    "--coverage",
    "-fsanitize=address,undefined",
    "-fno-sanitize-recover=all",
)


def require(program: str, package: str) -> None:
    """Skip without a program; in CI, which installs it, fail."""
    if shutil.which(program) is None:
        if os.environ.get("CI"):
            pytest.fail(f"{program} is missing; CI must have it")
        pytest.skip(f"{program} is not installed (package {package})")


@pytest.fixture(scope="session")
def host_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    require("gcc", "gcc")
    # A tool that reads the coverage names the folder.
    named = os.environ.get("TREADLINK_COLLECTOR_BUILD")
    return Path(named) if named else tmp_path_factory.mktemp("collector-host")


@pytest.fixture(scope="session")
def host(host_folder: Path) -> HostCollector:
    return HostCollector(build_host(host_folder, CHECKED))


@pytest.fixture(scope="session")
def run(host: HostCollector) -> Callable[..., bytes]:
    return lambda *records: host.run(b"".join(records))


@pytest.fixture(scope="session")
def board_image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    missing = missing_packages()
    if missing:
        if os.environ.get("CI"):
            pytest.fail(f"CI must have {' '.join(missing)}")
        pytest.skip(f"not installed: {' '.join(missing)}")
    return build_board(tmp_path_factory.mktemp("collector-board"))
