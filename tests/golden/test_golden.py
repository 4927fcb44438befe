"""Results of whole commands, held field by field against stored ones.

A change that is meant to change results accepts them with `pytest tests/golden --update-golden`, which prints every
difference; the diff of tests/golden/data is then part of the change.
"""

import html
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from closure_rig.draw import blind, draw
from closure_rig.record import record

from tests.golden.comparison import table, words_and_numbers
from tests.testkit.commands import run

ROOT = Path(__file__).parents[2]
MEASURED = ROOT / ".." / "shared" / "measured" / "innerliner_drum_80kmh.csv"
MAP = ROOT / "examples" / "innerliner_drum_80kmh.map.toml"

# Seeds of `closure_rig.draw.blind`: mounting offset, bending damping; electrical tone (outside the catalogue), nothing.
SEALED = (25, 24, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (14, 13)))
# Two speeds of the rig's seven recordings.
RUNS = 2
SECONDS = 3.0
DEFAULTS = ("kinematic", "weak-form", "wear", "ply-steer")
OTHERS = ("self-calibration", "ring-modal", "ring-paper", "load", "slip-angle", "asynchronous")


def estimated(recording: Path, folder: Path, estimators: tuple[str, ...]) -> list[dict[str, object]]:
    out = folder / f"{recording.stem}.csv"
    options = [word for name in estimators for word in ("--estimator", name)]
    run("estimate", recording, "--csv", out, *options)
    # A simulation starts now, so that host times differ from run to run.
    return [
        {key: cell for key, cell in row.items() if not key.startswith("host_")} for row in table(out.read_text("utf-8"))
    ]


@pytest.mark.parametrize(
    ("scenario", "duration_s", "estimators"),
    [("demo", 4, DEFAULTS + OTHERS), ("standstill_restart", 12, DEFAULTS), ("lab", 1.5, ("kinematic", "forward"))],
)
def test_estimates_of_a_simulated_drive(compare, tmp_path, scenario, duration_s, estimators):
    recording = tmp_path / f"{scenario}.mcap"
    run("simulate", scenario, "--out", recording, "--duration", duration_s, "--seed", 4)
    compare(f"estimate-{scenario}", estimated(recording, tmp_path, estimators))


def test_estimates_of_the_measured_tire(compare, tmp_path):
    if not MEASURED.exists():
        pytest.skip("the measured recording is not part of the repository; it is looked for in ../shared/measured")
    recording = tmp_path / "drum.mcap"
    run("import", MEASURED, "--map", MAP, "--out", recording)
    compare("estimate-drum", estimated(recording, tmp_path, DEFAULTS + OTHERS + ("forward",)))


def test_contents_of_a_recording(compare, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run("simulate", "demo", "--out", "demo.mcap", "--duration", 3, "--seed", 4, "--fault", "drop:rate=0.02")
    compare("inspect-demo", without_host_times(json.loads(run("inspect", "demo.mcap", "--json"))))


def without_host_times(value):
    """Return JSON without the times of the run, which differ from run to run."""
    if isinstance(value, dict):
        return {key: without_host_times(item) for key, item in value.items() if key not in ("start_ns", "host_ns")}
    return [without_host_times(item) for item in value] if isinstance(value, list) else value


@pytest.mark.parametrize("seed", SEALED)
def test_diagnosis_of_a_sealed_case(request, compare, tmp_path, monkeypatch, seed):
    case = draw(blind(seed))
    bench = replace(case.bench, runs=case.bench.runs[:RUNS])
    record(replace(case, bench=bench), tmp_path, SECONDS)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("gateway.diagnosis.campaign_diagnosis.commit", lambda: "0123456789" * 4)
    names = [f"run-{index + 1}.mcap" for index in range(RUNS)]
    run("diagnose", *names, "--json", "found.json", "--html", "found.html", "--jobs", 1)
    compare(f"diagnose-{seed}", json.loads(without_hashes(Path("found.json").read_text("utf-8"))))
    if not request.config.getoption("--golden-numbers"):
        compare(f"report-{seed}", report_text(without_hashes(Path("found.html").read_text("utf-8"))))


def without_hashes(text: str) -> str:
    """Return a text without the hashes of recordings, which hold the version that wrote them."""
    return re.sub(r"\b[0-9a-f]{64}\b", "of the content", text)


def report_text(page: str) -> list[list[object]]:
    """Return the page's visible text, labels of the figures included, line by line as words and numbers."""
    body = re.sub(r"<(style|script)\b.*?</\1>", "", page, flags=re.DOTALL)
    lines = re.sub(r"<[^>]*>", "\n", body).splitlines()
    return [words_and_numbers(html.unescape(line)) for line in lines if line.strip()]
