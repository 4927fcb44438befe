"""Campaign of a simulated fleet: time, memory and size with one and more workers, and the trends against the truth.

    python -m tools.bench_campaign FOLDER --make 1000           # simulate the recordings
    python -m tools.bench_campaign FOLDER --jobs 1 --jobs 2     # estimate them, a dataset for each number of workers
    python -m tools.bench_campaign FOLDER --check 2             # compare the trends of that dataset with the truth
    python -m tools.bench_campaign FOLDER --packing 200         # many short recordings: overhead, `compact` and a query

The fleet has eight vehicles with one instrumented wheel each, recorded for 30 s now and then while they roll 10,000 km
in 250 days. Temperature, load and speed vary from recording to recording; pressure and stiffness follow the
temperature. One vehicle wears by 0.5 mm in 10,000 km, one loses 3 kPa a month, one gets a new tire, one has a sensor
that becomes noisy, and one in 100 recordings of another has a wrong load: true outliers. The others have no trend but
the normal wear of 0.2 mm in 10,000 km.
"""

import argparse
import json
import math
import os
import platform
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import duckdb
import numpy as np

from gateway.core.config.validation import parse_document
from gateway.core.constants import STANDARD_ATMOSPHERE_PA, ZERO_CELSIUS_K
from gateway.core.estimates.tire_data import SOFTENING_PER_K
from gateway.core.recording.writer import RecordingWriter
from gateway.fleet.history_reading import read_histories, read_odometer
from gateway.fleet.recording_estimation import RECORDINGS, REVOLUTIONS
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.trend_result import Quantity
from gateway.fleet.views.trend_page import write_trends_page
from gateway.fleet.views.trend_tables import number_of
from gateway.simulator.scenario import vehicle_toml
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import simulate

BEGIN_NS = 1_767_225_600 * 10**9  # 1 January 2026
DAY_NS = 86_400 * 10**9
KM_A_DAY = 40.0
DAYS = 250.0
DAYS_A_MONTH = 365.25 / 12.0
DURATION_S = 30.0
SHORT_S = 3.0
QUERIES = 3
BENDING = 3.08e-3
PRESSURE_KPA = 220.0
LOAD_N = 4000.0
# Runs a command and prints what it and its workers have used: this process has waited for others too.
_MEASURED = """
import resource, signal, subprocess, sys
process = subprocess.Popen(sys.argv[1:])
signal.signal(signal.SIGTERM, lambda *_: process.terminate())
status = process.wait()
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss)
sys.exit(status if status >= 0 else 128 - status)
"""


@dataclass(frozen=True)
class Vehicle:
    """One vehicle of the fleet: what happens to its tire.

    Attributes:
        name: of the vehicle.
        wear_mm: in 10,000 km.
        leak_kpa: lost in a month.
        changed_at: share of its recordings after which it has a new tire.
        noise: factor by which the sensor's noise grows over all recordings.
        outliers: whether every hundredth recording has a third less load than stated.
    """

    name: str
    wear_mm: float = 0.2
    leak_kpa: float = 0.0
    changed_at: float = 1.0
    noise: float = 1.0
    outliers: bool = False


FLEET = (
    Vehicle("worn", wear_mm=0.5),
    Vehicle("leaking", leak_kpa=3.0),
    Vehicle("new tire", wear_mm=0.5, changed_at=0.5),
    Vehicle("noisy sensor", noise=8.0),
    Vehicle("overloaded", outliers=True),
    Vehicle("plain 1"),
    Vehicle("plain 2"),
    Vehicle("plain 3"),
)


@dataclass(frozen=True)
class Planned:
    """One recording of the fleet and what is true of it."""

    path: str
    vehicle: str
    start_ns: int
    km: float
    sensor_id: str
    wear_mm: float
    pressure_kpa: float
    temperature_degc: float
    load_n: float
    speed_kmh: float
    noise_mg: float
    seed: int
    outlier: bool


