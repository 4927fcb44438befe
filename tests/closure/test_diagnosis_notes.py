"""Notes of a diagnosis."""

from __future__ import annotations

import pytest

from gateway.closure.diagnose import _notes
from gateway.closure.effects.base import BaselineModel
from gateway.closure.starting import make_core
from gateway.reasons import Code, Reason
from tests.closure.planted_campaign import TWO_SPEEDS, campaign_of


@pytest.mark.parametrize("model", BaselineModel)
def test_model_without_mean_is_noted(model):
    notes = _notes(campaign_of(TWO_SPEEDS), with_mean=make_core(model).mean)
    if model is BaselineModel.PAPER:
        assert notes == (Reason(Code.MEANS_NOT_COMPARED),)
    else:
        assert notes == ()
