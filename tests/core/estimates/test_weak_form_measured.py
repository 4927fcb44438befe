"""Modal and weak form, and the lateral axis, on a measured tire: five revolutions on a drum determine few numbers."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from firmware_protocol.messages import Coupling
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Status
from gateway.forces.lateral_shape import lateral_record, slopes
from gateway.importing.import_map import load_map
from gateway.importing.importer import import_file
from tests.testkit.commands import run
from tools.generators.lateral_signals import RADIUS_M, Sensor, through_pipeline

ROOT = Path(__file__).parents[3]
MAP = ROOT / "examples" / "innerliner_drum_80kmh.map.toml"
MEASURED = ROOT / ".." / "shared" / "measured" / "innerliner_drum_80kmh.csv"


def test_measured_tire_leaves_bending_and_tangential_undetermined(tmp_path: Path) -> None:
    if not MEASURED.exists():
        pytest.skip("the measured recording is not part of the repository; it is expected in ../shared/measured")
    recording, table = tmp_path / "drum.mcap", tmp_path / "drum.jsonl"
    import_file(MEASURED, load_map(MAP), recording)
    options = ["--estimator", "weak-form", "--estimator", "ring-modal", "--json", str(table)]
    run("estimate", recording, *options)
    last = json.loads(table.read_text(encoding="utf-8").splitlines()[-1])
    # Without a load there are only ratios.
    assert last["Cw_status"] == "invalid"
    assert last["ring-modal:Cw_status"] == "invalid"
    # Because of waves that are not the belt's shape, Rs/Cw is known to about a half, Ts and Bs not at all.
    assert 5.0 < last["Rs/Cw"] < 16.0
    assert 0.2 < last["Rs/Cw_std"] / last["Rs/Cw"] < 0.9
    for name in ("Bs/Cw", "Ts/Cw"):
        assert last[f"{name}_status"] != "valid"
        assert "not determined" in last[f"{name}_reason"]
        if last[name] is not None:
            assert last[f"{name}_std"] > last[name] / 3.0
    assert last["ring-modal:Ts/Cw"] is None or math.isfinite(last["ring-modal:Ts/Cw_std"])


RECORDING = Path(__file__).parents[3] / ".." / "shared" / "measured" / "innerliner_drum_80kmh.csv"


@pytest.mark.skipif(not RECORDING.exists(), reason="the measured recording is not at hand")
def test_measured_deformation_repeats_but_roll_tilt_is_unknown() -> None:
    columns = np.genfromtxt(RECORDING, delimiter=",", names=True)
    values = np.stack([columns[axis] for axis in ("x_g", "y_g", "z_g")], axis=1) * STANDARD_GRAVITY_MPS2
    sensor = Sensor(rate_hz=25600.0)
    results = through_pipeline(values, sensor, ["ply-steer"], coupling=Coupling.AC)
    good = [r.revolution for r in results if not r.revolution.faults]
    assert len(good) >= 4
    angles = np.degrees(
        [slopes(lateral_record(r, 0.0), (r.leading_edge_rad, r.trailing_edge_rad), RADIUS_M).values_rad for r in good]
    )
    assert np.all(angles.std(axis=0, ddof=1) < 0.05)
    assert np.all((angles > 0.1) & (angles < 0.4))
    last = {e.name: e for e in results[-1].estimates}
    assert last["ply_steer_first_half_rad"].status is Status.PROVISIONAL
    assert last["sensor_roll_rad"].status is Status.INVALID
    # The tilt is not known; one degree of it changes the slope by a third.
    assert np.degrees(last["ply_steer_first_half_rad"].std) > 0.05
