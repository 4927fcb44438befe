"""Reasons of vehicle signals, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class VehicleCode(Codes):
    """Reasons of vehicle signals."""

    SIGNAL_MISSING = Code("it has not been received lately")
    SIGNAL_OUTSIDE_RECORDING = Code(
        "its values are {away_s:.2f days} {side} the recording's first revolution, as in a log of another date: add "
        "{shift_s:+.0f s} to `offset_s` of its source, and both begin together"
    )
    CAR_CONTRADICTED = Code(
        "{what} {ratio:.3f} ± {std:.3f} times {of}: {causes}",
        what={"speed": "the speed of the car is", "rotation": "the car's wheel turns"},
        of={
            "radius": "that of belt radius and rotation",
            "contacts": "as fast as the contacts in the signal say",
        },
    )
    LOG_STEPS_BACK = Code("the log's times step back {count:.0f} times: its lines are out of order, or twice in it")
    BUS_MESSAGE_TWICE = Code(
        "message {message} comes from two buses, {first} and {second}: only that of {first} is decoded. `channel` of "
        "the source chooses one, as in can:drive.blf?channel=1"
    )
    TPMS_NOT_USED = Code(
        why={
            "unknown": (
                "sensor {id} ({model}) is in no [[tpms.sensor]] of the vehicle file, so its pressure is not used. "
                "Of this car?"
            ),
            "unchecked": ("messages of sensor {id} ({model}) have no check of their bits (mic), so they are not used"),
            "empty": (
                "messages of sensor {id} ({model}) have neither pressure nor temperature: rtl_433 does not decode "
                "them whole"
            ),
            "unread": "a line is not a JSON object as rtl_433 prints it, or it is cut",
        },
    )
