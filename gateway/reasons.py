"""Reasons and notices as values: a code with its numbers. `gateway.views.wording` turns them into text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

Value: TypeAlias = "float | str | Reason | tuple[Value, ...]"


class Code(StrEnum):
    """Meaning of a reason. The text of each code, with the values it needs, is in `gateway.views.wording`.

    Codes appear in JSON output and recordings: a code may be added, but not renamed without an entry in the changelog.
    """

    # Revolutions
    CONTACT_HAS_NO_SLOPE = "contact_has_no_slope"
    CONTACT_IN_NOISE = "contact_in_noise"
    CONTACT_INTERPOLATED = "contact_interpolated"
    NO_CONTACT = "no_contact"
    RADIAL_CLIPPED = "radial_clipped"
    RADIAL_SATURATED = "radial_saturated"
    SAMPLES_LOST = "samples_lost"
    EFFECTS_OUTSIDE_LOADS = "effects_outside_loads"
    EFFECTS_OUTSIDE_PRESSURES = "effects_outside_pressures"
    EFFECTS_OUTSIDE_SPEEDS = "effects_outside_speeds"
    EFFECTS_OF_OTHER_SENSOR = "effects_of_other_sensor"
    # - Revolutions that do not come
    ALL_FRAMES_REFUSED = "all_frames_refused"
    CONTACTS_NOT_ALIKE = "contacts_not_alike"
    NO_CONTACT_IN_AC_SIGNAL = "no_contact_in_ac_signal"
    NO_CONTACT_SEEN = "no_contact_seen"
    NO_FRAME_RECEIVED = "no_frame_received"
    NO_REVOLUTION = "no_revolution"
    NO_SAMPLES = "no_samples"
    RADIAL_AT_RANGE_END = "radial_at_range_end"
    RADIAL_IS_IN_G = "radial_is_in_g"
    RADIAL_IS_IN_MPS2 = "radial_is_in_mps2"
    RADIAL_OUTWARD = "radial_outward"
    RADIAL_SCALE_DOES_NOT_FIT = "radial_scale_does_not_fit"
    RATE_DOES_NOT_FIT = "rate_does_not_fit"
    SAMPLES_INTERRUPTED = "samples_interrupted"
    SAMPLES_TOO_SHORT = "samples_too_short"
    SAMPLES_WITHOUT_HELLO = "samples_without_hello"
    WHEEL_STANDS = "wheel_stands"
    WHEEL_TOO_SLOW = "wheel_too_slow"

    # Plug-ins
    PLUGIN_EFFECT_TAKEN = "plugin_effect_taken"
    PLUGIN_FAILED = "plugin_failed"
    PLUGIN_LACKS_MEMBERS = "plugin_lacks_members"
    PLUGIN_NAME_TAKEN = "plugin_name_taken"
    PLUGIN_NAME_DIFFERS = "plugin_name_differs"
    PLUGIN_NOT_IMPORTED = "plugin_not_imported"
    PLUGIN_WRONG_TYPE = "plugin_wrong_type"

    # Estimates
    # Of any estimator
    AC_COUPLED = "ac_coupled"
    AVERAGE_ERRORS_UNKNOWN = "average_errors_unknown"
    AXIS_MISSING = "axis_missing"
    AXIS_NOT_FINITE = "axis_not_finite"
    AXIS_AGAINST_ROLLING = "axis_against_rolling"
    EDGE_ERRORS_UNKNOWN = "edge_errors_unknown"
    EFFECTS_NOT_SUBTRACTED = "effects_not_subtracted"
    NEEDS_LOAD = "needs_load"
    NEEDS_PRESSURE = "needs_pressure"
    NO_CONTACT_EDGES = "no_contact_edges"
    NO_STEADY_VALUE = "no_steady_value"
    NOT_SETTLED = "not_settled"
    REVOLUTION_NOT_USED = "revolution_not_used"
    SAMPLES_LOST_SHARE = "samples_lost_share"
    SIGNAL_MISSING = "signal_missing"
    SPEED_OR_RADIUS_UNKNOWN = "speed_or_radius_unknown"
    TOO_FEW_ORDERS = "too_few_orders"
    # Of what the signal says against what is stated
    CONTACTS_MISSED = "contacts_missed"
    ERROR_COVERS = "error_covers"
    GAIN_WOULD_FIT = "gain_would_fit"
    GRAVITY_CONTRADICTED = "gravity_contradicted"
    MAY_CHANGE_BY = "may_change_by"
    NO_SINGLE_CAUSE = "no_single_cause"
    OFFSET_CONTRADICTED = "offset_contradicted"
    OFFSET_UNKNOWN = "offset_unknown"
    RADIUS_WOULD_FIT = "radius_would_fit"
    RATE_WOULD_FIT = "rate_would_fit"
    STEADY_VALUE_CONTRADICTED = "steady_value_contradicted"
    STEADY_VALUE_DISAGREES = "steady_value_disagrees"
    UNIT_IS_G = "unit_is_g"
    UNIT_IS_MPS2 = "unit_is_mps2"
    VEHICLE_SPEED_CONTRADICTED = "vehicle_speed_contradicted"
    WHEEL_SPEED_CONTRADICTED = "wheel_speed_contradicted"
    WIDTH_CONTRADICTED = "width_contradicted"
    WIDTH_DISAGREES = "width_disagrees"
    ZERO_CONTRADICTED = "zero_contradicted"
    ZERO_WOULD_FIT = "zero_would_fit"
    # Of the tire's four numbers
    BENDING_LIKE_SHEAR = "bending_like_shear"
    CORRELATED = "correlated"
    FIT_AT_ZERO = "fit_at_zero"
    FIT_NOT_CONVERGED = "fit_not_converged"
    LINEAR_RING = "linear_ring"
    LINEAR_RING_TENSION = "linear_ring_tension"
    MODEL_ERROR_SHARE = "model_error_share"
    NO_BELT_SHAPE = "no_belt_shape"
    NO_FLAT_CONTACT = "no_flat_contact"
    NO_RING_EQUILIBRIUM = "no_ring_equilibrium"
    NOT_DETERMINED = "not_determined"
    ORDERS_UNUSABLE = "orders_unusable"
    RING_DOES_NOT_FIT = "ring_does_not_fit"
    # Of distance
    DISTANCE_BRIDGED = "distance_bridged"
    DISTANCE_INTERRUPTED = "distance_interrupted"
    # Of forces
    FORCE_NOT_DETERMINED = "force_not_determined"
    FRICTION_OF_LONGITUDINAL_ONLY = "friction_of_longitudinal_only"
    NEEDS_SIDE_FORCE_CALIBRATION = "needs_side_force_calibration"
    SLIP_LIMIT_NOT_DETERMINED = "slip_limit_not_determined"
    SLIP_NOT_LATERAL = "slip_not_lateral"
    # Of load and wear
    BENDING_NOT_POSITIVE = "bending_not_positive"
    CORRECTED_FOR_BENDING = "corrected_for_bending"
    CORRECTED_FOR_WEAR = "corrected_for_wear"
    FROM_BELT_WIDTH = "from_belt_width"
    FROM_CONTACT_ANGLE = "from_contact_angle"
    FROM_RATIO = "from_ratio"
    HALF_ANGLE_OUTSIDE_CALIBRATION = "half_angle_outside_calibration"
    LOAD_CONTRADICTED = "load_contradicted"
    NEEDS_ESTIMATOR = "needs_estimator"
    NEEDS_LOAD_CALIBRATION = "needs_load_calibration"
    NEEDS_REFERENCE_NUMBER = "needs_reference_number"
    NEEDS_RING_THICKNESS = "needs_ring_thickness"
    NEEDS_WEAR_VALUES = "needs_wear_values"
    NO_LOAD_FROM_BELT_WIDTH = "no_load_from_belt_width"
    NO_LOAD_FROM_CONTACT_ANGLE = "no_load_from_contact_angle"
    NUMBER_MISSING = "number_missing"
    OVER_REVOLUTIONS = "over_revolutions"
    PRESSURE_OLD = "pressure_old"
    PRESSURE_NOT_COMPENSATED = "pressure_not_compensated"
    PRESSURE_OUTSIDE_CALIBRATION = "pressure_outside_calibration"
    TEMPERATURE_NOT_COMPENSATED = "temperature_not_compensated"
    UNKNOWN_ESTIMATOR = "unknown_estimator"
    WEAR_CONTRADICTED = "wear_contradicted"
    WEAR_UNKNOWN = "wear_unknown"
    # Of the lateral axis
    CONICITY_NOT_SEPARATED = "conicity_not_separated"
    FROM_AXIS_MEANS = "from_axis_means"
    FROM_LAMINATE = "from_laminate"
    INCLUDES_CONICITY = "includes_conicity"
    LAMINATE_DIFFERS = "laminate_differs"
    LAMINATE_NOT_BALANCED = "laminate_not_balanced"
    LATERAL_ZERO_CONTRADICTED = "lateral_zero_contradicted"
    LATERAL_ZERO_NOT_SEPARATED = "lateral_zero_not_separated"
    NEEDS_BOTH_SLIPS = "needs_both_slips"
    ORDERS_USED = "orders_used"
    ROLL_CONTRADICTED = "roll_contradicted"
    ROLL_NOT_CALIBRATED = "roll_not_calibrated"
    ROLL_UNLIKELY = "roll_unlikely"
    SCATTER_UNKNOWN = "scatter_unknown"
    SIGN_NOT_DETERMINED = "sign_not_determined"
    SLIP_BEYOND_LAW = "slip_beyond_law"
    SLIP_OUTSIDE_CALIBRATION = "slip_outside_calibration"
    SPEED_UNUSABLE = "speed_unusable"
    ZERO_SLIP_GIVEN = "zero_slip_given"
    ZERO_SLIP_IS_MEAN = "zero_slip_is_mean"
    ZERO_SLIP_NOT_SETTLED = "zero_slip_not_settled"
    # Of the sensor's calibration
    FLAT_CONTACT_ASSUMED = "flat_contact_assumed"
    NEEDS_TEMPERATURE_CHANGE = "needs_temperature_change"
    NEEDS_TWO_SPEEDS = "needs_two_speeds"
    NO_REVOLUTION_YET = "no_revolution_yet"
    NOT_FINITE = "not_finite"
    OTHER_OFFSET_STATED = "other_offset_stated"
    # Of what is not locked to the wheel
    AT_WHEEL_ORDER = "at_wheel_order"
    IN_BAND = "in_band"
    NEEDS_UNINTERRUPTED_ROLLING = "needs_uninterrupted_rolling"
    NO_LINE = "no_line"

    # Of road and water
    CAVITY_CONTRADICTED = "cavity_contradicted"
    LIKE_A_WATER_WEDGE = "like_a_water_wedge"
    NEEDS_CAVITY_LENGTH = "needs_cavity_length"
    NEEDS_REVOLUTIONS = "needs_revolutions"
    NEEDS_TEMPERATURE = "needs_temperature"
    NOT_VERIFIED_BY_MEASUREMENT = "not_verified_by_measurement"
    ROAD_BELOW_NOISE = "road_below_noise"
    ROAD_CLASS = "road_class"
    ROAD_WAVES = "road_waves"
    TOO_SLOW_FOR_ROAD = "too_slow_for_road"

    # Sensors
    AXIS_READS = "axis_reads"
    PRESSURE_FROZEN = "pressure_frozen"
    SENSOR_DEAD = "sensor_dead"
    SENSOR_FLIPPED = "sensor_flipped"
    SENSOR_LOOSE = "sensor_loose"
    SENSOR_STUCK = "sensor_stuck"
    SENSOR_TILTED = "sensor_tilted"

    # Wheels, links and alarms
    # - Alarms as events
    ALARM_CLEARED = "alarm_cleared"
    ALARM_COMES_AND_GOES = "alarm_comes_and_goes"
    ALARM_RAISED = "alarm_raised"
    ALARM_STANDS = "alarm_stands"
    # - Thresholds
    BATTERY_BELOW_LIMIT = "battery_below_limit"
    BATTERY_NOW = "battery_now"
    FRAME_LOSS_ABOVE_LIMIT = "frame_loss_above_limit"
    FRAME_LOSS_NOW = "frame_loss_now"
    LINK_DOWN = "link_down"
    LOAD_ABOVE_LIMIT = "load_above_limit"
    LOAD_NOW = "load_now"
    PRESSURE_ABOVE_LIMIT = "pressure_above_limit"
    PRESSURE_BELOW_LIMIT = "pressure_below_limit"
    PRESSURE_NOW = "pressure_now"
    SENSOR_RANGE_REACHED = "sensor_range_reached"
    SPEED_ABOVE_LIMIT = "speed_above_limit"
    SPEED_NOW = "speed_now"
    TEMPERATURE_ABOVE_LIMIT = "temperature_above_limit"
    TEMPERATURE_NOW = "temperature_now"
    WEAR_ABOVE_LIMIT = "wear_above_limit"
    WEAR_NOW = "wear_now"
    # - Silence
    AXIS_SILENT = "axis_silent"
    ENVIRONMENT_SILENT = "environment_silent"
    HUB_OF_WHEEL_SILENT = "hub_of_wheel_silent"
    HUB_SILENT = "hub_silent"
    SAMPLES_MISSING = "samples_missing"
    SAMPLES_SILENT = "samples_silent"
    SENDS_AGAIN = "sends_again"
    SENSOR_NEVER_HEARD = "sensor_never_heard"
    SENSOR_SILENT = "sensor_silent"
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
    MARK_NOT_KEPT = "mark_not_kept"
    MTU = "mtu"
    MTU_TOO_SMALL = "mtu_too_small"
    MTU_UNKNOWN = "mtu_unknown"
    NOTIFICATIONS_DROPPED = "notifications_dropped"
    QUOTED_TEXT = "quoted_text"
    RETRY_INTERVAL = "retry_interval"
    # - Live outputs
    SINK_CLOSED = "sink_closed"
    SINK_CONNECTED = "sink_connected"
    SINK_CONNECTING = "sink_connecting"
    SINK_DOWN = "sink_down"
    SINK_DROPS = "sink_drops"
    SINK_ENDED = "sink_ended"
    SINK_FAULT = "sink_fault"
    SINK_FULL = "sink_full"
    SINK_LOST = "sink_lost"
    SINK_STALLED = "sink_stalled"
    # - Health of links
    FIRMWARE_TOO_NEW = "firmware_too_new"
    FIRMWARE_TOO_OLD = "firmware_too_old"
    FRAMES_DAMAGED = "frames_damaged"
    FRAMES_RESUMED = "frames_resumed"
    FRAMES_WITH_BAD_PAYLOAD = "frames_with_bad_payload"
    FRAMES_WITH_UNKNOWN_FLAGS = "frames_with_unknown_flags"
    HUB_RESTARTED = "hub_restarted"
    HUB_RESTARTS_REPEATEDLY = "hub_restarts_repeatedly"
    LINK_NO_DATA_YET = "link_no_data_yet"
    LINK_RESUMED = "link_resumed"
    LINK_SILENT = "link_silent"
    NEWER_FRAME_LAYOUT = "newer_frame_layout"
    NEWER_PROTOCOL = "newer_protocol"
    NO_FRAMES = "no_frames"
    NO_FRAMES_ANY_MORE = "no_frames_any_more"
    NO_HELLO = "no_hello"
    OLDER_PROTOCOL = "older_protocol"
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
    # - False statements of a hub
    HELLO_AXES_DIFFER = "hello_axes_differ"
    HELLO_HIGHPASS_WITH_DC = "hello_highpass_with_dc"
    HELLO_KEEPS_CHANGING = "hello_keeps_changing"
    HELLO_RATE_DIFFERS = "hello_rate_differs"
    HELLO_SCALE_ABSURD = "hello_scale_absurd"
    HELLO_SCALE_AGAINST_RANGE = "hello_scale_against_range"
    HELLO_SCALE_ZERO = "hello_scale_zero"
    HELLO_SENSORS_ALTERNATE = "hello_sensors_alternate"
    HELLO_ZERO_ABSURD = "hello_zero_absurd"
    HUB_BOOT_COUNTS_DIFFER = "hub_boot_counts_differ"
    HUB_CLOCK_STILL = "hub_clock_still"
    HUB_NUMBER_RESERVED = "hub_number_reserved"
    HUB_SENDS_AS_WHEEL = "hub_sends_as_wheel"
    HUB_SENDS_COMMANDS = "hub_sends_commands"
    HUB_TIME_AGAINST_TICK = "hub_time_against_tick"
    ONLY_UNKNOWN_TYPES = "only_unknown_types"
    PRESSURE_IMPOSSIBLE = "pressure_impossible"
    SAMPLES_REPEATED = "samples_repeated"
    SAMPLE_NUMBERS_JUMP = "sample_numbers_jump"
    TEMPERATURE_IMPOSSIBLE = "temperature_impossible"
    WHEELS_REFUSED = "wheels_refused"
    # - Sessions and commands
    ASSUMED_NOT_MEASURED = "assumed_not_measured"
    COMMAND_FAILED = "command_failed"
    COMMAND_NOT_VERIFIED = "command_not_verified"
    COMMAND_OUTCOME = "command_outcome"
    COMMAND_REFUSED = "command_refused"
    COMMAND_REPEATED = "command_repeated"
    COMMAND_UNKNOWN = "command_unknown"
    COMMAND_VALUE_REFUSED = "command_value_refused"
    DECODING_BEHIND = "decoding_behind"
    EFFECTS_SUBTRACTED = "effects_subtracted"
    HUB_LOG = "hub_log"
    HUB_LOG_LEFT_OUT = "hub_log_left_out"
    LOAD_RANGE = "load_range"
    PRESSURE_RANGE = "pressure_range"
    RECORDING_BEHIND = "recording_behind"
    RECORDING_STOPPED = "recording_stopped"
    SPEED_RANGE = "speed_range"
    TOPICS_BEHIND = "topics_behind"
    VIEW_BEHIND = "view_behind"
    # - Recordings of a campaign
    AXIS_CONSTANT = "axis_constant"
    SAMPLES_STUCK = "samples_stuck"
    DIFFERENT_SENSORS = "different_sensors"
    RECORDING_DAMAGED = "recording_damaged"
    RECORDING_ORDER_UNKNOWN = "recording_order_unknown"
    RECORDING_WITHOUT_DATA = "recording_without_data"
    ABOUT_RECORDING = "about_recording"
    SEVERAL_SENSORS = "several_sensors"
    # - Recordings of a dataset
    ESTIMATION_FAILED = "estimation_failed"
    RECORDING_CHANGED = "recording_changed"
    RECORDING_NOT_READ = "recording_not_read"
    RECORDING_NOT_USED = "recording_not_used"
    WORKER_ENDED = "worker_ended"
    WORKER_MEMORY_ABOVE_LIMIT = "worker_memory_above_limit"
    WORKER_MEMORY_FULL = "worker_memory_full"
    # - Provenance of conditions
    ASSUMED_LOAD = "assumed_load"
    ASSUMED_OFFSET = "assumed_offset"
    ASSUMED_PRESSURE = "assumed_pressure"
    ASSUMED_RADIUS = "assumed_radius"
    ASSUMED_TEMPERATURE = "assumed_temperature"
    FROM_CONFIGURATION = "from_configuration"
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

    # Trends of a dataset
    TREND_CLOCK_WRONG = "trend_clock_wrong"
    TREND_DISTANCE_CONSTANT = "trend_distance_constant"
    TREND_LOAD_STATED = "trend_load_stated"
    TREND_LOAD_STEPS = "trend_load_steps"
    TREND_LOSES_PRESSURE = "trend_loses_pressure"
    TREND_NO_VALUES = "trend_no_values"
    TREND_OUTLIERS_LEFT_OUT = "trend_outliers_left_out"
    TREND_PRESSURE_CONSTANT = "trend_pressure_constant"
    TREND_PRESSURE_NOT_MEASURED = "trend_pressure_not_measured"
    TREND_RECORDED_DISTANCE = "trend_recorded_distance"
    TREND_SENSOR_CLIPS = "trend_sensor_clips"
    TREND_SENSOR_GAIN = "trend_sensor_gain"
    TREND_SENSOR_LOSSES = "trend_sensor_losses"
    TREND_SENSOR_MOVES = "trend_sensor_moves"
    TREND_SENSOR_NOISE = "trend_sensor_noise"
    TREND_SENSOR_ZERO = "trend_sensor_zero"
    TREND_STEPS = "trend_steps"
    TREND_STIFFNESS_DRIFTS = "trend_stiffness_drifts"
    TREND_TEMPERATURE_CONSTANT = "trend_temperature_constant"
    TREND_TEMPERATURE_STUCK = "trend_temperature_stuck"
    TREND_TEMPERATURE_UNKNOWN = "trend_temperature_unknown"
    TREND_TOO_FEW = "trend_too_few"
    TREND_UNDETERMINED = "trend_undetermined"
    TREND_UNREADABLE_FILE = "trend_unreadable_file"
    TREND_VEHICLE_WITHOUT_ODOMETER = "trend_vehicle_without_odometer"
    TREND_WEARS_FAST = "trend_wears_fast"

    # Security
    COUNTERS_NOT_SAVED = "counters_not_saved"
    COUNTERS_SAVED_LATE = "counters_saved_late"
    FRAMES_IGNORED = "frames_ignored"
    FRAMES_NOT_TRUSTED = "frames_not_trusted"
    FRAMES_USED = "frames_used"
    FRAMES_VERDICT = "frames_verdict"
    FRAME_BEFORE_HELLO = "frame_before_hello"
    FRAME_EARLIER_START = "frame_earlier_start"
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
    SIGNER_AT_HUB = "signer_at_hub"
    SIGNER_HUB = "signer_hub"
    SIGNER_SENSOR = "signer_sensor"
    SIGNER_UNKNOWN = "signer_unknown"

    # Files and configuration
    RECORDING_CHANNEL_UNDECLARED = "recording_channel_undeclared"
    RECORDING_CHUNK_DAMAGED = "recording_chunk_damaged"
    RECORDING_CUT_OFF = "recording_cut_off"
    RECORDING_DESCRIPTION_DAMAGED = "recording_description_damaged"
    RECORDING_RECORD_DAMAGED = "recording_record_damaged"
    RECORDING_RECORD_MISSING = "recording_record_missing"
    RECORDING_RECORD_TOO_LARGE = "recording_record_too_large"
    UNIT_UNLIKELY = "unit_unlikely"

    # Diagnosis: acceptance tests
    IMPLAUSIBLE_PARAMETER = "implausible_parameter"
    FADES_WITHIN_ONE_WAVE = "fades_within_one_wave"
    HOLLOW_ROAD = "hollow_road"
    PROBABILITY_TOO_LOW = "probability_too_low"
    SEARCH_ENDED_EARLY = "search_ended_early"
    EVIDENCE_TEMPERED = "evidence_tempered"
    LEAVES_MORE_THAN_WITHOUT = "leaves_more_than_without"
    SIZE_DIFFERS_BETWEEN_RECORDINGS = "size_differs_between_recordings"
    LEAVES_RESIDUAL_AT_EDGES = "leaves_residual_at_edges"
    NOTHING_REMAINS = "nothing_remains"
    ORDER_OR_FREQUENCY = "order_or_frequency"
    BESIDE_SOMETHING_LARGER = "beside_something_larger"

    # Diagnosis: deciding recordings
    RECORD_AT_SPEED = "record_at_speed"
    RECORD_REVERSED = "record_reversed"
    RECORD_WARMER = "record_warmer"
    RECORD_AT_LOAD = "record_at_load"
    RECORD_AT_PRESSURE = "record_at_pressure"
    RECORD_AT_REST = "record_at_rest"
    RECORD_ROAD_AT_ANOTHER_SPEED = "record_road_at_another_speed"
    RECORD_LIVE = "record_live"
    RECORD_LIVE_FOR_LONGER = "record_live_for_longer"
    COMPARE_CLOCK = "compare_clock"
    NO_RECORDING_DECIDES = "no_recording_decides"
    DECIDES_AGAINST = "decides_against"

    # Diagnosis: notes
    MEANS_NOT_COMPARED = "means_not_compared"
    REVOLUTIONS_LEFT_OUT = "revolutions_left_out"
    REVOLUTION_NOT_MEASURED = "revolution_not_measured"
    BEYOND_RECORDING_LIMIT = "beyond_recording_limit"
    BEYOND_GROUP_LIMIT = "beyond_group_limit"
    BETWEEN_GROUP_SPEEDS = "between_group_speeds"
    TOO_FEW_ALIKE = "too_few_alike"
    OUTLIER_OF_GROUP = "outlier_of_group"
    CLIPPED_UNLIKE_GROUP = "clipped_unlike_group"
    CONTACTS_CONTRADICT = "contacts_contradict"
    LOADS_CONTRADICT = "loads_contradict"
    FEW_REVOLUTIONS = "few_revolutions"
    ONE_SPEED = "one_speed"
    GROUPS_TOO_SHORT = "groups_too_short"
    NOISE_ROLLS_OFF = "noise_rolls_off"


@dataclass(frozen=True, slots=True, init=False)
class Reason:
    """A code and the values that belong to it, in SI units with the unit in the name.

    Attributes:
        code: its meaning.
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


def codes_of(reasons: Iterable[Reason]) -> tuple[Code, ...]:
    """Return the codes of reasons and of those nested in them, in order."""
    return tuple(inner.code for reason in reasons for inner in reason)


class Level(StrEnum):
    """Severity of a notice."""

    INFO = "info"
    WARNING = "warning"
    SECURITY = "security"
    """A warning that an attack could explain."""
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
