"""Makes, diagnoses and counts the blind cases.

Run: PYTHONPATH=tools python -m blind_rig --cache DIR --results FILE [--gateway DIR] [--case NAME] [--limit SECONDS]

A case is three files of text that `treadlink import` reads and `treadlink diagnose` diagnoses, by the version of
the gateway in DIR. The file of results is continued; after the limit no further case begins. The summary counts.
"""

import argparse
import json
import math
import os
import re
import resource
import subprocess
import sys
import time
import zlib
from pathlib import Path
from typing import Any, Final

import numpy as np

from blind_rig.cases import ALONG, LATERAL, RADIAL, RATE_HZ, Array, Case, Drive
from blind_rig.cases import CASES as FIRST
from blind_rig.elements import rolled_by_elements
from blind_rig.ring import rolled
from blind_rig.second import SECOND

CASES: Final = (*FIRST, *SECOND)
_SECONDS: Final = 8.0
_RUNS: Final = ((45.0, 4500.0), (95.0, 4500.0), (70.0, 6500.0))
_NOISE_MPS2: Final = 3.2
_MAP: Final = """[file]
format = "csv"
[sampling]
rate_hz = 9600.0
[sensor]
coupling = "DC"
[axis.radial]
column = "r"
unit = "m/s^2"
[axis.circumferential]
column = "c"
unit = "m/s^2"
[axis.lateral]
column = "l"
unit = "m/s^2"
{mounting}[conditions]
position = "FL"
radius_mm = {radius_mm}
load_n = {load_n}
pressure_kpa = {pressure_kpa}
"""


