"""Orders of one wheel, as the views take them."""

from dataclasses import dataclass

from gateway.compare.order_statistics import OrderStatistics, SpeedBin
from gateway.core.reasons import Reason
from gateway.core.text.numbers import shown_value, unit_symbol
from gateway.core.text.readout import SPEED
from gateway.exporting.mean_revolution import MeanRevolution


@dataclass(frozen=True, slots=True)
class WheelOrders:
    """Orders and average of one wheel.

    Attributes:
        wheel: position.
        radius_m: belt radius that turns angular speeds into speeds.
        statistics: of its usable revolutions.
        mean: their time synchronous average.
        rejected: number of revolutions that were left out because they have faults.
        doubts: what speaks against the known effects that were subtracted.
    """

    wheel: str
    radius_m: float
    statistics: OrderStatistics
    mean: MeanRevolution
    rejected: int
    doubts: tuple[Reason, ...] = ()

    @property
    def speed_range_kmh(self) -> tuple[float, float]:
        """Lowest and highest speed."""
        low, high = self.statistics.omega_range_radps
        return self.kmh(low), self.kmh(high)

    @property
    def speeds_with_spectrum(self) -> tuple[SpeedBin, ...]:
        """Ranges of speed that have a spectrum over several revolutions, slowest first."""
        return tuple(speed_bin for speed_bin in self.statistics.speeds if speed_bin.blocks)

    def speeds_text(self, decimals: int, *omegas_radps: float) -> str:
        """Return rolling speeds in the unit of the screen: `40.0 to 80.0 km/h`."""
        speeds = [shown_value(SPEED, omega_radps * self.radius_m, decimals) for omega_radps in omegas_radps]
        return f"{' to '.join(speeds)} {unit_symbol(SPEED)}"

    def kmh(self, omega_radps: float) -> float:
        """Return the rolling speed of an angular speed, to a millionth, so that limits are what they are stated as."""
        return round(omega_radps * self.radius_m * 3.6, 6)
