"""Reasons of the bring-up of a firmware, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class FirmwareCode(Codes):
    """Reasons of the bring-up of a firmware."""

    # Bring-up of a firmware
    AXES_OUT_OF_ORDER = Code(
        "the {axis} axis has the steady value of a wheel that rolls, {level_mps2:.0f m/s²}, the radial one "
        "{radial_mps2:.0f m/s²}: the order is circumferential, lateral, radial"
    )
    AXIS_STANDS = Code("the {axis} axis sends the same count for {duration_s:.1f s} while the wheel rolls")
    BLOCKS_NOT_FULL = Code(
        "a block holds {samples:.0f} samples on average, {full} fit: the link carries {more:.0%} more bytes than it"
        " must"
    )
    BLOCK_COPIED = Code(
        "the {samples} samples from number {first} are those from number {earlier} again, noise included: a buffer was "
        "sent before it was filled"
    )
    BOOT_COUNT_NOT_HIGHER = Code(
        "the hub has restarted, but boot_count went from {before:.0f} to {after:.0f}: count every start, where it "
        "survives a loss of power"
    )
    BYTES_BETWEEN_FRAMES = Code(
        "{bytes} bytes between {frames} frames: frames are sent back to back, with nothing between them"
    )
    CHECK_AT_REST = Code(
        "the wheel does not roll; at rest its axes read {share:.2f} g together, where 1 g and the zero errors are "
        "expected"
    )
    CHECK_FRAMES_LOST = Code(
        "{lost} frames are missing by their counters ({damaged} of them beside damaged bytes), {frames} arrived"
    )
    CHECK_NOT_DONE = Code(
        "{why}",
        why={
            "ac_has_no_scale": (
                "the sensor is AC-coupled, so that its steady value, and the scale with it, cannot be seen"
            ),
            "does_not_roll": "the wheel does not roll: roll it, or move the sensor on a turntable, at 10 m/s or more",
            "hub_takes_no_commands": "the hub answered no command, as one that takes none",
            "no_commands": "no command can be sent: a file, or a source that is only read",
            "no_commands_wanted": "commands were left out, as asked for",
            "no_radial_axis": "the sensor has no radial axis",
            "stopped_early": "the check ended before it came to this: give it more time with --for",
        },
    )
    CHECK_NO_KEY = Code("there is no key of {identity}: give --keys FILE")
    CHECK_TOO_SHORT = Code("{duration_s:.1f s} are too short: {needed_s:g s} are needed")
    COMMAND_ANSWERED_DAMAGED = Code("a command with a wrong CRC was answered: it must be dropped without an answer")
    COMMAND_ANSWER_LATE = Code("no answer to {command} within {waited_s:g s}, although the hub answers commands")
    COMMAND_ANSWER_NOT_OF_HUB = Code(
        "COMMAND_RESULT comes from wheel {wheel}: it is sent by the hub itself (wheel 255)"
    )
    COMMAND_OUTCOME_WRONG = Code("{command} was answered with outcome {outcome}; {expected} is right here")
    COMMAND_REPLY_MISMATCH = Code(
        "COMMAND_RESULT states command {command} and seq {seq}; the command sent was {sent}, seq {sent_seq}"
    )
    COUNTS_OFFSET_BINARY = Code(
        "counts jump by the whole range, and are smooth with the highest bit inverted: they are offset binary; "
        "int16 is two's complement"
    )
    DROPS_NOT_NUMBERED = Code(
        "frames_dropped rose by {dropped:.0f}, but only {missing:.0f} numbers are missing: a frame that cannot be "
        "sent must use its number"
    )
    FRAME_CRC_VARIANT = Code(
        "the CRC of the frames is {how}: CRC-32 of zlib over all bytes before it, little endian",
        how={
            "always_zero": "always 0",
            "big_endian": "big endian",
            "bzip2": "not reflected (CRC-32/BZIP2)",
            "castagnoli": "CRC-32C (Castagnoli)",
            "from_zero": "with the initial value 0",
            "from_zero_not_inverted": "with the initial value 0 and without the final inversion",
            "mpeg2": "not reflected (CRC-32/MPEG-2)",
            "not_inverted": "without the final inversion",
            "of_header": "over the header only",
            "of_payload": "over the payload only",
            "of_words": "not reflected, over words (the default of an STM32's CRC unit)",
            "without_sync": "without the sync",
        },
    )
    FRAME_CRC_WRONG = Code(
        "frames start, but the CRC of none is right: CRC-32 of zlib over all bytes before it, little endian "
        "(`treadlink protocol vectors`)"
    )
    FRAME_FLAGS_UNKNOWN = Code("flags are {flags}: only bit 0 is defined, all others are 0")
    FRAME_LENGTH_COUNTS = Code(
        "length counts {how}: it is that of the payload alone",
        how={
            "frame": "header, payload and CRC",
            "with_crc": "payload and CRC",
            "with_header": "header and payload",
        },
    )
    FRAME_TYPE_UNKNOWN = Code("type {type} is not defined")
    FRAME_VERSION_WRONG = Code(
        "the version byte is {version}: 0x10, the version in which the layout of the frame appeared"
    )
    FRAME_WITHOUT_TAG = Code("bit 0 of flags is set, but the payload has no room for a tag")
    HELLO_ABSENT_AXES_FILLED = Code("range, scale and zero of axes that the mask lacks should be 0: {axes}")
    HELLO_OTHER_MAJOR = Code("HELLO states protocol {major}.{minor}, its frame 1.0")
    LINK_NEARLY_FULL = Code(
        "the samples take {needed:.0f} bytes/s, {share:.0%} of the {capacity:.0f} bytes/s that the link carries"
    )
    LOG_HAS_CONTROLS = Code("a log text has control characters; it should be one line")
    LOG_LEVEL_RESERVED = Code("log level {level} is reserved")
    LOG_NOT_UTF8 = Code("a log text is not UTF-8")
    LOG_TOO_OFTEN = Code("{lines} log texts within a second, at most 10 are allowed")
    MESSAGE_RATE_WRONG = Code("{type} came {count} times in {span_s:.1f s}, {due:.0f} are due")
    PAYLOAD_LENGTH_WRONG = Code(
        "the payload of {type} has {length} bytes, its layout {layout}: a C struct must be packed"
    )
    PAYLOAD_VALUE_WRONG = Code("{field} of {type} is outside its range")
    RATE_NOT_EXACT = Code(
        "samples come at {measured_hz:.2f Hz} by the hub's clock, {share:+.2%} from the {stated_hz:g Hz} of HELLO; "
        "0.1 % is recommended"
    )
    SAMPLES_BEFORE_HELLO = Code("SAMPLES come before the first HELLO of the wheel")
    SAMPLES_DROPPED_BY_HUB = Code("the hub has dropped {holes:.0f} samples, as first_sample and HUB_STATUS say")
    SAMPLES_NOT_SWITCHED = Code(
        "{state} {waited_s:g s} after SET_STREAM was done",
        state={"on": "no SAMPLES within", "off": "SAMPLES still come"},
    )
    SAMPLE_NUMBERS_HOLES = Code(
        "first_sample leaves out {holes:.0f} samples, but no frame is missing and samples_dropped of HUB_STATUS "
        "does not rise"
    )
    SAMPLE_NUMBERS_OVERLAP = Code(
        "first_sample rose by {step:.0f} after a block of {samples:.0f} samples: it counts samples"
    )
    PRESSURE_LIKE_KPA = Code("pressure_pa is {pressure_pa:.0f} Pa: is it in kPa?")
    ROWS_TRANSPOSED = Code(
        "counts are smooth when a block is read axis by axis, {ratio:.0f} times smoother than row by row: each row has "
        "the counts of all axes at one instant"
    )
    SCALE_OFF_BY_POWER_OF_TWO = Code(
        "the steady radial value is {level_mps2:.0f m/s²}, {ratio:.2f} times R Omega² = {expected_mps2:.0f m/s²} (R"
        " = {radius_m:.0f mm}, --radius): is the scale wrong by a factor of 2 to the power of {power}? Check how "
        "many bits a word of the sensor has, and how they are aligned"
    )
    SEQ_BIG_ENDIAN = Code("seq counts in the wrong order of bytes: it is sent little endian")
    SEQ_GOES_BACK = Code("seq {seq:.0f} is lower than before, without a restart: it has 32 bits and does not go back")
    SEQ_JUMPS = Code("seq jumped over {gap:.0f} numbers to {seq:.0f}")
    SEQ_NOT_FROM_ZERO = Code("the first seq after the start is {seq:.0f}: it counts from 0 at every start")
    SEQ_REPEATED = Code(
        "seq {seq:.0f} came again: it counts the frames of every type, and a reader drops repeated ones"
    )
    SEQ_SHARED = Code("all sources share one seq: every wheel, and the hub itself, has a counter of its own")
    SEQ_STANDS = Code("seq is {seq:.0f} in every frame")
    SET_RATE_NOT_STATED = Code(
        "HELLO states {stated_hz:g Hz} still, {waited_s:g s} after SET_RATE was done: it follows at once when the "
        "rate changes"
    )
    SOME_FRAMES_DAMAGED = Code(
        "{damaged} times a frame was damaged, {frames} are intact: a bad cable or ground, an overrun, or a buffer "
        "that is overwritten while it is sent"
    )
    SOURCE_SIGNS_SOME_FRAMES = Code("some frames are signed and some are not: a source signs all of its frames or none")
    STATUS_FRAMES_SENT_WRONG = Code(
        "frames_sent rose by {stated:.0f} while {arrived:.0f} frames arrived or are missing"
    )
    STATUS_UPTIME_WRONG = Code("uptime_s is {uptime_s:.0f} when the clock is at {clock_s:.1f s}")
    TAG_WRONG = Code("the tag is not that of the key of {identity} and boot_count {boot_count}")
    TICK_GOES_BACK = Code(
        "tick_us went back by {back_us:.0f} to {tick_us:.0f}: it has 32 bits, is never set, and wraps every 71.6 "
        "minutes"
    )
    TICK_IN_OTHER_UNIT = Code(
        "tick_us counts {unit}, not us: it advanced {pace:.4g} times as far as {duration_s:.1f s} of this "
        "computer's clock"
    )
    TICK_JITTERS = Code(
        "tick_us of the blocks scatters over {spread_s:.1f ms} about an even rate ({std_s:.2f ms} standard "
        "deviation): take it in the sensor's interrupt"
    )
    TICK_NOT_OF_FIRST_SAMPLE = Code(
        "frames sent after a block have tick_us {tick_us:.0f}, before the block's last sample: tick_us of SAMPLES "
        "is that of the first sample"
    )
    TICK_PACE_WRONG = Code("tick_us advanced {pace:.4f} times as far as {duration_s:.1f s} of this computer's clock")
    TICK_STANDS = Code("tick_us is {tick_us:.0f} in two messages in a row")
    TIME_NOT_ECHOED = Code("host_ns of TIME_SYNC is {host_ns}, not the {sent_ns} of SET_TIME")
