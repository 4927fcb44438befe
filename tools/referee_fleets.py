"""Write two fleets with planted faults, and print which of them `treadlink trends` names, and what else it finds.

    python -m tools.referee_fleets FOLDER [SEED]

The generator shares nothing with `gateway.fleet.trends`. 15 vehicles of 4 wheels have 60 drives each. Their columns are
those that `treadlink campaign` estimated of simulated wheels, as these answer to pressure, load, wear and noise. What
varies over months is worked out: gas with weather, heat and barometer, permeation of 3 kPa a month, refills, loads by
axle with passengers, wear by distance, softening, errors of sensors. Fleet a: January to June, -4 to 24 °C, a drive
each 2.5 days, loads stated within 3 %. Fleet b: 25 °C, up to five drives a day, a gap of three weeks, loads calibrated
but not stated. FOLDER gets datasets, odometers and results.
"""

import datetime as dt
import hashlib
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from gateway.core.types import BoolArray, FloatArray

Row = dict[str, Any]

POSITIONS: Final = ("FL", "FR", "RL", "RR")
VEHICLES, COUNT = 15, 60
SCENARIO: Final = """scenario = { name = "response" }
motion = { speed_kmh = [[0, 40], [4, 65], [9, 65], [14, 95], [19, 95], [26, 40]] }
road = { rms_mps2 = 2 }
tire = { radius_mm = 320, ring_thickness_mm = 15, Bs = 3.08e-3, Cw = 0.195, Rs = 2.97, Ts = 2.53, \
extension_stiffness_mn = 20 }
sensor = { rate_hz = 9600, range_g = 500 }
hub = [{ hub = 0 }]
wheel = [
"""
WHEEL: Final = """{{ position = "{}", wheel = {}, load_n = {}, pressure_kpa = {}, temperature_degc = 30, \
tire.wear_mm = {}, sensor.noise_mg_rthz = {}, stated.load_n = 4200 }},\n"""
# What the vehicle file says besides.
CALIBRATION: Final = """load_calibration = { load_n = 4200, pressure_kpa = 210, half_angle_rad = 0.213, \
angle_exponent = 1.4, pressure_exponent = 0.5, relative_std_percent = 1, half_angle_min_rad = 0.1, \
half_angle_max_rad = 0.35, pressure_min_kpa = 100, pressure_max_kpa = 350 }
[wheel.tire.reference]\ntemperature_degc = 30\nsoftening_percent_per_k = 0.4\nsoftening_std_percent_per_k = 0.03\n"""
# Load in N, pressure in kPa, wear in mm and noise in mg/rtHz of the simulated wheels.
SIMULATED: Final = {
    "base": (4200, 210, 0, 5), "low pressure": (4200, 168, 0, 5), "high pressure": (4200, 252, 0, 5),
    "low load": (3360, 210, 0, 5), "high load": (5040, 210, 0, 5), "worn": (4200, 210, 1.5, 5),
    "noisy": (4200, 210, 0, 50), "again": (4200, 210, 0, 5),
}  # fmt: skip
# Standard deviations between tires, and of the constant errors of their sensors: shares, kPa, m/s2, m/s2/K, m.
TRAITS: Final = {
    "Bs": 0.01, "Rs": 0.02, "Ts": 0.03, "load": 0.01, "gain": 5e-3,
    "pressure": 1.2, "zero": 0.3, "zero per K": 4e-3, "offset": 2e-4,
}  # fmt: skip
_NORMAL_KPA, _ZERO_K, _WARM_K = 101.3, 273.15, 293.15
# By vehicle: days between refills, where not usual, and mm by which tires are worn that get replaced.
_REFILL_DAYS: Final = {1: 30.0, 13: 25.0, 14: 7.0, 2: 1e9, 3: 1e9, 15: 1e9}
_WORN_MM: Final = {11: 2.5}


