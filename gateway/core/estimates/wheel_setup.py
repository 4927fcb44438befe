"""Setup of one wheel in the pipeline, made from the configuration."""

from dataclasses import dataclass, field

from gateway.core.estimates.doubt_rules import EVERY_RULE, DoubtRule
from gateway.core.estimates.sensor_claims import AXIS_GAIN_STD as AXIS_GAIN_STD
from gateway.core.estimates.sensor_claims import GAIN_STD as GAIN_STD
from gateway.core.estimates.sensor_claims import HAND_MOUNTED_STD_M as HAND_MOUNTED_STD_M
from gateway.core.estimates.sensor_claims import HAND_MOUNTED_STD_RAD as HAND_MOUNTED_STD_RAD
from gateway.core.estimates.sensor_claims import LOAD_STD as LOAD_STD
from gateway.core.estimates.sensor_claims import NONLINEARITY_STD as NONLINEARITY_STD
from gateway.core.estimates.sensor_claims import PRESSURE_STD as PRESSURE_STD
from gateway.core.estimates.sensor_claims import RADIUS_STD as RADIUS_STD
from gateway.core.estimates.sensor_claims import RATE_STD as RATE_STD
from gateway.core.estimates.sensor_claims import ZERO_G_STD_MPS2 as ZERO_G_STD_MPS2
from gateway.core.estimates.sensor_claims import SensorClaims as SensorClaims
from gateway.core.estimates.tire_data import RUN_OUT_M as RUN_OUT_M
from gateway.core.estimates.tire_data import SOFTENING_PER_K as SOFTENING_PER_K
from gateway.core.estimates.tire_data import SOFTENING_STD_PER_K as SOFTENING_STD_PER_K
from gateway.core.estimates.tire_data import LoadCalibration as LoadCalibration
from gateway.core.estimates.tire_data import ReferenceNumbers as ReferenceNumbers
from gateway.core.estimates.tire_data import TireData as TireData
from gateway.core.revolutions.effect_correction import CorrectedEffect as CorrectedEffect
from gateway.core.revolutions.effect_correction import CorrectedSignal as CorrectedSignal
from gateway.core.revolutions.effect_correction import CorrectionTable as CorrectionTable
from gateway.core.revolutions.effect_correction import EffectParameter as EffectParameter


@dataclass(frozen=True, slots=True)
class WheelSetup:
    """One wheel as configured.

    Attributes:
        position: name shown to the user, e.g. `FL`.
        hub: hub number on its link.
        wheel: wheel number at the hub.
        radius_m: belt radius.
        radius_std_m: its standard error.
        load_n: vertical load, None when unknown.
        load_std_n: its standard error.
        pressure_pa: stated inflation pressure, used until the sensor reports one; None when unknown.
        pressure_std_pa: its standard error.
        pressure_relative_std: standard error of the pressure, stated or measured, over its value, where that is larger.
        temperature_degc: stated temperature, used until the sensor reports one.
        sensor: what is stated about the sensor.
        tire: the new tire's reference numbers, thickness, calibrations and laminate.
        correction: known effects to subtract from the axes; None for none.
        assumed_errors: quantities whose standard error is not stated and has its default, by their names in a budget.
        rules: of doubt that apply; all, but in a study of what one of them brings.
    """

    position: str
    hub: int
    wheel: int
    radius_m: float
    radius_std_m: float = 0.0
    load_n: float | None = None
    load_std_n: float = 0.0
    pressure_pa: float | None = None
    pressure_std_pa: float = 0.0
    pressure_relative_std: float = 0.0
    temperature_degc: float | None = None
    sensor: SensorClaims = field(default_factory=SensorClaims)
    tire: TireData = field(default_factory=TireData)
    correction: CorrectionTable | None = None
    assumed_errors: frozenset[str] = frozenset()
    rules: frozenset[DoubtRule] = EVERY_RULE
