import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.config.vehicle import (
    Axle,
    Mounting,
    Reference,
    Thresholds,
    Tire,
    Vehicle,
    VehicleConfig,
    Wheel,
    load_vehicle,
    parse_vehicle,
)
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.errors import ConfigError
from gateway.forces.belt_laminate import BeltLaminate

EXAMPLE = Path(__file__).with_name("demo_car.toml").read_text()


def faults_of(text: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        parse_vehicle(text, "car.toml")
    assert caught.value.remedy
    return str(caught.value).splitlines()


def test_setups_use_si_overrides_and_axle_weights() -> None:
    config = parse_vehicle(EXAMPLE, "car.toml")
    front_left, front_right, rear_left = config.wheel_setups()
    assert (front_left.position, front_left.hub, front_left.wheel) == ("FL", 0, 0)
    assert front_left.radius_m == pytest.approx(0.32)
    assert front_left.pressure_pa == pytest.approx(2.1e5)
    assert front_left.pressure_std_pa == pytest.approx(2e3)
    assert front_left.load_n == pytest.approx(450 * STANDARD_GRAVITY_MPS2)
    assert front_left.load_std_n == pytest.approx(0.1 * 450 * STANDARD_GRAVITY_MPS2)
    assert front_right.radius_m == pytest.approx(0.30)
    assert front_right.temperature_degc == 35.0
    assert front_right.pressure_pa == pytest.approx(2.1e5)
    assert (rear_left.load_n, rear_left.load_std_n) == (5000.0, 50.0)
    assert config.tire_of(config.wheel[1]).reference == Reference(Bs=1e-3, Cw=0.195)
    assert config.wheel[0].sensor_number == 0xA001
    assert config.wheel[2].mounting.offset_m == pytest.approx(5e-3)
    assert config.wheel[2].mounting.roll_rad == pytest.approx(math.pi / 10)
    assert config.thresholds.speed_max_mps == pytest.approx(50.0)
    assert config.thresholds.frame_loss_max == pytest.approx(0.01)
    assert config.tire.ring_thickness_m == pytest.approx(0.015)
    assert config.name == "Demo car"
    assert config.notices() == ()


def test_axle_error_combines_scale_and_split() -> None:
    axle = Axle(wheels=("A", "B"), weight_kg=1000.0, weight_std_kg=30.0, split_std_percent=4.0)
    assert axle.wheel_load_std_n == pytest.approx(math.hypot(15.0, 20.0) * STANDARD_GRAVITY_MPS2)


def test_a_weight_without_its_error_is_known_no_better_than_any_load() -> None:
    unstated = Axle(wheels=("A", "B"), weight_kg=1000.0)
    assert unstated.wheel_load_std_n == pytest.approx(0.1 * 500.0 * STANDARD_GRAVITY_MPS2)
    uneven = Axle(wheels=("A", "B"), weight_kg=1000.0, split_std_percent=20.0)
    assert uneven.wheel_load_std_n == pytest.approx(0.2 * 500.0 * STANDARD_GRAVITY_MPS2)
    weighed = Axle(wheels=("A", "B"), weight_kg=1000.0, weight_std_kg=0.0)
    assert weighed.wheel_load_std_n == pytest.approx(0.05 * 500.0 * STANDARD_GRAVITY_MPS2)
    lines = {what: wheels for what, _, wheels in parse_vehicle(EXAMPLE, "car.toml").assumed_errors()}
    assert lines["load"] == ("FL", "FR")


def test_every_fault_is_listed_at_once() -> None:
    lines = faults_of(Path(__file__).with_name("every_fault.toml").read_text())
    expected = [
        ('vehicle.colour: "red" found', "known keys: name"),
        ("tire.radius_mm: 0.32 found", "100 to 1200", "if the value is in m, write 320"),
        ("tire.radius_m: 0.32 found", "did you mean 'radius_mm'?"),
        ("tire.pressure_kpa: 2.1 found", "if the value is in bar, write 210"),
        ("tire.reference.Bs: -1 found", "above 0"),
        ("axle[#1].weight_kg: true found", "a number from 20 to 40000"),
        ('wheel[FL].sensor_id: "zz" found', "hexadecimal"),
        ('wheel[#3].hub: "one" found', "a whole number from 0 to 255"),
        ("wheel[#3].wheel: 255 found", "0 to 254"),
        ("wheel[#3].load_n: 4.5 found", "if the value is in kN, write 4500"),
        ("wheel[#2].wheel: hub = 0, wheel = 0 found", "wheel[FL] has the same"),
        ('wheel[#3].position: "FR" found', "wheel[#2] has the same position"),
        ('wheel[#3].sensor_id: "00A1" found', "wheel[#2] has the same sensor"),
        ("wheel[FL].load_n: 5000.0 found", "axle[#1] states its load too"),
        ('axle[#1].wheels: "Fr" found', "did you mean FR?"),
        ('axle[#1].wheels: "FL" found', "axle[#1] lists this wheel too"),
        ("wheel[#2].load_std_n: 5 found", "needs load_n"),
        ("thresholds.pressure_min_kpa: 300 found", "less than pressure_max_kpa = 200"),
    ]
    for parts in expected:
        assert any(line.startswith("car.toml: ") and all(part in line for part in parts) for line in lines), parts
    assert len(lines) == len(expected)


def _wheel(tire: str = "", keys: str = "", wheel_tire: str = "") -> str:
    radius = "" if "radius_mm" in tire else "radius_mm = 320\n"
    head = f'[tire]\n{radius}{tire}\n[[wheel]]\nposition = "FL"\nhub = 0\nwheel = 0\n{keys}\n'
    return f"{head}[wheel.tire]\n{wheel_tire}\n"


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (
            _wheel("radius_mm = 100\nring_thickness_mm = 80"),
            "tire.ring_thickness_mm: 80 found, allowed: up to 30 % of radius_mm = 100",
        ),
        (
            _wheel("ring_thickness_mm = 80", wheel_tire="radius_mm = 100"),
            "wheel[FL].tire.radius_mm: 100 found, allowed: at most 30 % of it is ring_thickness_mm = 80",
        ),
        (
            _wheel("ring_thickness_mm = 1\nwear_mm = 60"),
            "tire.wear_mm: 60 found, allowed: less than ring_thickness_mm = 1, that of the new ring",
        ),
        (
            _wheel("wear_mm = 6", wheel_tire="ring_thickness_mm = 5"),
            "wheel[FL].tire.ring_thickness_mm: 5 found, allowed: that of the new ring, more than wear_mm = 6",
        ),
        (
            _wheel(keys="load_n = 50\nload_std_n = 50_000"),
            "wheel[FL].load_std_n: 50000 found, allowed: up to load_n = 50",
        ),
        (
            _wheel() + '[[axle]]\nwheels = ["FL"]\nweight_kg = 20\nweight_std_kg = 21',
            "axle[#1].weight_std_kg: 21 found, allowed: up to weight_kg = 20",
        ),
        (
            _wheel()
            + '[[vehicle_signals.signal]]\nquantity = "vehicle_speed"\nmessage = "m"\nsignal = "s"\nfactor = 0',
            "vehicle_signals.signal[#1].factor: 0 found, allowed: any number but 0, which loses the value",
        ),
    ],
)
def test_keys_that_contradict_each_other_are_one_fault(text: str, fault: str) -> None:
    assert faults_of(text) == [f"car.toml: {fault}"]


