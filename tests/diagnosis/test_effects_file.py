"""Effects files are written, read back, and rejected when invalid."""

import hashlib
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.config.vehicle import parse_vehicle
from gateway.core.errors import ConfigError
from gateway.core.estimates.wheel_setup import CorrectedEffect, CorrectionTable, EffectParameter
from gateway.core.revolutions.reasons import RevolutionCode
from gateway.core.session.corrections import check_effects, effects_doubts, effects_notices
from gateway.diagnosis.effects_file import effects_text, load_effects

RNG = np.random.default_rng(1)
TABLE = CorrectionTable(
    position="FL",
    omega_radps=np.array([40.0, 60.0]),
    orders_mps2=RNG.standard_normal((2, 3, 12)) + 1j * RNG.standard_normal((2, 3, 12)),
    effects=(
        CorrectedEffect("imbalance", (EffectParameter("cosine", 1e-4, 2e-6, "m"),)),
        CorrectedEffect("tread pitch", (EffectParameter("order", 70.0, math.nan),)),
    ),
    radius_m=0.32,
    omega_range_radps=(39.0, 61.0),
    load_range_n=(3900.0, 4100.0),
    pressure_range_pa=(2.1e5, 2.3e5),
    sensor_offset_m=2e-3,
    sensor_id=0xB001,
    sources=("a.mcap", "b.mcap"),
    vehicle="rig",
    tire="205/55 R16",
)
VEHICLE = """
[tire]
radius_mm = 320
[[wheel]]
position = "FL"
hub = 0
wheel = 0
[wheel.mounting]
offset_mm = 2
"""


def written(tmp_path, text):
    path = tmp_path / "fl.effects.json"
    path.write_text(text)
    return path


def test_written_values_read_back(tmp_path):
    again = load_effects(written(tmp_path, effects_text(TABLE)))
    np.testing.assert_allclose(again.orders_mps2, TABLE.orders_mps2, rtol=1e-6)
    np.testing.assert_array_equal(again.omega_radps, TABLE.omega_radps)
    assert again.effects[0] == TABLE.effects[0]
    assert math.isnan(again.effects[1].parameters[0].std)
    for name in ("position", "omega_range_radps", "load_range_n", "sensor_id", "sources", "vehicle", "tire"):
        assert getattr(again, name) == getattr(TABLE, name)
    for name in ("radius_m", "sensor_offset_m"):
        assert getattr(again, name) == pytest.approx(getattr(TABLE, name))
    assert again.pressure_range_pa == pytest.approx(TABLE.pressure_range_pa)


def test_unknown_values_stay_unknown(tmp_path):
    bare = replace(TABLE, load_range_n=None, pressure_range_pa=None, sensor_id=None, sources=())
    again = load_effects(written(tmp_path, effects_text(bare)))
    assert (again.load_range_n, again.pressure_range_pa, again.sensor_id) == (None, None, None)


def changed(change):
    """Return a file with a change, and the digest of what it then states."""
    document = json.loads(effects_text(TABLE))
    change(document)
    document.pop("digest")
    stated = json.dumps(document, sort_keys=True, separators=(",", ":"))
    return json.dumps({**document, "digest": hashlib.sha256(stated.encode()).hexdigest()})


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d["effects"][0]["parameters"][0].update(value=2e-4),
        lambda d: d["effects"].pop(0),
        lambda d: d["table"].update(cosine_mps2=[[[0.0] * 12] * 3] * 2, sine_mps2=[[[0.0] * 12] * 3] * 2),
        lambda d: d["table"]["cosine_mps2"][1][2].__setitem__(3, 7.0),
        lambda d: d["valid"].update(load_n=None),
        lambda d: d.update(radius_mm=321.0),
        lambda d: d.update(digest="0" * 64),
    ],
)
def test_edited_file_is_refused(tmp_path, change):
    document = json.loads(effects_text(TABLE))
    change(document)
    with pytest.raises(ConfigError, match=r"fl.effects.json was edited after diagnose wrote it") as caught:
        load_effects(written(tmp_path, json.dumps(document)))
    assert "again" in caught.value.remedy


def test_rearranged_file_is_read(tmp_path):
    document = json.loads(effects_text(TABLE))
    rearranged = json.dumps(dict(reversed(document.items())), indent=1)
    assert load_effects(written(tmp_path, rearranged)).effects[0] == TABLE.effects[0]


