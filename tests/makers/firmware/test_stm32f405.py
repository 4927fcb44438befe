"""The port for the STM32F405: its image on the emulated chip, its drivers against models of the parts."""

import contextlib
import ctypes
import platform
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import CommandResult, Environment, Hello, LogText, Outcome, SampleBlock, SetTime
from tests.makers.firmware.conftest import require
from tests.testkit.collector_bench import command_bytes
from tests.testkit.emulated_firmware.firmware_build import (
    COLLECTOR,
    WARNINGS,
    build_stm32f405,
    include_flags,
    missing_packages,
    write_protocol,
)
from tests.testkit.sensor_parts import Adxl372, Ms5803, prom_check

PARTS = COLLECTOR / "ports" / "parts"
TIMEOUT_S = 60.0
CALIBRATION = (46546, 42845, 29751, 29457, 32745, 29059)
SHIM = """
#include "spi_bus.h"
typedef bool (*exchange)(unsigned, const uint8_t *, uint8_t *, size_t);
exchange bus;
bool spi_bus_transfer(unsigned part, const uint8_t *out, uint8_t *in, size_t size) { return bus(part, out, in, size); }
"""
EXCHANGE = ctypes.CFUNCTYPE(
    ctypes.c_bool, ctypes.c_uint, ctypes.POINTER(ctypes.c_uint8), ctypes.POINTER(ctypes.c_uint8), ctypes.c_size_t
)
OK, NO_ANSWER, OVERRUN, TORN = range(4)


class Ms5803State(ctypes.Structure):
    """The driver's `ms5803`."""

    _fields_ = (
        ("part", ctypes.c_uint),
        ("prom", ctypes.c_uint16 * 8),
        ("pressure_raw", ctypes.c_uint32),
        ("converts_temperature", ctypes.c_bool),
        ("ready", ctypes.c_bool),
        ("pressure_pa", ctypes.c_int32),
        ("temperature_cdegc", ctypes.c_int16),
    )


class Drivers:
    """The drivers on this computer, their bus at a model."""

    def __init__(self, library: Path) -> None:
        self.c = ctypes.CDLL(str(library))
        self.c.ms5803_open.restype = self.c.ms5803_step.restype = ctypes.c_bool
        self.failures: list[Exception] = []

    def connect(self, model: Adxl372 | Ms5803 | None) -> None:
        def exchange(_: int, out: object, into: object, size: int) -> bool:
            if model is None:
                return False
            try:
                answer = model.transfer(ctypes.string_at(out, size))  # type: ignore[arg-type]
            except Exception as error:  # ctypes would swallow it
                self.failures.append(error)
                return False
            ctypes.memmove(into, answer, size)  # type: ignore[arg-type]
            return True

        self._exchange = EXCHANGE(exchange)
        ctypes.c_void_p.in_dll(self.c, "bus").value = ctypes.cast(self._exchange, ctypes.c_void_p).value

    def start(self, wanted_hz: float) -> tuple[int, float]:
        rate = ctypes.c_float()
        outcome = self.c.adxl372_start(0, ctypes.c_float(wanted_hz), ctypes.byref(rate))
        return outcome, rate.value

    def read(self) -> tuple[int, np.ndarray, int]:
        counts = (ctypes.c_int16 * 120)()
        rows, remaining = ctypes.c_uint32(), ctypes.c_uint32()
        outcome = self.c.adxl372_read(0, counts, ctypes.byref(rows), ctypes.byref(remaining))
        return outcome, np.array(counts[: 3 * rows.value]).reshape(-1, 3), remaining.value


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    require("gcc", "gcc")
    folder = tmp_path_factory.mktemp("drivers")
    (folder / "shim.c").write_text(SHIM, "utf-8")
    built = folder / "drivers.so"
    flags = [flag for flag in WARNINGS if flag != "-Wmissing-prototypes"]
    sources = [*PARTS.glob("*.c"), folder / "shim.c"]
    subprocess.run(["gcc", *flags, "-O1", "-shared", "-fPIC", f"-I{PARTS}", *sources, "-o", built], check=True)
    return built


