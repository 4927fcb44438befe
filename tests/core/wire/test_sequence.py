"""Counter rules against a plain model that remembers everything."""

from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.sequence import Arrival, Window, advance, classify, unwrap

U32 = st.integers(0, 2**32 - 1)
STEPS = st.lists(
    st.sampled_from([1, 1, 1, 1, 0, 2, 3, -1, -2, -5, -63, -64, 63, 64, 65, 200, -3, 2**31 - 1, 2**31, -(2**31) + 1]),
    max_size=60,
)


class Remembering:
    """The rules in words of the specification, on unwrapped numbers, with every frame remembered."""

    def __init__(self) -> None:
        self.last: int | None = None
        self.first = 0
        self.seen: set[int] = set()

    def arrive(self, seq: int) -> tuple[Arrival, int]:
        if self.last is None:
            self.last = self.first = seq
            self.seen = {seq}
            return Arrival.FIRST, 0
        ahead = (seq - self.last) % 2**32
        number = self.last + (ahead if ahead < 2**31 else ahead - 2**32)
        if number > self.last:
            gap = number - self.last - 1
            self.last = number
            self.seen.add(number)
            return (Arrival.GAP if gap else Arrival.IN_ORDER), gap
        if self.last - number >= 64:
            self.last = self.first = seq
            self.seen = {seq}
            return Arrival.RESTART, 0
        if number in self.seen:
            return Arrival.DUPLICATE, 0
        self.seen.add(number)
        return Arrival.LATE, -1 if number >= self.first else 0


@given(U32, STEPS)
def test_classify_follows_the_rules(start: int, steps: list[int]) -> None:
    model, window, seq = Remembering(), None, start
    for step in [0, *steps]:
        seq = (seq + step) % 2**32
        arrival, lost, window = classify(window, seq)
        assert (arrival, lost) == model.arrive(seq)


@given(U32, STEPS, st.integers(0, 200))
def test_advance_is_many_frames_in_order(start: int, steps: list[int], frames: int) -> None:
    window = Window.starting(start)
    for step in steps:
        window = classify(window, (window.last + step) % 2**32).window
    stepwise = window
    for _ in range(frames):
        stepwise = classify(stepwise, (stepwise.last + 1) % 2**32).window
    assert advance(window, frames) == stepwise


@given(st.integers(0, 2**70), st.integers(-(2**31) + 1, 2**31 - 1))
def test_unwrap_finds_the_nearest(last: int, step: int) -> None:
    assert unwrap(last, (last + step) % 2**32) == last + step


@given(st.integers(2, 40), st.integers(0, 2**50), st.data())
def test_unwrap_of_other_widths(bits: int, last: int, data: st.DataObject) -> None:
    value = data.draw(st.integers(0, 2**bits - 1))
    result = unwrap(last, value, bits)
    assert result % 2**bits == value
    assert abs(result - last) <= 2 ** (bits - 1)
