"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import Feature, Registry

FEATURE: Final = Feature(
    adds={
        Registry.QUANTITIES: {"forward": "gateway.ring.quantities:FORWARD"},
        Registry.NUMBERS: {"forward": "gateway.ring.forward:ForwardEstimator"},
    }
)
