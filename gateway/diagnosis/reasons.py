"""Reasons of the diagnosis, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class DiagnosisCode(Codes):
    """Reasons of the diagnosis."""

    EFFECTS_ENLARGE_ERROR = Code(
        "the effects are not those of this tire and sensor: they make the error larger ({before_mps2:.3g} -> "
        "{after_mps2:.3g m/s²})"
    )
    AXES_LEFT_OUT = Code("the {axes} axes are not used: they may be other axes than stated")
    AXIS_CONSTANT = Code("the {axis} axis is dead or stuck, and not used: it reads one value in {count} revolutions")
    DATA_FAULT = Code(
        "fault in the data: {samples} samples ({share:.2%}) {how}",
        how={
            "bridged": (
                "are on {lines} straight lines in every axis, far beyond chance: bridged gaps, which bias the "
                "numbers. A new import of the measurement leaves them out"
            ),
            "stuck": (
                "repeat the one before on every axis, in {runs} stretches of three or more, far beyond chance: check "
                "sensor, hub and link"
            ),
        },
    )
    DIFFERENT_SENSORS = Code("the recordings are of different sensors: {sensors}")
    RECORDING_DAMAGED = Code("{damage}. Its readable part is used")
    RECORDING_ORDER_UNKNOWN = Code(
        "the recordings' times do not say which was first: they are taken in the order of the command"
    )
    RECORDING_REPEATS = Code("has the same revolutions as {other}")
    RECORDING_WITHOUT_DATA = Code("contains nothing that can be used")
    RECORDING_WITHOUT_WHEEL = Code("contains no revolution of wheel {wheel}")
    LEFT_WHEN_ENDED = Code(
        "no number is determined, and nothing identified: the search ended while {residual_ratio:.3g} times the noise "
        "of the means was unexplained (rms)"
    )
    NUMBERS_CONTRADICT = Code(
        "tire, load or pressure is not as stated, so no number is determined: {number} is {low:.3g} in {recording} "
        "alone and {high:.3g} in {other}, which their errors do not explain"
    )
    NOT_A_RING = Code(
        "the signal is not that of a rolling tire's belt, so no number is determined: {share:.0%} of its rms is left "
        "unexplained ({recordings})"
    )
    REVOLUTIONS_CLIPPED = Code("the radial axis is cut off at the end of its range in {count} of {total} revolutions")
    SENSOR_ALARM = Code("alarm of the sensor: {reason}")
    SENSOR_IN_DOUBT = Code("no number is determined, because the sensor itself is in doubt: {recordings}")
    ABOUT_RECORDING = Code("{recording}: {reason}")
    RECORDING_LEFT_OUT = Code("{recording} is not used: {reason}")
    SEVERAL_SENSORS = Code("several")
    RECORDING_NOT_READ = Code("{message}")
    RECORDING_NOT_USED = Code("{message}")
    ASSUMED = Code(
        quantity={
            "load_n": "load {value:.0f N} (not stated)",
            "offset_m": "mounting offset 0.0 mm below the neutral layer (neither stated nor measured)",
            "pressure_pa": "pressure {value:.0f kPa} (neither stated nor measured)",
            "temperature_degc": "temperature steady (neither stated nor measured)",
        },
    )
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
    IMPLAUSIBLE_PARAMETER = Code(
        "{parameter} would be {value:.4g}{unit: }, outside its plausible range of {low:.4g} to {high:.4g}{unit: }"
    )
    FADES_WITHIN_ONE_WAVE = Code(
        "it is a bump and not a wave: at the {edge} edge it fades within {waves:.2f} of a wavelength"
    )
    HOLLOW_ROAD = Code("the road would be hollow with a radius of {radius_m:.3g m}, larger than any inner drum (5 m)")
    PROBABILITY_TOO_LOW = Code("its probability is {probability:probability}, and {needed:.2g} is needed")
    TIME_LIMIT_SPENT = Code(
        "the limit of {limit_s:.3g s} is for reading ({reading_s:.2g s}), fit and search ({search_s:.2g s}): the step "
        "under way at the limit was finished. Test on unseen revolutions and figures are not counted ({after_s:.2g s})"
    )
    RIVALS_UNTRIED = Code("the search ended before it had tried {effects} in its place")
    SEARCH_ENDED_EARLY = Code(
        "the search for effects ended at its time limit before it was complete: other effects may be more probable "
        "(sets tried: {sets}; effects never tried: {untried})",
        untried={"()": "none"},
    )
    EVIDENCE_TEMPERED = Code(
        "evidence from {axes} counts less: what is left unexplained there has {residual_ratio:.3g} times the rms of "
        "the noise of the means"
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
        "{effect}: {parameter} {value:.4g}{unit: } explains nearly as much as {best:.4g}{unit: } (probability "
        "{probability:probability}), which makes up most of its error"
    )
    PLUGIN_EFFECTS_LEFT_OUT = Code(
        "effects of plug-ins ({effects}) are not used: with them the diagnosis failed: {error}"
    )
    NOT_ON_EXACT_RING = Code(
        "it is not there with the equations of large deformations ({effect} is {errors:.1f} errors from zero): it "
        "absorbs errors of the simpler ones"
    )
    LEAVES_MORE_THAN_WITHOUT = Code(
        "with it more stays unexplained: {with_it:.3g} times the noise of the means, without it {without:.3g} times"
    )
    SMALLER_THAN_LEFT = Code(
        "it is smaller than what stays unexplained there ({size_mps2:.2g m/s²}, {left_mps2:.2g m/s²}): an equation "
        "that is off by as much makes any small effect look certain"
    )
    SIZE_DIFFERS_BETWEEN_RECORDINGS = Code("its size would have to differ between recordings (most in {recording})")
    LEAVES_RESIDUAL_AT_EDGES = Code(
        "another cause is there: it leaves {residual_share:.0f %} of the scatter where the contact begins and ends"
    )
    TURN_WITHOUT_ACCELERATION = Code(
        "the mean of the lateral axis does not follow it ({slope:.2f} ± {std:.2f} of what a turn makes of it)"
    )
    STRAIGHTS_NOT_SEEN = Code("straight driving and turns have not followed each other often enough to part them")
    CAMBER_BESIDE_TURN = Code("the side force of a turn at {turn_radps:.2g rad/s} can make as much of the lateral axis")
    CAMBER_TOO_LARGE = Code("the camber would change by {camber_rad:.2g deg}")
    NOTHING_REMAINS = Code("the other effects explain all of it")
    ORDER_OR_FREQUENCY = Code(
        "one speed does not show whether it is an order of the wheel or a fixed frequency (the residual is "
        "{noise_floors:.1f} times the noise floor)"
    )
    BESIDE_SOMETHING_LARGER = Code(
        "it may be a part of something unknown beside it that is larger ({own_mps2:.2f m/s²}, {larger_mps2:.2f m/s²})"
    )
    FAILS_UNSEEN = Code(
        "with the size of the other recordings it does not explain {recording}: the error of the {axis} axis goes "
        "from {before_mps2:.3g} to {after_mps2:.3g m/s²}"
    )
    SIZES_DIFFER = Code("it has another size in each recording (chi-square {chi2:.3g} of {freedom})")
    SIZE_CHANGES = Code(
        "its size changes from the first to the second half of a recording (chi-square {chi2:.3g} of {freedom})"
    )
    TAKEN_BY_UNKNOWN = Code(
        "an unknown waveform on the {axis} axis, fixed in time or to an edge of the contact, explains it as well: "
        "{taken:.3g} of its log odds are gone beside it"
    )
    UNTESTED_ELSEWHERE = Code("no recording of another speed, load or pressure can test it")
    RECORD_AGAIN = Code(
        how={
            "another_road": (
                "record again on another road or drum: a resonance of the tire keeps its frequency, vibration from a "
                "track does not"
            ),
            "another_speed": "record again at another speed: road vibration grows with it, sensor noise does not",
            "at_rest": (
                "record at rest with the axle level and the tire lifted: the lateral axis then reads the zero-g "
                "offset alone"
            ),
            "better_clock": "compare the hub's clock with one better than {host_clock:.0f ppm}",
            "live": "record live, with host time stamps",
            "live_longer": "record live for longer: the hub's clock is known to {clock_std:.0f ppm} so far",
            "none_decides": "no other speed, load, pressure, temperature or direction that was tried here would decide",
            "ratio": "record again at {ratio:g} times the {quantity}",
            "reversed": "record again rolling in the opposite direction",
            "warmer": "record again with the tire {difference_k:g K} warmer",
        },
    )
    DECIDES_AGAINST = Code("against {effect}: {recording}")
    MEANS_NOT_COMPARED = Code(
        "the paper's model has no mean, so the means of the axes are not compared, and a zero-g offset or a "
        "constant gain error in them is not detected; start from --model exact to detect it"
    )
    REVOLUTIONS_LEFT_OUT = Code("{revolutions} revolutions are not used: {reason}")
    REVOLUTION_UNUSED = Code(
        why={
            "between_speeds": "at speeds between those of the {groups} most informative groups",
            "clipped": "the radial axis is cut off at the end of its range, unlike in others at the same conditions",
            "group_limit": "beyond the first {limit} at the same speed, load, pressure and temperature",
            "not_measured": "the radial axis or the sampling rate is not known",
            "outlier": "an outlier at the same conditions, as after an impact",
            "recording_limit": "beyond the first {limit} of a recording",
            "too_few": "too few at the same speed, load, pressure and temperature",
        },
    )
    CIRCUMFERENTIAL_REVERSED = Code(
        "its circumferential axis points the other way: the tire rolled backwards or was reversed on its rim, or the "
        "axis is reversed"
    )
    BASELINE_UNFITTED = Code(
        "its belt radius, load or pressure is not as stated: the baseline model cannot be fitted to it"
    )
    CONTACT_UNLIKE_OTHERS = Code(
        "its load, pressure or tire is not as stated: its contact half angle is {angle_rad:.1f deg}, that of {count} "
        "others with the same stated load and pressure {other_rad:.1f deg}"
    )
    CONTACTS_CONTRADICT = Code(
        "load, pressure or tire is not as stated: the contact half angle is {short_rad:.1f deg} in {short}, "
        "{long_rad:.1f deg} in {long}"
    )
    LATERAL_OPPOSITE = Code(
        "the lateral axis of one is reversed, or its sensor or tire is turned round: the lateral waveforms of "
        "{recording} and {other} are opposite"
    )
    LATERAL_OPPOSITE_TO_OTHERS = Code(
        "its lateral axis is reversed, or its sensor or tire is turned round: its lateral waveform is the opposite of "
        "that of {count} others"
    )
    LOADS_CONTRADICT = Code(
        "a stated load or pressure is {share:.1%} off, which all errors include: the contact width number (Cw), which "
        "no load changes, is {low:.4g} to {high:.4g}"
    )
    RADIUS_UNLIKE_OTHERS = Code(
        "its belt radius is {radius_m:.1f mm} (stated), that of {count} others {other_m:.1f mm}"
    )
    WIDTH_UNLIKE_OTHERS = Code(
        "its load or pressure is not as stated: the contact width number (Cw), which no load changes, is {value:.4g} "
        "in it and {other:.4g} in {count} others"
    )
    FEW_REVOLUTIONS = Code(
        "there are only {revolutions} revolutions: a pattern common to all of them may still be chance"
    )
    EDGES_ALIGNED = Code(
        "begin and end of the contact are fitted in {revolutions} revolutions, unseen ones too, by up to "
        "{parameters} parameters of their own, whatever moves them; without that the rms error on unseen revolutions "
        "is {before_mps2:.4g m/s²} before and {after_mps2:.4g m/s²} after"
    )
    ONE_SPEED = Code("there is one speed only: effects that depend on speed cannot be separated from those that do not")
    GROUPS_TOO_SHORT = Code(
        "no spectrum of the signal that does not repeat with the wheel: {groups} of {of} groups are too short"
    )
    NOISE_ROLLS_OFF = Code("the noise falls off from about {corner_hz:.0f Hz} on, as behind a low-pass filter")