def planned(folder: Path, count: int) -> list[Planned]:
    """Return the recordings of the fleet, in the order of time."""
    rng = np.random.default_rng(20260101)
    plans = []
    each = count // len(FLEET)
    # The same wear, leak and distance whatever the number of recordings: fewer are further apart.
    interval = DAYS / max(each, 1)
    for number, vehicle in enumerate(FLEET):
        for index in range(each):
            days = index * interval + 0.2 + rng.uniform(0.0, 0.05)
            km = days * KM_A_DAY
            changed = index >= vehicle.changed_at * each
            since_km = km - vehicle.changed_at * each * interval * KM_A_DAY if changed else km
            degc = 32.0 + 8.0 * math.sin(2.0 * math.pi * days / 365.25) + rng.normal(0.0, 4.0)
            warm = (degc + ZERO_CELSIUS_K) / (20.0 + ZERO_CELSIUS_K)
            cold_kpa = PRESSURE_KPA - vehicle.leak_kpa * days / DAYS_A_MONTH
            atmosphere_kpa = STANDARD_ATMOSPHERE_PA * 1e-3
            outlier = vehicle.outliers and index % 50 == 25
            plans.append(
                Planned(
                    path=str(folder / f"{vehicle.name.replace(' ', '_')}_{index:04d}.mcap"),
                    vehicle=vehicle.name,
                    start_ns=BEGIN_NS + round(days * DAY_NS),
                    km=km,
                    sensor_id=f"{0xA000 + 16 * number + changed:08x}",
                    wear_mm=vehicle.wear_mm * since_km / 10_000.0,
                    pressure_kpa=(cold_kpa + atmosphere_kpa) * warm - atmosphere_kpa,
                    temperature_degc=degc,
                    load_n=LOAD_N * (rng.normal(1.0, 0.01) if not outlier else 0.67),
                    speed_kmh=float(rng.uniform(35.0, 45.0)),
                    noise_mg=5.0 * vehicle.noise ** (index / max(each - 1, 1)),
                    seed=int(rng.integers(1 << 31)),
                    outlier=outlier,
                )
            )
    return sorted(plans, key=lambda plan: plan.start_ns)


def write(plan: Planned, duration_s: float) -> int:
    """Simulate one recording; return its size."""
    path = Path(plan.path)
    if path.exists():
        return path.stat().st_size
    softened = BENDING * math.exp(-SOFTENING_PER_K * (plan.temperature_degc - 25.0))
    text = (
        f"[scenario]\nseed = {plan.seed}\n[motion]\nspeed_kmh = {plan.speed_kmh:.3f}\n"
        f"[tire]\nreference_pressure_kpa = {PRESSURE_KPA}\nBs = {softened:.9g}\nwear_mm = {plan.wear_mm:.6f}\n"
        f"sidewall_pressure_share = 0.5\n"
        f"[sensor]\nrate_hz = 2000\nnoise_mg_rthz = [{plan.noise_mg:.3f}, {plan.noise_mg:.3f}, {plan.noise_mg:.3f}]\n"
        f"[[wheel]]\nposition = 'FL'\nwheel = 0\nsensor_id = '{plan.sensor_id}'\nload_n = {plan.load_n:.3f}\n"
        f"pressure_kpa = {plan.pressure_kpa:.4f}\ntemperature_degc = {plan.temperature_degc:.3f}\n"
        f"[wheel.stated]\nload_n = {LOAD_N}\npressure_kpa = {PRESSURE_KPA}\n"
    )
    scenario = parse_document(Scenario, text, "fleet")
    toml = vehicle_toml(scenario)
    toml = toml.replace('name = ""', f'name = "{plan.vehicle}"').replace(f"Bs = {softened:.9g}", f"Bs = {BENDING}")
    toml = toml.replace("[wheel.tire.reference]", "[wheel.tire.reference]\ntemperature_degc = 25.0")
    toml = toml.replace("load_std_n = 20.0", f"load_std_n = {0.01 * LOAD_N}")
    assert f"Bs = {BENDING}" in toml
    assert f"load_std_n = {0.01 * LOAD_N}" in toml
    part = path.with_suffix(".part")
    part.unlink(missing_ok=True)
    writer = RecordingWriter(part, start_ns=plan.start_ns, vehicle_toml=toml, sources=("sim",))
    for chunk in simulate(scenario, duration_s=duration_s).chunks("sim", plan.start_ns):
        writer.write(chunk)
    writer.close()
    part.rename(path)
    return path.stat().st_size