@given(radius=st.integers(100, 1200), thickness=st.integers(1, 80), wear=st.integers(0, 60))
def test_ring_is_accepted_within_its_radius_and_its_wear(radius: int, thickness: int, wear: int) -> None:
    tire = f"radius_mm = {radius}\nring_thickness_mm = {thickness}\nwear_mm = {wear}"
    alone = f'[[wheel]]\nposition = "FL"\nhub = 0\nwheel = 0\n[wheel.tire]\n{tire}'
    for text in (_wheel(tire), alone):
        if thickness > 0.3 * radius or wear >= thickness:
            assert len(faults_of(text)) == (thickness > 0.3 * radius) + (wear >= thickness)
        else:
            assert parse_vehicle(text, "car.toml").wheel_setups()


def test_missing_radius_names_each_wheel() -> None:
    lines = faults_of('[[wheel]]\nposition = "FL"\nhub = 0\nwheel = 0\n')
    assert lines == [
        "car.toml: wheel[FL].tire.radius_mm: missing, the belt radius is required here or as tire.radius_mm"
    ]


def test_fault_in_the_only_wheel_is_reported_once() -> None:
    (line,) = faults_of('[tire]\nradius_mm = 320\n[[wheel]]\nposition = "FL"\nhub = 0\nwheel = 0\nload_n = 4\n')
    assert line.startswith("car.toml: wheel[FL].load_n: 4 found")


