"""Discovery messages by which Home Assistant finds wheels and links on an MQTT broker.

Source: Home Assistant, "MQTT", section "MQTT discovery"; the abbreviations of keys are not used.
"""

import json
from collections.abc import Iterator
from typing import Any, Final, NamedTuple
from urllib.parse import quote

from gateway import __version__
from gateway.core.quantity_catalogue import declared
from gateway.core.table_columns import typeset_unit

EXPIRE_S: Final = 30
"""A state that is not renewed for this long is no longer the present one; states come once a second."""


_MANUFACTURER: Final = "treadlink"
COMPONENTS: Final = ("sensor", "binary_sensor")
"""Kinds of entities of wheels and links."""


class Discovery(NamedTuple):
    """A retained message for Home Assistant: topic and payload."""

    topic: str
    payload: dict[str, Any]


class _Entity(NamedTuple):
    component: str
    field: str
    name: str
    unit: str = ""
    device_class: str = ""
    template: str = ""


# Kind of quantity to Home Assistant, by its unit.
_CLASSES: Final = {"m/s": "speed", "Pa": "pressure", "°C": "temperature", "m": "distance", "mm": "distance"}


def _number(field: str, name: str) -> _Entity:
    unit = typeset_unit(field)
    return _Entity("sensor", field, name, unit, _CLASSES.get(unit, ""))


_STATE: Final = (
    _number("pressure_pa", "pressure"),
    _number("temperature_degc", "inner liner"),
    _Entity("sensor", "state", "motion"),
    _Entity(
        "binary_sensor", "alarms", "alarm", "", "problem", "{{ 'ON' if value_json.alarms | length > 0 else 'OFF' }}"
    ),
)
_LINK: Final = (
    _Entity("sensor", "battery_percent", "battery", "%", "battery"),
    _Entity("sensor", "rssi_dbm", "signal", "dBm", "signal_strength"),
    _Entity("sensor", "frames_lost", "lost frames"),
    _Entity("binary_sensor", "connected", "link", "", "connectivity", "{{ 'ON' if value_json.connected else 'OFF' }}"),
)


def wheel_discovery(discovery_prefix: str, prefix: str, position: str) -> Iterator[Discovery]:
    """Yield the messages for the entities of a wheel."""
    numbers = (_number(quantity.name, quantity.entity) for quantity in declared() if quantity.entity)
    return _discovery(
        (*numbers, *_STATE), discovery_prefix, prefix, f"wheel/{quote(position, safe='')}", f"Wheel {position}"
    )


def link_discovery(discovery_prefix: str, prefix: str, link: str) -> Iterator[Discovery]:
    """Yield the messages for the entities of a link."""
    return _discovery(_LINK, discovery_prefix, prefix, f"link/{quote(link, safe='')}", f"Link {link}")


def announced_topic(payload: bytes, status_topic: str) -> str | None:
    """Return the state topic of an entity that a gateway with this status topic has announced, None for any other."""
    try:
        entity = json.loads(payload)
    except (ValueError, RecursionError):
        return None
    if not isinstance(entity, dict) or entity.get("availability_topic") != status_topic:
        return None
    device, topic = entity.get("device"), entity.get("state_topic")
    is_of_gateway = isinstance(device, dict) and device.get("manufacturer") == _MANUFACTURER
    return topic if is_of_gateway and isinstance(topic, str) else None


def _discovery(
    entities: tuple[_Entity, ...], discovery_prefix: str, prefix: str, path: str, device: str
) -> Iterator[Discovery]:
    node = _identifier(f"{prefix}_{path}")
    for entity in entities:
        payload: dict[str, Any] = {
            "name": entity.name,
            "unique_id": f"{node}_{entity.field}",
            "state_topic": f"{prefix}/{path}/state",
            "value_template": entity.template or f"{{{{ value_json.{entity.field} | default(none) }}}}",
            "availability_topic": f"{prefix}/status",
            "expire_after": EXPIRE_S,
            "device": {
                "identifiers": [node],
                "name": device,
                "manufacturer": _MANUFACTURER,
                "model": "intelligent tire gateway",
                "sw_version": __version__,
            },
        }
        if entity.unit:
            payload |= {"unit_of_measurement": entity.unit, "state_class": "measurement"}
        if entity.device_class:
            payload["device_class"] = entity.device_class
        yield Discovery(f"{discovery_prefix}/{entity.component}/{node}/{entity.field}/config", payload)


def _identifier(text: str) -> str:
    """Return text in the characters that Home Assistant allows in topics."""
    return "".join(char if char.isascii() and char.isalnum() else "_" for char in text)