def _signal(case: Case, kmh: float, load_n: float, rng: np.random.Generator) -> Array:
    ring = case.ring
    omega = kmh / 3.6 / ring.radius_m
    if case.elements:
        shape = rolled_by_elements(ring, load_n, omega, case.depth_m)
    else:
        shape = rolled(ring, load_n, omega, case.depth_m, case.stiffer)
    nodes = shape.inertia_m.shape[1]
    grid = (np.arange(nodes + 1) - nodes // 2) * (2.0 * math.pi / nodes)
    closed = [np.concatenate([curve, curve[:, :1]], axis=1) for curve in (shape.inertia_m, shape.gravity_mps2)]
    time_s = np.arange(round(_SECONDS * RATE_HZ)) / RATE_HZ
    drift = 0.003 * float(rng.uniform(-1.0, 1.0))
    axle = omega * time_s * (1.0 - drift + drift * time_s / _SECONDS) + float(rng.uniform(0.0, 6.0))
    angle = case.turn(axle) if case.turn else axle
    angle = np.unwrap(angle)
    rate = np.gradient(angle, time_s)
    spin = np.gradient(rate, time_s)

    def read(angles: Array) -> Array:
        wrapped = np.mod(angles + math.pi, 2.0 * math.pi) - math.pi
        inward, along = (np.interp(wrapped, grid, curve) for curve in closed[0])
        down, forward = (np.interp(wrapped, grid, curve) for curve in closed[1])
        f = np.zeros((3, len(angles)))
        f[RADIAL] = rate**2 * inward + down
        f[ALONG] = rate**2 * along + spin * ring.radius_m + forward
        return f

    f = read(angle)
    if case.chain:
        f = case.chain(Drive(time_s, angle, rate, read), f)
    signal: Array = f + _NOISE_MPS2 * rng.standard_normal(f.shape)
    return signal


def _make(case: Case, folder: Path) -> None:
    half = folder.with_name(f"{folder.name}.part")
    half.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(zlib.crc32(case.name.encode()))
    mounting = "" if case.stated_mm is None else f"[mounting]\noffset_mm = {case.stated_mm}\n"
    for index, (kmh, load_n) in enumerate(_RUNS):
        signal = _signal(case, kmh, load_n, rng)
        columns = np.stack([signal[RADIAL], signal[ALONG], signal[LATERAL]], axis=1)
        np.savetxt(half / f"{index}.csv", columns, fmt="%.3f", delimiter=",", header="r,c,l", comments="")
        text = _MAP.format(
            mounting=mounting,
            radius_mm=1e3 * case.ring.radius_m,
            load_n=load_n,
            pressure_kpa=1e-3 * case.ring.pressure_pa,
        )
        (half / f"{index}.toml").write_text(text, encoding="ascii")
    half.rename(folder)


def _stem(case: Case) -> str:
    return re.sub(r"\W+", "-", case.name)


def _run(gateway: Path, *arguments: str) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "gateway.core.cli", *arguments],
        env={**os.environ, "PYTHONPATH": str(gateway)}, cwd=gateway, capture_output=True, text=True, check=False,
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(f"treadlink {arguments[0]}: {done.stderr.strip()[-500:]}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _diagnose(case: Case, folder: Path, gateway: Path, out: Path) -> dict[str, Any]:
    recordings = []
    for index in range(len(_RUNS)):
        recording = folder / f"{index}.mcap"
        if not recording.is_file():
            _run(
                gateway,
                "import",
                str(folder / f"{index}.csv"),
                "--map",
                str(folder / f"{index}.toml"),
                "--out",
                str(recording),
            )
        recordings.append(str(recording))
    cpu_s = _run(gateway, "diagnose", *recordings, "--json", str(out), "--jobs", "1", "--force")
    return {"case": case.name, "cpu_s": round(cpu_s, 1), "result": str(out)}


def judged(case: Case, result: dict[str, Any]) -> dict[str, Any]:
    """Return what a diagnosis says of a case: names, false ones, those that are missing, and what is left."""
    names = [entry["name"] for entry in result["effects"] if entry["verdict"] == "named"]
    laws = [law["name"] for law in result.get("laws", []) if law.get("certain")]
    said = names + laws

    def is_right(name: str, choice: tuple[str, ...]) -> bool:
        return any(right in name for right in choice)

    allowed = [*case.right, case.also]
    return {
        "names": said,
        "false": [name for name in said if not any(is_right(name, choice) for choice in allowed)],
        "missing": [choice[0] for choice in case.right if not any(is_right(name, choice) for name in said)],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--gateway", type=Path, default=Path(__file__).parents[2])
    parser.add_argument("--case", action="append")
    parser.add_argument("--limit", type=float, default=math.inf, help="seconds after which no further case begins")
    options = parser.parse_args()
    begun = time.monotonic()
    lines = [json.loads(line) for line in options.results.read_text().splitlines()] if options.results.is_file() else []
    lines = [line for line in lines if "fault" not in line]
    done = {line["case"] for line in lines}
    for case in CASES:
        if case.name in done or (options.case and case.name not in options.case):
            continue
        if time.monotonic() - begun > options.limit:
            break
        folder = options.cache / _stem(case)
        if not folder.is_dir():
            _make(case, folder)
        try:
            line = _diagnose(
                case, folder, options.gateway.resolve(), options.results.with_suffix(f".{_stem(case)}.json")
            )
        except RuntimeError as error:
            line = {"case": case.name, "fault": str(error)}
        lines.append(line)
        with options.results.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
        print(f"{case.name}: {line.get('fault') or line['cpu_s']}", flush=True)
    _summary(options.results, lines)


def _summary(results: Path, lines: list[dict[str, Any]]) -> None:
    false = named = right = numbers = 0
    pulls: list[float] = []
    cases = {case.name: case for case in CASES}
    for line in lines:
        case = cases[line["case"]]
        path = results.with_suffix(f".{_stem(case)}.json")
        if not path.is_file():
            print(f"{case.name}: {line.get('fault')}")
            continue
        result = json.loads(path.read_text(encoding="utf-8"))
        said = judged(case, result)
        false += bool(said["false"])
        named += bool(case.right)
        right += bool(case.right) and not said["missing"]
        pulls += (of_case := _pulls(case, result))
        worst = max(map(abs, of_case), default=0.0)
        held_out = result["held_out"]
        after = held_out["rms_after_mps2"] / result["noise_floor_mps2"]
        print(
            f"{case.name:28} {line.get('cpu_s', 0):5.0f} s, left {after:5.2f} floors, worst pull {worst:4.1f}: "
            f"{said['names']} false {said['false']} missing {said['missing']}"
        )
    numbers = len(pulls)
    far = sum(abs(pull) > 3.5 for pull in pulls)
    rms = math.sqrt(sum(pull**2 for pull in pulls) / max(numbers, 1))
    print(f"{len(lines)} of {len(CASES)} cases: {false} with a false name, {right} of {named} with every right name")
    print(f"{numbers} numbers determined: pulls {rms:.2f}, {far} beyond 3.5 errors")


def _pulls(case: Case, result: dict[str, Any]) -> list[float]:
    """Return the errors of the determined numbers, and of the case's size, over their standard errors."""
    ring = case.ring
    true = {"Bs": ring.bs, "Cw": ring.cw, "Rs": ring.rs, "Ts": ring.ts}
    pulls = []
    for name, number in result["estimates"]["after"].items():
        if number["determined"] and (quantity := name.split(" (")[0]) in true:
            pulls.append((number["value"] - true[quantity]) / number["std"])
    for effect in result["effects"]:
        if case.size and effect["verdict"] == "named" and effect["name"] == case.size[0]:
            value, std = effect["parameters"][case.size[1]], effect["std"][case.size[1]]
            pulls.append((value - case.size[2]) / std)
    return pulls


if __name__ == "__main__":
    main()