@pytest.fixture
def drivers(library: Path) -> Iterator[Drivers]:
    opened = Drivers(library)
    yield opened
    assert opened.failures == []


@pytest.mark.parametrize("name", sorted(path.name for path in PARTS.glob("*.c")))
def test_drivers_compile_with_clang_without_a_warning(tmp_path: Path, name: str) -> None:
    require("clang", "clang")
    subprocess.run(["clang", *WARNINGS, f"-I{PARTS}", "-c", PARTS / name, "-o", tmp_path / "driver.o"], check=True)


def random_rows(n: int) -> np.ndarray:
    return np.random.default_rng(7).integers(-2048, 2048, (n, 3)).astype(np.int16)


@pytest.mark.parametrize(
    ("wanted_hz", "rate_hz", "code"), [(1, 400, 0), (1000, 800, 1), (2500, 3200, 3), (6400, 6400, 4), (1e6, 6400, 4)]
)
def test_accelerometer_starts_at_the_nearest_rate(drivers: Drivers, wanted_hz: float, rate_hz: int, code: int) -> None:
    part = Adxl372(random_rows(9))
    drivers.connect(part)
    assert drivers.c.adxl372_reset(0) == OK
    assert drivers.start(wanted_hz) == (OK, rate_hz)
    assert part.writes[0] == (0x41, 0x52)
    assert part.registers[0x3D] == code << 5
    assert part.registers[0x3E] == code
    assert part.registers[0x3A] == 0b010
    assert part.registers[0x3F] == 0b10111


def test_rows_of_the_fifo_arrive_to_the_bit(drivers: Drivers) -> None:
    rows = random_rows(300)
    part = Adxl372(rows, rows_per_look=50)
    drivers.connect(part)
    drivers.start(6400)
    taken = []
    for _ in range(8):
        outcome, counts, remaining = drivers.read()
        assert outcome == OK
        assert remaining == len(part.fifo) // 3 >= 1
        taken.append(counts)
    np.testing.assert_array_equal(np.concatenate(taken), rows[:299])


def test_overrun_of_the_fifo_is_told_and_a_restart_ends_it(drivers: Drivers) -> None:
    part = Adxl372(random_rows(1000), rows_per_look=200)
    drivers.connect(part)
    drivers.start(6400)
    assert drivers.read()[0] == OVERRUN
    part.rows_per_look = 5
    drivers.start(6400)
    outcome, counts, _ = drivers.read()
    assert (outcome, len(counts)) == (OK, 4)


def test_rows_that_do_not_begin_with_x_are_refused(drivers: Drivers) -> None:
    part = Adxl372(random_rows(100))
    drivers.connect(part)
    drivers.start(6400)
    assert drivers.read()[0] == OK
    del part.fifo[0]
    assert drivers.read()[0] == TORN


def test_another_part_or_a_dead_bus_is_no_accelerometer(drivers: Drivers) -> None:
    drivers.connect(Adxl372(random_rows(1), identity=bytes([0xAD, 0x1D, 0xE5])))
    assert drivers.c.adxl372_reset(0) == NO_ANSWER
    drivers.connect(None)
    assert drivers.c.adxl372_reset(0) == NO_ANSWER
    assert drivers.start(400)[0] == NO_ANSWER


def expected_pressure(raw: tuple[int, int]) -> tuple[float, float]:
    """Pressure in Pa and temperature in °C by the data sheet's formulas, in real numbers."""
    c1, c2, c3, c4, c5, c6 = CALIBRATION
    dt = raw[1] - c5 * 2**8
    centi = 2000 + dt * c6 / 2**23
    offset, sensitivity = c2 * 2**16 + c4 * dt / 2**7, c1 * 2**15 + c3 * dt / 2**8
    below = centi - 2000
    if centi < 2000:
        correction, offset, sensitivity = 3 * dt**2 / 2**33, offset - 1.5 * below**2, sensitivity - 5 * below**2 / 8
        if centi < -1500:
            offset, sensitivity = offset - 7 * (centi + 1500) ** 2, sensitivity - 4 * (centi + 1500) ** 2
    else:
        correction, offset = 7 * dt**2 / 2**37, offset - below**2 / 16
    return 10 * (raw[0] * sensitivity / 2**21 - offset) / 2**15, (centi - correction) / 100


