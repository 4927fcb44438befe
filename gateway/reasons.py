"""Reasons and notices as values: a code with its numbers. `gateway.views.wording` turns them into text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

Value: TypeAlias = "float | str | Reason | tuple[Value, ...]"


class Code(StrEnum):
    """What a reason says. The text of each code, with the values it needs, is in `gateway.views.wording`.

    Codes appear in JSON output and recordings: a code may be added, but not renamed without an entry in the changelog.
    """

    # Revolutions
    SAMPLES_LOST = "samples_lost"

    # Estimates

    # Sensors

    # Wheels, links and alarms
    # - Thresholds
    BATTERY_BELOW_LIMIT = "battery_below_limit"
    FRAME_LOSS_ABOVE_LIMIT = "frame_loss_above_limit"
    LINK_DOWN = "link_down"
    LOAD_ABOVE_LIMIT = "load_above_limit"
    PRESSURE_ABOVE_LIMIT = "pressure_above_limit"
    PRESSURE_BELOW_LIMIT = "pressure_below_limit"
    SENSOR_RANGE_REACHED = "sensor_range_reached"
    SPEED_ABOVE_LIMIT = "speed_above_limit"
    TEMPERATURE_ABOVE_LIMIT = "temperature_above_limit"
    WEAR_ABOVE_LIMIT = "wear_above_limit"
    # - Events of links and devices
    BATTERY_LEVEL = "battery_level"
    BLE_DEVICE = "ble_device"
    LINK_AWAY = "link_away"
    LINK_CONNECTED = "link_connected"
    LINK_DISCONNECTED = "link_disconnected"
    LINK_ENDED = "link_ended"
    LINK_EVENT = "link_event"
    LINK_LOST = "link_lost"
    LINK_NOT_OPEN = "link_not_open"
    LINK_RESTORED = "link_restored"
    LINK_RETRYING = "link_retrying"
    MARK = "mark"
    MTU = "mtu"
    MTU_TOO_SMALL = "mtu_too_small"
    MTU_UNKNOWN = "mtu_unknown"
    NOTIFICATIONS_DROPPED = "notifications_dropped"
    QUOTED_TEXT = "quoted_text"
    RETRY_INTERVAL = "retry_interval"
    # - Health of links
    FIRMWARE_TOO_NEW = "firmware_too_new"
    FIRMWARE_TOO_OLD = "firmware_too_old"
    FRAMES_DAMAGED = "frames_damaged"
    FRAMES_RESUMED = "frames_resumed"
    FRAMES_WITH_BAD_PAYLOAD = "frames_with_bad_payload"
    FRAMES_WITH_UNKNOWN_FLAGS = "frames_with_unknown_flags"
    HUB_RESTARTED = "hub_restarted"
    HUB_RESTARTS_REPEATEDLY = "hub_restarts_repeatedly"
    HUB_SILENT = "hub_silent"
    LINK_NO_DATA_YET = "link_no_data_yet"
    LINK_RESUMED = "link_resumed"
    LINK_SILENT = "link_silent"
    NEWER_FRAME_LAYOUT = "newer_frame_layout"
    NEWER_PROTOCOL = "newer_protocol"
    NO_FRAMES = "no_frames"
    NO_HELLO = "no_hello"
    SENSOR_SILENT = "sensor_silent"
    SENDS_AGAIN = "sends_again"
    # - Content of a line without frames
    CHECK_SOURCE_ADDRESS = "check_source_address"
    CHOOSE_HUB_PORT = "choose_hub_port"
    LINE_ALL_FRAMES_DAMAGED = "line_all_frames_damaged"
    LINE_CONSTANT = "line_constant"
    LINE_GPS_RECEIVER = "line_gps_receiver"
    LINE_NOT_A_HUB = "line_not_a_hub"
    LINE_TEXT = "line_text"
    LINE_UBLOX_RECEIVER = "line_ublox_receiver"
    LINE_WRONG_BAUD_RATE = "line_wrong_baud_rate"
    # - Wheels and their sensors
    SENSOR_REPLACED = "sensor_replaced"
    SENSOR_SWAPPED = "sensor_swapped"
    WHEEL_ADDRESS = "wheel_address"
    WHEEL_NOT_CONFIGURED = "wheel_not_configured"
    WHEEL_NOT_IN_CONFIGURATION = "wheel_not_in_configuration"
    # - Sessions and commands
    ASSUMED_NOT_MEASURED = "assumed_not_measured"
    COMMAND_FAILED = "command_failed"
    COMMAND_OUTCOME = "command_outcome"
    COMMAND_REFUSED = "command_refused"
    COMMAND_UNKNOWN = "command_unknown"
    COMMAND_VALUE_REFUSED = "command_value_refused"
    DECODING_BEHIND = "decoding_behind"
    EFFECTS_SUBTRACTED = "effects_subtracted"
    HUB_LOG = "hub_log"
    LOAD_RANGE = "load_range"
    PRESSURE_RANGE = "pressure_range"
    RECORDING_BEHIND = "recording_behind"
    RECORDING_STOPPED = "recording_stopped"
    SPEED_RANGE = "speed_range"
    TOPICS_BEHIND = "topics_behind"
    VIEW_BEHIND = "view_behind"
    # - Recordings of a campaign
    AXIS_CONSTANT = "axis_constant"
    DIFFERENT_SENSORS = "different_sensors"
    RECORDING_DAMAGED = "recording_damaged"
    RECORDING_ORDER_UNKNOWN = "recording_order_unknown"
    RECORDING_WITHOUT_DATA = "recording_without_data"
    REVOLUTIONS_LEFT_OUT = "revolutions_left_out"
    ABOUT_RECORDING = "about_recording"
    SEVERAL_SENSORS = "several_sensors"
    # - Provenance of conditions
    ASSUMED_LOAD = "assumed_load"
    ASSUMED_PRESSURE = "assumed_pressure"
    ASSUMED_RADIUS = "assumed_radius"
    ASSUMED_TEMPERATURE = "assumed_temperature"
    FROM_CONFIGURATION = "from_configuration"
    FROM_CONFIGURATION_DEFAULT = "from_configuration_default"
    FROM_RECORDING = "from_recording"
    FROM_SENSOR = "from_sensor"
    OF_RECORDINGS = "of_recordings"
    STATED_LOAD = "stated_load"
    STATED_LOAD_RANGE = "stated_load_range"
    STATED_OFFSET = "stated_offset"
    STATED_PITCH = "stated_pitch"
    STATED_PRESSURE = "stated_pressure"
    STATED_PRESSURE_RANGE = "stated_pressure_range"
    STATED_RADIUS = "stated_radius"
    STATED_ROLL = "stated_roll"

    # Security
    COUNTERS_NOT_SAVED = "counters_not_saved"
    COUNTERS_SAVED_LATE = "counters_saved_late"
    FRAMES_IGNORED = "frames_ignored"
    FRAMES_NOT_TRUSTED = "frames_not_trusted"
    FRAMES_USED = "frames_used"
    FRAMES_VERDICT = "frames_verdict"
    FRAME_BEFORE_HELLO = "frame_before_hello"
    FRAME_LATE = "frame_late"
    FRAME_NO_KEY = "frame_no_key"
    FRAME_REPLAYED = "frame_replayed"
    FRAME_UNSIGNED = "frame_unsigned"
    FRAME_WRONG_TAG = "frame_wrong_tag"
    KEY_MISSING_FRAMES_IGNORED = "key_missing_frames_ignored"
    KEY_MISSING_FRAMES_NOT_VERIFIED = "key_missing_frames_not_verified"
    SENSOR_NOT_ADMITTED = "sensor_not_admitted"
    SENSOR_NOT_ADMITTED_SWAPPED = "sensor_not_admitted_swapped"
    SENSOR_NOT_ADMITTED_UNCONFIGURED = "sensor_not_admitted_unconfigured"
    SIGNER_HUB = "signer_hub"
    SIGNER_SENSOR = "signer_sensor"
    SIGNER_UNKNOWN = "signer_unknown"

    # Files and configuration


@dataclass(frozen=True, slots=True, init=False)
class Reason:
    """A code and the values that belong to it, in SI units with the unit in the name.

    Attributes:
        code: what is said.
        values: name and value of each number, name or nested reason, in the order given.
    """

    code: Code
    values: tuple[tuple[str, Value], ...]

    def __init__(self, code: Code, **values: Value) -> None:
        object.__setattr__(self, "code", code)
        object.__setattr__(self, "values", tuple(values.items()))

    def __getitem__(self, name: str) -> Value:
        """Return one value; raises KeyError when the code has none of that name."""
        return dict(self.values)[name]

    def __iter__(self) -> Iterator[Reason]:
        """Iterate over this reason and those nested in it, outermost first."""
        yield self
        for _, value in self.values:
            for inner in value if isinstance(value, tuple) else (value,):
                if isinstance(inner, Reason):
                    yield from inner


class Level(StrEnum):
    """How much a notice matters to the user."""

    INFO = "info"
    WARNING = "warning"
    SECURITY = "security"
    """A warning that somebody's bad intent could explain."""
    ERROR = "error"
    """Data is being lost."""


@dataclass(frozen=True, slots=True)
class Notice:
    """Something that the user should know.

    Attributes:
        subject: name of the link, hub, wheel or file that it is about, empty for the whole session.
        reason: what happened.
        level: how much it matters.
    """

    subject: str
    reason: Reason
    level: Level = Level.INFO
