"""Size, cost, test coverage and resistance of the reference collector.

Run `python -m tests.makers.firmware.bench_firmware`: half a minute, with QEMU and a compiler for Arm.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from gateway.core.errors import SourceError
from tests.testkit.emulated_firmware.firmware_build import (
    CORTEX_M4,
    WARNINGS,
    build_board,
    build_host,
    build_stm32f405,
    include_flags,
    library_sources,
    require_board_tools,
    write_protocol,
)

ROOT = Path(__file__).parents[3]
CLOCK_HZ = 64e6
RATE_HZ = 9600.0
# Cycles of an instruction on a Cortex-M4: 1 for most, 2 to 3 for loads and taken branches, more with a slow flash.
CYCLES = (1.0, 1.5)
AES_BLOCKS = 16
OPTIMISATIONS = ("-Os", "-O2")
LABELS = {
    "put_unsigned": "interrupt: take 36 samples from the FIFO",
    "frame_unsigned": "a frame of 36 samples",
    "sample_unsigned": "a sample, all included",
    "frame_signed": "a signed frame of 35 samples",
    "sample_signed": "a sample, all included, signed",
    "idle_poll": "main loop with nothing to do",
    "second_signed": "HELLO, ENVIRONMENT, HUB_STATUS, TIME_SYNC, signed",
    "command_unsigned": "a command with its reply",
    "command_signed": "a signed command with its reply",
    "boot_count": "boot counter",
}


def main() -> None:
    try:
        require_board_tools()
    except SourceError as missing:
        print(f"skipped: {missing}. {missing.remedy}")
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sizes(folder)
        software = costs(folder, "-O2")
        hardware = costs(folder, "-O2", "-DTL_AES_HARDWARE")
        instructions(software, hardware)
        load(software, hardware)
        memory(software)
        failed = attack(folder) + coverage(folder)
    sys.exit(failed != 0)


def sizes(folder: Path) -> None:
    """Print the flash of the library's objects, as arm-none-eabi-size counts it."""
    generated = write_protocol(folder)
    sources = [generated, *library_sources()]
    for optimisation in OPTIMISATIONS:
        objects = []
        for source in sources:
            objects.append(folder / f"{source.stem}.o")
            flags = [*CORTEX_M4, "-ffunction-sections", optimisation, *WARNINGS, *include_flags(folder)]
            subprocess.run(["arm-none-eabi-gcc", *flags, "-c", source, "-o", objects[-1]], check=True)
        print(f"$ arm-none-eabi-size -t *.o    # {optimisation}")
        table = subprocess.run(
            ["arm-none-eabi-size", "-t", *(path.name for path in objects)],
            cwd=folder,
            capture_output=True,
            text=True,
            check=True,
        )
        print(table.stdout)
        board = build_board(folder, (optimisation,))
        port = build_stm32f405(folder, (optimisation,))
        for image, what in ((board, "the emulated board with the bench"), (port, "the STM32F405 with its drivers")):
            whole = subprocess.run(
                ["arm-none-eabi-size", image.name], cwd=folder, capture_output=True, text=True, check=True
            ).stdout.splitlines()[1]
            print(f"image of {what}:\n{whole}\n")


def costs(folder: Path, *options: str) -> dict[str, int]:
    """Return what the measuring program on the emulated board counts."""
    image = build_board(folder, options, main="measure.c")
    command = ["qemu-system-arm", "-M", "mps2-an386", "-display", "none", "-monitor", "none", "-nodefaults"]
    command += ["-icount", "shift=0", "-serial", "stdio", "-kernel", str(image)]
    results: dict[str, int] = {}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.strip() == "end":
                break
            key, value = line.split()
            results[key] = int(value)
        process.kill()
    return results


def instructions(software: dict[str, int], hardware: dict[str, int]) -> None:
    print(f"{'instructions, -O2 (resolution 40 except per sample)':52s} {'AES in C':>9s} {'AES hw':>9s}")
    for key, label in LABELS.items():
        print(f"{label:52s} {software[key]:9d} {hardware[key]:9d}")
    print()


def load(software: dict[str, int], hardware: dict[str, int]) -> None:
    print(f"{'load by a wheel: 3 axes, 9600 Hz, 64 MHz':52s} {'Minstr/s':>9s} {'1 cycle':>8s} {'1.5 cycles':>10s}")
    for label, result, key in (
        ("unsigned", software, "sample_unsigned"),
        ("signed, AES in C", software, "sample_signed"),
        ("signed, AES in hardware (its own time comes on top)", hardware, "sample_signed"),
    ):
        rate = result[key] * RATE_HZ
        single, more = (f"{100.0 * rate * cycles / CLOCK_HZ:.1f} %" for cycles in CYCLES)
        print(f"{label:52s} {rate / 1e6:9.2f} {single:>8s} {more:>10s}")
    frames = RATE_HZ / 35.0
    print(f"AES blocks of a signed stream: {frames * AES_BLOCKS:.0f} per s\n")


def memory(result: dict[str, int]) -> None:
    print("RAM, bytes")
    wheels = 4
    for label, value in (
        (f"collector with {wheels} wheels and 16 frames of queue", result["ram_collector"]),
        ("of these, a wheel", result["ram_wheel"]),
        ("of these, the queue", result["ram_queue"]),
        ("stack, greatest depth of all measured", result["stack_bytes"]),
    ):
        print(f"  {label:50s} {value:6d}")
    print()


def attack(folder: Path) -> int:
    """Print the counts of hostile commands; return 0 when none was carried out."""
    program = build_host(folder, ("-O2",), main="attack.c")
    done = subprocess.run([program, "1000000"], capture_output=True, text=True, check=False)
    print(done.stdout)
    return done.returncode


def coverage(folder: Path) -> int:
    """Print the lines of the library that the tests on the host execute, under the sanitizers."""
    build = folder / "covered"
    build.mkdir()
    tests = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "tests/makers/firmware",
        "--deselect",
        "tests/makers/firmware/test_emulated_board.py",
    ]
    environment = {**os.environ, "TREADLINK_COLLECTOR_BUILD": str(build)}
    done = subprocess.run(tests, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    print(done.stdout.splitlines()[-1])
    print(f"{'coverage, gcov':52s} {'lines':>9s} {'executed':>9s}")
    total = [0, 0.0]
    for source in library_sources():
        report = subprocess.run(
            ["gcov", "-n", f"collector-{source.stem}.gcda"], cwd=build, capture_output=True, text=True, check=False
        ).stdout
        match = re.search(rf"File '\S*{source.name}'\nLines executed:([\d.]+)% of (\d+)", report)
        assert match is not None, report
        percent, lines = float(match[1]), int(match[2])
        total = [total[0] + lines, total[1] + percent * lines]
        print(f"{source.name:52s} {lines:9d} {percent:7.1f} %")
    print(f"{'in all':52s} {total[0]:9d} {total[1] / total[0]:7.1f} %")
    return done.returncode


if __name__ == "__main__":
    main()
