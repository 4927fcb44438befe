import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from firmware_protocol.messages import Coupling
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.importing.commands.import_measurement import import_
from gateway.importing.import_map import load_map
from gateway.importing.importer import import_file
from tests.importing.measurements import Decoded
from tests.testkit.commands import run

ROOT = Path(__file__).parents[2]
MAP = ROOT / "examples" / "innerliner_drum_80kmh.map.toml"
MEASURED = ROOT / ".." / "shared" / "measured" / "innerliner_drum_80kmh.csv"


def test_committed_map_is_valid() -> None:
    import_map = load_map(MAP)
    assert import_map.columns() == ("x_g", "y_g", "z_g")
    assert any("20000 Hz" in text for text in import_map.assumed)
    (setup,) = import_map.vehicle().wheel_setups()
    assert (setup.load_n, setup.pressure_pa) == (None, None)


def test_measured_recording_is_imported(tmp_path: Path) -> None:
    if not MEASURED.exists():
        pytest.skip("the measured recording is not part of the repository; it is looked for in ../shared/measured")
    out = tmp_path / "drum.mcap"
    result = CliRunner().invoke(import_, [str(MEASURED), "--map", str(MAP), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "13000 samples, 0.507812 s at 25600 Hz" in result.output
    assert "assumed: rate 25600 Hz" in result.output
    decoded = Decoded(out)
    assert decoded.hello.coupling is Coupling.AC
    assert decoded.counters.crc_errors == 0
    data = np.loadtxt(MEASURED, delimiter=",", skiprows=1)[:, 1:] * [-1.0, 1.0, 1.0] * STANDARD_GRAVITY_MPS2
    error = np.abs(decoded.samples_mps2 - data).max(axis=0)
    assert (error <= 0.5 * np.array(decoded.hello.scale_mps2) * (1 + 1e-9)).all()
    assert decoded.vehicle_toml is not None
    assert parse_vehicle(decoded.vehicle_toml, "recording").wheel_setups()[0].position == "drum"


def test_circumferential_sign_fits_the_sensor_position() -> None:
    """A sensor e below the neutral layer reads -(e/R) ds/dtheta along the rotation; the map must orient x so."""
    if not MEASURED.exists():
        pytest.skip("the measured recording is not part of the repository; it is looked for in ../shared/measured")
    x, _, z = np.loadtxt(MEASURED, delimiter=",", skiprows=1)[:, 1:].T
    axis = load_map(MAP).axis.circumferential
    assert axis is not None
    smooth = np.hanning(41) / np.hanning(41).sum()
    slope = np.gradient(np.convolve(z, smooth, "same"))
    along = axis.sign * np.convolve(x, smooth, "same")
    assert np.corrcoef(along[50:-50], slope[50:-50])[0, 1] < -0.5


def test_measured_recording_gives_revolutions(tmp_path: Path) -> None:
    if not MEASURED.exists():
        pytest.skip("the measured recording is not part of the repository; it is looked for in ../shared/measured")
    recording, table = tmp_path / "drum.mcap", tmp_path / "drum.jsonl"
    import_file(MEASURED, load_map(MAP), recording)
    run("estimate", recording, "--json", table)
    rows = [json.loads(line) for line in table.read_text(encoding="utf-8").splitlines()]
    # 13,000 samples at about 2268 a revolution hold six contacts, so five revolutions from contact to contact.
    assert len(rows) == 5
    assert all(row["position"] == "drum" and row["faults"] == "" and row["ac_coupled"] for row in rows)
    for row in rows:
        assert (row["device_end_s"] - row["device_start_s"]) * 25600 == pytest.approx(2268, rel=0.01)
        assert row["speed_mps"] * 3.6 == pytest.approx(76.6, abs=0.5)
        # Half the plateau is crossed 20.9 degrees apart; the edge itself lies outside that.
        contact_deg = math.degrees(row["trailing_edge_rad"] - row["leading_edge_rad"])
        assert 20.9 <= contact_deg <= 27.0
        assert 0.15 < row["trailing_edge_rad"] < 0.25
        assert -0.25 < row["leading_edge_rad"] < -0.15
        for name in ("Bs", "Cw"):
            assert (row[name], row[f"{name}_status"]) == (None, "invalid")
            assert "load" in row[f"{name}_reason"]