@pytest.mark.parametrize("raw", [(4311550, 8387300), (5400000, 9500000), (5400000, 7600000), (5400000, 6900000)])
def test_pressure_is_compensated_as_the_data_sheet_says(drivers: Drivers, raw: tuple[int, int]) -> None:
    drivers.connect(Ms5803(CALIBRATION, raw))
    state = Ms5803State()
    assert drivers.c.ms5803_open(ctypes.byref(state), 1)
    for _ in range(2):
        assert drivers.c.ms5803_step(ctypes.byref(state))
    pressure_pa, temperature_degc = expected_pressure(raw)
    assert state.ready
    assert state.pressure_pa == pytest.approx(pressure_pa, abs=20)
    assert state.temperature_cdegc / 100 == pytest.approx(temperature_degc, abs=0.02)


def test_model_of_the_check_sum_gives_the_published_example() -> None:
    """Application note AN520 of the maker."""
    assert prom_check([0x3132, 0x3334, 0x3536, 0x3738, 0x3940, 0x4142, 0x4344, 0x4500]) == 0xB


def test_pressure_of_the_data_sheet_example() -> None:
    """The example that the compensation's flow chart carries: 1000.5 mbar, 20.15 °C."""
    assert expected_pressure((4311550, 8387300)) == pytest.approx((100050, 20.15), abs=10)


def test_damaged_calibration_and_silence_are_refused(drivers: Drivers) -> None:
    state = Ms5803State()

    class Damaged(Ms5803):
        @property
        def prom(self) -> list[int]:
            return [word ^ (0x10 if index == 3 else 0) for index, word in enumerate(super().prom)]

    drivers.connect(Damaged(CALIBRATION, (1, 1)))
    assert not drivers.c.ms5803_open(ctypes.byref(state), 1)

    class Silent(Ms5803):
        def transfer(self, out: bytes) -> bytes:
            return bytes(len(out))

    drivers.connect(Silent(CALIBRATION, (1, 1)))
    assert not drivers.c.ms5803_open(ctypes.byref(state), 1)


def serve(line: socket.socket, models: list[Adxl372 | Ms5803]) -> None:
    """Answer the board's bus until it ends."""
    with contextlib.suppress(OSError), line.makefile("rb") as reader:
        while len(head := reader.read(3)) == 3:
            line.sendall(models[head[0]].transfer(reader.read(head[1] << 8 | head[2])))


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    missing = missing_packages()
    if missing:
        for program in ("qemu-system-arm", "arm-none-eabi-gcc"):
            require(program, program)
    return build_stm32f405(tmp_path_factory.mktemp("stm32f405"), ("-Os", "-DBOARD_BUS_ON_USART2"))


@contextlib.contextmanager
def emulated(image: Path, models: list[Adxl372 | Ms5803]) -> Iterator[socket.socket]:
    """Run the image; the link's other end."""
    link, board_link = socket.socketpair()
    bus, board_bus = socket.socketpair()
    command = ["qemu-system-arm", "-M", "netduinoplus2", "-display", "none", "-monitor", "none", "-nodefaults"]
    for name, end in (("link", board_link), ("bus", board_bus)):
        command += ["-chardev", f"socket,id={name},fd={end.fileno()}", "-serial", f"chardev:{name}"]
    descriptors = (board_link.fileno(), board_bus.fileno())
    link.settimeout(TIMEOUT_S)
    with link, bus, subprocess.Popen([*command, "-kernel", str(image)], pass_fds=descriptors) as process:
        board_link.close()
        board_bus.close()
        server = threading.Thread(target=serve, args=(bus, models))
        server.start()
        try:
            yield link
        finally:
            process.kill()
            bus.shutdown(socket.SHUT_RDWR)
            server.join(TIMEOUT_S)


