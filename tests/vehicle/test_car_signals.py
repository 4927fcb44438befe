"""The vehicle's own signals stand on a line of their own, on the console and on the page."""

import math

from gateway.console.styled_rows import Role
from gateway.console.wheel_panel import car_runs, reading_of, shown_numbers
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.reasons import Reason
from gateway.publishing.web_page.page_state import page_state
from gateway.vehicle.reasons import VehicleCode


def test_signals_of_the_car_are_apart_from_the_numbers(made) -> None:
    signals = (
        Estimate("vehicle_speed_mps", 18.0, 0.18, Status.VALID),
        Estimate("vehicle_speed_age_s", 0.02, 0.0, Status.VALID),
        Estimate("car_wheel_speed_radps", 56.0, math.nan, Status.VALID),
        Estimate.invalid("steering_angle_rad", Reason(VehicleCode.SIGNAL_MISSING)),
        Estimate("latitude_deg", 48.137154, 1.9e-5, Status.VALID),
        Estimate("longitude_deg", -11.576124, 1.9e-5, Status.VALID),
        Estimate("ground_speed_mps", 18.0, 0.18, Status.VALID),
    )
    result = made.result()
    wheel = made.wheel(last=made.result(estimates=(*result.estimates, *signals)))
    reading = reading_of(wheel)
    assert car_runs(reading) == [
        ("vehicle speed 64.80 ± 0.65 km/h", Role.TEXT),
        ("car wheel speed 56.00 rad/s", Role.TEXT),
        ("steering angle — deg x", Role.WARNING),
        ("latitude 48.1372 ± 0.0001 deg", Role.TEXT),
        ("longitude -11.5761 ± 0.0001 deg", Role.TEXT),
        ("ground speed 64.80 ± 0.65 km/h", Role.TEXT),
    ]
    assert not {"vehicle speed", "vehicle speed age", "car wheel speed"} & {
        shown.label for shown in shown_numbers(wheel, reading)
    }
    (shown,) = page_state(made.snapshot(wheels=(wheel,)), run_form=None)["wheels"]
    assert [text for text, _ in shown["car"]] == [text for text, _ in car_runs(reading)]
