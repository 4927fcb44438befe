"""Damaged files of loggers and buses: nothing is read in part, or wrongly, without a word."""

import pytest

from tools.reliability.damage_table import SILENT, verdicts

# Samples without a checksum: zeros among them cannot be told from measured ones.
_NO_CHECKSUM = {("run.raw", "blank"), ("run.wav", "blank"), ("run.tdms", "blank")}


@pytest.mark.slow
def test_damage_is_told() -> None:
    silent = {(name, damage) for name, row in verdicts().items() for damage, said in row.items() if said == SILENT}
    assert silent <= _NO_CHECKSUM
