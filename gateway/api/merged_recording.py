"""Merging of recordings for programs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gateway.api.recording_access import Recording, path_of
from gateway.api.recording_access import open as open_recording
from gateway.core.config.document_tables import document_text
from gateway.core.config.validation import read_text
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.errors import RecordingError
from gateway.core.session.program_arguments import PathLike, paths
from gateway.core.text.output_file import check_outputs
from gateway.upkeep.merge import merge_recordings

_CONFIGURATION: Final = "the configuration"


def merge(
    recordings: Sequence[PathLike], out: PathLike, *, config: Mapping[str, Any] | PathLike | None = None
) -> Recording:
    """Merge recordings of one drive into a new one and open it, as `treadlink merge`.

    Args:
        recordings: finished recordings, two or more.
        out: new .mcap file.
        config: vehicle configuration of the result: a TOML file or its tables; None where the recorded ones are the
            same.

    Raises:
        RecordingError: there are less than two, one is unfinished or damaged, they do not belong together, or `out`
            exists.
        ConfigError: the configuration has faults.
    """
    sources, target = paths(recordings), Path(out)
    if len(sources) < 2:
        raise RecordingError("there is nothing to merge", "Give two recordings or more.")
    check_outputs([target], [*sources, path_of(config)], force=True)
    vehicle_toml = None
    if isinstance(config, Mapping):
        vehicle_toml = document_text(config, _CONFIGURATION)
    elif config is not None:
        vehicle_toml = read_text(Path(config), _CONFIGURATION)
    if vehicle_toml is not None:
        parse_vehicle(vehicle_toml, _CONFIGURATION)
    return open_recording(merge_recordings(sources, target, vehicle_toml=vehicle_toml).target)
