"""Notes of a diagnosis."""

import pytest

from gateway.core.reasons import Reason
from gateway.diagnosis.closed_loop import _notes
from gateway.diagnosis.effects.effect import BaselineModel
from gateway.diagnosis.model.baseline_registry import make_core
from gateway.diagnosis.reasons import DiagnosisCode
from tests.diagnosis.planted_campaign import TWO_SPEEDS, campaign_of


@pytest.mark.parametrize("model", BaselineModel)
def test_model_without_mean_is_noted(model):
    notes = _notes(campaign_of(TWO_SPEEDS), with_mean=make_core(model).mean)
    if model is BaselineModel.PAPER:
        assert notes == (Reason(DiagnosisCode.MEANS_NOT_COMPARED),)
    else:
        assert notes == ()
