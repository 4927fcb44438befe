"""Declaration of the feature."""

from typing import Final

from gateway.feature import Feature, Registry

FEATURE: Final = Feature(
    adds={
        Registry.PARTS: {
            "names of vehicle signals": "gateway.pipeline.vehicle_signals:SIGNAL_NAMES",
            "vehicle signals": "gateway.session.signal_decoding:open_decoder",
        },
    },
)
