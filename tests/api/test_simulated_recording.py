import numpy as np
import pytest

import gateway

ONE_WHEEL = {"scenario": {"seed": 5}, "wheel": [{"position": "RR", "wheel": 0, "load_n": 4000, "pressure_kpa": 230}]}


def test_simulation_in_memory_equals_the_file(tmp_path):
    held = gateway.simulate(ONE_WHEEL, duration_s=2.0)
    filed = gateway.simulate(ONE_WHEEL, duration_s=2.0, out=tmp_path / "rr.mcap")
    assert filed.path == tmp_path / "rr.mcap"
    for recording in (held, filed):
        assert recording.wheels == ("RR",)
        assert recording.info.finished
        assert recording.info.sources == ("sim:scenario?seed=5",)
    np.testing.assert_array_equal(held["RR"].samples().axes_mps2, filed["RR"].samples().axes_mps2)
    assert len(held["RR"].samples()) == len(held["RR"].samples())  # read twice


def test_truth_belongs_to_the_simulated_wheel():
    recording = gateway.simulate(ONE_WHEEL, duration_s=2.0)
    assert recording.truth["RR"].plan.load_n.at(1.0) == 4000
    assert recording["RR"].revolutions().load_n == pytest.approx(4000)
    assert recording["RR"].environment().pressure_pa == pytest.approx(230e3, rel=0.01)
    assert recording.vehicle.wheel[0].position == "RR"


def test_seed_duration_and_faults_are_those_of_the_command():
    plain = gateway.simulate("lab", duration_s=2.0, seed=9)
    other = gateway.simulate("lab", duration_s=2.0, seed=10)
    faulty = gateway.simulate("lab", duration_s=2.0, seed=9, faults=["drop:rate=0.05"])
    assert plain.info.duration_s == pytest.approx(2.0, abs=0.05)
    assert (plain["W1"].samples().radial_mps2 != other["W1"].samples().radial_mps2).any()
    assert plain.info.frames_lost == 0
    assert faulty.info.frames_lost > 0


@pytest.mark.parametrize(
    ("scenario", "options", "message"),
    [
        ("lob", {}, "no scenario 'lob'"),
        ({"wheel": [{"position": "FL", "wheel": 0, "lood_n": 1}]}, {"duration_s": 1.0}, "lood_n"),
        ({"wheel": [{"position": object(), "wheel": 0}]}, {"duration_s": 1.0}, "cannot express object"),
        (ONE_WHEEL, {}, "is endless"),
        (ONE_WHEEL, {"duration_s": 1.0, "out": "drive.csv"}, "does not end in .mcap"),
        (ONE_WHEEL, {"duration_s": 1.0, "faults": ["magic"]}, "magic"),
    ],
)
def test_wrong_simulation_is_an_error_with_a_remedy(scenario, options, message):
    with pytest.raises(gateway.Error, match=message):
        gateway.simulate(scenario, **options)


def test_scenario_takes_numbers_of_numpy():
    wheel = {"position": "RR", "wheel": np.int64(0), "load_n": np.array([[0, 3000.0], [2, 4000.0]]), "phase_deg": None}
    recording = gateway.simulate({"wheel": [wheel]}, duration_s=np.float64(1.0))
    assert recording.truth["RR"].load_n(1.0) == 3500.0


def test_existing_recording_is_not_overwritten(tmp_path):
    path = tmp_path / "kept.mcap"
    path.write_bytes(b"kept")
    with pytest.raises(gateway.RecordingError, match="exists"):
        gateway.simulate(ONE_WHEEL, duration_s=1.0, out=path)
    assert path.read_bytes() == b"kept"


def test_interrupted_simulation_leaves_no_file(tmp_path, monkeypatch):
    path = tmp_path / "part.mcap"
    monkeypatch.setattr("gateway.core.recording.writer.RecordingWriter.write", lambda *_: _interrupt())
    with pytest.raises(KeyboardInterrupt):
        gateway.simulate(ONE_WHEEL, duration_s=1.0, out=path)
    assert not path.exists()


def _interrupt():
    raise KeyboardInterrupt
