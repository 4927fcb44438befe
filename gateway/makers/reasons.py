"""Reasons of the bring-up of a firmware, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class FirmwareCode(Codes):
    """Reasons of the bring-up of a firmware."""

    CHECK_NOT_DONE = Code(
        why={
            "ac_has_no_scale": "an AC-coupled sensor sends no steady value, so its scale cannot be checked",
            "at_rest": (
                "the wheel does not roll: roll it; at rest its axes read {share:.2f} g together, where 1 g and the "
                "zero errors are expected"
            ),
            "does_not_roll": (
                "the wheel does not roll, or slowly: roll it, or move the sensor on a turntable, at 10 m/s or more"
            ),
            "hub_takes_no_commands": "the hub answered no command: either it takes none, or it received none",
            "no_commands": "no command can be sent: the source is a file, or is only read",
            "no_commands_wanted": "commands were switched off by an option",
            "no_key": "there is no key of {identity}: state it with --keys FILE",
            "no_radial_axis": "the sensor has no radial axis",
            "stopped_early": "the check ended before it came to this: give it more time with --for",
            "too_short": (
                "{duration_s:.1f s} were received (in a dump by the hub's clock), {needed_s:g s} are needed: give it "
                "more time with --for"
            ),
        },
    )
    BYTES_BETWEEN_FRAMES = Code(
        "{bytes} bytes are between {frames} frames: send frames back to back, with nothing between them"
    )
    FRAME_CRC_VARIANT = Code(
        "the CRC of the frames is {how}: use CRC-32 of zlib over all bytes before it, little endian",
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
        "frames start, but the CRC of none is right: use CRC-32 of zlib over all bytes before it, little endian "
        "(`treadlink protocol vectors` prints examples)"
    )
    HEADER_WRONG = Code(
        field={
            "flags": "the flags are {value}: only bit 0 is defined, all others must be 0",
            "tag": "bit 0 of the flags is set, but the payload has no room for a tag",
            "type": "type {value} is not defined",
            "version": "the version byte is {value}: it must be 0x10, the version in which this layout appeared",
        },
    )
    FRAME_LENGTH_COUNTS = Code(
        "the length counts {how}: it must count the payload alone",
        how={
            "frame": "header, payload and CRC",
            "with_crc": "payload and CRC",
            "with_header": "header and payload",
        },
    )
    PAYLOAD_WRONG = Code(
        what={
            "length": "the payload of {type} has {length} bytes, its layout {layout}: pack the C struct",
            "value": "{field} of {type} is outside its range",
        },
    )
    SOME_FRAMES_DAMAGED = Code(
        "a frame was damaged {damaged} times, {frames} are intact: {cause}",
        cause={
            "altered": "the port or a terminal program alters bytes: set it to raw mode, without flow control",
            "unknown": (
                "check cable and ground, the receiver's buffer, and that no buffer is overwritten while it is sent"
            ),
        },
    )
    CHECK_FRAMES_LOST = Code(
        "{lost} frames are missing by their counters ({damaged} of them beside damaged bytes), {frames} arrived"
    )
    BOOT_COUNT_NOT_HIGHER = Code(
        "the hub has restarted, but boot_count went from {before:.0f} to {after:.0f}: count every start, and store "
        "the count where it survives a loss of power"
    )
    DROPS_NOT_NUMBERED = Code(
        "frames_dropped rose by {dropped:.0f}, but only {missing:.0f} numbers are missing: a frame that cannot be "
        "sent must use its number"
    )
    SEQ_WRONG = Code(
        how={
            "big_endian": "seq counts in the wrong order of bytes: send it little endian",
            "goes_back": "seq {seq:.0f} is lower than the one before, without a restart: it must not go back",
            "jumps": "seq jumped over {gap:.0f} numbers to {seq:.0f}: it must rise by 1 with every frame",
            "not_from_zero": "the first seq after the start is {seq:.0f}: count from 0 at every start",
            "repeated": "seq {seq:.0f} came twice: count the frames of every type; receivers drop a repeated number",
            "shared": "all sources share one seq: every wheel, and the hub itself, needs a counter of its own",
            "stands": "seq is {seq:.0f} in every frame: it must rise by 1 with every frame",
        },
    )
    TICK_WRONG = Code(
        how={
            "goes_back": (
                "tick_us went back by {back_us:.0f} to {tick_us:.0f}: it has 32 bits, is never set, and wraps every "
                "71.6 minutes"
            ),
            "jitters": (
                "tick_us of the blocks scatters over {spread_s:.1f ms} about an even rate ({std_s:.2f ms} standard "
                "deviation): take it in the sensor's interrupt"
            ),
            "ms": (
                "tick_us counts ms, not us: by it samples come at {measured_hz:.0f Hz}, where HELLO states "
                "{stated_hz:g Hz}"
            ),
            "not_of_first_sample": (
                "frames sent after a block have tick_us {tick_us:.0f}, before the block's last sample: tick_us of "
                "SAMPLES must be that of the first sample"
            ),
            "other_unit": (
                "tick_us counts {unit}, not us: it advanced {pace:.4g} times as far as {duration_s:.1f s} of this "
                "computer's clock"
            ),
            "pace": "tick_us advanced {pace:.4f} times as far as {duration_s:.1f s} of this computer's clock",
            "stands": "tick_us is {tick_us:.0f} in two messages in a row: it must advance",
        },
    )
    TIME_NOT_ECHOED = Code("host_ns of TIME_SYNC is {host_ns}: it must be that of SET_TIME, {sent_ns}")
    HELLO_WRONG = Code(
        how={
            "absent_axes": "range, scale and zero of axes that the mask lacks should be 0: {axes}",
            "late": "SAMPLES come before the first HELLO of the wheel: send HELLO first",
            "major": "HELLO states protocol {major}.{minor}, its frame 1.0",
        },
    )
    LOG_TEXT_WRONG = Code(
        how={
            "controls": "a log text has control characters: it should be one line",
            "level": "log level {level} is reserved",
            "not_utf8": "a log text is not UTF-8",
            "too_often": "{lines} log texts were sent within a second: at most 10 are allowed",
        },
    )
    MESSAGE_RATE_WRONG = Code("{type} came {count} times in {span_s:.1f s}: {due:.0f} are due")
    PRESSURE_LIKE_KPA = Code("pressure_pa is {pressure_pa:.0f} Pa: is it in kPa?")
    STATUS_WRONG = Code(
        field={
            "frames_sent": "frames_sent rose by {stated:.0f} while {arrived:.0f} frames arrived or are missing",
            "uptime_s": "uptime_s is {uptime_s:.0f} when the clock is at {clock_s:.1f s}",
        },
    )
    BLOCKS_NOT_FULL = Code(
        "a block holds {samples:.0f} samples on average, {full} fit: the link carries {more:.0%} more bytes than needed"
    )
    COUNTS_WRONG = Code(
        how={
            "axes_order": (
                "the {axis} axis has the steady value of a wheel that rolls, {level_mps2:.0f m/s²}, the radial one "
                "{radial_mps2:.0f m/s²}: the order must be circumferential, lateral, radial"
            ),
            "axis_stands": "the {axis} axis sends the same count for {duration_s:.1f s} while the wheel rolls",
            "offset_binary": (
                "counts jump by the whole range, and are smooth with the highest bit inverted: they are offset binary; "
                "send int16 as two's complement"
            ),
            "repeated": (
                "the {samples} samples from number {first} are those from number {earlier} again, noise included: a "
                "buffer was sent before it was filled"
            ),
            "transposed": (
                "counts are smooth when a block is read axis by axis, {ratio:.0f} times smoother than row by row: each "
                "row must have the counts of all axes at one instant"
            ),
        },
    )
    LINK_NEARLY_FULL = Code(
        "the samples take {needed:.0f} bytes/s, {share:.0%} of the {capacity:.0f} bytes/s that the link carries"
    )
    RATE_NOT_EXACT = Code(
        "samples come at {measured_hz:.2f Hz} by the hub's clock, {share:+.2%} from the {stated_hz:g Hz} of HELLO: "
        "0.1 % is recommended"
    )
    NUMBERS_WRONG = Code(
        how={
            "dropped": "the hub has dropped {holes:.0f} samples, as first_sample and HUB_STATUS state",
            "holes": (
                "first_sample leaves out {holes:.0f} samples, but no frame is missing and samples_dropped of "
                "HUB_STATUS does not rise"
            ),
            "overlap": "first_sample rose by {step:.0f} after a block of {samples:.0f} samples: count every sample",
        },
    )
    SCALE_OFF_BY_POWER_OF_TWO = Code(
        "the scale may be wrong by a factor of 2 to the power of {power}: check how many bits a word of the sensor "
        "has, and how they are aligned (the steady radial value is {level_mps2:.0f m/s²}, {ratio:.2f} times R Omega² = "
        "{expected_mps2:.0f m/s²}, with R = {radius_m:.0f mm} of --radius)"
    )
    ANSWER_WRONG = Code(
        how={
            "late": "{command} was not answered within {waited_s:g s}, although the hub answers commands",
            "not_of_hub": "COMMAND_RESULT comes from wheel {wheel}: the hub itself (wheel 255) must send it",
            "other_command": "COMMAND_RESULT is of command {command}, seq {seq}; sent was {sent}, seq {sent_seq}",
            "outcome": "{command} was answered with outcome {outcome}: {expected} is right here",
            "to_damaged": "a command with a wrong CRC was answered: drop it without an answer",
        },
    )
    COMMAND_FUTILE = Code(
        command={
            "rate": "HELLO still states {stated_hz:g Hz} {waited_s:g s} after SET_RATE was done: send it at once",
            "stream_off": "SAMPLES still come {waited_s:g s} after SET_STREAM was done",
            "stream_on": "no SAMPLES came within {waited_s:g s} after SET_STREAM was done",
        },
    )
    SIGNATURE_WRONG = Code(
        how={
            "some_frames": "some frames are signed and some are not: a source must sign all of its frames or none",
            "tag": "the tag is not that of the key of {identity} and boot_count {boot_count}",
        },
    )
