"""Treadlink, the gateway between intelligent tires and the engineer's computer.

Programs and notebooks use it by these names, also as `import treadlink`; the command `treadlink` has the same options:

    gateway.open("drive.mcap")           a recording: wheels, samples, revolutions, averages, orders, estimates, alarms
    gateway.live("serial:///dev/ttyUSB0")    an iterator over revolutions and their estimates as they complete
    gateway.simulate("demo", duration_s=30)  a simulated recording with the true state of its tires
    gateway.import_measurement("drum.csv", "drum.map.toml")    a measurement that was made elsewhere, as a recording
    gateway.calibrate(["a.mcap", "b.mcap"])    load calibration of a tire
    gateway.campaign("fleet/", "fleet.dataset")    many recordings into a dataset; gateway.tire_trends of it
    gateway.merge(["front.mcap", "rear.mcap"], "drive.mcap")    recordings of one drive as one
    gateway.figures("figures", "drive.mcap")    the papers' figures from measurements
    gateway.diagnose(["drive.mcap"])     the physical effects that the model of a wheel lacks, with a report
    gateway.Error                        base of every error, with `remedy`

Everything is loaded when it is first used.
"""

# Type checkers and editors take this name for true. It is not imported from `typing`: that alone would take most of the
# time of the import.
TYPE_CHECKING = False

if TYPE_CHECKING:
    from gateway.api.diagnosis_report import DiagnosisReport as DiagnosisReport
    from gateway.api.diagnosis_report import diagnose as diagnose
    from gateway.api.estimate_comparison import Comparison as Comparison
    from gateway.api.estimate_tables import Alarms as Alarms
    from gateway.api.estimate_tables import Estimates as Estimates
    from gateway.api.fleet_results import CampaignResult as CampaignResult
    from gateway.api.fleet_results import TireTrends as TireTrends
    from gateway.api.fleet_results import campaign as campaign
    from gateway.api.fleet_results import tire_trends as tire_trends
    from gateway.api.live_revolutions import LiveRevolutions as LiveRevolutions
    from gateway.api.live_revolutions import live as live
    from gateway.api.measurement_import import guess_map as guess_map
    from gateway.api.measurement_import import import_measurement as import_measurement
    from gateway.api.merged_recording import merge as merge
    from gateway.api.recording_access import Recording as Recording
    from gateway.api.recording_access import Wheel as Wheel
    from gateway.api.recording_access import WheelNotFoundError as WheelNotFoundError
    from gateway.api.recording_access import open as open
    from gateway.api.revolution_view import Revolution as Revolution
    from gateway.api.signal_tables import AngleWaveforms as AngleWaveforms
    from gateway.api.signal_tables import AverageWaveform as AverageWaveform
    from gateway.api.signal_tables import Environment as Environment
    from gateway.api.signal_tables import OrderSpectra as OrderSpectra
    from gateway.api.signal_tables import Revolutions as Revolutions
    from gateway.api.signal_tables import Samples as Samples
    from gateway.api.simulated_recording import simulate as simulate
    from gateway.core.errors import ConfigError as ConfigError
    from gateway.core.errors import OutputError as OutputError
    from gateway.core.errors import RecordingError as RecordingError
    from gateway.core.errors import SourceError as SourceError
    from gateway.core.errors import TreadlinkError
    from gateway.forces.tire_calibration import TireCalibration as TireCalibration
    from gateway.forces.tire_calibration import calibrate as calibrate
    from gateway.papers.paper_figures import figures as figures

    Error = TreadlinkError

__version__ = "0.1.0"

# Name -> module and name there; the block above says the same to type checkers and editors.
_LAZY = {
    "Alarms": "gateway.api.estimate_tables:Alarms",
    "AngleWaveforms": "gateway.api.signal_tables:AngleWaveforms",
    "AverageWaveform": "gateway.api.signal_tables:AverageWaveform",
    "CampaignResult": "gateway.api.fleet_results:CampaignResult",
    "Comparison": "gateway.api.estimate_comparison:Comparison",
    "ConfigError": "gateway.core.errors:ConfigError",
    "DiagnosisReport": "gateway.api.diagnosis_report:DiagnosisReport",
    "Environment": "gateway.api.signal_tables:Environment",
    "Error": "gateway.core.errors:TreadlinkError",
    "Estimates": "gateway.api.estimate_tables:Estimates",
    "LiveRevolutions": "gateway.api.live_revolutions:LiveRevolutions",
    "OrderSpectra": "gateway.api.signal_tables:OrderSpectra",
    "OutputError": "gateway.core.errors:OutputError",
    "Recording": "gateway.api.recording_access:Recording",
    "RecordingError": "gateway.core.errors:RecordingError",
    "Revolution": "gateway.api.revolution_view:Revolution",
    "Revolutions": "gateway.api.signal_tables:Revolutions",
    "Samples": "gateway.api.signal_tables:Samples",
    "SourceError": "gateway.core.errors:SourceError",
    "TireCalibration": "gateway.forces.tire_calibration:TireCalibration",
    "TireTrends": "gateway.api.fleet_results:TireTrends",
    "Wheel": "gateway.api.recording_access:Wheel",
    "WheelNotFoundError": "gateway.api.recording_access:WheelNotFoundError",
    "calibrate": "gateway.forces.tire_calibration:calibrate",
    "campaign": "gateway.api.fleet_results:campaign",
    "diagnose": "gateway.api.diagnosis_report:diagnose",
    "figures": "gateway.papers.paper_figures:figures",
    "guess_map": "gateway.api.measurement_import:guess_map",
    "import_measurement": "gateway.api.measurement_import:import_measurement",
    "live": "gateway.api.live_revolutions:live",
    "merge": "gateway.api.merged_recording:merge",
    "open": "gateway.api.recording_access:open",
    "simulate": "gateway.api.simulated_recording:simulate",
    "tire_trends": "gateway.api.fleet_results:tire_trends",
}


def names() -> tuple[str, ...]:
    """Return the names that are loaded on first use."""
    return tuple(_LAZY)


def __getattr__(name: str) -> object:
    """Load a name on first use (PEP 562)."""
    if name not in _LAZY:
        raise AttributeError(f"module 'gateway' has no attribute '{name}'")
    import importlib

    module, _, attribute = _LAZY[name].partition(":")
    value: object = getattr(importlib.import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_LAZY})
