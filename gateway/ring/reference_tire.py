"""The reference tire of the ring paper."""

from typing import Final

# Ring paper, Table 3: Bs, Cw, Rs, Ts of a new car tire at 5000 N, 2.1 bar, 65 km/h.
TABLE_3_NUMBERS: Final = (3.0833e-3, 0.1953, 2.9740, 2.5289)
TABLE_3_LOAD_N: Final = 5000.0
TABLE_3_PRESSURE_PA: Final = 2.1e5
TABLE_3_RADIUS_M: Final = 0.32
TABLE_3_LOAD_NUMBER: Final = TABLE_3_LOAD_N / (TABLE_3_PRESSURE_PA * TABLE_3_RADIUS_M**2)
"""Load over pressure and radius squared, Q / (p0 R^2)."""
