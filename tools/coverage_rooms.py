"""Covered lines and branches of every room, from the JSON report of coverage; `make coverage` calls it.

The exit status is 1 where a room is below `LEAST_PERCENT` without a reason in `EXCEPTIONS`.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

LEAST_PERCENT: Final = 85.0
EXCEPTIONS: Final[Mapping[str, str]] = {
    "gateway/core/compiled": "two of its 13 lines are for an installation without the compiled core",
    "gateway/fleet": "the diagnoses of a campaign, 17 of its 436 branches, are tested by slow tests",
    "gateway/importing": "readers of MF4, HDF5, IDE, UFF and TDMS run in processes that are killed and write no counts",
}
"""Reason for each room that may be below."""


class RoomCoverage(NamedTuple):
    """Counts of a room."""

    lines: int = 0
    covered_lines: int = 0
    branches: int = 0
    covered_branches: int = 0

    def plus(self, summary: Mapping[str, Any]) -> RoomCoverage:
        """Return the counts with those of a file."""
        return RoomCoverage(
            self.lines + summary["num_statements"],
            self.covered_lines + summary["covered_lines"],
            self.branches + summary["num_branches"],
            self.covered_branches + summary["covered_branches"],
        )

    @property
    def line_percent(self) -> float:
        """Share of lines that ran."""
        return 100.0 * self.covered_lines / self.lines if self.lines else 100.0

    @property
    def branch_percent(self) -> float:
        """Share of branches that were taken."""
        return 100.0 * self.covered_branches / self.branches if self.branches else 100.0


def rooms(report: Mapping[str, Any]) -> dict[str, RoomCoverage]:
    """Return the counts of each room of the core, of each feature and of `firmware_protocol`."""
    counts: defaultdict[str, RoomCoverage] = defaultdict(RoomCoverage)
    for name, file in report["files"].items():
        parts = Path(name).parts[:-1]
        room = "/".join(parts[: 3 if parts[:2] == ("gateway", "core") else 2])
        counts[room] = counts[room].plus(file["summary"])
    return dict(sorted(counts.items()))


def main(arguments: list[str] | None = None) -> int:
    """Print the table; return 1 where a room is below what is asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("report", type=Path)
    report = json.loads(parser.parse_args(arguments).report.read_text())
    low = []
    print(f"{'room':<28}{'lines':>8}{'covered':>9}{'branches':>10}{'covered':>9}")
    for name, counts in rooms(report).items():
        print(
            f"{name:<28}{counts.lines:>8}{counts.line_percent:>7.1f} %"
            f"{counts.branches:>10}{counts.branch_percent:>7.1f} %"
        )
        if min(counts.line_percent, counts.branch_percent) < LEAST_PERCENT:
            low.append(name)
    for name in low:
        print(
            f"{name} may be below: {EXCEPTIONS[name]}"
            if name in EXCEPTIONS
            else f"{name} is below {LEAST_PERCENT:.0f} %"
        )
    return any(name not in EXCEPTIONS for name in low)


if __name__ == "__main__":
    sys.exit(main())
