"""Why estimates are not determined, and what would help, in a few words."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from gateway.closure.diagnosis import FAR_OFF, Diagnosis
from gateway.views.report.rows import listed, ratio, remark_words

# A number that is known worse than this share of itself is not determined.
_WORST_SHARE: Final = 0.3
# `load 4000 N (nobody states it)`
_ASSUMED: Final = re.compile(r"(load|pressure) \d")


def why_undetermined(diagnosis: Diagnosis, names: Sequence[str]) -> str:
    """Return the main reason why some estimates are not determined, and the remedy; empty for none."""
    if not names:
        return ""
    share = ratio(diagnosis.held_out.rms_after_mps2, diagnosis.noise_floor_mps2)
    if share > FAR_OFF:
        return "the model still lacks too much; explain what is left first"
    assumed = [match[1] for text in diagnosis.assumed if (match := _ASSUMED.match(remark_words(text)))]
    if assumed:
        return f"{listed(list(dict.fromkeys(assumed)))} assumed; state it"
    known = [diagnosis.estimates_after[name] for name in names if name in diagnosis.estimates_after]
    if any(not one.std < _WORST_SHARE * abs(one.value) for one in known):
        return "known to no better than 30 %; record longer, or at more loads"
    # Each load and pressure is judged by itself, so all of one may be doubtful where most data are well described.
    if len(known) > 1:
        return "the model lacks too much at this load and pressure"
    return "too small to be told; record at more loads"
