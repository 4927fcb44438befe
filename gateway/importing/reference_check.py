"""Check of the estimated revolutions of a recording against the references in it."""

from gateway.core.config.vehicle import ASSUMED_RADIUS_MM, VehicleConfig
from gateway.core.estimates.results import RevolutionResult
from gateway.importing.reference_comparison import ReferenceComparison, TurnLog
from gateway.importing.reference_topic import ReferenceReader


class ReferenceCheck:
    """Collector of the revolutions of a recording while it is estimated, to compare them with its references."""

    def __init__(self, reader: ReferenceReader, vehicle: VehicleConfig | None) -> None:
        """Prepare the check; `vehicle` gives the belt radii."""
        self._reader = reader
        self._turns: dict[str, TurnLog] = {}
        setups = vehicle.wheel_setups() if vehicle is not None else ()
        self._radius_m = {setup.position: setup.radius_m for setup in setups}

    def add(self, result: RevolutionResult) -> None:
        """Add a revolution."""
        self._turns.setdefault(result.position, TurnLog()).add(result.revolution)

    def comparisons(self) -> tuple[ReferenceComparison, ...]:
        """Return the comparison with every reference, by wheel."""
        comparisons = []
        for reference in self._reader.references():
            turns = self._turns.get(reference.position, TurnLog())
            comparison = turns.compare(
                reference.position,
                reference.name,
                reference.quantity,
                reference.times_s,
                reference.values,
                reference.value_std,
                self._radius_m.get(reference.position, ASSUMED_RADIUS_MM * 1e-3),
            )
            comparisons.append(comparison)
        return tuple(comparisons)
