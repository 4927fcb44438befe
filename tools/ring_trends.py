"""Trends of the ring paper's Figs. 14 to 16 under each assumption, and what would decide between them.

    python -m tools.ring_trends

docs/evidence/ring-paper-figures.md explains the result.
"""

import math

from gateway.papers.ring_data import RADIUS_M
from gateway.papers.trend_assumptions import ASSUMPTIONS, IN_PAPER, agrees, edge_pressure, readings, trend

# Place of 5000 N and 2.1 bar, the condition of the paper's Figs. 11 and 12, among the nine.
_NOMINAL = 4


def main() -> None:
    """Print both tables."""
    print("Exponents of Eq. 28's numbers with the correlation of the nine points; linear slope of Cw; fit residual at")
    print("5000 N, 2.1 bar and the largest; * where all signs are those of the paper (Cw rises, Rs falls, Ts rises)")
    names = {"Cw": "Cw over Pn", "Rs": "Rs over angle", "Ts": "Ts over angle"}
    print(
        f"{'':34s}" + "".join(f"{names[number]:>17s}" for number in IN_PAPER) + f"{'Cw slope':>10s}{'residual %':>13s}"
    )
    for assumption in ASSUMPTIONS:
        result = readings(assumption)
        trends = [trend(number, result) for number in IN_PAPER]
        cells = "".join(f"{entry.exponent:+9.2f} ({entry.correlation:+.2f})" for entry in trends)
        worst = max(entry.residual_share for entry in result)
        mark = "*" if agrees(result) else " "
        residuals = f"{100 * result[_NOMINAL].residual_share:8.1f}{100 * worst:6.1f}"
        print(f"{assumption.name:32s}{mark} {cells}{trends[0].slope:+10.2f}{residuals}")
    print("\nWhat would decide: exponent of the weak form's Cw over Pn; length of the contact and between the steepest")
    print("slopes at 2.1 bar and 2000, 5000, 8000 N; pressure over the outer fifth of the contact over its mean")
    print(f"{'':34s}{'weak form':>10s}{'contact mm':>21s}{'steepest mm':>21s}{'outer fifth':>13s}")
    for assumption in ASSUMPTIONS:
        result = readings(assumption)
        middle = result[_NOMINAL - 1 : _NOMINAL + 2]
        contact = "".join(f"{2e3 * RADIUS_M * entry.solution.half_angle_rad:7.0f}" for entry in middle)
        steepest = "".join(f"{2e3 * RADIUS_M * entry.steepest_rad:7.0f}" for entry in middle)
        growth = trend("Cw", result, weak_form=True).exponent
        outer = edge_pressure(result[_NOMINAL].solution)
        print(f"{assumption.name:34s}{growth:+10.2f}{contact}{steepest}{outer:13.2f}")
    worst = max(
        abs(value / true - 1.0)
        for assumption in ASSUMPTIONS
        if assumption.name != "sidewall softens"
        for entry in readings(assumption)
        for value, true in ((entry.weak_form[1], entry.solution.numbers.Cw),)
        if math.isfinite(value)
    )
    print(f"\nLargest error of the weak form's Cw, but for the softening sidewall: {100 * worst:.1f} %")


if __name__ == "__main__":
    main()
