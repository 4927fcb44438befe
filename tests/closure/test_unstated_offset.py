"""A mounting offset that is neither stated nor measured: expected rather than rare, and listed among the assumptions.

At one speed a sensor e below the neutral layer reads a (1 - e a / V^2) on its radial axis: as a nonlinear one does.
"""

import math
from pathlib import Path

import pytest

from gateway.closure.effects.effect import RADIAL, BaselineModel, GroupConditions
from gateway.closure.inference import criteria
from gateway.closure.inference.set_evidence import log_prior_odds
from gateway.closure.model.baseline_registry import make_core
from gateway.closure.model.closure_model import ClosureModel
from gateway.config.vehicle import parse_vehicle
from gateway.reasons import Code, Reason
from gateway.recording.reader import RecordingReader
from gateway.session.campaign import read_campaign
from tests.closure.planted_campaign import Plant, among, campaign_of, conditions, nothing, searched
from tests.closure.test_effect_sensor_nonlinearity import bent
from tests.closure.test_sensor_depth import at_depth
from tests.testkit.campaign_recordings import write_recording

OFFSET, NONLINEARITY = "mounting offset", "sensor nonlinearity"
EFFECTS = among(OFFSET, NONLINEARITY, "belt extension", "gain")
AT_60 = "[motion]\nspeed_kmh = 60.0"


def rolling_at(speed_kmh: float, *, is_known: bool = False) -> GroupConditions:
    return conditions(speed_kmh, offset_known=is_known)


@pytest.mark.parametrize(
    ("plant", "speed_kmh", "noise_mps2"),
    [(at_depth(4e-3), 75.0, 0.3), (at_depth(3e-3), 60.0, 1.0), (bent(-1e-5, 0.0), 60.0, 1.0)],
    ids=["below, belt stretched", "below", "nonlinear"],
)
def test_offset_and_nonlinearity_are_left_open_at_one_speed(plant: Plant, speed_kmh: float, noise_mps2: float) -> None:
    campaign = campaign_of((rolling_at(speed_kmh),), plant, axes=(RADIAL,), noise_mps2=noise_mps2, seed=2)
    posterior, _ = searched(campaign, EFFECTS)
    assert posterior.identified() == ()
    assert {OFFSET, NONLINEARITY} <= set(*posterior.alternatives())


def test_nothing_is_named_where_the_assumption_holds() -> None:
    posterior, _ = searched(campaign_of((rolling_at(60.0),), nothing, axes=(RADIAL,)), EFFECTS)
    assert posterior.identified() == ()
    assert posterior.probability([OFFSET]) < criteria.SUPPORTED


def test_only_an_unstated_offset_is_expected() -> None:
    offset = EFFECTS[OFFSET]
    assert not offset.expected((rolling_at(60.0, is_known=True), rolling_at(30.0, is_known=True)))
    assert offset.expected((rolling_at(60.0, is_known=True), rolling_at(30.0)))
    for item, odds in ((True, criteria.PRIOR_ODDS), (False, criteria.EXPECTED_ODDS)):
        campaign = campaign_of((rolling_at(60.0, is_known=item),), axes=(RADIAL,))
        model = ClosureModel(campaign, make_core(BaselineModel.EXACT), (offset, EFFECTS["gain"]))
        assert log_prior_odds(model) == pytest.approx(math.log(odds * criteria.PRIOR_ODDS))


def test_unstated_offset_is_listed_as_assumed(tmp_path: Path) -> None:
    def unstated(toml: str) -> str:
        return "\n".join(line for line in toml.splitlines() if not line.startswith("offset_mm"))

    keys = "[wheel.sensor]\noffset_mm = 3.0\naxes = ['radial']"
    path = write_recording(tmp_path / "rec.mcap", AT_60, wheels=(keys,), duration_s=3.0, change=unstated)
    campaign = read_campaign([path])
    assert Reason(Code.ASSUMED_OFFSET) in campaign.assumed
    assert not any(group.conditions.offset_known for group in campaign.groups)
    assert all(reason.code is not Code.STATED_OFFSET for reason in campaign.stated)

    recorded_toml = RecordingReader(path).vehicle_toml or ""
    text = recorded_toml.replace("[wheel.mounting]", "[wheel.mounting]\noffset_mm = 3.0")
    stated = read_campaign([path], vehicle=parse_vehicle(text, "test"))
    assert Reason(Code.ASSUMED_OFFSET) not in stated.assumed
    assert all(group.conditions.offset_known for group in stated.groups)

    listed = text.replace("[vehicle]", "[vehicle]\nassumed = ['mounting offset 3 mm: as on other tires']")
    guessed = read_campaign([path], vehicle=parse_vehicle(listed, "test"))
    assert guessed.assumed == ("mounting offset 3 mm: as on other tires",)
    assert not any(group.conditions.offset_known for group in guessed.groups)
    assert guessed.groups[0].declared_offset_m == pytest.approx(3e-3)