def frames_until(link: socket.socket, enough: Callable[[list], bool]) -> list:
    decoder, frames = FrameDecoder(), []
    while not enough(frames):
        received = link.recv(1 << 16)
        assert received
        frames += decoder.feed(received)
    assert decoder.counters.crc_errors == decoder.counters.lost == 0
    return [frame.message for frame in frames]


def test_samples_of_the_part_arrive_from_the_emulated_chip(image: Path) -> None:
    rows = random_rows(2000)
    raw = (5400000, 9500000)
    with emulated(image, [Adxl372(rows), Ms5803(CALIBRATION, raw)]) as link:

        def enough(frames: list) -> bool:
            samples = sum(len(f.message.counts) for f in frames if isinstance(f.message, SampleBlock))
            measured = [f.message.pressure_pa for f in frames if isinstance(f.message, Environment)]
            answered = any(isinstance(f.message, CommandResult) for f in frames)
            return answered and samples >= 1900 and any(value is not None and np.isfinite(value) for value in measured)

        link.recv(1, socket.MSG_PEEK)  # the receiver is not open before
        link.sendall(command_bytes(SetTime(5), 100))
        messages = frames_until(link, enough)
    blocks = [message for message in messages if isinstance(message, SampleBlock)]
    counts = np.concatenate([block.counts for block in blocks])
    np.testing.assert_array_equal(counts, rows[: len(counts)])
    result = next(message for message in messages if isinstance(message, CommandResult))
    assert result.outcome == Outcome.DONE
    hello = next(message for message in messages if isinstance(message, Hello))
    assert hello.rate_hz == 6400
    environment = [message for message in messages if isinstance(message, Environment)][-1]
    pressure_pa, _ = expected_pressure(raw)
    assert environment.pressure_pa == pytest.approx(pressure_pa - 101325, abs=20)


def test_board_without_an_accelerometer_says_so(image: Path) -> None:
    absent = Adxl372(random_rows(1), identity=bytes(3))
    with emulated(image, [absent, Ms5803(CALIBRATION, (1, 1))]) as link:
        messages = frames_until(link, lambda frames: any("ADXL372" in str(f.message) for f in frames))
    assert any(isinstance(message, LogText) and "ADXL372: no answer" in message.text for message in messages)


def on_model_of_the_chip(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Run the board's code against the model of its registers, which single-steps this computer's processor."""
    require("gcc", "gcc")
    if (sys.platform, platform.machine()) != ("linux", "x86_64"):
        pytest.skip("the model of the registers is for x86-64 Linux")
    protocol = write_protocol(folder)
    port, program = COLLECTOR / "ports" / "stm32f405", folder / "registers"
    sources = [Path(__file__).with_name("stm32f405_registers.c"), COLLECTOR / "tl_boot_count.c", protocol]
    # Addresses of 32 bits in pointers of 64; a part that does not answer is given up sooner.
    flags = ("-std=c11", "-O1", "-Wall", "-Wno-int-to-pointer-cast", "-DPATIENCE=100u", *options)
    includes = [*include_flags(folder), f"-I{PARTS}", f"-I{port}"]
    subprocess.run(["gcc", *flags, *includes, *sources, "-o", program], check=True)
    return subprocess.run([program], capture_output=True, text=True, timeout=TIMEOUT_S, check=False)


def test_board_drives_clock_watchdog_link_bus_and_flash_as_the_manual_says(tmp_path: Path) -> None:
    result = on_model_of_the_chip(tmp_path)
    assert result.returncode == 0, result.stdout + result.stderr
    assert result.stdout.splitlines() == [
        "start, clock, watchdog",
        "link: transmit and receive interrupts",
        "bus: exchange and chip select",
        "flash: keys, erasing, programming, boot counter",
        "start without a crystal",
    ]


def test_model_of_the_chip_refuses_the_clock_of_another_crystal(tmp_path: Path) -> None:
    result = on_model_of_the_chip(tmp_path, "-DBOARD_CRYSTAL_MHZ=12u")
    assert result.returncode == 1
    assert "== 168u" in result.stdout
