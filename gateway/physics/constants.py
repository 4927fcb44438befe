"""Constants of nature and of the papers."""

from __future__ import annotations

from typing import Final

STANDARD_GRAVITY_MPS2: Final = 9.80665

# Ring paper, Table 3: Bs, Cw, Rs, Ts of a new car tire at 5000 N, 2.1 bar, 65 km/h.
TABLE_3_NUMBERS: Final = (3.0833e-3, 0.1953, 2.9740, 2.5289)
