"""DBC files as tools write them: their encoding, units, named values, ranges, and messages that are wrong."""

import math
import threading
from pathlib import Path

import cantools.database
import pytest

from gateway.core.clock import ManualClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.errors import ConfigError
from gateway.core.links.bus_frames import BusFrame, pack
from gateway.core.links.source import BusFrames, open_source
from gateway.vehicle.bus_decoding import BusDecoder
from gateway.vehicle.dbc_file import only_messages, read_dbc
from gateway.vehicle.signal_decoding import SignalDecoder, open_decoder
from gateway.vehicle.vehicle_signals import Quantity, SignalSetup

HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: ECU\n'
STEERING = SignalSetup(Quantity.STEERING_ANGLE, "Lenkung", "Winkel")
SPEED = SignalSetup(Quantity.VEHICLE_SPEED, "S", "V")


def decoded(dbc: str, setup: SignalSetup, data: bytes, can_id: int) -> float | None:
    """Return the value of the one signal of a frame, None without one."""
    decoder = SignalDecoder(BusDecoder([setup], 1.0, HEAD + dbc, "car.dbc"))
    values = decoder.take(BusFrames("can:x", 0, pack([BusFrame(0, can_id, False, data)], 0)))
    return next(iter(values.values()), None)


def speed(raw: int, *, setup: SignalSetup = SPEED, table: str = "", limits: str = "[0|300]") -> float | None:
    dbc = f'BO_ 516 S: 8 ECU\n SG_ V : 0|16@1+ (0.01,0) {limits} "km/h" ECU\n{table}'
    return decoded(dbc, setup, raw.to_bytes(2, "little") + bytes(6), 516)


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8", "utf-8-sig"])
@pytest.mark.parametrize("place", ["source", "vehicle"])
def test_text_has_the_encoding_of_its_writer(encoding: str, place: str, tmp_path: Path) -> None:
    text = HEAD + 'BO_ 256 Lenkung: 8 ECU\n SG_ Winkel : 0|16@1- (0.1,0) [-800|800] "°" ECU\nCM_ "Prüfstand – 1";\n'
    path, log = tmp_path / "car.dbc", tmp_path / "drive.log"
    path.write_bytes(text.replace("\n", "\r\n").encode(encoding))
    log.write_text("(1700000000.000000) can0 100#7D00000000000000\n")
    mapping = """
[vehicle_signals]
dbc = "car.dbc"
[[vehicle_signals.signal]]
quantity = "steering_angle"
message = "Lenkung"
signal = "Winkel"
"""
    toml = open_source("sim:lab?speed=max&duration=1&seed=2", ManualClock()).vehicle_toml
    vehicle = parse_vehicle((toml or "") + mapping, "car.toml")
    stated = [open_source(f"can:{log}?dbc={path}", ManualClock()).dbc_text] if place == "source" else []
    decoder = open_decoder(vehicle, tmp_path / "car.toml", stated, [])
    assert decoder is not None
    assert decoder.dbc_text == text
    items = list(open_source(f"can:{log}?speed=max", ManualClock()).items(threading.Event()))
    assert decoder.take(items[0]) == pytest.approx({"steering_angle_rad": math.radians(12.5)})
    assert read_dbc(path) == text


@pytest.mark.parametrize("unit", ["Km/h", "KM/H", "KPH", " km/h"])
def test_units_are_read_in_any_case(unit: str) -> None:
    dbc = f'BO_ 516 S: 8 ECU\n SG_ V : 0|16@1+ (0.01,0) [0|300] "{unit}" ECU\n'
    assert decoded(dbc, SPEED, b"\x10\x27" + bytes(6), 516) == pytest.approx(100.0 / 3.6)
    stated = SignalSetup(Quantity.VEHICLE_SPEED, "S", "V", unit=unit)
    assert decoded(dbc.replace(unit, ""), stated, b"\x10\x27" + bytes(6), 516) == pytest.approx(100.0 / 3.6)


@pytest.mark.parametrize("table", ['VAL_ 516 V 9999 "SNA" ;', 'VAL_ 516 V 9999 "Sensor_startup" ;'])
def test_values_with_a_name_are_no_measurements(table: str) -> None:
    assert speed(9999, table=table) is None
    assert speed(9998, table=table) == pytest.approx(99.98 / 3.6)


def test_names_that_repeat_the_value_leave_it() -> None:
    assert speed(0, table='VAL_ 516 V 0 "0 km/h" 65535 "SNA" ;') == 0.0


def test_states_of_a_switch_are_measurements_but_not_its_faults() -> None:
    dbc = """BO_ 300 B: 8 ECU
 SG_ Pedal : 0|2@1+ (1,0) [0|3] "" ECU
VAL_ 300 Pedal 0 "released" 1 "pressed" 2 "Signal_not_available" 3 "Error" ;
"""
    setup = SignalSetup(Quantity.BRAKE, "B", "Pedal")
    assert [decoded(dbc, setup, bytes([raw]) + bytes(7), 300) for raw in range(4)] == [0.0, 1.0, None, None]


