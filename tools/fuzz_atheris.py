"""Coverage-guided fuzzing with atheris, which is not among the project's dependencies.

    python3 -m venv fuzzing
    fuzzing/bin/pip install -r requirements.lock atheris
    fuzzing/bin/pip install --no-deps --no-build-isolation -e .
    fuzzing/bin/python tools/fuzz_atheris.py decoder -max_total_time=600
    fuzzing/bin/python tools/fuzz_atheris.py recording CORPUS_FOLDER -max_total_time=600 -rss_limit_mb=1024

The first argument names a target (without one they are listed), the others go to libFuzzer. Good inputs are put into
the corpus folder first. A crash leaves its input in `crash-*`; run that with `fuzz_atheris.py TARGET crash-...`.
"""

import sys
from hashlib import sha1
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).parents[1]))

with atheris.instrument_imports(include=["gateway", "firmware_protocol"]):
    from tools.reliability.fuzz_targets import TARGETS


def main() -> None:
    if len(sys.argv) < 2 or sys.argv[1] not in TARGETS:
        for name, target in TARGETS.items():
            print(f"{name:10s} {target.text}")
        sys.exit(2)
    target = TARGETS[sys.argv.pop(1)]
    for argument in sys.argv[1:]:
        if Path(argument).is_dir():
            for seed in target.seeds():
                (Path(argument) / sha1(seed).hexdigest()).write_bytes(seed)
    atheris.Setup(sys.argv, lambda data: target.run(data) and None)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