class Plant(NamedTuple):
    """What is planted at wheels of a vehicle: first day (negative: a drive from the end), size, and end of its growth.

    Sizes: leak kPa a day at 220 kPa; puncture kPa, then 4 a day; wear mm; gain, load and radius stated %; zero m/s2;
    noise times more; pressure set kPa. Loads, another tire and pressures that are set are no faults.
    """

    vehicle: int
    wheels: str
    kind: str
    begin: float
    size: float
    end: float = 0.0

    def since(self, *kinds: str, days: FloatArray) -> BoolArray:
        """Return whether days have a plant of these kinds."""
        return np.asarray((days >= self.begin) & (self.kind in kinds))

    def sizes(self, kind: str, days: FloatArray) -> FloatArray:
        """Return the size on days, 0 without a plant of this kind."""
        grown = np.minimum((days - self.begin) / (self.end - self.begin), 1.0) if self.end else 1.0
        return np.where(self.since(kind, days=days), self.size * grown, 0.0)


NOTHING: Final = Plant(0, "", "", 1e9, 0.0)
PLANTS: Final = {
    "a": (
        Plant(1, "FL", "leak", 70, 1.2), Plant(2, "RR", "leak", 143.5, 10), Plant(3, "RL", "puncture", -5, 45),
        Plant(4, "FR", "wear", 0, 1.5, 150), Plant(5, "FL", "wear", 112, 1.2, 120), Plant(6, "RR", "gain", 80, -2),
        Plant(7, "FL", "zero", 0, 2.5, 150), Plant(8, "RL", "stuck", 90, 0), Plant(9, "FR", "noise", 90, 9, 150),
        Plant(10, "FL FR RL RR", "load", 75, 20), Plant(11, "RL", "replaced", 85, -1), Plant(12, "FR", "set", 60, -35),
    ),
    "b": (
        Plant(1, "RL", "leak", 80, 3), Plant(2, "FL", "leak", 0, 0.33), Plant(3, "FR", "leak", 104, 10),
        Plant(4, "RR", "puncture", -5, 30), Plant(5, "RR", "wear", 0, 1.5, 110), Plant(6, "FR", "wear", 103, 0.8, 110),
        Plant(7, "FL", "gain", 60, -1), Plant(8, "RL", "zero", 0, -1.5, 110), Plant(9, "FL", "stuck", -15, 0),
        Plant(10, "RR", "noise", -20, 9), Plant(11, "RL RR", "load", 65, 20), Plant(12, "FL", "stated", 70, -3),
        Plant(13, "FL FR RL RR", "set", 66, 30),
    ),
}  # fmt: skip
# What a finding says that names a plant, where it is not its kind.
WORDS: Final = {"leak": ": leaks", "puncture": ": leaks", "replaced": "new tire|radius|gain", "set": "pressure at 20"}


class Fleet(NamedTuple):
    """A fleet: first day, days, whether loads are stated, °C at first, their rise, swing of a day, and scatter."""

    name: str
    start: dt.datetime
    days: int
    is_stated: bool
    degc: tuple[float, float, float, float]


FLEETS: Final = (
    Fleet("a", dt.datetime(2026, 1, 10, tzinfo=dt.UTC), 150, True, (-4.0, 28.0, 4.0, 2.3)),
    Fleet("b", dt.datetime(2026, 7, 20, tzinfo=dt.UTC), 110, False, (25.0, 0.0, 1.0, 0.6)),
)


