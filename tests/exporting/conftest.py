import numpy as np
import pytest

from gateway.core.config.vehicle import recorded_vehicle
from gateway.core.recording.recorded_file import open_recorded_file
from gateway.core.session.recording_pass import OpenedRecording
from gateway.exporting.recorded_signals import revolutions, sample_blocks
from gateway.exporting.recording_export import ExportRequest, export_recording
from tests.testkit.campaign_recordings import write_recording

ESTIMATORS = ("kinematic", "weak-form")


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """Path of a recording of two wheels, 2 s, on a link that loses frames; the sensor of W1 has no lateral axis."""
    folder = tmp_path_factory.mktemp("export")
    wheels = ("load_n = 4200.0", "load_n = 3900.0\n[wheel.sensor]\naxes = ['circumferential', 'radial']")
    tables = "faults = ['drop:rate=0.004']\n[sensor]\nrate_hz = 2000.0"
    return write_recording(folder / "drive.mcap", tables, wheels=wheels, duration_s=2.0)


@pytest.fixture(scope="session")
def vehicle(recorded):
    return recorded_vehicle(open_recorded_file(recorded).vehicle_toml, "test")


@pytest.fixture(scope="session")
def truth(recorded, vehicle):
    """Samples of each wheel as read, by name of their column."""
    blocks = list(sample_blocks(OpenedRecording(open_recorded_file(recorded), vehicle)))
    actual = {}
    for wheel in ("W0", "W1"):
        selected = [block for block in blocks if block.wheel == wheel]
        axes = np.concatenate([block.axes_mps2 for block in selected])
        actual[wheel] = {
            "circumferential_mps2": axes[:, 0],
            "lateral_mps2": axes[:, 1],
            "radial_mps2": axes[:, 2],
            "device_s": np.concatenate([block.hub_time_s for block in selected]),
            "host_ns": np.concatenate([block.host_time_ns for block in selected]),
            "saturated": np.concatenate([block.saturated for block in selected]),
            "number": np.concatenate([block.first_sample + np.arange(len(block)) for block in selected]),
        }
    return actual


@pytest.fixture(scope="session")
def results(recorded, vehicle):
    return list(revolutions(OpenedRecording(open_recorded_file(recorded), vehicle), ESTIMATORS))


@pytest.fixture
def export(recorded, tmp_path):
    """Function that exports the recording and returns the path of the file."""

    def exported(format_name, *contents, name="out", recording=recorded, wheels=(), estimators=ESTIMATORS, **options):
        path = tmp_path / name
        export_recording(recording, path, ExportRequest(contents, format_name, estimators, wheels), **options)
        return path

    return exported
