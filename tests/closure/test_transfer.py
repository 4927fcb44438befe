"""Transfer: the error with the effects of another recording, as they were found there."""

from __future__ import annotations

import pytest

from gateway.closure.effects.effect import LATERAL
from gateway.closure.transfer import Transfer, transfer
from gateway.errors import TreadlinkError
from tests.closure.planted_campaign import ALL_AXES, ONE_SPEED, campaign_of, turned

ROLL_RAD = 0.03


def with_roll(angle_rad: float) -> Transfer:
    """Return the transfer of a roll tilt to a campaign that has one of `ROLL_RAD`."""
    campaign = campaign_of(ONE_SPEED, turned(LATERAL, ROLL_RAD), axes=ALL_AXES, seed=9)
    return transfer(campaign, {"roll tilt": {"roll_rad": angle_rad}})


def test_right_effects_lower_the_error_to_the_noise() -> None:
    found = with_roll(ROLL_RAD)
    assert found.held_out.rms_before_mps2 > 2.0 * found.noise_floor_mps2
    assert found.held_out.rms_after_mps2 == pytest.approx(found.noise_floor_mps2, rel=0.05)
    assert "contact centre" in found.refitted
    assert "roll tilt" not in found.refitted


def test_transferred_parameters_are_not_refitted() -> None:
    """Twice the tilt leaves as much as none: nothing moves it to the size that these recordings have."""
    found = with_roll(2.0 * ROLL_RAD)
    assert found.effects == {"roll tilt": {"roll_rad": 2.0 * ROLL_RAD}}
    assert found.held_out.rms_after_mps2 == pytest.approx(found.held_out.rms_before_mps2, rel=0.1)


@pytest.mark.parametrize(
    ("effects", "message"),
    [({"wings": {"span_m": 1.0}}, "no effect 'wings'"), ({"roll tilt": {}}, "lacks the parameter")],
)
def test_unknown_effect_or_parameter_is_rejected(effects: dict[str, dict[str, float]], message: str) -> None:
    with pytest.raises(TreadlinkError, match=message) as error:
        transfer(campaign_of(ONE_SPEED), effects)
    assert "--save-effects" in error.value.remedy
