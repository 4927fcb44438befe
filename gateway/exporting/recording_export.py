"""Export of a recording to a file."""

import importlib
import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from gateway.core.errors import OutputError
from gateway.core.estimates.results import RevolutionResult
from gateway.core.reasons import Notice, Reason
from gateway.core.recording.recorded_file import open_recorded_file
from gateway.core.session.recording_pass import OpenedRecording, open_recording
from gateway.core.storable_text import storable
from gateway.core.text.output_file import OutputFile, WholeOutput, is_stdout, scratch_folder
from gateway.exporting.export_registry import CONTENTS, FORMATS
from gateway.exporting.export_table import Block, ExportWriter, Target, WheelTable, length
from gateway.exporting.measured_tables import Source, measured
from gateway.exporting.recorded_signals import SignalBlock, revolutions, sample_blocks
from gateway.exporting.wheel_conditions import conditions, first_pass, on_hub_time


class ExportFile(WholeOutput):
    """An export file.

    Attributes:
        rows: number of rows so far.
    """

    def __init__(self, path: Path, name: str, *, force: bool = False) -> None:
        """Open a file.

        Raises:
            OutputError: as `OutputFile`; or a package that the format needs is missing.
        """
        self.rows = 0
        self._output = OutputFile(path, force=force)
        direct = is_stdout(path) or (path.exists() and not path.is_file())
        self._scratch = ExitStack()
        try:
            # On the same disk, so that a full disk is reported as that of the file.
            scratch = None if direct else str(self._scratch.enter_context(scratch_folder(path)))
            module_name, attribute = FORMATS[name].writer.split(":")
            self._writer: ExportWriter = getattr(importlib.import_module(module_name), attribute)(
                Target(self._output.file, scratch)
            )
        except BaseException:
            self._scratch.close()
            self._output.discard()
            raise

    def begin(self, tables: Sequence[WheelTable]) -> None:
        """Take the tables; as the writer's.

        Raises:
            OutputError: the format cannot hold them, or the disk refuses; the latter also for the other methods.
        """
        with self._output.explained():
            self._writer.begin(tables)

    def write(self, table: WheelTable, block: Block) -> None:
        """Append rows to a table."""
        if not length(block):
            return
        with self._output.explained():
            self._writer.write(table, block)
        self.rows += length(block)

    def close(self) -> None:
        """Write what stands after the rows, and give the file its name."""
        with self._output.explained():
            self._writer.end()
        self._scratch.close()
        self._output.close()

    def discard(self) -> None:
        """Leave no file."""
        try:
            self._writer.discard()
        finally:
            self._scratch.close()
            self._output.discard()


@dataclass(frozen=True, slots=True)
class ExportReport:
    """Result of an export.

    Attributes:
        wheels: positions.
        rows: number of rows of all contents and wheels.
        columns: number of columns of each content, by its name.
        damage: what of the recording was unreadable; None when everything was read.
        doubts: what speaks against the known effects that were subtracted.
    """

    wheels: tuple[str, ...]
    rows: int
    columns: dict[str, int]
    damage: Reason | None
    doubts: tuple[Notice, ...] = ()


@dataclass(frozen=True, slots=True)
class ExportRequest:
    """What is exported.

    Attributes:
        contents: names from CONTENTS; several only for a format that takes them.
        format_name: name from FORMATS.
        estimators: names from the registry, for estimates.
        wheels: positions to export; all when empty.
    """

    contents: Sequence[str]
    format_name: str
    estimators: Sequence[str] = ()
    wheels: Sequence[str] = ()


def export_recording(
    path: Path,
    out: Path,
    request: ExportRequest,
    *,
    config_path: Path | None = None,
    effects_paths: Sequence[Path] = (),
    key_file: Path | None = None,
    force: bool = False,
    on_progress: Callable[[float], None] = lambda _: None,
) -> ExportReport:
    """Write contents of a recording to a file; memory use does not depend on its length.

    Args:
        path: recording or dump of a link.
        out: file; `-` is standard output.
        request: what is exported.
        config_path: vehicle configuration; None for the one in the recording.
        effects_paths: known effects to subtract from revolutions.
        key_file: sensor signing keys; None for the default file.
        force: overwrite the file.
        on_progress: called with the share of the work that is done.

    Raises:
        TreadlinkError: the recording or the configuration cannot be read, has nothing to export, or the file cannot be
            written, which then is as before.
    """
    file = open_recorded_file(path)
    passes, size, done = 1 + len(request.contents), max(file.info.size_bytes, 1), 0
    recording = open_recording(
        file,
        config_path,
        effects_paths=effects_paths,
        key_file=key_file,
        on_position=lambda position: on_progress((done + position / size) / passes),
    )
    overview = first_pass(recording, wheels=request.wheels)
    done = 1
    damage = file.damage
    positions = [wheel.position for wheel in overview.wheels]

    def reopened() -> OpenedRecording:
        # A file of its own, since passes may overlap.
        return replace(recording, file=open_recorded_file(path))

    def samples() -> Iterator[SignalBlock]:
        blocks = sample_blocks(reopened(), wheels=positions)
        return blocks if overview.has_arrivals else map(on_hub_time, blocks)

    def results(with_estimators: bool) -> Iterator[RevolutionResult]:
        revolution_results = revolutions(
            reopened(), tuple(request.estimators) if with_estimators else (), wheels=positions
        )
        return revolution_results if overview.has_arrivals else map(_on_hub_time, revolution_results)

    source = Source(samples, results, storable(path.name), overview.start_ns, request.estimators)
    by_position = {wheel.position: conditions(wheel, overview, recording) for wheel in overview.wheels}
    with ExportFile(out, request.format_name, force=force) as out_file:
        measured_contents = [measured(name, source) for name in request.contents]
        tables: dict[tuple[str, str], WheelTable] = {
            (content.what, wheel): replace(content.table(wheel), conditions=by_position[wheel])
            for content in measured_contents
            for wheel in positions
        }
        out_file.begin(list(tables.values()))
        for content in measured_contents:
            rows = out_file.rows
            for wheel, block in content.rows:
                out_file.write(tables[content.what, wheel], block)
            if out_file.rows == rows and CONTENTS[content.what].needs_results:
                raise OutputError(
                    f"'{path}' has no {content.what} to export: no wheel completed a revolution that can be used",
                    f"`treadlink estimate {shlex.quote(str(path))}` lists the reasons.",
                )
            done += 1
    columns = {content.what: len(content.columns) for content in measured_contents}
    doubts = recording.effects_doubts()
    return ExportReport(tuple(positions), out_file.rows, columns, damage, tuple(doubts))


def _on_hub_time(result: RevolutionResult) -> RevolutionResult:
    revolution = result.revolution
    return replace(result, host_ns=round((revolution.start_s + revolution.period_s) * 1e9))