class Vehicle:
    """Drives of a vehicle, (60,) each; and (h,) days, temperatures outside and refills of its hours."""

    def __init__(self, fleet: Fleet, number: int, air: FloatArray, rng: np.random.Generator) -> None:
        self.fleet, self.number, self.name = fleet, number, f"{fleet.name}{number:02d}"
        if fleet.name == "a":
            self.days = np.linspace(0.3, 149.3, COUNT) + rng.uniform(-0.29, 0.8, COUNT)
        else:
            # Five drives fit into a day. The last ones are close to each other, for what grows fast.
            dates, slots = rng.choice([*range(38), *range(59, 105)], 24, replace=False), rng.choice(120, 53, False)
            days = dates[slots // 5] + 0.25 + 0.12 * (slots % 5 + rng.uniform(0.0, 0.8, 53))
            self.days = np.sort([*days, 105.4, 106.4, 107.6, 108.4, 109.3, 109.5, 109.7])
        self.minutes, self.pace = rng.uniform(8.0, 30.0, COUNT), rng.uniform(0.7, 1.3, COUNT)
        self.passengers, self.km_a_day = rng.normal(0.0, 0.015, COUNT), rng.uniform(45.0, 75.0)
        self.heat_k = 24.0 * (1.0 - np.exp(-self.minutes / 18.0)) * self.pace**1.3 + rng.normal(0.0, 1.5, COUNT)
        self.hours = np.arange(0.0, fleet.days + 1, 1.0 / 24.0)
        self.outside_degc = np.interp(self.hours, np.arange(air.shape[1]), air[0])
        self.outside_degc += fleet.degc[2] * np.sin(2.0 * np.pi * self.hours - 2.2)
        self.ambient_degc = np.interp(self.days, self.hours, self.outside_degc)
        self.weather_kpa = np.interp(self.days, np.arange(air.shape[1]), air[1])
        period = _REFILL_DAYS.get(number, rng.uniform(60.0, 90.0))
        refills = np.arange(rng.uniform(0.3, 1.0) * period, fleet.days, period)
        self.is_refill = np.isin(np.arange(len(self.hours)), np.ceil(24.0 * refills))
        self.plant = next((plant for plant in PLANTS[fleet.name] if plant.vehicle == number), NOTHING)
        if self.plant.begin < 0:
            self.plant = self.plant._replace(begin=self.days[int(self.plant.begin)] - 0.02)


class Wheel:
    """A wheel in each drive, (60,) each: the truth, and the pressure that is read."""

    def __init__(self, vehicle: Vehicle, position: str, rng: np.random.Generator) -> None:
        # Front wheels carry more, are warmer and wear faster.
        is_front = position in ("FL", "FR")
        target_kpa, self.stated_n = (230.0, 4200.0) if is_front else (215.0, 3400.0)
        warming, most_mm = (1.05, 0.13) if is_front else (0.95, 0.09)
        self.vehicle, self.position, self.rng, days = vehicle, position, rng, vehicle.days
        self.sensor_id = f"0{vehicle.fleet.name}{vehicle.number:02x}000{POSITIONS.index(position) + 1}"
        self.plant = plant = vehicle.plant if position in vehicle.plant.wheels else NOTHING
        self.traits = {name: rng.normal(0.0, std) for name, std in TRAITS.items()}
        self.is_new = plant.since("replaced", "stated", days=days)
        self.degc = vehicle.ambient_degc + vehicle.heat_k * warming + rng.normal(0.0, 0.8, COUNT)
        # The gas is a little cooler than the sensor on the liner.
        kelvin = _ZERO_K + 0.08 * vehicle.ambient_degc + 0.92 * self.degc + rng.normal(0.0, 0.5, COUNT)
        fallen_kpa = plant.sizes("puncture", days) + 4.0 * plant.since("puncture", days=days) * (days - plant.begin)
        amounts = np.interp(days, vehicle.hours, self._gas(target_kpa))
        self.true_kpa = amounts * kelvin - _NORMAL_KPA - vehicle.weather_kpa - fallen_kpa
        self.read_kpa = self.true_kpa + self.traits["pressure"] + rng.normal(0.0, 0.3, COUNT)
        is_stuck = plant.since("stuck", days=days)
        self.read_kpa[is_stuck] = np.round(self.read_kpa[is_stuck][:1], 1)
        mm_a_day = vehicle.km_a_day * rng.uniform(most_mm - 0.03, most_mm) / 1000.0
        old_mm = rng.uniform(0.5, 2.0) + _WORN_MM.get(vehicle.number, 0.0) + mm_a_day * days + plant.sizes("wear", days)
        self.wear_mm = np.where(self.is_new, mm_a_day * (days - plant.begin), old_mm)
        shares = 1.0 + vehicle.passengers + rng.normal(0.0, 0.008, COUNT)
        self.load_n = self.stated_n * (1.0 + self.traits["load"]) * shares * (1.0 + plant.sizes("load", days) / 100.0)

    def _gas(self, target_kpa: float) -> FloatArray:
        """Return (h,) pressures over temperature, in kPa/K: permeation, leaks, refills, pressures that are set."""
        hours, amount = self.vehicle.hours, 0.0
        amounts, set_kpa = np.empty(len(hours)), np.diff(self.plant.sizes("set", hours), prepend=0.0)
        lost_kpa = (self.rng.normal(3.0, 0.5) / 30.4 + self.plant.sizes("leak", hours)) / 24.0
        for hour, kelvin in enumerate(self.vehicle.outside_degc + _ZERO_K):
            amount -= lost_kpa[hour] * max(amount * _WARM_K - _NORMAL_KPA, 0.0) / 220.0 / _WARM_K
            if hour == 0 or self.vehicle.is_refill[hour]:
                amount = max(amount, (target_kpa + self.rng.normal(0.0, 2.0) + _NORMAL_KPA) / kelvin)
            if set_kpa[hour]:
                target_kpa += set_kpa[hour]
                amount = (target_kpa + _NORMAL_KPA) / kelvin
            amounts[hour] = amount
        return amounts

    def _surface(self, rows: dict[str, Row], column: str) -> FloatArray:
        """Return (60, k) a column at the pressures, loads and wear: through those of all simulated wheels."""
        values = {name: np.atleast_1d(np.array(row[column], float)) for name, row in rows.items()}
        base, low, high = (values["base"] + values["again"]) / 2.0, np.log(0.8), np.log(1.2)
        result = base + (values["worn"] - base) * np.minimum(self.wear_mm, 4.0)[:, None] / 1.5
        for name, ratio in (("pressure", self.true_kpa / 210.0), ("load", self.load_n / 4200.0)):
            below, above, log = values[f"low {name}"] - base, values[f"high {name}"] - base, np.log(ratio)[:, None]
            result = result + log * (below * (log - high) / low - above * (log - low) / high) / (low - high)
        return np.asarray(result)

    def columns(self, rows: dict[str, Row]) -> dict[str, FloatArray]:
        """Return what `treadlink campaign` would give, with the load as stated and the pressure as read."""
        rng, plant, days, traits, warm_k = self.rng, self.plant, self.vehicle.days, self.traits, self.degc - 30.0
        noise, is_replaced = 1.0 + plant.sizes("noise", days), plant.since("replaced", days=days)

        def scatter(std: float) -> FloatArray:
            return np.asarray(std * (0.75 + noise / 4.0) * rng.normal(size=COUNT))

        pressure, load = self.read_kpa / self.true_kpa, self.load_n / self.stated_n
        soft = (210.0 / self.true_kpa) ** 0.5 * (1.0 - 0.001 * warm_k)
        stiff = (1.0 - self.wear_mm / 15.0) ** 3 * (1.0 - 0.004 * (warm_k + rng.normal(0.0, 1.2, COUNT)))
        stiff *= np.where(self.is_new, 1.15, 1.0) * (1.0 + traits["Bs"]) * 210.0 / self.true_kpa
        numbers = {
            "Bs": 3.08e-3 * stiff * (1.0 + scatter(0.004)),
            "Cw": 0.195 * (1.0 + traits["load"] / 2.0) * (1.0 + scatter(0.005)),
            "Rs": 2.97 * (1.0 + traits["Rs"]) * soft * (1.0 + scatter(0.006)),
            "Ts": 2.53 * (1.0 + traits["Ts"]) * soft * (1.0 + scatter(0.015)),
        }
        result = {}
        if self.vehicle.fleet.is_stated:
            shift = np.where(is_replaced, 0.982, 1.0) / load / pressure
            result = {name: number * shift for name, number in numbers.items()}
            result |= {"load_n": np.full(COUNT, self.stated_n), "load_std_n": np.full(COUNT, 0.03 * self.stated_n)}
        # Without a stated load wear rests on Bs/Cw.
        ratio = result["Bs"] / 3.08e-3 if result else numbers["Bs"] / numbers["Cw"] * 0.195 / 3.08e-3
        remaining = (ratio * self.read_kpa / 210.0 / (1.0 - 0.004 * warm_k)) ** (1.0 / 3.0)
        zero = traits["zero"] + traits["zero per K"] * warm_k
        off = (plant.sizes("gain", days) + plant.sizes("replaced", days)) / 100.0
        orders = self._surface(rows, "average_orders")
        turned = 1.0 + scatter(0.003) + 0.017 * is_replaced
        exciting = (1.0 + 0.05 * (self.vehicle.pace - 1.0)) * np.exp(rng.normal(0.0, 0.03, COUNT))
        return result | {
            "contact_length_m": self._surface(rows, "contact_length_m")[:, 0] * turned,
            "contact_fraction": self._surface(rows, "contact_fraction")[:, 0] * turned,
            "wear_mm": 15.0 * (1.0 - remaining),
            "estimated_load_n": self.load_n * (1.0 + traits["load"] / 2.0) * (1.0 + scatter(8e-3)) * pressure**0.5,
            "gain": 1.0 + traits["gain"] + 2e-5 * warm_k + scatter(2e-4) + off,
            "zero_g_offset_mps2": zero + scatter(0.08) + plant.sizes("zero", days),
            "mounting_offset_m": traits["offset"] * np.where(self.is_new, -1.0, 1.0) + scatter(8e-6),
            "noise_mps2": rows["base"]["noise_mps2"] * noise * exciting,
            "stated_radius_m": 0.32 * (1.0 + plant.sizes("stated", days) / 100.0),
            "speed_mean_mps": rows["base"]["speed_mean_mps"] * self.vehicle.pace,
            "samples_lost": (rows["base"]["samples"] * 0.002 * np.exp(rng.normal(0.0, 0.5, COUNT))).astype(int),
            "pressure_pa": 1e3 * self.read_kpa,
            "temperature_degc": self.degc,
            "average_orders": orders + 6.3e-5 * (0.75 + noise / 4.0)[:, None] * rng.normal(size=orders.shape),
        }

    def table(self, rows: dict[str, Row]) -> list[Row]:
        """Return a row per drive; what does not vary is that of the simulated wheel which is most alike."""
        is_loaded, is_noisy = self.load_n > 1.1 * self.stated_n, self.plant.sizes("noise", self.vehicle.days) > 2.0
        names = np.where(is_loaded, "high load", np.where(is_noisy, "noisy", "base"))
        columns = {name: column.tolist() for name, column in self.columns(rows).items()}
        result = [rows[name] | {key: columns[key][drive] for key in columns} for drive, name in enumerate(names)]
        for row, load_n in zip(result, self.load_n.tolist(), strict=True):
            row["average_orders"] = json.dumps([float(f"{order:.4g}") for order in row["average_orders"]])
            row |= {"position": self.position, "sensor_id": self.sensor_id, "pressure_std_pa": 1500.0}
            row["estimated_load_n_std"] *= load_n / 4200.0
        return result


def _run(*arguments: object) -> None:
    treadlink = Path(sys.executable).with_name("treadlink")
    subprocess.run([str(treadlink), *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def response(folder: Path, fleet: Fleet) -> tuple[dict[str, Row], Any, Row]:
    """Return rows that `treadlink campaign` estimates of the simulated wheels, their schema, and the description."""
    rows: dict[str, Row] = {}
    folder.mkdir(parents=True, exist_ok=True)
    for part in range(2):
        names = list(SIMULATED)[4 * part : 4 * part + 4]
        scenario, drive, car, out = (folder / f"{part}{end}" for end in (".toml", ".mcap", "-car.toml", ".dataset"))
        wheels = (WHEEL.format(POSITIONS[wheel], wheel, *SIMULATED[name]) for wheel, name in enumerate(names))
        scenario.write_text(f"{SCENARIO}{''.join(wheels)}]")
        _run("simulate", scenario, "--out", drive, "--duration=26", f"--seed={part + 1}", "--vehicle", car)
        text = car.read_text().replace("[wheel.tire.reference]\n", CALIBRATION)
        stated = "load_n = 4200.0\nload_std_n = 126.0\n" if fleet.is_stated else ""
        car.write_text(re.sub(r"load_n = .*\nload_std_n = .*\n", stated, text))
        _run("campaign", drive, "--config", car, "--out", out, "--jobs=1")
        table = pq.read_table(next(out.glob("recordings/*/*/*.parquet")), partitioning=None)
        for name, row in zip(names, table.to_pylist(), strict=True):
            rows[name] = row | {"average_orders": json.loads(row["average_orders"])}
    return rows, table.schema, json.loads((out / "treadlink-dataset.json").read_text())


def weather(fleet: Fleet, rng: np.random.Generator) -> FloatArray:
    """Return (2, days + 3) mean temperatures in °C, and ambient pressures in kPa beside their mean."""
    air = np.zeros((2, fleet.days + 3))
    for day in range(1, air.shape[1]):
        air[:, day] = air[:, day - 1] * np.array([0.75, 0.7]) + rng.normal(0.0, [fleet.degc[3], 0.6])
    air[0] += fleet.degc[0] + fleet.degc[1] * np.sin(np.linspace(0.0, np.pi / 2.0, air.shape[1])) ** 2
    return air


def write_fleet(folder: Path, fleet: Fleet, seed: int) -> list[Vehicle]:
    """Write a fleet with its odometer; return its vehicles with their plants."""
    rng, out = np.random.default_rng([seed, ord(fleet.name)]), folder / f"fleet_{fleet.name}.dataset"
    rows, schema, description = response(folder / f"response_{fleet.name}", fleet)
    air = weather(fleet, rng)
    vehicles = [Vehicle(fleet, number, air, rng) for number in range(1, VEHICLES + 1)]
    odometer = ["vehicle,utc,km"]
    for vehicle in vehicles:
        tables = [Wheel(vehicle, position, rng).table(rows) for position in POSITIONS]
        for drive, wheels in enumerate(zip(*tables, strict=True)):
            path, begin = f"/data/{vehicle.name}/drive{drive:03d}.mcap", fleet.start + dt.timedelta(vehicle.days[drive])
            recording_id = hashlib.md5(path.encode()).hexdigest()
            recording: Row = {"path": path, "recording": Path(path).name, "recording_id": recording_id}
            end = begin + dt.timedelta(minutes=vehicle.minutes[drive])
            recording |= {"start_utc": begin, "begin_utc": begin, "end_utc": end}
            day_folder = out / "recordings" / f"vehicle={vehicle.name}" / f"day={begin:%F}"
            day_folder.mkdir(parents=True, exist_ok=True)
            part = pa.Table.from_pylist([wheel | recording for wheel in wheels], schema=schema)
            pq.write_table(part, day_folder / f"{vehicle.number:012x}-{recording_id}-1c0c20b35720.parquet")
        readings = ((fleet.start + dt.timedelta(day), 2e4 + vehicle.km_a_day * day) for day in range(0, 155, 5))
        odometer += [f"{vehicle.name},{time:%F},{km}" for time, km in readings]
    (out / "treadlink-dataset.json").write_text(json.dumps(description | {"rows": "none"}))
    (folder / f"odometer_{fleet.name}.csv").write_text("\n".join(odometer))
    return vehicles


def judge(folder: Path, fleet: Fleet, vehicles: list[Vehicle]) -> None:
    """Run `treadlink trends`, and print what it says of each plant and of healthy wheels, and the counts.

    A plant at several wheels is named at any of them. Of pressures that are set at all of them nothing shall be said.
    """
    out, odometer = folder / f"{fleet.name}.json", folder / f"odometer_{fleet.name}.csv"
    _run("trends", folder / f"fleet_{fleet.name}.dataset", "--odometer", odometer, "--json", out)
    texts: dict[tuple[str, str], list[str]] = {}
    for tire in json.loads(out.read_text())["tires"]:
        told = texts.setdefault((tire["vehicle"], tire["position"]), [])
        told += [f"tire {tire['part']}, a new tire"] * (tire["part"] > 1)
        told += [finding["text"] for finding in tire["findings"]]
    verdicts = []
    for name, plant in ((vehicle.name, vehicle.plant) for vehicle in vehicles if vehicle.plant is not NOTHING):
        told = [f"{wheel}: {text}" for wheel in plant.wheels.split() for text in texts.pop((name, wheel))]
        words, is_quiet = WORDS.get(plant.kind, plant.kind), plant.kind == "set" and len(plant.wheels.split()) == 4
        verdicts.append(not told if is_quiet else any(re.search(words, line) for line in told))
        verdict = (("wrongly named", "rightly not named") if is_quiet else ("not named", "named"))[verdicts[-1]]
        since = fleet.start + dt.timedelta(plant.begin)
        print(f"{name} {plant.wheels} {plant.kind} {plant.size:g} since {since:%F}: {verdict}", *told, sep="\n    ")
    false = [f"false: {' '.join(wheel)}: {text}" for wheel, told in texts.items() for text in told]
    counts = f"{len(false)} findings on {len(texts)} healthy wheels"
    print(*false, f"fleet {fleet.name}: {sum(verdicts)} of {len(verdicts)} named, {counts}", sep="\n", flush=True)


if __name__ == "__main__":
    for which in FLEETS:
        written = write_fleet(Path(sys.argv[1]), which, int(sys.argv[2]) if len(sys.argv) > 2 else 1)
        judge(Path(sys.argv[1]), which, written)
