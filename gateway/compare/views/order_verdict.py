"""What the page of orders says first: what stands out, against what, what usually makes it, and what to do."""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from gateway.compare.order_statistics import BLOCK_REVOLUTIONS
from gateway.compare.outstanding_lines import MINIMUM_TIMES, Keeps, OutstandingLine, outstanding_lines
from gateway.compare.views.order_tables import share_texts
from gateway.compare.views.wheel_orders import WheelOrders
from gateway.core.constants import AXIS_NAMES
from gateway.core.text.text import clean, counted
from gateway.core.text.wording import text

_RADIAL: Final = AXIS_NAMES.index("radial")
_MAX_LINES: Final = 3
_CAUSES: Final = {
    Keeps.ORDER: "it keeps its order as the speed changes: something that turns with the wheel, but not as fast, such "
    "as another shaft, a drum, a gear or a bearing",
    Keeps.FREQUENCY: "it keeps its frequency as the speed changes: usually a resonance of suspension, rim or air "
    "cavity, else a motor or mains",
    Keeps.UNKNOWN: "these speeds do not tell whether it keeps its order, as what turns does, or its frequency, as a "
    "resonance does",
}
_STEPS: Final = {
    Keeps.ORDER: "look for what turns {order:.2f} times as fast as the wheel",
    Keeps.FREQUENCY: "look for what vibrates at about {frequency:.0f} Hz; record with motors off, or on another road",
    Keeps.UNKNOWN: "record at two steady speeds: what turns keeps its order, a resonance keeps its frequency",
}


class OrderVerdict(NamedTuple):
    """First lines of the page.

    Attributes:
        answer: sentences.
        lines: what stands out, the clearest of each wheel first.
        steps: what to do, with what it is about.
    """

    answer: str
    lines: list[str]
    steps: list[dict[str, str]]


def order_verdict(wheels: Sequence[WheelOrders]) -> OrderVerdict:
    """Return what to say first of the orders of wheels."""
    standing = [(wheel, line) for wheel in wheels for line in outstanding_lines(wheel.statistics)[:_MAX_LINES]]
    steps = [step for wheel in wheels for step in _conditions(wheel)]
    steps += [_step(wheel, line) for wheel, line in standing]
    answer = " ".join(_sentences(wheels, [wheel for wheel, _ in standing], is_calm=not steps))
    return OrderVerdict(
        answer or "No wheel has a usable revolution.", [_line_text(wheel, line) for wheel, line in standing], steps
    )


def _sentences(wheels: Sequence[WheelOrders], standing: Sequence[WheelOrders], *, is_calm: bool) -> Iterator[str]:
    judged = [wheel for wheel in wheels if wheel.statistics.blocks]
    if judged:
        names = ", ".join(dict.fromkeys(clean(wheel.wheel) for wheel in standing))
        if names:
            yield f"Between the orders {counted(len(standing), 'line')} {_verb(standing)} out: {names}."
        else:
            yield (
                "Nothing stands out between the orders: beyond what noise makes, no line has "
                f"{MINIMUM_TIMES:.0f} times the amplitude around it."
            )
        if is_calm:
            yield "Nothing to act on."
        shares = ", ".join(f"{clean(wheel.wheel)} {share_texts(wheel.statistics)[_RADIAL]}" for wheel in judged)
        noise = 100.0 * max(wheel.statistics.noise_share for wheel in judged)
        yield (
            f"Of the radial signal's power this repeats with every revolution: {shares} (of noise alone {noise:.1f} %)."
            f" The contact patch makes it; the largest {_largest(judged)}."
        )


def _verb(standing: Sequence[WheelOrders]) -> str:
    return "stands" if len(standing) == 1 else "stand"


def _largest(wheels: Sequence[WheelOrders]) -> str:
    """Return the largest radial order of the wheels."""
    orders = sorted({1 + int(np.nanargmax(wheel.statistics.repeated_mps2[_RADIAL, 1:])) for wheel in wheels})
    return f"order is {orders[0]}" if len(orders) == 1 else f"orders are {orders[0]} to {orders[-1]}"


def _line_text(wheel: WheelOrders, line: OutstandingLine) -> str:
    return (
        f"{clean(wheel.wheel)}, {line.axis} axis: order {line.order:.2f} (about {line.frequency_hz:.0f} Hz) at "
        f"{wheel.speeds_text(0, *line.range_radps)}, {line.amplitude_mps2:.2g} m/s², "
        f"{line.times:.1f} times what lies around it; {_CAUSES[line.keeps]}."
    )


def _step(wheel: WheelOrders, line: OutstandingLine) -> dict[str, str]:
    step = _STEPS[line.keeps].format(order=line.order, frequency=line.frequency_hz)
    return {"about": f"{clean(wheel.wheel)}, order {line.order:.2f}", "step": step}


def _conditions(wheel: WheelOrders) -> Iterator[dict[str, str]]:
    """Yield what keeps the orders of a wheel from being judged."""
    subject = clean(wheel.wheel)
    for doubt in wheel.doubts:
        yield {"about": subject, "step": clean(text(doubt))}
    if wheel.rejected:
        left_out = f"{counted(wheel.rejected, 'revolution')} with faults left out: treadlink inspect says what was lost"
        yield {"about": subject, "step": left_out}
    if not wheel.statistics.blocks:
        yield {"about": subject, "step": f"record {BLOCK_REVOLUTIONS} revolutions in a row at a steady speed"}
