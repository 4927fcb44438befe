"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import Feature, Registry

FEATURE: Final = Feature(
    adds={
        Registry.SOURCES: {
            "can": "gateway.vehicle.log_sources:CAN",
            "nmea": "gateway.vehicle.log_sources:NMEA",
            "rtl433": "gateway.vehicle.log_sources:RTL433",
        },
        Registry.VEHICLE_KEYS: {
            "tpms": "gateway.vehicle.tire_sensors:TPMS",
            "vehicle_signals": "gateway.vehicle.bus_signals:VEHICLE_SIGNALS",
        },
        Registry.PARTS: {
            "names of vehicle signals": "gateway.vehicle.vehicle_signals:SIGNAL_NAMES",
            "tire sensors": "gateway.vehicle.tire_sensors:open_tire_sensors",
            "vehicle signals": "gateway.vehicle.signal_decoding:open_decoder",
        },
    },
)
