"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import Feature, Registry

FEATURE: Final = Feature(
    adds={
        Registry.SOURCES: {
            "can": "gateway.vehicle.log_sources:CAN",
            "nmea": "gateway.vehicle.log_sources:NMEA",
        },
        Registry.VEHICLE_KEYS: {
            "vehicle_signals": "gateway.vehicle.bus_signals:VEHICLE_SIGNALS",
        },
        Registry.PARTS: {
            "names of vehicle signals": "gateway.vehicle.vehicle_signals:SIGNAL_NAMES",
            "vehicle signals": "gateway.vehicle.signal_decoding:open_decoder",
        },
    },
)
