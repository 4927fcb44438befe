"""Reasons of datasets and trends, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class FleetCode(Codes):
    """Reasons of datasets and trends."""

    ESTIMATION_FAILED = Code("treadlink has a fault, {kind}: {message}")
    RECORDING_CHANGED = Code("the file changed while it was read")
    TIRE_UNIDENTIFIED = Code(
        "{recordings} recordings have neither a vehicle's name nor a sensor's number, and may be of several tires: set "
        "name in [vehicle]"
    )
    RECORDING_NOTHING_READABLE = Code("{damage}. Its readable part gives nothing: {why}")
    WORKER_ENDED = Code("its worker process was killed or crashed each time it was tried")
    WORKER_MEMORY_ABOVE_LIMIT = Code(
        "its worker process used more than its limit of {limit_bytes:.0f MB} of memory each time it was tried"
    )
    WORKER_MEMORY_FULL = Code("its worker process had no memory left")
    WORKERS_ABSENT = Code(
        "the dask scheduler has no worker: what is not done waits until one comes, as `dask worker {address}` starts it"
    )
    WORKER_SILENT = Code(
        "worker {worker} has sent nothing for {silent_s:.0f s}: it is paused, hanging or cut off. Its recordings go "
        "once to another worker"
    )
    TREND_ALARMS = Code("alarm '{name}' in {count} of {of} recordings; the last was: {why}")
    TREND_CLOCK_WRONG = Code(
        "not used, because the recorder's clock was wrong: {path} says that it began on {date}. Set the clock and "
        "record again"
    )
    TREND_DAMAGED = Code("{count} of {of} recordings are damaged: their readable part was estimated")
    TREND_DISTANCE_CONSTANT = Code(
        "the distance is the same in all recordings: an odometer file needs readings before and after them"
    )
    TREND_DISTANCE_SHORT = Code("the recordings span {distance_m:.3g km}: a rate per 1,000 km needs {needed_m:.0f km}")
    TREND_FEW_VALID = Code("more than half of the revolutions are not used in {count} of {of} recordings: {why}")
    TREND_FINDINGS_MARKED = Code("{count} findings are marked in {file} and have not grown since")
    TREND_LAST_DEVIATES = Code(
        "the last recording, {date}, deviates from the trend by {deviation:+.1f} standard deviations"
    )
    TREND_FILE_LEFT_OUT = Code(
        "not used, because it {why}: {path}",
        why={
            "foreign": "is not a file of this dataset",
            "unreadable": "cannot be read",
        },
    )
    TREND_LOAD_STATED = Code("stated, not measured")
    TREND_LOSES_PRESSURE = Code(
        "leaks, {from_pa:.0f kPa} to {to_pa:.0f kPa} in {over_s:.3g days} at 20 °C: {loss_pa:±{std_pa} kPa} a month"
    )
    TREND_LOSS_CHANGED = Code(
        "leaks, {from_pa:.0f kPa} to {to_pa:.0f kPa} in {over_s:.3g days} at 20 °C: {after_pa:±{after_std_pa} kPa} a "
        "month in {count} recordings, {first} to {last} ({before_pa:±{before_std_pa} kPa} a month before)"
    )
    TREND_NEWEST_FALL = Code(
        "the loss of pressure may have grown: the last {count} recordings, from {date} on, are below the trend by "
        "{deviation:.1f} standard deviations"
    )
    TREND_NEWEST_LEFT = Code("without the last {count} recordings, which differ from the trend since {date}")
    TREND_NO_REVOLUTION = Code(
        "no recording has a revolution: the wheel stood still, or the sensor sent no usable signal"
    )
    TREND_NO_VALUES = Code("no recording has a value: {why}")
    TREND_NOT_MEASURED = Code(
        "no sensor has sent a {quantity}",
        quantity={"temperature": "temperature, without which a colder season looks like a loss of pressure"},
    )
    TREND_NOW_SINCE = Code("by the {count} recordings since {date}, which differ from the earlier trend")
    TREND_OUTLIERS_LEFT_OUT = Code("{count} outliers are not used")
    TREND_PASSED = Code(
        "from {date} to {until}, {name:series} deviates from its trend by {deviations:.1f} standard deviations and "
        "more in {count} recordings in a row: {first} to {last}"
    )
    TREND_PRESSURE_CONSTANT = Code(
        "the pressure sensor is stuck, or too coarse to show a loss: it reads {pressure_pa:.1f kPa} in all {count} "
        "recordings"
    )
    TREND_PRESSURE_FELL = Code(
        "leaks, {from_pa:.0f kPa} to {to_pa:.0f kPa} in {span_s:.1f h} at 20 °C: by {fall_pa:±{std_pa} kPa} ({first} "
        "to {last})"
    )
    TREND_PRESSURE_RISES = Code("the pressure rises, as by refills or weather: the tire's own loss is hidden")
    TREND_PRESSURE_STUCK = Code(
        "sensor: its pressure is stuck, and not used for the trends ({pressure_pa:.1f kPa} in {count} recordings from "
        "{first} to {last}, while the temperature varies)"
    )
    TREND_PROVISIONAL = Code("provisional in {count} of {of} recordings: {why}")
    TREND_RATE_SINCE = Code("of the {count} recordings since {date}; before, it was {before:±{std} of {unit}}")
    TREND_RECORDED_DISTANCE = Code(
        "over the recorded {distance_m:.0f km} only, less than the tire has rolled: --odometer states the rest"
    )
    TREND_REFILLS_HIDE = Code(
        "the loss may be {low_pa:.2g kPa} to {high_pa:.2g kPa} a month, as the scatter can hide refills"
    )
    TREND_REFILLS_OFTEN = Code(
        "this holds for up to {often:.0f} refills a month: in a tire that is refilled every week, a loss of up to "
        "{hidden_pa:.0f kPa} a month would not be seen"
    )
    TREND_REPEATED = Code("{count} recordings repeat another and count once: {pairs}")
    TREND_REPEATS = Code("{path} repeats {other}")
    TREND_SENSOR_CLIPS = Code("sensor: {share:±{std} %} more of its samples are at the end of its range")
    TREND_SENSOR_LOSSES = Code("sensor: {share:±{std} %} more of its samples are lost")
    TREND_SENSOR_MOVES = Code("sensor: its distance from the neutral layer has changed by {change_m:±{std} mm}")
    TREND_SENSOR_NOISE = Code("sensor: its noise is {factor:.1f} ± {std:.1f} times as large as before")
    TREND_SENSOR_STEADY = Code(
        "sensor: its gain or its zero has changed. Record at several speeds to know which (its steady radial value by "
        "{share:±{std} %}, a zero by {change_mps2:±{zero_std_mps2} m/s²})"
    )
    TREND_SLOPE_CHANGED = Code(
        "{name:series} has another trend, and is {change:±{std} of {unit}} from its earlier one at the end ({count} "
        "recordings, {first} to {last})"
    )
    TREND_SPAN_SHORT = Code("the recordings span {span_s:.2g days}: a rate per month needs {needed_s:.0f days}")
    TREND_SPEED_WITH_TIME = Code("influences of speed and time cannot be separated: the speed changes with the time")
    TREND_STATED_CHANGED = Code(
        "the stated {statement} changed on {date}: no change of the {what}",
        statement={
            "calibration": "[tire.load_calibration]",
            "load": "load of {before:.0f N} to {after:.0f N}",
            "radius": "belt radius of {before:.1f mm} to {after:.1f mm}",
            "reference": "[tire.reference]",
            "thickness": "ring_thickness_mm",
        },
    )
    TREND_STATED_LEVELS = Code(
        "what is stated of the tire changed {count} times: the level is fitted anew from each on"
    )
    TREND_STEPS = Code("{count} steps are fitted and not part of the trend")
    TREND_STIFFNESS_DRIFTS = Code("{name} changes by {share:±{std} %} a month, seen over {span_s:.3g days}")
    TREND_STRUCTURE_CHANGED = Code(
        "structure: inspect the tire {place}: the waveform far from the sensor's contact {course}, now by "
        "{change:±{std} %} of the centripetal acceleration, {scatters:.1f} scatters of a recording",
        course={
            "growing": "grows since {date}",
            "sudden": "has changed at once by {date}",
        },
        place={
            "ahead": "{from_rad:.0f deg} to {to_rad:.0f deg} ahead of the sensor, the part that enters the contact "
            "before it. Belt, tread or rim has changed there, or the sensor; which is not known",
            "unknown": "all around. Belt, tread, rim or sensor has changed at one place; which, and where, is not "
            "known",
        },
    )
    TREND_TEMPERATURE_CONSTANT = Code("the temperature varies too little, or is not known")
    TREND_TEMPERATURE_IMPOSSIBLE = Code(
        "sensor: its temperature is wrong, and not used for the trends (up to {temperature_degc:.0f degC} in {count} "
        "recordings)"
    )
    TREND_TEMPERATURE_STUCK = Code(
        "the temperature sensor may be stuck, and a colder season looks like a loss of pressure: it reads "
        "{temperature_degc:.1f degC} in all {count} recordings"
    )
    TREND_TOO_FEW = Code("{count} recordings with a value, {needed} are needed")
    TREND_TIRE_MOVED = Code(
        "came from {origin} to {target}, first recorded there on {date}; each wheel has a trend of its own"
    )
    TREND_TIRE_UNIDENTIFIED = Code(
        "the recordings may be of several tires, whose differences would look like a trend: no vehicle's name and no "
        "sensor's number says that they are of one"
    )
    TREND_TIRES_EXCHANGED = Code(
        "wheels or sensors were exchanged: sensor {sensor} came from {origin} to {target}, sensor {other} went the "
        "other way, first recorded on {date}; each wheel has a trend of its own"
    )
    TREND_TIRES_UNIDENTIFIED = Code(
        "NOT IDENTIFIED: {recordings} recordings have neither a vehicle's name nor a sensor's number, and may be of "
        "several vehicles. Their numbers are marked ~ and make no finding. Set name in [vehicle], and estimate again"
    )
    TREND_UNDETERMINED = Code("the recordings do not determine it")
    TREND_VEHICLE_WITHOUT_ODOMETER = Code(
        "the odometer file does not cover vehicle {vehicle}: its distance is the recorded one"
    )
    TREND_WEAR_CHANGED = Code(
        "wears by {after_m:±{after_std_m} mm} in 1,000 km; before, {before_m:±{before_std_m} mm}: "
        "{count} recordings, {first} to {last}"
    )
    TREND_WEAR_SOFTENS = Code("of this, {share:±{std} %} a month is the measured wear's")
    TREND_WEARS_SHORT = Code("wears by {wear_m:±{std_m} mm} in {distance_m:.0f km}")
    TREND_WEARS_FAST = Code("wears by {rate_m:±{std_m} mm} in 1,000 km; the median of the fleet is {median_m:.3f mm}")
