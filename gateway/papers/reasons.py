"""Reasons of the papers' estimators, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class PaperCode(Codes):
    """Reasons of the papers' estimators."""

    # Of the tire's four numbers
    LINEAR_RING = Code("linear ring: its model error is in the standard error")
