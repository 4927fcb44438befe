"""Reasons of security, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class SecurityCode(Codes):
    """Reasons of security."""

    # Events of links and devices
    LINK_IN_USE = Code("the session of process {process} has this hub too; many hubs serve one program alone")

    # Security
    FRAMES_IGNORED = Code("ignored, but recorded")
    FRAMES_USED = Code("not refused for that (policy warn)")
    FRAME_EARLIER_START = Code(
        "{signer} sends under boot count {start}, but {latest} was accepted before ({count} frames so far): an old "
        "recording is replayed, or the hub was replaced or has lost its boot count. If the hub is yours, set its boot "
        "count above {latest}, or give a new key: treadlink keys new {identity} --replace; {consequence}"
    )
    FRAME_NOT_TRUSTED = Code(
        "{fault}; {consequence}",
        fault={
            "too late": (
                "a frame arrived long after later ones ({count} so far): a recording of the sensor may be replayed"
            ),
            "before hello": "signed frames arrive, but no verified hello ({count} so far)",
            "replayed": "a frame arrived twice ({count} so far): a recording of the sensor may be replayed",
            "unsigned": "a frame is not signed ({count} so far): anyone could have sent it",
            "wrong tag": (
                "a signed frame has a wrong tag ({count} so far): forged, from an earlier start, or signed with "
                "another key"
            ),
        },
    )
    FRAME_NO_KEY = Code(
        "frames are signed by {signer}, whose key is missing ({count} so far); `treadlink keys import` admits "
        "it; {consequence}"
    )
    KEY_MISSING = Code(
        "no key for sensor {sensor}: its frames {frames}; add its key with `treadlink keys import`",
        frames={"ignored": "will be ignored", "not_verified": "cannot be verified"},
    )
    NO_KEYS = Code("the policy is to verify frames, but '{file}' has no key: import keys with `treadlink keys import`")
    SENSOR_NOT_ADMITTED = Code(
        "sensor {sensor} is here, but the configuration names {expected} ({count} frames so far); configure it "
        "to admit it; {consequence}"
    )
    SENSOR_NOT_ADMITTED_SWAPPED = Code(
        "sensor {sensor} of {owner} is here: wheels swapped? ({count} frames so far); {consequence}"
    )
    SENSOR_NOT_ADMITTED_UNCONFIGURED = Code(
        "sensor {sensor} is at a wheel that is not configured ({count} frames so far); configure it to admit it; "
        "{consequence}"
    )
    SIGNER_AT_HUB = Code("{signer} at hub {hub}")
    SIGNER_HUB = Code("hub {identity}")
    SIGNER_SENSOR = Code("sensor {identity}")
    SIGNER_UNKNOWN = Code("an unknown sensor")
