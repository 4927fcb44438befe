"""Reasons of recordings, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class RecordingCode(Codes):
    """Reasons of recordings."""

    RECORDING_RECORD_TOO_LARGE = Code(
        "'{recording}' has {size_bytes:.1f MB} in one chunk or record at byte {at_byte:d}, which is skipped; at most "
        "{largest_bytes:.1f MB} are read at once. Check where the file comes from"
    )
