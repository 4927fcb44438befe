import pytest

import gateway

# Two wheels on a link that loses frames; FR is driven into the end of its sensor's range.
SCENARIO = {
    "scenario": {"seed": 7, "faults": ["drop:rate=0.004"]},
    "motion": {"speed_kmh": 70},
    "hub": [{"hub": 0, "clock_ppm": 120}],
    "wheel": [
        {"position": "FL", "wheel": 0, "load_n": 4200, "sensor_id": "0000a001"},
        {"position": "FR", "wheel": 1, "load_n": 3900, "sensor_id": "0000a002", "sensor": {"range_g": 150}},
    ],
}


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """Path of a recording of two wheels, 5 s at 70 km/h."""
    path = tmp_path_factory.mktemp("api") / "drive.mcap"
    gateway.simulate(SCENARIO, duration_s=5.0, out=path)
    return path


@pytest.fixture(scope="module")
def recording(recorded):
    with gateway.open(recorded) as opened:
        yield opened
