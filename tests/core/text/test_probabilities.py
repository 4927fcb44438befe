"""Probabilities as text."""

import pytest

from gateway.core.reasons import Reason
from gateway.core.text.probabilities import probability_text
from gateway.core.text.wording import text
from gateway.diagnosis.reasons import DiagnosisCode


@pytest.mark.parametrize(
    ("probability", "shown"),
    [
        (0.98938, "0.989"),
        (0.98999, "0.989"),
        (0.99, "0.990"),
        (0.957, "0.957"),
        (0.9999, "0.999"),
        (1.0, "1.000"),
        (0.83, "0.83"),
        (0.0, "0.00"),
        (0.053, "0.05"),
    ],
)
def test_probability_near_one_is_rounded_down(probability: float, shown: str) -> None:
    assert probability_text(probability) == shown


def test_reason_does_not_reach_its_own_limit() -> None:
    said = text(Reason(DiagnosisCode.PROBABILITY_TOO_LOW, probability=0.98996, needed=0.99))
    assert said == "its probability is 0.989, and 0.99 is needed"
    said = text(Reason(DiagnosisCode.PROBABILITY_TOO_LOW, probability=0.053, needed=0.99))
    assert said == "its probability is 0.053, and 0.99 is needed"
