"""Counters of a link: frames delivered, lost and skipped, by cause."""

from dataclasses import dataclass, field


@dataclass(slots=True)
class SourceCounters:
    """Counters of one source (hub, wheel).

    Attributes:
        frames: frames delivered.
        lost: frames missing by their counters; a late one is taken off again.
        duplicates: frames that had arrived before; not delivered.
        reordered: frames that came late; delivered.
        restarts: number of times that the counter restarted.
        unknown_type: intact frames of a type this version does not know.
    """

    frames: int = 0
    lost: int = 0
    duplicates: int = 0
    reordered: int = 0
    restarts: int = 0
    unknown_type: int = 0


@dataclass(slots=True)
class LinkCounters:
    """Counters of one link, kept up to date by its decoder.

    Every intact frame is either delivered, a duplicate, or counted under exactly one of `bad_payload`, `unknown_type`,
    `other_major`, `newer_minor`, `unknown_flags` and `refused`.

    Attributes:
        crc_errors: sync and length that were no intact frame.
        noise_bytes: bytes outside intact frames.
        truncated: frames cut off by the end of the stream.
        bad_payload: intact frames whose payload breaks its layout.
        unknown_type: intact frames of a type this version does not know.
        other_major: intact frames of another major version.
        newer_minor: intact frames with a layout newer than this version.
        unknown_flags: intact frames with a flag this version does not know.
        refused: intact frames that the decoder's gate did not let through; their counters are not looked at.
        sources: counters per (hub, wheel); at most 65,536 entries.
    """

    crc_errors: int = 0
    noise_bytes: int = 0
    truncated: int = 0
    bad_payload: int = 0
    unknown_type: int = 0
    other_major: int = 0
    newer_minor: int = 0
    unknown_flags: int = 0
    refused: int = 0
    sources: dict[tuple[int, int], SourceCounters] = field(default_factory=dict)

    @property
    def frames(self) -> int:
        """Frames delivered."""
        return sum(source.frames for source in self.sources.values())

    @property
    def lost(self) -> int:
        """Frames missing by their counters."""
        return sum(source.lost for source in self.sources.values())

    @property
    def duplicates(self) -> int:
        """Frames seen twice."""
        return sum(source.duplicates for source in self.sources.values())

    @property
    def reordered(self) -> int:
        """Frames that came late."""
        return sum(source.reordered for source in self.sources.values())

    @property
    def restarts(self) -> int:
        """Counter restarts."""
        return sum(source.restarts for source in self.sources.values())

    @property
    def skipped(self) -> int:
        """Intact frames that this version cannot read."""
        return self.unknown_type + self.other_major + self.newer_minor + self.unknown_flags

    @property
    def intact(self) -> int:
        """Frames whose CRC was right, delivered or not."""
        return self.frames + self.duplicates + self.bad_payload + self.skipped + self.refused
