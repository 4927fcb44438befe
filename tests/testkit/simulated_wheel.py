"""One simulated wheel run through the whole pipeline, from bytes to results."""

from __future__ import annotations

from functools import lru_cache

from firmware_protocol.decoder import FrameDecoder
from gateway.config.validation import parse_document
from gateway.pipeline.results import RevolutionResult
from gateway.pipeline.wheel_setup import WheelSetup
from gateway.pipeline.wheels import Pipeline
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import simulate
from gateway.simulator.truth import WheelTruth


@lru_cache(maxsize=32)
def simulated(
    tables: str, duration_s: float, setup: WheelSetup, estimators: tuple[str, ...], wheel: str = "", seed: int = 4
) -> tuple[tuple[RevolutionResult, ...], WheelTruth]:
    """Return the results and the truth of a scenario's `tables` with one wheel; `wheel` holds its further keys."""
    text = f"[scenario]\nseed = {seed}\n{tables}\n[[wheel]]\nposition = 'FL'\nwheel = 0\n{wheel}\n"
    simulation = simulate(parse_document(Scenario, text, "test"), duration_s=duration_s)
    pipeline, decoder = Pipeline((setup,), setup, estimators), FrameDecoder()
    results: list[RevolutionResult] = []
    for chunk in simulation.chunks("link", 10**18):
        results += pipeline.frames("link", decoder.feed(chunk.data), chunk.host_ns)
    return tuple(results + pipeline.finish()), simulation.truth["FL"]


def last(results: tuple[RevolutionResult, ...]) -> dict[str, object]:
    """Return the last result's estimates by name."""
    return {estimate.name: estimate for estimate in results[-1].estimates}
