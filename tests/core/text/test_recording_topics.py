"""The topics of a recording: stated conditions and estimates side by side."""

from dataclasses import replace

from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.text.recording_topics import revolution_payload


def test_estimated_load_does_not_replace_the_stated_one(made) -> None:
    result = made.result(estimates=(Estimate("load_n", 4200.0, 30.0, Status.VALID),))
    stated = replace(result, conditions=replace(result.conditions, load_n=4000.0))
    payload = revolution_payload(stated)
    assert payload["load_n"] == 4000.0
    assert (payload["estimated_load_n"], payload["estimated_load_n_std"]) == (4200.0, 30.0)
