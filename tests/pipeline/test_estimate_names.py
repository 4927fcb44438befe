"""Names of estimates when several estimators give the same quantity."""

from gateway.pipeline.wheel_setup import WheelSetup
from gateway.pipeline.wheels import Pipeline
from tests.pipeline.rolling_signals import LOAD_N, PRESSURE_PA, RADIUS_M

SETUP = WheelSetup("FL", 0, 0, RADIUS_M, load_n=LOAD_N, pressure_pa=PRESSURE_PA)


def test_later_estimators_prefix_shared_names(roll, to_frames) -> None:
    frames = to_frames(roll(65.0, 1.2).radial_mps2)

    def names_and_values(*estimators: str) -> dict[str, float]:
        pipeline = Pipeline([SETUP], SETUP, estimators)
        results = pipeline.frames("link", frames, 10**18) + pipeline.finish()
        last = results[-1].estimates
        assert len({e.name for e in last}) == len(last)
        return {e.name: e.value for e in last}

    both = names_and_values("ring-paper", "weak-form")
    weak, paper = names_and_values("weak-form"), names_and_values("ring-paper")
    assert {"Bs", "Ts/Cw", "ring-paper:Bs", "ring-paper:Ts/Cw"} <= set(both)
    assert {name: both[name] for name in weak} == weak
    assert {name: both[f"ring-paper:{name}"] for name in paper} == paper
    assert both["Cw"] != both["ring-paper:Cw"]
