"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature, Registry

FEATURE: Final = Feature(
    commands={
        "figures": CommandLine(
            "gateway.papers.commands.figures:figures", "Draw the papers' figures from simulated tires or measurements."
        ),
    },
    adds={
        Registry.QUANTITIES: {
            "ring-modal": "gateway.core.ring_quantities:RING",
            "ring-paper": "gateway.core.ring_quantities:RING",
        },
        Registry.NUMBERS: {
            "ring-modal": "gateway.papers.ring_modal:RingModalEstimator",
            "ring-paper": "gateway.papers.ring_paper:RingPaperEstimator",
        },
    },
)
