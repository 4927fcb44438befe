"""Damaged files of loggers and buses: nothing is read in part, or wrongly, without a word."""

import pytest

from tools.reliability.damage_table import SILENT, verdicts


@pytest.mark.slow
def test_damage_is_told() -> None:
    silent = {(name, damage) for name, row in verdicts().items() for damage, said in row.items() if said == SILENT}
    assert not silent