def make(folder: Path, count: int, jobs: int, duration_s: float) -> None:
    """Simulate the fleet."""
    recordings = folder / "recordings"
    recordings.mkdir(parents=True, exist_ok=True)
    plans = planned(recordings, count)
    begin = time.monotonic()
    with ProcessPoolExecutor(jobs) as pool:
        sizes = list(pool.map(partial(write, duration_s=duration_s), plans, chunksize=4))
    (folder / "truth.json").write_text(json.dumps([asdict(plan) for plan in plans]))
    lines = ["vehicle,utc,km"]
    for vehicle in FLEET:
        for day in range(0, 260, 7):
            utc = np.datetime_as_string(np.datetime64(BEGIN_NS + day * DAY_NS, "ns"), unit="s")
            lines.append(f"{vehicle.name},{utc}Z,{20_000 + day * KM_A_DAY:.1f}")
    (folder / "odometer.csv").write_text("\n".join(lines) + "\n")
    print(f"{len(plans)} recordings of {duration_s:g} s, {sum(sizes) / 1e6:.0f} MB, {time.monotonic() - begin:.0f} s")


def estimate(folder: Path, jobs: int, limit_s: float | None) -> None:
    """Run the campaign with this number of workers and print what it took."""
    dataset = folder / f"jobs{jobs}.dataset"
    command = [sys.executable, "-c", _MEASURED, sys.executable, "-m", "gateway.core.cli", "campaign"]
    command += [str(folder / "recordings"), "--out", str(dataset), "--jobs", str(jobs)]
    begin = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        printed, _ = process.communicate(timeout=limit_s)
    except subprocess.TimeoutExpired:
        process.terminate()
        printed, _ = process.communicate()
    wall_s = time.monotonic() - begin
    *lines, used = printed.splitlines()
    cpu_s, peak_kib = map(float, used.split())
    tables = (RECORDINGS, REVOLUTIONS)
    sizes = {name: [part.stat().st_size for part in (dataset / name).rglob("*.parquet")] for name in tables}
    count = len(sizes[RECORDINGS])
    print(f"--jobs {jobs}: exit status {process.returncode}")
    print("\n".join(f"  {line}" for line in lines))
    each = f"{cpu_s / max(count, 1):.2f} s each; coordinator or worker {peak_kib / 1024:.0f} MB at most"
    print(f"  {count} recordings in the dataset; {wall_s:.0f} s, {cpu_s:.0f} s of CPU, {each}")
    for name, result in sizes.items():
        print(f"  {name}: {sum(result) / 1e6:.1f} MB, {sum(result) / max(count, 1) / 1e3:.1f} kB a recording")


def pack(dataset: Path, tables: Path) -> None:
    """Pack a dataset with `treadlink compact`; print its files and a query over all revolutions, before and after."""
    command = [sys.executable, "-m", "gateway.core.cli", "compact", str(dataset), "--out", str(tables)]
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    answers = []
    for name, tree, revolutions in (
        ("dataset", dataset, f"{REVOLUTIONS}/*/*/*.parquet"),
        ("compact", tables, f"{REVOLUTIONS}-*.parquet"),
    ):
        sizes = [part.stat().st_size for part in tree.rglob("*.parquet")]
        rows, took_s = timed_query(tree / revolutions)
        answers.append(rows)
        print(
            f"  {name}: {len(sizes)} Parquet files, {sum(sizes) / 1e6:.2f} MB; mean speed of {len(rows)} vehicles "
            f"{1e3 * took_s:.0f} ms, best of {QUERIES}"
        )
    # The order of a sum differs with the files.
    before, after = (np.array([mean for _, mean in rows]) for rows in answers)
    assert np.allclose(before, after, rtol=1e-12)