def test_missing_wheel_is_a_fault() -> None:
    assert any("wheel: missing, required: a list of tables" in line for line in faults_of("[tire]\nradius_mm = 320\n"))


@pytest.mark.parametrize(
    "text", ["tire = 5", "wheel = 'x'", "wheel = [1, 2]", "axle = {}", "[[wheel]]\ntire = 1", "thresholds = []"]
)
def test_wrong_shapes_are_faults_not_crashes(text: str) -> None:
    assert faults_of(text)


def test_nan_and_infinity_are_rejected() -> None:
    lines = faults_of('[tire]\nradius_mm = nan\npressure_kpa = inf\n[[wheel]]\nposition = "A"\nhub = 0\nwheel = 0\n')
    assert [line.split(" ")[1] for line in lines] == ["tire.radius_mm:", "tire.pressure_kpa:"]


def test_syntax_error_names_the_line() -> None:
    with pytest.raises(ConfigError, match=r"car\.toml: not valid TOML: .*line 3"):
        parse_vehicle('[tire]\nradius_mm = 320\nsize = "', "car.toml")


def test_unreadable_files_are_reported(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file"):
        load_vehicle(tmp_path / "none.toml")
    latin = tmp_path / "latin.toml"
    latin.write_bytes(b'[vehicle]\nname = "\xfcber"\n')
    with pytest.raises(ConfigError, match="byte 18 is not UTF-8"):
        load_vehicle(latin)


def test_load_vehicle_reads_a_file(tmp_path: Path) -> None:
    path = tmp_path / "car.toml"
    path.write_text(EXAMPLE, encoding="utf-8")
    assert load_vehicle(path) == parse_vehicle(EXAMPLE, "elsewhere")


def test_configuration_made_in_python_is_checked() -> None:
    wheel = Wheel(position="FL", hub=0, wheel=0)
    with pytest.raises(ValueError, match="belt radius is required"):
        VehicleConfig(wheel=(wheel,))
    with pytest.raises(ValueError, match="has the same position"):
        VehicleConfig(tire=Tire(radius_mm=300.0), wheel=(wheel, wheel))


def numbers(low: float, high: float) -> st.SearchStrategy[float | None]:
    return st.none() | st.floats(low, high)


REFERENCES = st.builds(Reference, Bs=numbers(1e-6, 10), Ts=numbers(1e-300, 1000))
TIRES = st.builds(
    Tire,
    size=st.none() | st.text(),
    radius_mm=numbers(100, 1200),
    pressure_kpa=numbers(10, 1500),
    temperature_degc=numbers(-60, 250),
    reference=REFERENCES,
)


@st.composite
def vehicles(draw: st.DrawFn) -> VehicleConfig:
    positions = draw(
        st.lists(st.from_regex(r"\A[A-Za-z0-9][A-Za-z0-9_.-]{0,23}\Z"), min_size=1, max_size=4, unique=True)
    )
    on_axle = draw(st.lists(st.sampled_from(positions), unique=True))
    wheels = []
    for number, position in enumerate(positions):
        load_n = None if position in on_axle else draw(numbers(50, 1e5))
        wheels.append(
            Wheel(
                position=position,
                hub=draw(st.integers(0, 255)),
                wheel=number,
                sensor_id=draw(st.none() | st.just(f"{number + 0xABC:x}")),
                load_n=load_n,
                load_std_n=None if load_n is None else draw(numbers(0, min(load_n, 5e4))),
                tire=draw(TIRES),
                mounting=Mounting(offset_mm=draw(st.floats(-20, 80))),
            )
        )
    tire = draw(TIRES).overridden_by(Tire(radius_mm=draw(st.floats(100, 1200))))
    axle = (Axle(wheels=tuple(on_axle), weight_kg=draw(st.floats(20, 4e4))),) if on_axle else ()
    return VehicleConfig(
        vehicle=Vehicle(name=draw(st.text()), assumed=tuple(draw(st.lists(st.text(), max_size=2)))),
        tire=tire,
        axle=axle,
        wheel=tuple(wheels),
        thresholds=Thresholds(battery_min_percent=draw(numbers(0, 100))),
    )


@given(vehicles())
def test_toml_round_trip(config: VehicleConfig) -> None:
    assert parse_vehicle(config.to_toml(), "round") == config


LAMINATE = """
[tire.laminate]
rubber_mpa = 6
[[tire.laminate.ply]]
angle_deg = -24
thickness_mm = 1.2
cord_gpa = 200
cord_share_percent = 22
[[tire.laminate.ply]]
angle_deg = 24
angle_std_deg = 0.5
thickness_mm = 1.2
cord_gpa = 200
cord_std_gpa = 5
cord_share_percent = 22
"""
WHEEL = "[tire]\nradius_mm = 320\n[[wheel]]\nposition = 'FL'\nhub = 0\nwheel = 0\n"


def test_laminate_has_tolerances_in_si() -> None:
    config = parse_vehicle(WHEEL + LAMINATE, "car.toml")
    assert parse_vehicle(config.to_toml(), "again") == config
    belt = config.wheel_setups()[0].tire.of(BeltLaminate)
    assert belt is not None
    assert (belt.rubber_pa, belt.rubber_std_pa) == (6e6, pytest.approx(1.2e6))
    inner, outer = belt.plies
    assert inner.angle_rad == pytest.approx(math.radians(-24.0))
    assert (inner.cord_std_pa, outer.cord_std_pa) == (pytest.approx(20e9), pytest.approx(5e9))
    assert (inner.angle_std_rad, outer.angle_std_rad) == pytest.approx((math.radians(1.0), math.radians(0.5)))
    assert inner.cord_share == pytest.approx(0.22)


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("cord_gpa = 200\n", "cord_gpa = 200000\n", "tire.laminate.ply[#1].cord_gpa: 200000 found, allowed: a number"),
        ("cord_gpa = 200\n", "cord_gpa = 200000\n", "if the value is in MPa, write 200"),
        ("rubber_mpa = 6", "rubber_mpa = 6000000", "if the value is in Pa, write 6"),
        ("rubber_mpa = 6", "rubber_mpa = 400\nply_count = 2", "tire.laminate.ply_count: 2 found, unknown key"),
        ("angle_deg = -24\n", "", "tire.laminate.ply[#1].angle_deg: missing, required: a number from -90 to 90"),
        ("cord_share_percent = 22", "cord_share_percent = 0", "at least two plies need cords"),
    ],
)
def test_faults_of_a_laminate_name_key_and_allowed_values(old: str, new: str, fault: str) -> None:
    text = WHEEL + LAMINATE.replace(old, new, 1)
    assert any(fault in line for line in faults_of(text))


def test_cord_softer_than_rubber_is_a_fault() -> None:
    soft = LAMINATE.replace("rubber_mpa = 6", "rubber_mpa = 400").replace("gpa = 200", "gpa = 0.2", 1)
    fault = "tire.laminate.ply[#1].cord_gpa: 0.2 found, allowed: at least tire.laminate.rubber_mpa"
    assert any(fault in line for line in faults_of(WHEEL + soft))


def test_inverted_slip_range_is_a_fault() -> None:
    table = "[tire.slip_calibration]\nbelt_share = 0.2\nslip_min_deg = 1\nslip_max_deg = -1\n"
    assert any("tire.slip_calibration.slip_min_deg" in line for line in faults_of(WHEEL + table))
