"""Reasons of the papers' estimators, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class PaperCode(Codes):
    """Reasons of the papers' estimators."""

    LINEAR_RING = Code("by the linear model of the tire, whose error is in the standard error")
