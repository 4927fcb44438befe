"""Declaration of the feature."""

from typing import Final

from gateway.feature import Feature, Registry

FEATURE: Final = Feature(
    adds={
        Registry.NUMBERS: {
            "forward": "gateway.estimators.forward:ForwardEstimator",
        },
    },
)