@pytest.mark.parametrize("version", [1, 2])
def test_file_without_digest_has_to_be_made_again(tmp_path, version):
    text = changed(lambda d: d.update(treadlink_effects=version))
    with pytest.raises(ConfigError, match=f"version {version}, which has no digest") as caught:
        load_effects(written(tmp_path, text))
    assert "--save-effects" in caught.value.remedy


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "not valid JSON"),
        ("[" * 100_000, "not valid JSON"),
        ("[]", "not an effects file"),
        ('{"held_out": {}}', "treadlink_effects"),
        (changed(lambda d: d.update(treadlink_effects=4)), "version 4"),
        (changed(lambda d: d["effects"][0]["parameters"][0].update(value=math.nan)), "value: input should be a finite"),
        (changed(lambda d: d.update(colour="red")), "colour"),
        (changed(lambda d: d.pop("wheel")), "wheel"),
        (changed(lambda d: d.update(radius_mm="320")), "radius_mm"),
        (changed(lambda d: d.update(effects=[])), "effects"),
        (changed(lambda d: d["table"]["omega_radps"].reverse()), "ascend"),
        (changed(lambda d: d["table"]["omega_radps"].pop()), "table"),
        (changed(lambda d: d["table"]["sine_mps2"].pop()), "sine_mps2"),
        (changed(lambda d: d["table"]["cosine_mps2"][0][1].pop()), "inhomogeneous"),
        (changed(lambda d: d["valid"].update(omega_radps=[60.0, 40.0])), "omega_radps"),
        (changed(lambda d: d["table"]["omega_radps"].__setitem__(0, math.nan)), "omega_radps"),
        (changed(lambda d: d["effects"][0]["parameters"][0].update(std=-1.0)), "std"),
        (effects_text(TABLE).replace('"digest"', '"sum"'), "digest: field required"),
    ],
)
def test_invalid_effects_file_is_rejected(tmp_path, text, says):
    with pytest.raises(ConfigError, match=says) as caught:
        load_effects(written(tmp_path, text))
    assert "fl.effects.json" in str(caught.value)
    assert caught.value.remedy


def test_missing_file_is_reported(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        load_effects(tmp_path / "absent.json")


@given(st.binary(max_size=200))
def test_noise_is_rejected(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("noise") / "x.json"
    path.write_bytes(data)
    with pytest.raises(ConfigError):
        load_effects(path)


class TestBelonging:
    def test_effects_fit_their_own_vehicle(self):
        check_effects((TABLE,), parse_vehicle(VEHICLE, "test"))

    @pytest.mark.parametrize(
        ("table", "says"),
        [
            (replace(TABLE, position="RR"), "RR"),
            (replace(TABLE, sensor_offset_m=0.0), "neutral layer"),
            (replace(TABLE, radius_m=0.3), "belt radius"),
        ],
    )
    def test_effects_of_another_vehicle_are_rejected(self, table, says):
        with pytest.raises(ConfigError, match=says) as caught:
            check_effects((table,), parse_vehicle(VEHICLE, "test"))
        assert caught.value.remedy

    def test_effects_without_configuration_are_rejected(self):
        with pytest.raises(ConfigError, match="no configuration"):
            check_effects((TABLE,), None)

    def test_two_files_of_one_wheel_are_rejected(self):
        with pytest.raises(ConfigError, match="two effects files"):
            check_effects((TABLE, TABLE), parse_vehicle(VEHICLE, "test"))

    def test_effects_of_another_sensor_are_rejected(self):
        text = VEHICLE.replace('position = "FL"', 'position = "FL"\nsensor_id = "0000beef"')
        with pytest.raises(ConfigError, match="0000beef"):
            check_effects((TABLE,), parse_vehicle(text, "test"))

    def test_effects_of_another_car_are_noted(self):
        """Name and tire do not make a subtraction wrong, so they are noted and not refused."""
        assert effects_doubts((TABLE,), parse_vehicle(VEHICLE, "test")) == []
        other = parse_vehicle('[vehicle]\nname = "car"\n' + VEHICLE.replace("320", '320\nsize = "195/65 R15"'), "test")
        check_effects((TABLE,), other)
        doubts = effects_doubts((TABLE,), other)
        assert [doubt.reason.code for doubt in doubts] == [
            RevolutionCode.EFFECTS_OF_OTHER,
            RevolutionCode.EFFECTS_OF_OTHER,
        ]
        assert {doubt.subject for doubt in doubts} == {"FL"}
        assert effects_notices((TABLE,), other)[1:] == doubts
