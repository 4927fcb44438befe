"""Sensors of the reference board as the bus sees them, after their data sheets: registers, FIFO, commands."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


class BusError(Exception):
    """A driver did what the data sheet forbids."""


@dataclass
class Adxl372:
    """ADXL372 (data sheet Rev. B).

    Args:
        rows: shape (n, 3), counts of 12 bit that it will measure.
        rows_per_look: rows that it measures between two readings of its status; no clock is involved.
    """

    rows: NDArray[np.int16]
    rows_per_look: int = 6
    identity: bytes = bytes([0xAD, 0x1D, 0xFA])
    registers: dict[int, int] = field(default_factory=dict)
    writes: list[tuple[int, int]] = field(default_factory=list)
    fifo: list[int] = field(default_factory=list)
    measured: int = 0
    overrun: bool = False

    FIFO_WORDS = 512

    def transfer(self, out: bytes) -> bytes:
        """Exchange the bytes of one chip select."""
        address, reads = out[0] >> 1, out[0] & 1
        if not reads:
            for offset, value in enumerate(out[1:]):
                self._write(address + offset, value)
            return bytes(len(out))
        if address == 0x42:
            return b"\0" + self._read_fifo(len(out) - 1)
        if address == 0x04:
            self._measure()
        return b"\0" + bytes(self._register(address + offset) for offset in range(len(out) - 1))

    def _write(self, address: int, value: int) -> None:
        self.writes.append((address, value))
        if address == 0x41 and value == 0x52:
            self.registers.clear()
            self.fifo.clear()
            return
        if address == 0x3A:
            if self.registers.get(0x3F, 0) & 3:
                raise BusError("the FIFO was changed outside standby")
            self.fifo.clear()
            self.overrun = False
        self.registers[address] = value

    def _register(self, address: int) -> int:
        match address:
            case 0 | 1 | 2:
                return self.identity[address]
            case 0x04:
                return 8 if self.overrun else 0
            case 0x06:
                return len(self.fifo) >> 8
            case 0x07:
                return len(self.fifo) & 0xFF
            case _:
                return self.registers.get(address, 0)

    def _measure(self) -> None:
        if self.registers.get(0x3F, 0) & 3 != 3 or (self.registers.get(0x3A, 0) >> 1) & 3 != 1:
            return
        for row in self.rows[self.measured : self.measured + self.rows_per_look]:
            self.fifo.extend((int(count) << 4 & 0xFFFF) | (axis == 0) for axis, count in enumerate(row))
        self.measured += self.rows_per_look
        if len(self.fifo) > self.FIFO_WORDS:
            self.overrun = True
            del self.fifo[: len(self.fifo) - self.FIFO_WORDS]

    def _read_fifo(self, size: int) -> bytes:
        words = size // 2
        if words % 3 or len(self.fifo) - words < 3:
            raise BusError("a reading of the FIFO must take whole rows and leave one")
        taken, self.fifo = self.fifo[:words], self.fifo[words:]
        return b"".join(word.to_bytes(2, "big") for word in taken)


def prom_check(words: list[int]) -> int:
    """Check sum of a calibration of eight words, less the last byte: remainder by x^4 + x + 1, bit by bit."""
    message = b"".join(word.to_bytes(2, "big") for word in words)[:-1]
    remainder = 0
    for index in range(8 * len(message) + 4):
        bit = message[index // 8] >> 7 - index % 8 & 1 if index < 8 * len(message) else 0
        remainder = remainder << 1 | bit
        if remainder & 0x10:
            remainder ^= 0x13
    return remainder


@dataclass
class Ms5803:
    """MS5803-14BA.

    Args:
        calibration: C1 to C6.
        raw: conversion of pressure, then of temperature.
    """

    calibration: tuple[int, ...]
    raw: tuple[int, int]
    converting: int | None = None

    @property
    def prom(self) -> list[int]:
        """The eight words, the last one with the check sum."""
        words = [0x1235, *self.calibration, 0]
        # The check sum covers all bytes but the last, which counts as zero.
        words[7] = prom_check(words)
        return words

    def transfer(self, out: bytes) -> bytes:
        """Exchange the bytes of one chip select."""
        match out[0]:
            case 0x1E | 0x48 | 0x58 as command:
                self.converting = {0x48: 0, 0x58: 1}.get(command)
                return bytes(len(out))
            case 0x00:
                value = 0 if self.converting is None else self.raw[self.converting]
                self.converting = None
                return b"\0" + value.to_bytes(3, "big")
            case address if address & 0xF0 == 0xA0:
                return b"\0" + self.prom[(address & 0xF) // 2].to_bytes(2, "big")
            case command:
                raise BusError(f"no such command: {command:#x}")
