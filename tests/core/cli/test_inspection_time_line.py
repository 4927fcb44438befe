"""Time line of `inspect`: full where nothing is lost, and lower where samples are missing."""

from collections import Counter

import pytest
from click.testing import CliRunner

from gateway.core.cli import treadlink
from gateway.core.cli.inspection_report import _time_line
from gateway.core.recording.inspection import WheelInspection
from tests.testkit.commands import invoked

RATE_HZ = 9600
BEGIN_S = 1_700_000_000.6


def lines(seconds: dict[int, list[int]], duration_s: float, *, rate: float | None = RATE_HZ) -> list[str]:
    """Return the rows of samples by the second of the recording, which begins within its first."""
    samples = sum(got for got, _ in seconds.values())
    source = WheelInspection(frames=Counter(samples=samples // 36), samples=samples, measured_hz=rate)
    source.seconds.update({int(BEGIN_S) + second: counts for second, counts in seconds.items()})
    begin = round(BEGIN_S * 1e9)
    return [line[6:] for line in _time_line(source, begin, begin + round(duration_s * 1e9))]


def whole(duration_s: int) -> dict[int, list[int]]:
    """Return all samples of a recording without losses, whose first second has 0.4 s and its last one 0.6 s."""
    seconds = {second: [RATE_HZ, 0] for second in range(duration_s + 1)}
    seconds[0], seconds[duration_s] = [int(0.4 * RATE_HZ) - 36, 0], [int(0.6 * RATE_HZ), 0]
    return seconds


@pytest.mark.parametrize("duration_s", [1, 20, 59, 60, 61, 63, 64, 65, 100, 127, 600, 3600])
@pytest.mark.parametrize("rate", [RATE_HZ, None])
def test_recording_without_losses_is_full(duration_s: int, rate: float | None) -> None:
    (line,) = lines(whole(duration_s), duration_s, rate=rate)
    assert set(line) == {"█"}
    assert 32 <= len(line) <= 64 or len(line) == duration_s + 1


def test_bursts_after_a_delay_are_no_losses() -> None:
    seconds = whole(60)
    seconds[21], seconds[20] = [seconds[20][0] + 7000, 0], [RATE_HZ - 7000, 0]
    seconds[40], seconds[41], seconds[42] = [0, 0], [0, 0], [3 * RATE_HZ, 0]
    (line,) = lines(seconds, 60)
    assert set(line) == {"█"}


def test_losses_lie_where_they_are() -> None:
    seconds = whole(60)
    seconds[10] = [RATE_HZ // 2, RATE_HZ // 2]
    # Of a silence, the number of the next block tells the losses.
    del seconds[30], seconds[31]
    seconds[32] = [RATE_HZ, 2 * RATE_HZ]
    bars, marks = lines(seconds, 60)
    assert bars[10] == "▄"
    assert bars[30:32] == "  "
    assert set(bars[:10] + bars[11:30] + bars[32:]) == {"█"}
    assert [k for k, mark in enumerate(marks[:61]) if mark == "x"] == [10, 30, 31]


def test_sensor_that_stops_leaves_the_rest_empty() -> None:
    seconds = {second: counts for second, counts in whole(60).items() if second < 30}
    seconds[30] = [RATE_HZ // 2, 0]
    (line,) = lines(seconds, 60)
    assert line == "█" * 30 + "▄" + " " * 30


def test_times_of_years_apart_take_no_memory() -> None:
    bars = lines({0: [RATE_HZ, 0], 3_000_000_000: [RATE_HZ, 0]}, 3e9)[0]
    assert len(bars) <= 64


def test_inspect_of_a_minute_without_losses_is_full(tmp_path) -> None:
    path = tmp_path / "run.mcap"
    run = CliRunner().invoke(treadlink, f"record sim:lab?speed=max&duration=70 --out {path}".split())
    assert run.exit_code == 0, run.output
    output = invoked("inspect", path).output
    assert "0 lost (0 %)" in output
    (bars,) = (line.strip() for line in output.splitlines() if "█" in line)
    assert set(bars) == {"█"}