def timed_query(files: Path) -> tuple[list[tuple[str, float]], float]:
    """Return the mean speed, m/s, of each vehicle over the revolutions in files, and the least time, s, of QUERIES."""
    query = f"SELECT vehicle, avg(speed_mps) FROM read_parquet('{files}') GROUP BY vehicle ORDER BY vehicle"
    rows: list[tuple[str, float]] = []
    took_s = []
    for _ in range(QUERIES):
        with duckdb.connect() as connection:
            begin = time.monotonic()
            rows = connection.sql(query).fetchall()
            took_s.append(time.monotonic() - begin)
    return rows, min(took_s)


def check(folder: Path, jobs: int) -> None:
    """Print the trends of a dataset beside the truth, and the outliers that are false."""
    plans = [Planned(**entry) for entry in json.loads((folder / "truth.json").read_text())]
    dataset, page = folder / f"jobs{jobs}.dataset", folder / f"jobs{jobs}.html"
    histories = read_histories(dataset, read_odometer(folder / "odometer.csv"))
    begin = time.monotonic()
    result = analyse(histories.tires, recordings=histories.recordings, failures=histories.failures)
    analysed = time.monotonic()
    write_trends_page(result, page, force=True)
    print(
        f"{result.recordings} recordings, {result.failures} failures: trends {analysed - begin:.1f} s, "
        f"page {time.monotonic() - analysed:.1f} s, {page.stat().st_size / 1e6:.1f} MB"
    )
    print("| tire | recordings | wear, mm in 10,000 km | true | pressure loss, kPa a month | true | findings |")
    print("|---|---|---|---|---|---|---|")
    for tire in result.tires:
        vehicle = next(item for item in FLEET if item.name == tire.vehicle)
        wear = number_of(tire.numbers, Quantity.WEAR_RATE)
        loss = number_of(tire.numbers, Quantity.PRESSURE_LOSS)
        words = "; ".join(str(finding.code) for finding in tire.findings) or "none"
        print(
            f"| {tire.vehicle} {tire.sensor_id} | {tire.recordings} | {10 * wear.value:.2f} ± {10 * wear.std:.2f} "
            f"| {vehicle.wear_mm} | {loss.value:.3f} ± {loss.std:.3f} | {vehicle.leak_kpa} | {words} |"
        )
    named = {Path(outlier.path).name for outlier in result.outliers}
    estimated = {Path(path).name for tire in histories.tires for path in tire.paths}
    true = {Path(plan.path).name for plan in plans if plan.outlier} & estimated
    share = 100.0 * len(named - true) / max(len(estimated - true), 1)
    print(f"outliers: {len(named & true)} of {len(true)} found; {len(named - true)} false, {share:.2f} % of the others")
    print(f"false: {', '.join(sorted(named - true)) or 'none'}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--make", type=int, metavar="COUNT", help="simulate this number of recordings")
    parser.add_argument("--jobs", type=int, action="append", default=[], help="estimate with this number of workers")
    parser.add_argument("--limit", type=float, metavar="SECONDS", help="stop each campaign after this time")
    parser.add_argument("--check", type=int, metavar="JOBS", help="compare the trends of this dataset with the truth")
    parser.add_argument("--packing", type=int, metavar="COUNT", help="simulate, estimate and pack short recordings")
    arguments = parser.parse_args()
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    if arguments.make:
        make(arguments.folder, arguments.make, os.cpu_count() or 1, DURATION_S)
    for jobs in arguments.jobs:
        estimate(arguments.folder, jobs, arguments.limit)
    if arguments.check:
        check(arguments.folder, arguments.check)
    if arguments.packing:
        make(arguments.folder, arguments.packing, os.cpu_count() or 1, SHORT_S)
        estimate(arguments.folder, 1, arguments.limit)
        pack(arguments.folder / "jobs1.dataset", arguments.folder / "jobs1.tables")


if __name__ == "__main__":
    main()
