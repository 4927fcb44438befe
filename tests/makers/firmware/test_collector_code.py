"""The collector's code: warnings, static analysis, and what it may use."""

import re
import subprocess
from pathlib import Path

import pytest

from gateway.core.errors import SourceError
from tests.makers.firmware.conftest import require
from tests.testkit.commands import run
from tests.testkit.emulated_firmware.firmware_build import (
    COLLECTOR,
    build_host,
    include_flags,
    require_board_tools,
    write_protocol,
)

HEAP_AND_SYSTEM = re.compile(r"\b(malloc|calloc|realloc|free|printf|sprintf|alloca|assert)\s*\(")


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("main", ["host.c", "attack.c"])
def test_compiles_without_a_warning(tmp_path: Path, compiler: str, main: str) -> None:
    require(compiler, compiler)
    assert build_host(tmp_path, ("-O2",), compiler, main).exists()


def test_static_analysis_finds_nothing(tmp_path: Path) -> None:
    require("cppcheck", "cppcheck")
    generated = write_protocol(tmp_path)
    command = [
        "cppcheck",
        "--std=c11",
        "--enable=warning,style,performance,portability",
        "--error-exitcode=1",
        "--quiet",
    ]
    # The board's linker script makes symbols that lie in one object although cppcheck takes them for several.
    command += ["--suppress=missingIncludeSystem", "--suppress=comparePointers", "--suppress=unusedStructMember"]
    command += [
        *include_flags(tmp_path),
        *(f"-I{COLLECTOR / 'ports' / port}" for port in ("mps2", "parts")),
        str(COLLECTOR),
        str(generated),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_written_collector_compiles_on_its_own(tmp_path: Path) -> None:
    require("gcc", "gcc")
    run("protocol", "collector", "--out", tmp_path)
    assert (tmp_path / "README.md").exists()
    sources = [*tmp_path.glob("*.c"), tmp_path / "ports/bench/bench.c", tmp_path / "ports/host/host.c"]
    command = ["gcc", "-std=c11", "-D_POSIX_C_SOURCE=200809L", f"-I{tmp_path}", f"-I{tmp_path / 'ports/bench'}"]
    subprocess.run([*command, *sources, "-o", tmp_path / "collector"], check=True)


def test_missing_programs_are_named_by_their_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda program: None)
    with pytest.raises(SourceError, match="the emulated board needs QEMU and a compiler for Arm") as refused:
        require_board_tools()
    assert "apt install qemu-system-arm gcc-arm-none-eabi libnewlib-arm-none-eabi" in refused.value.remedy


def test_library_uses_no_heap_and_no_system() -> None:
    sources = [*COLLECTOR.glob("*.c"), *COLLECTOR.glob("*.h")]
    assert len(sources) > 8
    for path in sources:
        assert HEAP_AND_SYSTEM.search(path.read_text("utf-8")) is None, path.name


def test_ports_are_about_a_dozen_functions() -> None:
    header = (COLLECTOR / "tl_port.h").read_text("utf-8")
    assert 12 <= len(set(re.findall(r"\btl_port_\w+(?=\()", header))) <= 14
