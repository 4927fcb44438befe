"""Blind test of `treadlink diagnose` on undeclared effects.

`run` draws tires, sensors and undeclared effects from a seed. The exact ring makes the recordings, once for all
versions; labels stay sealed until the diagnosis is made. `score` prints and draws how often each version is right.
Without either, ten cases are run and scored.

Run: python tools/bench_closure.py run --cases DIR --results FILE.jsonl [--gateway DIR] [--count N] [--jobs N]
     python tools/bench_closure.py score FILE.jsonl [OTHER.jsonl] [--figures DIR]
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from closure_rig.causes import CAUSES
from closure_rig.draw import Kind
from closure_rig.figure import draw_confusion, draw_reliability
from closure_rig.outside import STRANGERS
from closure_rig.plan import sampled
from closure_rig.run import read, run
from closure_rig.score import report
from closure_rig.store import Store

_REPOSITORY = Path(__file__).parents[1]


def main() -> None:
    """Run or score."""
    options = _options(sys.argv[1:])
    if options.command == "run":
        _run(options)
    elif options.command == "score":
        _score(options)
    else:
        with tempfile.TemporaryDirectory(prefix="closure-rig-") as folder:
            results = f"{folder}/short.jsonl"
            _run(_options(["run", "--cases", folder, "--results", results, "--count", "10"]))
            _score(_options(["score", results]))


def _run(options: argparse.Namespace) -> None:
    if not (options.gateway / "gateway").is_dir():
        raise SystemExit(f"'{options.gateway}' holds no package 'gateway': give a source tree of treadlink")
    try:
        store = Store(options.cases, options.seed)
    except ValueError as error:
        raise SystemExit(str(error)) from error
    cases = sampled(store.cases, options.seed)
    if options.only:
        cases = [case for case in cases if set(case.names) & set(options.only)]
    if options.kinds:
        cases = [case for case in cases if case.kind in options.kinds]
    count = options.count if options.count is not None else round(options.share * len(cases))
    cases = cases[:count]
    pending = len(cases) - len({case.number for case in cases} & {line["number"] for line in read(options.results)})
    print(f"{len(cases)} cases, {len(cases) - pending} of them done", file=sys.stderr)
    lines = run(store, cases, options.gateway, options.results, jobs=options.jobs, timeout_s=options.timeout)
    for index, line in enumerate(lines, 1):
        what = " + ".join(f"{name} {line['strengths'][name]:.2g} limits" for name in line["strengths"]) or "nothing"
        said = " + ".join(line.get("named", ())) or "nothing named"
        cost = f"{line['cpu_s']:.0f} s of CPU" if "cpu_s" in line else line["fault"].splitlines()[-1]
        print(f"{index}/{pending} case {line['number']}, {line['model']}, {what}: {said}: {line['outcome']}, {cost}")
        sys.stdout.flush()


def _score(options: argparse.Namespace) -> None:
    names = [path.stem for path in options.results]
    versions = {path.stem if names.count(path.stem) == 1 else str(path): read(path) for path in options.results}
    for name, lines in versions.items():
        if not lines:
            raise SystemExit(f"'{name}' holds no results")
    if len(versions) > 1 and not options.all:
        both = set.intersection(*({line["number"] for line in lines} for lines in versions.values()))
        versions = {name: [line for line in lines if line["number"] in both] for name, lines in versions.items()}
    print("\n".join(report(versions)))
    if options.figures is not None:
        draw_reliability(versions, options.figures / "closure-reliability.svg")
        draw_confusion(list(versions.values())[-1], options.figures / "closure-confusion.svg")


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    commands = parser.add_subparsers(dest="command")
    runs = commands.add_parser(
        "run",
        help="diagnose cases with one version of the gateway",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    names = sorted([entry.name for entry in CAUSES] + [entry.name for entry in STRANGERS])
    runs.add_argument("--cases", type=Path, required=True, help="folder of cases, shared by all versions")
    runs.add_argument("--results", type=Path, required=True, help="JSON lines, one a case; continued if they exist")
    runs.add_argument("--gateway", type=Path, default=_REPOSITORY, help="source tree of the version to run")
    runs.add_argument("--seed", type=int, default=1, help="of the plan of cases")
    runs.add_argument("--count", type=int, help="number of cases, a fair sample of all kinds; default: by --share")
    runs.add_argument("--share", type=float, default=1.0, help="share of the cases, likewise")
    runs.add_argument("--kinds", type=Kind, nargs="+", choices=list(Kind), help="only cases of these kinds")
    runs.add_argument("--only", action="append", choices=names, metavar="EFFECT", help="only this effect; repeatable")
    runs.add_argument("--jobs", type=int, default=1, help="cases at a time")
    runs.add_argument("--timeout", type=float, default=1800.0, help="seconds of CPU after which a diagnosis has failed")
    scores = commands.add_parser("score", help="print how often diagnoses are right, for versions side by side")
    scores.add_argument(
        "results", type=Path, nargs="+", help="JSON lines of one version each; the file's name names it"
    )
    scores.add_argument("--all", action="store_true", help="also cases that not every version has run")
    scores.add_argument("--figures", type=Path, help="folder for the reliability curve and the confusion matrix")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    main()