def test_values_beyond_the_stated_range_are_no_measurements() -> None:
    assert speed(30000) == pytest.approx(300.0 / 3.6)
    assert speed(30002) is None
    assert speed(65535) is None
    assert speed(65535, limits="[0|655.35]") == pytest.approx(655.35 / 3.6)
    assert speed(65535, limits="[0|0]") == pytest.approx(655.35 / 3.6), "no range is stated"


def test_sign_is_applied_after_the_range_and_a_scale_that_the_file_lacks_suspends_it() -> None:
    turned = SignalSetup(Quantity.VEHICLE_SPEED, "S", "V", factor=-1.0)
    assert speed(30000, setup=turned) == pytest.approx(-300.0 / 3.6)
    assert speed(65535, setup=turned) is None
    scaled = SignalSetup(Quantity.VEHICLE_SPEED, "S", "V", factor=0.1)
    assert speed(65535, setup=scaled) == pytest.approx(65.535 / 3.6)


WRONG = [
    'BO_ 70000 Wide: 8 ECU\n SG_ A : 0|8@1+ (1,0) [0|0] "" ECU\n',
    'BO_ 17 Twice: 8 ECU\n SG_ A : 0|8@1+ (,0) [0|0] "" ECU\n',
    'BA_ "Unknown" BO_ 516 7;\n',
    'CM_ BO_ 516 "first line\nSG_ second line";\nFOO_ 1 2 3;\n',
]


@pytest.mark.parametrize("wrong", WRONG)
def test_messages_that_nobody_maps_need_not_be_valid(wrong: str) -> None:
    mapped = 'BO_ 516 S: 8 ECU\n SG_ V : 0|16@1+ (0.01,0) [0|300] "km/h" ECU\n\n'
    table = 'VAL_ 516 V\n 65535 "SNA"\n 9999 "Fault" ;\nVAL_ 17 A 1 "x" ;\n'
    for dbc in (wrong + mapped + table, mapped + wrong + table):
        assert decoded(dbc, SPEED, b"\x10\x27" + bytes(6), 516) == pytest.approx(100.0 / 3.6)
        assert decoded(dbc, SPEED, b"\x0f\x27" + bytes(6), 516) is None
    both = [SPEED, SignalSetup(Quantity.VEHICLE_SPEED, "X", "V", wheel="FL")]
    with pytest.raises(ConfigError, match="no message 'X'; it has .*S"):
        BusDecoder(both, 1.0, HEAD + wrong + mapped + table, "car.dbc")


def test_mapped_message_that_is_not_valid_is_an_error() -> None:
    dbc = HEAD + 'BO_ 70000 S: 8 ECU\n SG_ V : 0|16@1+ (0.01,0) [0|300] "km/h" ECU\n'
    with pytest.raises(ConfigError, match="cannot be read as a DBC file"):
        BusDecoder([SPEED], 1.0, dbc, "car.dbc")


def test_long_names_of_messages_are_those_of_the_mapping() -> None:
    dbc = """BO_ 516 Vehicle_speed_of_the_brake_con_1: 8 ECU
 SG_ V : 0|16@1+ (0.01,0) [0|300] "km/h" ECU
BO_ 70000 Wide: 8 ECU
 SG_ A : 0|8@1+ (1,0) [0|0] "" ECU
BA_DEF_ BO_  "SystemMessageLongSymbol" STRING ;
BA_DEF_DEF_  "SystemMessageLongSymbol" "";
BA_ "SystemMessageLongSymbol" BO_ 516 "Vehicle_speed_of_the_brake_control_unit";
"""
    setup = SignalSetup(Quantity.VEHICLE_SPEED, "Vehicle_speed_of_the_brake_control_unit", "V")
    assert decoded(dbc, setup, b"\x10\x27" + bytes(6), 516) == pytest.approx(100.0 / 3.6)
    assert "Wide" not in only_messages(HEAD + dbc, [setup.message])


def test_of_a_file_with_very_many_messages_the_mapped_ones_are_parsed(monkeypatch: pytest.MonkeyPatch) -> None:
    others = "".join(f'BO_ {k} M{k}: 8 ECU\n SG_ A : 0|8@1+ (1,0) [0|0] "" ECU\n\n' for k in range(600, 10_600))
    parsed: list[str] = []
    parse = cantools.database.load_string
    monkeypatch.setattr(cantools.database, "load_string", lambda text, **kw: parsed.append(text) or parse(text, **kw))
    mapped = 'BO_ 516 S: 8 ECU\n SG_ V : 0|16@1+ (0.01,0) [0|300] "km/h" ECU\n'
    assert decoded(others + mapped, SPEED, b"\x10\x27" + bytes(6), 516) == pytest.approx(100.0 / 3.6)
    assert max(map(len, parsed)) < 300
