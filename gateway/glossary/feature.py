"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "explain": CommandLine(
            "gateway.glossary.commands.explain:explain",
            "Explain a quantity, an effect, a reason, a status, a column or a term.",
        ),
    },
)
