"""Reasons of the diagnosis, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class DiagnosisCode(Codes):
    """Reasons of the diagnosis."""

    # Revolutions
    EFFECTS_ENLARGE_ERROR = Code(
        "the effects make the error larger ({before_mps2:.3g} -> {after_mps2:.3g m/s²}): they are not those of this "
        "tire and sensor"
    )

    # Plug-ins
    PLUGIN_EFFECT_TAKEN = Code("its name or its rank is that of {effect} of {by}, rank {rank}")

    # Recordings of a campaign
    AXES_LEFT_OUT = Code("left out: the {axes} axes, which may not be what they are taken for")
    AXIS_CONSTANT = Code("the {axis} axis reads one value throughout {count} revolutions, dead or stuck: left out")
    SAMPLES_STUCK = Code(
        "data fault: {samples} samples ({share:.2%}) repeat the one before on every axis, in {runs} stretches of three "
        "or more, far beyond chance; check sensor, hub and link"
    )
    SAMPLES_BRIDGED = Code(
        "data fault: {samples} samples ({share:.2%}) are on {lines} straight lines in every axis, far beyond chance: "
        "bridged gaps, which bias the numbers. A new import of the measurement leaves them out"
    )
    DIFFERENT_SENSORS = Code("the recordings are of different sensors: {sensors}")
    RECORDING_DAMAGED = Code("{damage}. The readable part is used")
    RECORDING_ORDER_UNKNOWN = Code(
        "the recordings' times do not give their order: taken one after another, in the order given"
    )
    RECORDING_REPEATS = Code("holds the same revolutions as {other}")
    RECORDING_WITHOUT_DATA = Code("contains nothing that can be used")
    RECORDING_WITHOUT_WHEEL = Code("contains no revolution of wheel {wheel}")
    LEFT_WHEN_ENDED = Code(
        "the search ended with {residual_ratio:.3g} times the rms of the noise of the means unexplained: no number is "
        "determined, and nothing identified"
    )
    NUMBERS_CONTRADICT = Code(
        "{number} is {low:.3g} in {recording} alone and {high:.3g} in {other}, beyond their errors: tire, load or "
        "pressure is not as stated; no number is determined"
    )
    NOT_A_RING = Code(
        "the signal is not that of a ring: {share:.0%} of its rms is left unexplained, so no number is determined: "
        "{recordings}"
    )
    REVOLUTIONS_CLIPPED = Code("the radial axis is clipped in {count} of {total} revolutions")
    SENSOR_ALARM = Code("alarm of the sensor: {reason}")
    SENSOR_IN_DOUBT = Code("no number is determined where the sensor itself is in doubt: {recordings}")
    ABOUT_RECORDING = Code("{recording}: {reason}")
    RECORDING_LEFT_OUT = Code("{recording} left out: {reason}")
    SEVERAL_SENSORS = Code("several")

    # Recordings of a dataset
    RECORDING_NOT_READ = Code("{message}")
    RECORDING_NOT_USED = Code("{message}")

    # Provenance of conditions
    ASSUMED_LOAD = Code("load {load_n:.0f N} (not stated)")
    ASSUMED_OFFSET = Code("mounting offset 0.0 mm below the neutral layer (neither stated nor measured)")
    ASSUMED_PRESSURE = Code("pressure {pressure_pa:.0f kPa} (neither stated nor measured)")
    ASSUMED_TEMPERATURE = Code("temperature steady (neither stated nor measured)")
    GROUP_LABEL = Code(
        "{recording}: {speed_mps:.1f km/h}, {load_n:.0f N}, {pressure_pa:.0f kPa}{temperature}{way}",
        temperature={"known": ", {temperature_degc:.0f degC}", "unknown": ""},
        way={"forward": "", "reverse": ", reverse"},
    )
    OF_RECORDINGS = Code("{statement}: {recordings}")
    STATED = Code(
        "{quantity} ({source})",
        quantity={
            "load_n": "load {value:.0f N}",
            "offset_m": "mounting offset {value:z.1f mm} below the neutral layer",
            "pitch_rad": "mounting pitch {value:g deg}",
            "pressure_pa": "pressure {value:.0f kPa}",
            "radius_m": "belt radius {value:g mm}",
            "roll_rad": "mounting roll {value:g deg}",
        },
    )
    STATED_RANGE = Code(
        "{quantity} ({source})",
        quantity={
            "load_n": "load {low:.0f} to {high:.0f N}",
            "pressure_pa": "pressure {low:.0f kPa} to {high:.0f kPa}",
        },
    )

    # Diagnosis: effects that are not identified
    IMPLAUSIBLE_PARAMETER = Code(
        "{parameter} would be {value:.4g}{unit: }, outside its plausible range of {low:.4g} to {high:.4g}{unit: }"
    )
    FADES_WITHIN_ONE_WAVE = Code(
        "the packet at the {edge} edge fades within {waves:.2f} of a wavelength: a bump, not a wave"
    )
    HOLLOW_ROAD = Code("the road would be hollow with a radius of {radius_m:.3g m}, larger than any inner drum (5 m)")
    PROBABILITY_TOO_LOW = Code("its probability is {probability:probability}, and {needed:.2g} is needed")
    TIME_LIMIT_SPENT = Code(
        "limit {limit_s:.3g s}: reading took {reading_s:.2g s}, fit and search {search_s:.2g s}; hold-out and figures "
        "came after it, {after_s:.2g s}"
    )
    RIVALS_UNTRIED = Code("the search ended before it had tried {effects} in its place")
    SEARCH_ENDED_EARLY = Code(
        "the search for effects ended at its time limit before it was complete (sets tried: {sets}; effects never "
        "tried: {untried}): others may be more probable"
    )
    EVIDENCE_TEMPERED = Code(
        "what is left unexplained ({axes}) has {residual_ratio:.3g} times the rms of the noise of the means; evidence "
        "from there counts less by that factor"
    )
    ERROR_BY_POSSIBLE_EFFECT = Code(
        "most of the error of {numbers} comes from {effect}, which the data neither show nor exclude (probability "
        "{probability:probability}); without it the error would be {ratio:.2g} times smaller"
    )
    ERROR_BY_MISSING_EFFECT = Code(
        "most of the error of {numbers} comes from the possible absence of {effect} (probability "
        "{probability:probability}, not identified); if it were certain the error would be {ratio:.2g} times smaller"
    )
    OTHER_OPTIMUM = Code(
        "{effect}: nearly as good with {parameter} {value:.4g}{unit: } in place of {best:.4g}{unit: } (probability "
        "{probability:probability}), which makes up most of its error"
    )
    PLUGIN_EFFECTS_LEFT_OUT = Code(
        "effects of plug-ins ({effects}) are left out: with them the diagnosis failed: {error}"
    )
    NOT_ON_EXACT_RING = Code(
        "it absorbs errors of this model's equations: on the exact ring {effect} is {errors:.1f} errors from zero"
    )
    LEAVES_MORE_THAN_WITHOUT = Code(
        "with it the fit leaves {with_it:.3g} times the noise of the means, without it {without:.3g} times"
    )
    SMALLER_THAN_LEFT = Code(
        "its {size_mps2:.2g m/s²} are less than the {left_mps2:.2g m/s²} that stay unexplained there: an equation "
        "that is off by as much makes any small effect certain"
    )
    SIZE_DIFFERS_BETWEEN_RECORDINGS = Code("its size would have to differ between recordings (most in {recording})")
    LEAVES_RESIDUAL_AT_EDGES = Code(
        "it leaves {residual_share:.0f %} of the scatter at the contact edges, so it stands in for another cause"
    )
    TURN_WITHOUT_ACCELERATION = Code(
        "the mean of the lateral axis does not follow it ({slope:.2f} ± {std:.2f} of what a turn makes of it)"
    )
    STRAIGHTS_NOT_SEEN = Code("straight driving and turns have not followed each other often enough to part them")
    CAMBER_BESIDE_TURN = Code("the side force of a turn at {turn_radps:.2g rad/s} can make as much of the lateral axis")
    CAMBER_TOO_LARGE = Code("the camber would change by {camber_rad:.2g deg}")
    NOTHING_REMAINS = Code("nothing of it remains beside the other effects")
    ORDER_OR_FREQUENCY = Code(
        "the residual is {noise_floors:.1f} times the noise floor, and one speed does not distinguish an "
        "order from a fixed frequency"
    )
    BESIDE_SOMETHING_LARGER = Code(
        "its {own_mps2:.2f m/s²} may be part of something unknown beside it, {larger_mps2:.2f m/s²}"
    )
    FAILS_UNSEEN = Code(
        "with the size of the other recordings, the {axis} error of {recording} goes from {before_mps2:.3g} to "
        "{after_mps2:.3g m/s²}"
    )
    SIZES_DIFFER = Code(
        "it has no one size: fitted to each recording alone, its sizes differ from each other or from that in all "
        "(chi-square {chi2:.3g} of {freedom})"
    )
    SIZE_CHANGES = Code(
        "its size changes from the first to the second half of a recording (chi-square {chi2:.3g} of {freedom})"
    )
    TAKEN_BY_UNKNOWN = Code(
        "beside an unknown waveform on the {axis} axis, fixed in time or to an edge of the contact, {taken:.3g} of its "
        "log odds are gone"
    )
    UNTESTED_ELSEWHERE = Code("no recording of another speed, load or pressure can test it")

    # Diagnosis: deciding recordings
    RECORD_AT = Code("record again at {ratio:g} times the {quantity}")
    RECORD_REVERSED = Code("record again rolling in the opposite direction")
    RECORD_WARMER = Code("record again with the tire {difference_k:g K} warmer")
    RECORD_AT_REST = Code(
        "record at rest with the axle level and the tire lifted: the lateral axis then reads the zero-g offset alone"
    )
    RECORD_ROAD_AT_ANOTHER_SPEED = Code(
        "record again at another speed: road vibration grows with it, sensor noise does not"
    )
    RECORD_ON_ANOTHER_ROAD = Code(
        "record again on another road or drum: a resonance of the tire keeps its frequency, vibration from a track "
        "does not"
    )
    RECORD_LIVE = Code("record live, with host time stamps")
    RECORD_LIVE_FOR_LONGER = Code("record live for longer: the hub's clock is known to {clock_std:.0f ppm} so far")
    COMPARE_CLOCK = Code("compare the hub's clock with one better than {host_clock:.0f ppm}")
    NO_RECORDING_DECIDES = Code("no other speed, load, pressure, temperature or direction tried here would decide")
    DECIDES_AGAINST = Code("against {effect}: {recording}")

    # Diagnosis: notes
    MEANS_NOT_COMPARED = Code(
        "the paper's model has no mean, so the means of the axes are not compared, and a zero-g offset or a "
        "constant gain error in them is not detected; start from --model exact to detect it"
    )
    REVOLUTIONS_LEFT_OUT = Code("{revolutions} revolutions left out: {reason}")
    REVOLUTION_NOT_MEASURED = Code("the radial axis or the sampling rate is not known")
    BEYOND_RECORDING_LIMIT = Code("beyond the first {limit} of a recording")
    BEYOND_GROUP_LIMIT = Code("beyond the first {limit} at the same speed, load, pressure and temperature")
    BETWEEN_GROUP_SPEEDS = Code("at speeds between those of the {groups} most informative groups")
    TOO_FEW_ALIKE = Code("too few at the same speed, load, pressure and temperature")
    OUTLIER_OF_GROUP = Code("an outlier at the same conditions, as after an impact")
    CLIPPED_UNLIKE_GROUP = Code("the radial axis is clipped, unlike in others at the same conditions")
    CIRCUMFERENTIAL_REVERSED = Code(
        "the sign of its circumferential axis is opposite to that of a rolling tire: the tire rolled backwards or was "
        "reversed on its rim, or the axis is reversed"
    )
    BASELINE_UNFITTED = Code(
        "the baseline model cannot be fitted to it: its belt radius, load or pressure is not as stated"
    )
    CONTACT_UNLIKE_OTHERS = Code(
        "its contact half angle is {angle_rad:.1f deg}, that of {count} others with the same stated load and pressure "
        "{other_rad:.1f deg}: its load, pressure or tire is not as stated"
    )
    CONTACTS_CONTRADICT = Code(
        "contact half angle {short_rad:.1f deg} in {short}, {long_rad:.1f deg} in {long}: load, pressure or tire is "
        "not as stated"
    )
    LATERAL_OPPOSITE = Code(
        "the lateral waveforms of {recording} and {other} are opposite: the lateral axis of one is reversed, or its "
        "sensor or tire is turned round"
    )
    LATERAL_OPPOSITE_TO_OTHERS = Code(
        "its lateral waveform is the opposite of that of {count} others: its lateral axis is reversed, or its sensor "
        "or tire is turned round"
    )
    LOADS_CONTRADICT = Code(
        "Cw, which no load changes, is {low:.4g} to {high:.4g}: a stated load or pressure is {share:.1%} off; all "
        "errors contain that"
    )
    RADIUS_UNLIKE_OTHERS = Code(
        "its belt radius is stated as {radius_m:.1f mm}, that of {count} others as {other_m:.1f mm}"
    )
    WIDTH_UNLIKE_OTHERS = Code(
        "Cw, which no load changes, is {value:.4g} in it and {other:.4g} in {count} others: its load or pressure is "
        "not as stated"
    )
    FEW_REVOLUTIONS = Code("only {revolutions} revolutions: a pattern common to all of them may still be chance")
    EDGES_ALIGNED = Code(
        "the contact edges of {revolutions} revolutions, held-out ones too, are aligned by up to {parameters} "
        "parameters of their own, whatever moves them; as recorded, the held-out rms is {before_mps2:.4g m/s²} before "
        "and {after_mps2:.4g m/s²} after"
    )
    ONE_SPEED = Code("one speed only: effects that depend on speed cannot be separated from those that do not")
    GROUPS_TOO_SHORT = Code(
        "no spectrum of the signal that does not repeat with the wheel: {groups} of {of} groups are too short"
    )
    NOISE_ROLLS_OFF = Code("the noise rolls off at about {corner_hz:.0f Hz}, as behind a low-pass filter")
