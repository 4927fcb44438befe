"""Declaration of the feature."""

from typing import Final

from gateway.feature import CommandLine, Feature, Registry

FEATURE: Final = Feature(
    commands={
        "figures": CommandLine(
            "gateway.cli.figures:figures", "Draw the papers' figures from simulated tires or measurements."
        ),
    },
    adds={
        Registry.NUMBERS: {
            "ring-modal": "gateway.estimators.ring_modal:RingModalEstimator",
            "ring-paper": "gateway.estimators.ring_paper:RingPaperEstimator",
        },
    },
)
