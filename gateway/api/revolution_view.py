"""One revolution with its estimates, as programs get it from a stream."""

from collections.abc import Mapping
from html import escape
from typing import Final

import numpy as np

from gateway.api.column_table import utc_array
from gateway.core.estimates.estimator import Estimate, TireConditions
from gateway.core.estimates.estimator import Revolution as RevolutionSignal
from gateway.core.estimates.results import RevolutionResult
from gateway.core.quantity_catalogue import declared
from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.text.numbers import show
from gateway.core.text.wording import joined, text
from gateway.core.types import ComplexArray, FloatArray

_SHOWN: Final = tuple(quantity.name for quantity in declared() if quantity.entity)


class Revolution:
    """One revolution of a wheel: its signal in the angle domain, its conditions and its estimates.

    Attributes:
        signal: the revolution as the estimators take it, with every field.
        conditions: radius, load, pressure and temperature in use.
        estimates: by name; each has `value`, `std`, `status` and `reasons`.
    """

    __slots__ = ("_has_host_time", "_result", "conditions", "estimates", "signal")

    def __init__(self, result: RevolutionResult, *, has_host_time: bool = True) -> None:
        """Take a result of the pipeline."""
        self._result = result
        self._has_host_time = has_host_time
        self.signal: RevolutionSignal = result.revolution
        self.conditions: TireConditions = result.conditions
        self.estimates: Mapping[str, Estimate] = {estimate.name: estimate for estimate in result.estimates}

    @property
    def wheel(self) -> str:
        """Position of the wheel."""
        return self._result.position

    @property
    def number(self) -> int:
        """Running number of the wheel's revolution."""
        return self.signal.index

    @property
    def device_start_s(self) -> float:
        """Time of the hub's clock at the first contact centre, s."""
        return self.signal.start_s

    @property
    def period_s(self) -> float:
        """Duration, s."""
        return self.signal.period_s

    @property
    def host_ns(self) -> int:
        """Time of the computer's clock at its end, ns since the epoch; 0 when the file has no arrival times."""
        return self._result.host_ns if self._has_host_time else 0

    @property
    def host_utc(self) -> np.datetime64:
        """The same as `datetime64[ns]`, NaT when the file has no arrival times."""
        value: np.datetime64 = utc_array([self.host_ns])[0]
        return value

    @property
    def speed_mps(self) -> float:
        """Rolling speed, belt radius times angular speed, m/s."""
        return self.signal.omega_radps * self.conditions.radius_m

    @property
    def angle_rad(self) -> FloatArray:
        """Angles of the waveforms, (n,), 0 at the contact centre."""
        return angle_grid(len(self.signal.radial_mps2))

    @property
    def axes_mps2(self) -> FloatArray:
        """Circumferential, lateral and radial axis as measured, (3, n); NaN rows for absent axes."""
        return self.signal.axes_mps2

    @property
    def normalised_mps2(self) -> FloatArray:
        """Radial axis without gravity and angular acceleration, (n,)."""
        return self.signal.radial_mps2

    @property
    def orders_mps2(self) -> ComplexArray:
        """Coefficients c - i s of its orders 0 to 60, (61,)."""
        return self.signal.orders_mps2

    @property
    def usable(self) -> bool:
        """Whether it may be used for estimates."""
        return not self.signal.faults

    @property
    def faults(self) -> str:
        """Why it may not be used, in words; empty when it may."""
        return joined(self.signal.faults)

    @property
    def alarms(self) -> tuple[str, ...]:
        """Alarms that stood at the wheel, in words; of recordings only."""
        return tuple(text(alarm.reason) for alarm in self._result.alarms)

    def __getitem__(self, name: str) -> Estimate:
        """Return an estimate by name; raises KeyError for another name."""
        if name not in self.estimates:
            raise KeyError(f"there is no estimate '{name}': there are {', '.join(self.estimates)}")
        return self.estimates[name]

    def __repr__(self) -> str:
        shown = [show(self.estimates[name]) for name in _SHOWN if name in self.estimates]
        numbers = ", ".join(f"{estimate.label} {estimate.text()}" for estimate in shown)
        return f"<Revolution {self.number} of {self.wheel}: {numbers or f'speed {self.speed_mps * 3.6:.2f} km/h'}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            "<tr>"
            + "".join(
                f'<td style="text-align:left">{escape(cell)}</td>'
                for cell in (name, show(estimate).text(), str(estimate.status), joined(estimate.reasons))
            )
            + "</tr>"
            for name, estimate in self.estimates.items()
        )
        head = "<tr><th>estimate</th><th>value</th><th>status</th><th>reasons</th></tr>"
        return f"<p>{escape(repr(self)[1:-1])}</p><table>{head}{rows}</table>"
