"""Build of the reference collector: for this computer, and for the emulated board."""

import shutil
import subprocess
from enum import StrEnum
from pathlib import Path
from typing import Final

import firmware_protocol
from firmware_protocol.cgen import ENCODER_NAME, HEADER_NAME, c_encoder, c_header
from gateway.core.errors import SourceError

COLLECTOR: Final = Path(firmware_protocol.__file__).parent / "collector"
BENCH_PAGE_BYTES: Final = 256
"""Size of a flash page at the bench, small so that pages are erased often."""

WARNINGS: Final = (
    "-std=c11",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wshadow",
    "-Wcast-align",
    "-Wstrict-prototypes",
    "-Wmissing-prototypes",
    "-Wundef",
    "-Wswitch-default",
    "-Werror",
)
CORTEX_M4: Final = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
BOARD_PACKAGES: Final = {
    "qemu-system-arm": "qemu-system-arm",
    "arm-none-eabi-gcc": "gcc-arm-none-eabi libnewlib-arm-none-eabi",
}
"""Debian packages by the program that they provide."""


class Port(StrEnum):
    """Port of the collector, by its folder."""

    HOST = "host"
    BOARD = "mps2"
    STM32F405 = "stm32f405"


def missing_packages() -> list[str]:
    """Return the Debian packages that the emulated board needs and that are not installed."""
    return [package for program, package in BOARD_PACKAGES.items() if shutil.which(program) is None]


def require_board_tools() -> None:
    """Check that the emulated board can be built and run.

    Raises:
        SourceError: programs are missing; the remedy names their packages.
    """
    missing = missing_packages()
    if missing:
        raise SourceError(
            "the emulated board needs QEMU and a compiler for Arm", f"Install them: apt install {' '.join(missing)}."
        )


def library_sources() -> list[Path]:
    """Return the sources of the collector itself, without any port."""
    return sorted(COLLECTOR.glob("*.c"))


def write_protocol(folder: Path) -> Path:
    """Write the generated protocol code to a folder; return its source."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / HEADER_NAME).write_text(c_header(), "utf-8")
    (folder / ENCODER_NAME).write_text(c_encoder(), "utf-8")
    return folder / ENCODER_NAME


def include_flags(folder: Path) -> list[str]:
    """Return the include options for the generated header in `folder` and the collector's own."""
    return [f"-I{path}" for path in (folder, COLLECTOR, COLLECTOR / "ports" / "bench")]


def build_host(folder: Path, options: tuple[str, ...] = ("-O2",), compiler: str = "gcc", main: str = "host.c") -> Path:
    """Build a program of this computer with the collector; return it.

    Args:
        folder: for the generated code and the program.
        options: of the compiler.
        compiler: gcc or clang.
        main: program of the port, `host.c` for the collector.

    Raises:
        SourceError: there is no compiler, or it reports a warning.
    """
    port = COLLECTOR / "ports"
    sources = [*library_sources(), port / "bench" / "bench.c", port / Port.HOST / main]
    define = f"-DTL_BOOT_PAGE_BYTES={BENCH_PAGE_BYTES}u"
    name = "collector" if main == "host.c" else Path(main).stem
    return _compile(folder, compiler, sources, name, ("-D_POSIX_C_SOURCE=200809L", define, *options))


def build_board(folder: Path, options: tuple[str, ...] = ("-Os",), main: str = "main.c") -> Path:
    """Build the image of the emulated board; return the ELF file.

    Args:
        folder: for the generated code and the image.
        options: of the compiler.
        main: program of the port, `main.c` for the collector.

    Raises:
        SourceError: there is no compiler, or it reports a warning.
    """
    port = COLLECTOR / "ports" / Port.BOARD
    sources = [*library_sources(), port / "board.c", port / main]
    if main == "main.c":
        sources.append(COLLECTOR / "ports" / "bench" / "bench.c")
    page = f"-DTL_BOOT_PAGE_BYTES={BENCH_PAGE_BYTES}u"
    return _compile_image(folder, port, sources, Path(main).with_suffix(".elf").name, (page, *options))


def build_stm32f405(folder: Path, options: tuple[str, ...] = ("-Os",)) -> Path:
    """Build the image of the STM32F405; return the ELF file.

    Args:
        folder: for the generated code and the image.
        options: of the compiler; `-DBOARD_BUS_ON_USART2` puts models of the sensors behind USART 2, for the emulator.

    Raises:
        SourceError: there is no compiler, or it reports a warning.
    """
    port = COLLECTOR / "ports" / Port.STM32F405
    parts = COLLECTOR / "ports" / "parts"
    sources = [*library_sources(), *sorted(parts.glob("*.c")), port / "board.c", port / "main.c"]
    return _compile_image(folder, port, sources, "stm32f405.elf", (f"-I{parts}", *options))


def _compile_image(folder: Path, port: Path, sources: list[Path], name: str, options: tuple[str, ...]) -> Path:
    flags = (
        *CORTEX_M4,
        "-ffunction-sections",
        "-fdata-sections",
        "-Wl,--gc-sections",
        "-nostartfiles",
        "--specs=nano.specs",
        "-T",
        str(port / f"{port.name}.ld"),
        f"-I{port}",
    )
    return _compile(folder, "arm-none-eabi-gcc", sources, name, (*flags, *options))


def _compile(folder: Path, compiler: str, sources: list[Path], name: str, options: tuple[str, ...]) -> Path:
    if shutil.which(compiler) is None:
        package = BOARD_PACKAGES.get(compiler, compiler)
        raise SourceError(f"the compiler {compiler} is missing", f"Install it: apt install {package}.")
    generated = write_protocol(folder)
    program = folder / name
    done = subprocess.run(
        [compiler, *WARNINGS, *include_flags(folder), *options, str(generated), *map(str, sources), "-o", str(program)],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise SourceError(f"the collector does not compile:\n{done.stderr}", "Report this as a defect of treadlink.")
    return program
