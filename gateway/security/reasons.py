"""Reasons of security, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class SecurityCode(Codes):
    """Reasons of security."""

    LINK_IN_USE = Code("the session of process {process} has this hub too: many hubs serve only one program")
    FRAMES_IGNORED = Code("they are not used, but recorded")
    FRAMES_USED = Code("they are used nevertheless (policy warn)")
    FRAME_EARLIER_START = Code(
        "{signer} sends under boot count {start}, but {latest} was accepted before ({count} frames so far): an old "
        "recording is replayed, or the hub was replaced or has lost its boot count. If the hub is yours, set its boot "
        "count above {latest}, or make a new key: treadlink keys new {identity} --replace; {consequence}"
    )
    FRAME_NOT_TRUSTED = Code(
        "{fault}; {consequence}",
        fault={
            "too late": (
                "frames arrive long after later ones ({count} so far): a recording of the sensor may be replayed"
            ),
            "before hello": "signed frames arrive, but no verified HELLO ({count} so far)",
            "replayed": "frames arrive twice ({count} so far): a recording of the sensor may be replayed",
            "unsigned": "frames are not signed ({count} so far): anyone could have sent them",
            "wrong tag": (
                "signed frames have a wrong tag ({count} so far): they are forged, from an earlier start, or signed "
                "with another key"
            ),
        },
    )
    FRAME_NO_KEY = Code(
        "frames are signed by {signer}, whose key is missing ({count} so far): add it with `treadlink keys import`; "
        "{consequence}"
    )
    KEY_MISSING = Code(
        "no key for sensor {sensor}: its frames {frames}; add its key with `treadlink keys import`",
        frames={
            "ignored": "will not be used",
            "not_verified": "cannot be verified",
        },
    )
    NO_KEYS = Code("frames are to be verified, but '{file}' has no key: add keys with `treadlink keys import`")
    SENSOR_NOT_ADMITTED = Code(
        "{how}; {consequence}",
        how={
            "other": (
                "sensor {sensor} is here, but the configuration has {expected} ({count} frames so far): put it into "
                "the vehicle file if it is yours"
            ),
            "swapped": "sensor {sensor} of {owner} is here ({count} frames so far): were wheels swapped?",
            "unconfigured": (
                "sensor {sensor} is at a wheel that is not configured ({count} frames so far): put it into the "
                "vehicle file if it is yours"
            ),
        },
    )
    SIGNER = Code(
        who={
            "hub": "hub {identity}",
            "sensor": "sensor {identity}",
            "sensor_at_hub": "{signer} at hub {hub}",
            "unknown": "an unknown sensor",
        },
    )
