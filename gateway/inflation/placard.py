"""Placard of the vehicle: recommended cold pressure, by load, and what it is in a warm tire."""

from dataclasses import dataclass
from typing import Final

from pydantic import Field

from gateway.core.config.validation import AddedKey, AddedTable, within
from gateway.core.constants import STANDARD_ATMOSPHERE_PA, ZERO_CELSIUS_K

WARM_DEGC: Final = 25.0
"""Highest temperature of a cold tire whose placard states none: a session may begin with warm tires."""


@dataclass(frozen=True, slots=True)
class Placard:
    """Recommended cold gauge pressures.

    Attributes:
        pressure_pa: up to `load_n`.
        full_load_pressure_pa: above it.
        load_n: load of the wheel up to which `pressure_pa` holds.
        temperature_degc: of the tire when it was inflated; None where it is not known.
    """

    pressure_pa: float
    full_load_pressure_pa: float | None = None
    load_n: float | None = None
    temperature_degc: float | None = None

    def cold_pa(self, load_n: float | None) -> float:
        """Return the recommended cold pressure at a load; the lower one where the load is not known."""
        if load_n is None or self.load_n is None or self.full_load_pressure_pa is None or load_n <= self.load_n:
            return self.pressure_pa
        return self.full_load_pressure_pa

    def warm_pa(self, load_n: float | None, temperature_degc: float | None, coldest_degc: float) -> float:
        """Return Pwarm of UN R141, 2: the recommended pressure raised by the tire's temperature (ideal gas).

        Args:
            load_n: of the wheel.
            temperature_degc: of the air in the tire, None where it is not measured: the cold pressure then counts.
            coldest_degc: lowest one measured so far, that of the cold tire where the placard states none.
        """
        cold_pa = self.cold_pa(load_n)
        if temperature_degc is None:
            return cold_pa
        inflated_degc = min(coldest_degc, WARM_DEGC) if self.temperature_degc is None else self.temperature_degc
        ratio = (temperature_degc + ZERO_CELSIUS_K) / (inflated_degc + ZERO_CELSIUS_K)
        return (cold_pa + STANDARD_ATMOSPHERE_PA) * ratio - STANDARD_ATMOSPHERE_PA


class PlacardTable(AddedTable):
    """`[tire.placard]`: recommended cold pressure, which the pressure warning compares with."""

    pressure_kpa: float = Field(ge=50, le=1500, description="recommended cold gauge pressure in kPa, up to load_n")
    full_load_pressure_kpa: float | None = within(None, 50, 1500, "the same above load_n in kPa")
    load_n: float | None = within(None, 50, 100_000, "load of a wheel up to which pressure_kpa holds, in N")
    temperature_degc: float | None = within(
        None,
        -40,
        60,
        "temperature of the tire when it was inflated, in degrees Celsius; default: the coldest one of the session, "
        f"at most {WARM_DEGC:g}",
    )

    def data(self) -> Placard:
        """Return the placard in SI."""
        full_kpa = self.full_load_pressure_kpa
        return Placard(
            1e3 * self.pressure_kpa, None if full_kpa is None else 1e3 * full_kpa, self.load_n, self.temperature_degc
        )


PLACARD: Final = AddedKey(PlacardTable, "recommended cold pressure of the vehicle's placard")
