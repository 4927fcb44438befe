"""Modal and weak form on a measured tire, which determines few numbers."""

import json
import math
from pathlib import Path

import pytest
from click.testing import CliRunner

from gateway.cli.estimate import estimate
from gateway.importing.import_map import load_map
from gateway.importing.importer import import_file

ROOT = Path(__file__).parents[2]
MAP = ROOT / "examples" / "innerliner_drum_80kmh.map.toml"
MEASURED = ROOT / ".." / "shared" / "measured" / "innerliner_drum_80kmh.csv"


def test_measured_tire_leaves_bending_and_tangential_undetermined(tmp_path: Path) -> None:
    if not MEASURED.exists():
        pytest.skip("the measured recording is not part of the repository; it is expected in ../shared/measured")
    recording, table = tmp_path / "drum.mcap", tmp_path / "drum.jsonl"
    import_file(MEASURED, load_map(MAP), recording)
    options = ["--estimator", "weak-form", "--estimator", "ring-modal", "--json", str(table)]
    result = CliRunner().invoke(estimate, [str(recording), *options])
    assert result.exit_code == 0, result.output
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
