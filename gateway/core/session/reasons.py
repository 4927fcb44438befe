"""Reasons of sessions, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class SessionCode(Codes):
    """Reasons of sessions."""

    ALL_FRAMES_REFUSED = Code("all {count} frames were rejected: their signatures could not be verified")
    NO_FRAME_RECEIVED = Code("no frame was received that can be used: there is nothing to estimate")
    ALARM_CLEARED = Code("alarm over at {at_s:.1f s}, after {duration_s:.1f s}: {what}")
    ALARM_COMES_AND_GOES = Code(
        "ALARM at {at_s:.1f s}: {alarm}. It comes and goes: it is reported again after a minute without change"
    )
    ALARM_RAISED = Code("ALARM at {at_s:.1f s}: {alarm}")
    ALARM_STANDS = Code("ALARM still at {at_s:.1f s}: {alarm}")
    VALUE_ABOVE_LIMIT = Code(
        quantity={
            "pressure_pa": "pressure {value:.0f kPa} is above {limit:.0f kPa}",
            "temperature_degc": "inner liner at {value:.0f degC}, above {limit:.0f degC}",
            "load_n": "load {value:.0f N} is above {limit:.0f N}",
            "speed_mps": "speed {value:.0f km/h} is above {limit:.0f km/h}",
            "wear_m": "wear {value:.1f mm} is above {limit:.1f mm}",
            "frame_loss": "{value:.2f %} of the latest frames lost, above {limit:.2f %}",
        },
    )
    VALUE_BELOW_LIMIT = Code(
        quantity={
            "pressure_pa": "pressure {value:.0f kPa} is below {limit:.0f kPa}",
            "battery": "battery at {value:.0f %}, below {limit:.0f %}",
        },
    )
    VALUE_NOW = Code(
        quantity={
            "pressure_pa": "pressure {value:.0f kPa}",
            "temperature_degc": "inner liner at {value:.0f degC}",
            "load_n": "load {value:.0f N}",
            "speed_mps": "speed {value:.0f km/h}",
            "wear_m": "wear {value:.1f mm}",
            "frame_loss": "{value:.2f %} of the latest frames lost",
            "battery": "battery at {value:.0f %}",
        },
    )
    LINK_DOWN = Code("the link is down: {state}")
    SENSOR_RANGE_REACHED = Code("{count} samples are at the end of the sensor's range")
    AXIS_SILENT = Code(
        "the {axis} axis is silent for {silence_s:.0f s}, though HELLO states it: samples without it are not used"
    )
    BUS_NOT_MAPPED = Code(
        "no signal of this bus is mapped: its frames are recorded, but nothing is shown or compared. List the signals "
        "in [vehicle_signals] of the vehicle file"
    )
    BUS_SILENT = Code(
        "no frame of the vehicle's bus for {silence_s:.0f s}. Is the ignition off, a cable loose, or the bus off?"
    )
    HUB_OF_WHEEL_SILENT = Code("no frame of its hub for {silence_s:.0f s}")
    HUB_SILENT = Code(
        "no frame for {silence_s:.0f s} (wheels: {wheels}). Is its battery empty, is it out of range, or stopped?"
    )
    POSITION_MISSING = Code(
        "the receiver has had no position for {silence_s:.0f} s. Is it in a tunnel or building, or its antenna "
        "unplugged?"
    )
    RECEIVER_SILENT = Code(
        "no sentence of the receiver for {silence_s:.0f} s. Is it unplugged, switched off, or set to another baud rate?"
    )
    SAMPLES_MISSING = Code("no samples for {silence_s:.0f s}. Check its sensor's battery, distance and antenna")
    SAMPLES_SILENT = Code(
        "no samples for {silence_s:.0f s}, only other messages of its sensor. Were they stopped by a command, or does "
        "its firmware have a fault?"
    )
    SENDS_AGAIN = Code("it sends again after {away_s:.1f s}")
    SENSOR_NEVER_HEARD = Code(
        "nothing usable was received from its sensor in {silence_s:.0f s}. Is it switched on, and are hub and wheel "
        "number as configured?"
    )
    SENSOR_SILENT = Code(
        "its sensor is silent for {silence_s:.0f s}, its hub is not. Is its battery empty, is it out of range or "
        "broken?"
    )
    LINK_NOT_OPEN = Code("not open yet")
    SINK_DOWN = Code("nothing is published, {waiting} items wait: {state}")
    SINK_DROPS = Code("items are dropped, {dropped} so far: {state}")
    FIRMWARE_UNREADABLE = Code(
        "the firmware uses protocol {major}.x and treadlink {own}.x, so no frame can be read. Update {older}",
        older={"firmware": "the hub's firmware", "treadlink": "treadlink"},
    )
    FRAMES_DAMAGED = Code(
        "{share:.0f %} of the frames arrive damaged and are not used. Check cable, ground, distance and baud rate"
    )
    FRAMES_RESUMED = Code("frames arrive now")
    FRAMES_WITH_BAD_PAYLOAD = Code(
        "frames with a valid checksum are skipped, because their content violates the protocol: a fault of the "
        "firmware. `treadlink protocol check` names the fields"
    )
    FRAMES_WITH_UNKNOWN_FLAGS = Code("frames with unknown flags are skipped and counted")
    HUB_RESTARTED = Code("it restarted (boot count {boot_count}): its counters and times start again")
    HUB_RESTARTS_REPEATEDLY = Code("it restarts again and again: check its supply. Further restarts are not reported")
    LINK_NO_DATA_YET = Code(
        "open, but no data yet. Is the hub powered, awake and set to send? Are TX and RX connected correctly?"
    )
    LINK_RESUMED = Code("data arrives again")
    LINK_SILENT = Code(
        "open, but no data for {silence_s:.0f s}. Is the hub powered, awake and set to send? Are TX and RX "
        "connected correctly?"
    )
    PROTOCOL_DIFFERS = Code(
        how={
            "newer": (
                "its firmware uses protocol {version}, newer than treadlink's {own}: what both support is read, the "
                "rest is skipped and counted. Update treadlink"
            ),
            "newer_layout": (
                "frames of a layout newer than protocol {own} are skipped and counted: the firmware is newer. Update "
                "treadlink"
            ),
            "older": (
                "it takes only unsigned commands: its firmware uses protocol {version}, older than treadlink's {own}"
            ),
        },
    )
    NO_FRAMES = Code("data arrives, but no frame is in it: {content}")
    NO_FRAMES_ANY_MORE = Code("data arrives, but no frame is in it any more, after {frames} frames: {content}")
    NO_HELLO = Code(
        "samples arrive, but no valid HELLO for {silence_s:.0f s}: without rate and scale nothing can be estimated. A "
        "hub sends a HELLO every 2 s. Restart the hub; `treadlink protocol check` says what is wrong with a HELLO"
    )
    CHECK_SOURCE_ADDRESS = Code("Check the address of the source")
    CHOOSE_HUB_PORT = Code("Choose the hub's port; `treadlink doctor` lists the ports")
    LINE_ALL_FRAMES_DAMAGED = Code(
        "frames start, but all are damaged: a bad cable or ground, an overrun, or firmware with a wrong CRC "
        "(`treadlink protocol` prints test vectors)"
    )
    LINE_CONSTANT = Code(
        "every byte is {byte}: the line is held at one level. Is the hub powered, and are its data wire and "
        "ground connected?"
    )
    LINE_NOT_A_HUB = Code(
        "this is {device}. {remedy}",
        device={
            "gps": "a GPS receiver (NMEA text), not a hub",
            "u-blox": "a u-blox receiver, not a hub",
            "unknown": "not a hub",
        },
    )
    LINE_SYNC_SWAPPED = Code(
        "this is not a hub as it is: the two sync bytes of its frames are swapped (5A A5 instead of A5 5A). A fault"
        " of the firmware"
    )
    LINE_TEXT = Code("this is another device, which sends text: '{line}'. {remedy}")
    LINE_WRONG_BAUD_RATE = Code(
        "wrong baud rate, or another device on the port. Set the hub's rate, for example ?baudrate=115200; the "
        "default is {default_baud}"
    )
    OTHER_SENSOR = Code(
        how={
            "replaced": "sensor {sensor} is here, but the configuration has {expected}: is it a new sensor or tire?",
            "swapped": (
                "sensor {sensor} of {owner} is here: were wheels swapped? Estimates use load and tire of {position}"
            ),
        },
    )
    WHEEL_ADDRESS = Code("{position} (hub {hub}, wheel {wheel})")
    WHEEL_NOT_CONFIGURED = Code(
        "not configured{vehicle_file}: belt radius {radius_m:g mm} is assumed, the load is unknown",
        vehicle_file={
            "none": " (state it with --config VEHICLE.toml)",
            "others": " (the configuration has {configured})",
        },
    )
    HELLO_AXES_DIFFER = Code(
        "samples have the axes {sent}, but HELLO states {stated}: {count} blocks are not used. A fault of the firmware"
    )
    HELLO_HIGHPASS_WITH_DC = Code(
        "HELLO states DC coupling and a high-pass at {highpass_hz:g Hz} ({count} so far). The high-pass is ignored; if "
        "there is one, the firmware must state AC"
    )
    HELLO_KEEPS_CHANGING = Code(
        "HELLO keeps changing without a restart ({count} so far): each change of sensor, rate or axes starts the wheel "
        "anew. A faulty hub, two sensors under one number, or forged frames"
    )
    HELLO_RATE_DIFFERS = Code(
        "HELLO states {stated_hz:g Hz}, but samples come at {measured_hz:.0f Hz} by the hub's clock ({count} "
        "so far, each over {duration_s:g s}). One of the two is wrong: a fault of the firmware"
    )
    HELLO_SCALE_ABSURD = Code(
        "HELLO states a full scale of {full_scale_mps2:.3g m/s²} for the {axis} axis, which no tire sensor has "
        "({count} so far). Its accelerations are wrong"
    )
    HELLO_SCALE_AGAINST_RANGE = Code(
        "HELLO states a range of {range_mps2:.4g m/s²} for the {axis} axis, but scale and saturation give "
        "{full_scale_mps2:.4g m/s²} ({count} so far). Its accelerations may be wrong"
    )
    HELLO_SCALE_ZERO = Code(
        "HELLO states a scale of 0 for {axes} ({count} so far): such an axis cannot be used. A fault of the firmware"
    )
    HELLO_SENSORS_ALTERNATE = Code(
        "sensors {sensor} and {other} announce themselves in turn as this wheel ({count} so far): estimates of two "
        "sensors are mixed. Give each a wheel number of its own"
    )
    HELLO_ZERO_ABSURD = Code(
        "HELLO states {offset_counts:.6g} counts at zero acceleration for the {axis} axis, more than a sample can have "
        "({count} so far). Its accelerations are wrong"
    )
    HUB_BOOT_COUNTS_DIFFER = Code(
        "its wheels state different boot counts, {own:.0f} and {other:.0f} ({count} so far): each change is taken "
        "for a restart. A fault of the firmware"
    )
    HUB_CLOCK_STILL = Code(
        "the hub's clock does not advance while samples arrive ({count} so far, each over {duration_s:g s}): "
        "times and the sampling rate cannot be checked. A fault of the firmware"
    )
    HUB_NUMBER_RESERVED = Code(
        "the hub cannot be commanded alone: its number, 255, means every hub. Give it another ({count} HELLOs)"
    )
    HUB_SENDS_AS_WHEEL = Code(
        "the hub sends messages of a wheel under its own number, 255: {count} frames are not used. A fault of the "
        "firmware"
    )
    HUB_SENDS_COMMANDS = Code(
        "commands arrive from the hub ({count} frames), which only a gateway sends: is the line looped back?"
    )
    HUB_TIME_AGAINST_TICK = Code(
        "TIME_SYNC states {hub_us:.0f} us in a frame of tick {tick_us:.0f} us ({count} so far), a fault of the firmware"
    )
    ONLY_UNKNOWN_TYPES = Code(
        "it sends nothing but frames of unknown types ({count} so far). Update treadlink, or check the firmware"
    )
    PRESSURE_IMPOSSIBLE = Code(
        "the sensor states {pressure_pa:.0f kPa} ({count} so far), which no tire has: these readings are not used"
    )
    SAMPLES_REPEATED = Code("it sends the same samples again, a fault of the firmware: {count} blocks are not used")
    SAMPLE_NUMBERS_JUMP = Code(
        "sample numbers jump against the hub's clock, last by {last_s:+.3g s} ({count} so far): a restart of the "
        "sensor that HELLO does not show, or a fault of the firmware. The jumps are not counted as lost"
    )
    TEMPERATURE_IMPOSSIBLE = Code(
        "the sensor states {temperature_degc:.0f degC} ({count} so far), which no tire has: these readings are not used"
    )
    WHEELS_REFUSED = Code(
        "{count} wheel numbers beyond the {most} that a session takes are not used. A faulty hub, or forged frames: "
        "configure the wheels, and sign frames"
    )
    COMMAND_REFUSED = Code(
        "did not execute {command}: {outcome}",
        outcome={
            "unknown_command": "it does not know the command",
            "value_refused": "it refused the value",
            "failed": "the command failed",
            "not_verified": "the command is not signed, or signed with another key",
            "repeated": "the command was repeated: its counter is not above that of an earlier one",
        },
    )
    CORE_STUCK = Code(
        "does not answer for {stuck_s:.0f s}: there are no results until it does, the recording goes on. Leave it "
        "out, or repair it"
    )
    CORE_GOES_ON = Code("answers again after {stuck_s:.0f s}")
    EFFECTS_SUBTRACTED = Code("subtracted from its axes at {ranges}: {effects}")
    HUB_LOG = Code("log ({severity}): {text}")
    HUB_LOG_LEFT_OUT = Code("{count} more lines of its hubs left out: at most ten a second are shown")
    VALUE_RANGE = Code(
        quantity={
            "load_n": "{low:.0f} to {high:.0f N}",
            "pressure_pa": "{low:.0f kPa} to {high:.0f kPa}",
            "speed_mps": "{low:.0f km/h} to {high:.0f km/h}",
        },
    )
    DISK_SPACE = Code(
        "the disk has {lasts}",
        lasts={
            "hours": "{free_bytes:.1f GB} left, which lasts {left_s:.1f h} at the present pace",
            "little": "{free_bytes:.1f MB} left: free some space",
            "minutes": "{free_bytes:.1f MB} left and is full in {left_s:.0f min}: free some space",
            "unknown": "{free_bytes:.1f GB} left",
        },
    )
    RESULTS_LATE = Code(
        "results come {late_s:.0f s} late: this computer is too slow. Choose fewer estimators, or record now and "
        "estimate later"
    )
    RECORDING_BEGUN = Code("recording to {path}")
    RECORDING_FINISHED = Code("recording {path} finished")
    RECORDING_STOPPED = Code("RECORDING STOPPED: {error}. {remedy}")
    RECORDING_PART_REFUSED = Code("{error}. The recording goes on in the present file, and tries again")
    THREAD_STOPPED = Code("stopped by an internal error: {error}")
    STAGE_BEHIND = Code(
        "{stage}. Dropped data is counted",
        stage={
            "recording": "the disk is too slow: bytes are MISSING FROM THE RECORDING",
            "topics": "the disk is too slow: decoded values are left out of the recording, raw bytes are kept",
            "decoding": (
                "this computer is too slow to decode and estimate. Dropped data is counted; a recording has all of it"
            ),
            "view": "the screen is too slow: lines are left out",
        },
    )
    TIMES_REFUSED = Code(
        "frames are refused and counted, because their time is not between 1970 and 2116: that of the first is "
        "{time_s:utc}"
    )
    COUNTERS_NOT_SAVED = Code(
        "frames of this session could be replayed to the next one: {how}",
        how={
            "late": "the counters of the sensors could not be written in time",
            "refused": "{error}. {remedy}",
        },
    )
    FRAMES_NOT_TRUSTED = Code("frames that are not trusted: {counts}")
    FRAMES_VERDICT = Code("{count} {verdict}")
