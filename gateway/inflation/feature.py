"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import Feature, Registry

FEATURE: Final = Feature(
    adds={
        Registry.VEHICLE_KEYS: {"tire.placard": "gateway.inflation.placard:PLACARD"},
        Registry.WHEEL_WATCHES: {"pressure warning": "gateway.inflation.pressure_warning:pressure_warning"},
    }
)
