"""Labels of the series of trends."""

from __future__ import annotations

from typing import Final

SERIES_LABELS: Final[dict[str, str]] = {
    "wear_mm": "wear",
    "pressure_at_20_degc": "pressure at 20 °C",
    "estimated_load_n": "load",
    "contact_length_m": "contact length",
    "Bs": "Bs",
    "Cw": "Cw",
    "Rs": "Rs",
    "Ts": "Ts",
    "noise_mps2": "ln noise",
    "samples_lost": "samples lost",
    "samples_saturated": "samples at the end of the range",
    "mounting_offset_m": "distance from the neutral layer",
    "gain": "gain",
    "zero_g_offset_mps2": "zero-g offset",
}
