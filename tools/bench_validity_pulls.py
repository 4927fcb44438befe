"""Whether errors are as large as they say, and how often each quantity is valid in ordinary drives.

Run: python tools/bench_validity_pulls.py [--count 40] [--drives 5] [--markdown]

As it is, it takes 4 minutes. Pulls are those of the tires of tools/bench_validity.py.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from bench_validity import DEFAULT
from validity.bench import Order, judge_tire
from validity.pulls import never_table, ordinary_drives, ordinary_table, pull_table, pulls_of


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=40, help="tires with drawn statements")
    parser.add_argument("--exact", type=int, default=12, help="tires of which everything is known exactly")
    parser.add_argument("--drives", type=int, default=5, help="of each of them")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each ordinary drive; 0 for none")
    parser.add_argument("--seed", type=int, default=1, help="of everything")
    parser.add_argument("--markdown", action="store_true", help="tables to paste into docs")
    options = parser.parse_args(arguments)
    judged = []
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder)
        for tire in range(options.count):
            judged += judge_tire(Order(options.seed, tire, ("drawn",), DEFAULT, store))
            print(f"\r{tire + 1} of {options.count} tires", end="", file=sys.stderr, flush=True)
        for tire in range(options.exact):
            for drive in range(options.drives):
                judged += judge_tire(Order(options.seed, tire, ("known",), DEFAULT, store, drive=drive))
            print(f"\r{tire + 1} of {options.exact} exact", end="", file=sys.stderr, flush=True)
    print(pull_table(pulls_of(judged)).text(markdown=options.markdown))
    if options.seconds:
        drives = dict(ordinary_drives(options.seconds))
        for table in (ordinary_table(drives), never_table(drives)):
            print(table.text(markdown=options.markdown))


if __name__ == "__main__":
    main()
