"""Reasons of live outputs, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class PublishingCode(Codes):
    """Reasons of live outputs."""

    SINK_CONNECTED = Code("publishing")
    SINK_CONNECTING = Code("connecting")
    SINK_ENDED = Code("the reader has closed its end")
    SINK_FAULT = Code("internal error: {error}")
    SINK_FULL = Code("the receiver is slower than the session")
    SINK_LOST = Code("{error}; trying again every {interval_s:g s} or sooner")
    SINK_REFUSED = Code("the receiver refuses items: {error}")
    SINK_STALLED = Code("the receiver accepts nothing")
