"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import Feature, Registry

FEATURE: Final = Feature(
    adds={
        Registry.QUANTITIES: {
            "weak-form": "gateway.core.ring_quantities:RING",
            "forward": "gateway.ring.quantities:FORWARD",
        },
        Registry.NUMBERS: {
            "weak-form": "gateway.ring.weak_form:WeakFormEstimator",
            "forward": "gateway.ring.forward:ForwardEstimator",
        },
    }
)
