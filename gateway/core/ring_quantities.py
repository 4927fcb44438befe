"""Quantities of the ring: its four numbers, and their ratios."""

from typing import Final

from gateway.core.quantity import ON_WAVEFORM, Basis, BusFrame, OnBus, Quantity, Statement, Trend, Watch

RING_AVERAGE: Final = 50
"""Revolutions that the running average of the radial axis remembers."""
ON_SHAPE: Final = ON_WAVEFORM | {Basis.OFFSET, Basis.ZERO, Basis.HUB}
BY_RADIUS_AND_LOAD: Final = frozenset({Statement.RADIUS, Statement.LOAD})
_BELT_FRAME: Final = BusFrame(3, "Belt")
_RING_FRAME: Final = BusFrame(4, "Ring")


def _ring_number(
    name: str, description: str, possible: tuple[float, float], bus: OnBus, *, is_over_pressure: bool = True
) -> Quantity:
    return Quantity(
        name,
        description,
        plain=f"{description.rpartition(' number ')[0]} number ({name})",
        equation="balance of the rolling ring, scaled by Q / (p0 R^2)",
        powers={Basis.RADIUS: -2.0, Basis.LOAD: 1.0, Basis.PRESSURE: -1.0},
        rests_on=ON_SHAPE | {Basis.PRESSURE},
        possible=possible,
        is_steady=True,
        memory_revolutions=RING_AVERAGE,
        bus=bus,
        # 5 % of EI are 0.25 mm of a ring of 15 mm.
        watch=Watch(
            number=name,
            unit="%",
            notable=5.0,
            trend=Trend.STIFFNESS,
            is_logarithm=True,
            # EI falls with the cube of the thickness.
            falls_with_wear=name == "Bs",
            is_over_pressure=is_over_pressure,
            is_drawn=True,
            shifted_by=BY_RADIUS_AND_LOAD,
        ),
    )


_NUMBERS: Final = (
    _ring_number("Bs", "bending stiffness number EI / (R^4 p0)", (0.0, 0.1), OnBus(_BELT_FRAME, "Bs", 1e-6, 1e-5)),
    _ring_number(
        "Cw", "contact width number b / R", (0.05, 0.45), OnBus(_BELT_FRAME, "Cw", 1e-5, 1e-4), is_over_pressure=False
    ),
    _ring_number("Rs", "radial sidewall stiffness number kw / p0", (0.2, 30.0), OnBus(_RING_FRAME, "Rs", 1e-3, 1e-2)),
    _ring_number(
        "Ts", "tangential sidewall stiffness number kv / p0", (0.05, 30.0), OnBus(_RING_FRAME, "Ts", 1e-3, 1e-2)
    ),
)
RING_NUMBERS: Final = tuple(quantity.name for quantity in _NUMBERS)
"""Dimensionless numbers of the ring: bending stiffness, contact width, radial and tangential stiffness."""
_RATIOS: Final = tuple(
    Quantity(
        f"{name}/Cw",
        "ratio of the numbers, which needs neither load nor pressure",
        "balance of the rolling ring",
        rests_on=ON_SHAPE,
        possible=possible,
        is_steady=True,
        memory_revolutions=RING_AVERAGE,
    )
    for name, possible in zip(
        (name for name in RING_NUMBERS if name != "Cw"), ((0.0, 0.5), (1.0, 100.0), (0.5, 60.0)), strict=True
    )
)
RING_RATIOS: Final = tuple(quantity.name for quantity in _RATIOS)
"""Their ratios to Cw, which neither load nor pressure is needed for."""
RING: Final = (*_NUMBERS, *_RATIOS)
