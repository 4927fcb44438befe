"""Play test days with faults and account for every frame, alarm and number.

A row for each seed: faults injected, named, missed and falsely named, frames sent and lost with their causes.
`--rounds` lengthens the day. Needs pseudo-terminals, and mosquitto, without which no broker restarts.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from tools.mqtt_broker import PROGRAM, Broker
from tools.rehearsal.accounts import Accounts, account
from tools.rehearsal.day import Day, Played
from tools.rehearsal.plan import Fault, Kind, planned_day

_QUIET_S = 40.0
# What frames can be lost by; the last column of a day is its largest difference.
_CAUSES = (Kind.CUT, Kind.NOISE, Kind.DISK, Kind.UNPLUGGED)
_HEAD = (
    f"| seed | faults | named | missed | falsely named | frames | {' | '.join(f'lost: {kind}' for kind in _CAUSES)} "
    "| other | without a cause | difference |"
)


def quiet_day(day_s: float = _QUIET_S) -> Played:
    """Play a day without faults, with which the numbers of all others are compared."""
    with tempfile.TemporaryDirectory() as folder:
        return Day(Path(folder), 0, [], day_s, None).play()


def rehearse(
    seed: int, quiet: Played, rounds: int = 1, kinds: Iterable[Kind] = tuple(Kind)
) -> tuple[Accounts, list[Fault]]:
    """Play a day; return its accounts and the faults injected."""
    without = frozenset(Kind) - frozenset(kinds) | (frozenset() if PROGRAM else frozenset({Kind.BROKER}))
    faults, day_s = planned_day(seed, rounds, without=without)
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        broker = None
        if Kind.BROKER not in without:
            broker = Broker(Path(name)).start()
            stack.callback(broker.kill)
        return account(Day(Path(name), seed, faults, day_s, broker).play(), quiet, faults), faults


def _row(seed: int, accounts: Accounts) -> str:
    causes = [accounts.lost[kind] for kind in _CAUSES]
    cells = [seed, accounts.faults, accounts.named, len(accounts.missed), len(accounts.false), accounts.frames]
    cells += [*causes, accounts.lost.total() - sum(causes), len(accounts.unaccounted), f"{accounts.worst:.2g}"]
    return f"|{'|'.join(map(str, cells))}|"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--seeds", type=int, nargs=2, default=(1, 21), metavar=("FIRST", "END"), help="from FIRST, before END (1 21)"
    )
    parser.add_argument("--rounds", type=int, default=1, help="of all kinds of fault in a day (1)")
    parser.add_argument(
        "--only", nargs="+", type=Kind, choices=list(Kind), default=list(Kind), metavar="KIND", help=", ".join(Kind)
    )
    arguments = parser.parse_args()
    print(f"{_HEAD}\n|{'---|' * (_HEAD.count('|') - 1)}", flush=True)
    quiet = quiet_day()
    for seed in range(*arguments.seeds):
        begin_s = time.perf_counter()
        accounts, faults = rehearse(seed, quiet, arguments.rounds, arguments.only)
        print(_row(seed, accounts), flush=True)
        print(f"seed {seed}: {time.perf_counter() - begin_s:.0f} s", file=sys.stderr)
        for fault in faults if accounts.missed or accounts.false or accounts.unaccounted else ():
            print(
                f"  injected: {fault.begin_s:.1f} to {fault.end_s:.1f} s {fault.kind} {fault.target}", file=sys.stderr
            )
        for fault in accounts.missed:
            print(f"  missed: {fault}", file=sys.stderr)
        for at_s, link in accounts.unaccounted:
            print(f"  lost without a cause: {at_s:.2f} s {link}", file=sys.stderr)
        for at_s, subject, name in accounts.false:
            print(f"  false: {at_s:.1f} s {subject}: {name}", file=sys.stderr)


if __name__ == "__main__":
    main()
