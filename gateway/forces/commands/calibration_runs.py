"""Revolutions of calibration runs: recordings, or parts of them, in which a quantity is known."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from gateway.core.errors import CalibrationError
from gateway.core.estimates.results import RevolutionResult
from gateway.core.estimates.weighted_mean import MeanEstimate
from gateway.core.recording.reader import RecordingReader
from gateway.core.session.recording_pass import RecordingPass, open_recording
from gateway.core.session.session_parts import RigChannels, open_rig_channels
from gateway.core.text.progress import progress_bar
from gateway.forces.known_runs import KnownRun


def read_runs(
    path: Path,
    runs: Sequence[KnownRun],
    wheels: Sequence[str | None],
    estimators: Sequence[str],
    fallback: Path | None,
    take: Callable[[int, RevolutionResult], None],
    *,
    skipped_revolutions: int = 0,
) -> list[RigChannels]:
    """Read every recording once, and hand the revolutions of every run to `take`, with the index of the run.

    Returns the channels of the rig in the recording of each run.

    Args:
        path: of the runs file.
        runs: its runs.
        wheels: position of the wheel in each run; None for the only one recorded.
        estimators: names from the registry.
        fallback: vehicle configuration to use instead of those in the recordings.
        take: takes a revolution.
        skipped_revolutions: first ones of a wheel that are left out.

    Raises:
        TreadlinkError: a recording cannot be read.
        CalibrationError: a recording has no vehicle configuration, or not the wheel.
    """
    files: dict[Path, list[int]] = {}
    for index, run in enumerate(runs):
        files.setdefault(path.parent / run.recording, []).append(index)
    rigs: dict[int, RigChannels] = {}
    with progress_bar("reading the runs") as bar:
        for number, (file, indices) in enumerate(files.items()):
            reader = RecordingReader(file)
            size = max(reader.info.size_bytes, 1)

            def show(position: int, done: int = number, size: int = size, name: str = file.name) -> None:
                bar.show((done + position / size) / len(files), name)

            recording = open_recording(reader, fallback, verifies=False, on_position=show)
            if recording.vehicle is None:
                raise CalibrationError(
                    f"'{file}' contains no vehicle configuration",
                    "Give one that states the belt radius: --config VEHICLE.toml.",
                )
            rigs |= dict.fromkeys(indices, open_rig_channels(reader))
            revolution_counts: dict[str, int] = {}
            first_ns: dict[str, int] = {}
            for result in RecordingPass(recording, estimators, is_watched=False):
                position = result.position
                revolution_counts[position] = revolution_counts.get(position, 0) + 1
                since_s = 1e-9 * (result.host_ns - first_ns.setdefault(position, result.host_ns))
                for index in indices if revolution_counts[position] > skipped_revolutions else ():
                    run = runs[index]
                    if wheels[index] in (None, position) and run.from_s <= since_s <= (run.to_s or math.inf):
                        take(index, result)
            for index in indices:
                _check_wheel(file, wheels[index], sorted(revolution_counts))
    return [rigs[index] for index in range(len(runs))]


def rig_mean(
    name: str, rig: RigChannels, position: str, quantity: str, turns: Sequence[tuple[float, float]]
) -> MeanEstimate:
    """Return the mean of a channel of the rig at the revolutions of a run.

    Raises:
        CalibrationError: it does not cover them.
    """
    channel = rig.at(position, quantity, turns)
    covered = 0 if channel is None else channel.covered
    if channel is None or covered < len(turns):
        raise CalibrationError(
            f"{name}: its recording has a {quantity.replace('_', ' ')} at {covered} of {len(turns)} revolutions",
            "State it, or choose from_s and to_s; an import map keeps a column of the rig as a [[reference]] "
            f'with quantity = "{quantity}".',
        )
    return channel.mean()


def _check_wheel(file: Path, wheel: str | None, positions: Sequence[str]) -> None:
    if wheel is None and len(positions) > 1:
        raise CalibrationError(
            f"'{file}' contains {len(positions)} wheels: {', '.join(positions)}",
            f'Name one in the runs file, above the runs: wheel = "{positions[0]}".',
        )
    if wheel is not None and wheel not in positions:
        raise CalibrationError(
            f"'{file}' has no revolution of wheel {wheel}",
            f"Wheels with revolutions: {', '.join(positions) or 'none'}.",
        )


def run_name(run: KnownRun) -> str:
    """Return the name of a run in a report."""
    name = Path(run.recording).name
    if run.to_s is None:
        return f"{name} from {run.from_s:g} s" if run.from_s else name
    return f"{name} {run.from_s:g}-{run.to_s:g} s"
