"""Turn rate and curve radius in live outputs: CAN frames, the published state, and topics that plot."""

from dataclasses import replace

import cantools
import pytest

from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.quantity_catalogue import in_state
from gateway.core.text.recording_topics import revolution_payload
from gateway.publishing.can_frames import LAYOUTS, FrameEncoder, dbc_text

DBC = cantools.database.load_string(dbc_text(), "dbc")


def frame(layout: str, values: dict[str, float]) -> dict[str, object]:
    made = FrameEncoder().wheel("FL", LAYOUTS[layout], values)
    return DBC.decode_message(made.can_id, made.data)


@pytest.mark.parametrize("radius_m", [-12.4, 850.0, 3276.0])
def test_bus_carries_rate_and_radius_with_sign_error_and_status(radius_m: float) -> None:
    turning = frame("Turning", {"TurnRate": -0.31, "TurnRateError": 0.012, "TurnRateStatus": 2})
    assert (turning["TurnRate"], turning["TurnRateError"]) == pytest.approx((-0.31, 0.012))
    curve = frame("Curve", {"CurveRadius": radius_m, "CurveRadiusError": 24.0, "CurveRadiusStatus": 1})
    assert (curve["CurveRadius"], curve["CurveRadiusError"]) == pytest.approx((radius_m, 24.0))
    assert curve["CurveRadiusStatus"] == "provisional"


def test_nearly_straight_has_no_radius_on_the_bus() -> None:
    assert frame("Curve", {"CurveRadius": 9000.0, "CurveRadiusStatus": 2})["CurveRadius"] == "not_available"


def test_state_and_plots_have_rate_and_radius(made) -> None:
    names = ("turn_rate_radps", "curve_radius_m")
    assert set(names) <= set(in_state())
    estimates = tuple(Estimate(name, 0.5 * (index + 1), 0.1, Status.VALID) for index, name in enumerate(names))
    payload = revolution_payload(replace(made.result(), estimates=estimates))
    assert [(payload[name], payload[f"{name}_std"]) for name in names] == [(0.5, 0.1), (1.0, 0.1)]
