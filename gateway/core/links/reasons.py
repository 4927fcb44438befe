"""Reasons of links and devices, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class LinkCode(Codes):
    """Reasons of links and devices."""

    BATTERY_LEVEL = Code("battery {level:.0f %}")
    BLE_DEVICE = Code("{device}")
    COMPUTER_EVENT = Code("this computer")
    COMPUTER_PAUSED = Code(
        "it paused for {paused_s:.1f s}, and what was sent meanwhile may be lost. Overloaded, or a virtual machine "
        "that was stopped?"
    )
    COMPUTER_SUSPENDED = Code("it was suspended for {suspended_s:.1f s}; what was sent meanwhile is lost")
    LINK_AWAY = Code("back after {away_s:.1f s}")
    LINK_CONNECTED = Code("connected")
    LINK_DISCONNECTED = Code("disconnected on request")
    LINK_ENDED = Code("ended")
    LINK_EVENT = Code("{event}: {details}")
    LINK_LOST = Code("connection lost")
    LINK_RESTORED = Code("reconnected")
    LINK_RETRYING = Code("reconnecting fails")
    MARK = Code("mark: {text}")
    MARK_NOT_KEPT = Code("not kept: nothing is recorded")
    MTU = Code("MTU {mtu}")
    MTU_TOO_SMALL = Code("MTU {mtu} is less than the {needed} that frames need: expect losses")
    MTU_UNKNOWN = Code("MTU unknown (frames need {needed})")
    NOTIFICATIONS_DROPPED = Code("{count} notifications dropped because this computer is too slow")
    PORT_SHARED = Code("also open in {holders}, which takes a part of its bytes: quit it")
    QUOTED_TEXT = Code("{text}")
    SYSTEM_TIME_SLEWED = Code(
        "its system time was slewed by {step_s:+.1f s} within {span_s:.0f s}, as time services do. The times of this "
        "session stay those of the clock at its start: {ahead_s:+.1f s} makes them those of the new time, as "
        "`treadlink set-clock` does"
    )
    SYSTEM_TIME_SET = Code(
        "its system time jumped by {step_s:+.1f s}. The times of this session stay those of the clock at its start: "
        "{ahead_s:+.1f s} makes them those of the new time, as `treadlink set-clock` does"
    )
    RETRY_INTERVAL = Code("trying again every {interval_s:g s} or sooner")
    RECORDING_CHANNEL_UNDECLARED = Code(
        "'{recording}' has messages of the undeclared channel {channel:d}, which are skipped. `treadlink repair` may "
        "recover them"
    )
    RECORDING_CHUNK_DAMAGED = Code(
        "'{recording}' has a damaged chunk near byte {at_byte:d}; {skipped_bytes:d} bytes are skipped. `treadlink "
        "repair` recovers what is left of them"
    )
    RECORDING_CUT_OFF = Code(
        "'{recording}' is cut off at byte {at_byte:d}, inside a record. `treadlink repair` completes it"
    )
    RECORDING_DESCRIPTION_DAMAGED = Code(
        "'{recording}' has a damaged description, which contains the vehicle configuration. `treadlink repair` "
        "recovers the rest"
    )
    RECORDING_PARTS_DAMAGED = Code(
        "'{recording}' is damaged in {parts:d} parts, the first near byte {at_byte:d}: {unread_bytes:d} of its "
        "{size_bytes:d} bytes are not read. `treadlink repair` recovers what is left of them"
    )
    RECORDING_RECORD_DAMAGED = Code(
        "'{recording}' has a damaged record near byte {at_byte:d}. `treadlink repair` recovers what is left of it"
    )
    RECORDING_RECORD_MISSING = Code(
        "'{recording}' has no valid record at byte {at_byte:d}; the rest is not read. `treadlink repair` recovers it"
    )
