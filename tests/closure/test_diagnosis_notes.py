"""What a diagnosis says that the user must know of the data and of where it began."""

from __future__ import annotations

import pytest

from gateway.closure.diagnose import _notes
from gateway.closure.effects.base import BaselineModel
from gateway.closure.starting import make_core
from tests.closure.planted_campaign import TWO_SPEEDS, campaign_of


@pytest.mark.parametrize("model", BaselineModel)
def test_a_model_without_a_mean_says_what_it_cannot_see(model):
    notes = _notes(campaign_of(TWO_SPEEDS), with_mean=make_core(model).mean)
    if model is BaselineModel.PAPER:
        assert "no mean" in notes[0]
        assert "zero-g offset" in notes[0]
        assert "--model exact" in notes[0]
    else:
        assert notes == ()
