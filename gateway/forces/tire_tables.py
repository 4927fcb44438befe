"""Tables of a vehicle configuration for lateral behavior: calibrations of slip and side force, laminate."""

import math
from typing import Final

from pydantic import Field

from gateway.core.config.si_values import si_values
from gateway.core.config.validation import AddedKey, AddedTable, Section, within
from gateway.forces.belt_laminate import BeltLaminate, StatedPly
from gateway.forces.side_force_calibration import LinearLaw, SideForceCalibration
from gateway.forces.slip_calibration import SlipCalibration

# Relative standard errors where none is stated: the modulus of a twisted cord depends on its lay, that of a compound on
# temperature and strain.
CORD_STD: Final = 0.1
RUBBER_STD: Final = 0.2


class SlipCalibrationTable(AddedTable):
    """`[tire.slip_calibration]`: slope of the belt over slip angle, as written by `treadlink calibrate slip`."""

    belt_share: float = Field(gt=0, le=1, description="slope per slip angle at zero slip, dimensionless")
    belt_share_std: float = Field(ge=0, le=1, description="standard error of belt_share")
    zero_deg: float = Field(
        ge=-5, le=5, description="slope at zero slip in degrees, rolling forward: ply steer plus conicity"
    )
    zero_std_deg: float = Field(ge=0, le=5, description="standard error of zero_deg in degrees")
    saturation_per_deg: float = within(0.0, 0, 0.4, "relative loss of belt_share by slip, in 1 / degrees")
    saturation_std_per_deg: float = within(0.0, 0, 0.4, "standard error of saturation_per_deg in 1 / degrees")
    zero_share_correlation: float = within(0.0, -1, 1, "correlation of the errors of zero_deg and belt_share")
    share_saturation_correlation: float = within(
        0.0, -1, 1, "correlation of the errors of belt_share and saturation_per_deg"
    )
    slip_min_deg: float = Field(ge=-5, le=5, description="lowest calibrated slip angle in degrees")
    slip_max_deg: float = Field(ge=-5, le=5, description="highest calibrated slip angle in degrees")
    half_angle_min_rad: float = Field(ge=0.01, le=1.5, description="smallest calibrated half angle in rad")
    half_angle_max_rad: float = Field(ge=0.01, le=1.5, description="largest calibrated half angle in rad")
    pressure_min_kpa: float = Field(ge=10, le=1500, description="lowest calibrated gauge pressure in kPa")
    pressure_max_kpa: float = Field(ge=10, le=1500, description="highest calibrated gauge pressure in kPa")
    ply_steer_deg: float | None = within(None, -5, 5, "part of zero_deg that rolling in reverse turns over, in degrees")
    ply_steer_std_deg: float = within(0.0, 0, 5, "standard error of ply_steer_deg in degrees")
    conicity_deg: float | None = within(
        None, -5, 5, "part of zero_deg that rolling in reverse does not change, in degrees"
    )
    conicity_std_deg: float = within(0.0, 0, 5, "standard error of conicity_deg in degrees")

    def data(self) -> SlipCalibration:
        """Return the calibration in SI."""
        return SlipCalibration(**si_values(self))


class SideForceCalibrationTable(AddedTable):
    """`[tire.side_force_calibration]`: force per displacement of the belt, as written by the calibration."""

    side_n_per_mm: float = Field(ge=-100_000, le=100_000, description="side force per shift of the belt in N/mm")
    side_std_n_per_mm: float = Field(ge=0, le=100_000, description="standard error of side_n_per_mm in N/mm")
    shift_zero_mm: float = Field(ge=-50, le=50, description="shift without side force in mm")
    shift_zero_std_mm: float = Field(ge=0, le=50, description="standard error of shift_zero_mm in mm")
    moment_nm_per_deg: float | None = within(
        None, -100_000, 100_000, "aligning moment per yaw of the belt in N m / degrees"
    )
    moment_std_nm_per_deg: float = within(0.0, 0, 100_000, "standard error of moment_nm_per_deg in N m / degrees")
    yaw_zero_deg: float = within(0.0, -10, 10, "yaw without aligning moment in degrees")
    yaw_zero_std_deg: float = within(0.0, 0, 10, "standard error of yaw_zero_deg in degrees")
    half_angle_min_rad: float = Field(ge=0.01, le=1.5, description="smallest calibrated half angle in rad")
    half_angle_max_rad: float = Field(ge=0.01, le=1.5, description="largest calibrated half angle in rad")
    pressure_min_kpa: float | None = within(None, 10, 1500, "lowest calibrated gauge pressure in kPa")
    pressure_max_kpa: float | None = within(None, 10, 1500, "highest calibrated gauge pressure in kPa")

    def data(self) -> SideForceCalibration:
        """Return the calibration in SI."""
        deg = math.radians(1.0)
        low_kpa, high_kpa = self.pressure_min_kpa, self.pressure_max_kpa
        moment = None
        if self.moment_nm_per_deg is not None:
            moment = LinearLaw(
                factor=self.moment_nm_per_deg / deg,
                factor_std=self.moment_std_nm_per_deg / deg,
                zero=self.yaw_zero_deg * deg,
                zero_std=self.yaw_zero_std_deg * deg,
            )
        return SideForceCalibration(
            side=LinearLaw(
                factor=self.side_n_per_mm * 1e3,
                factor_std=self.side_std_n_per_mm * 1e3,
                zero=self.shift_zero_mm * 1e-3,
                zero_std=self.shift_zero_std_mm * 1e-3,
            ),
            moment=moment,
            half_angle_range_rad=(self.half_angle_min_rad, self.half_angle_max_rad),
            pressure_range_pa=None if low_kpa is None or high_kpa is None else (low_kpa * 1e3, high_kpa * 1e3),
        )


class PlyTable(Section):
    """`[[tire.laminate.ply]]`: one ply of the belt, or a layer of rubber."""

    angle_deg: float = Field(
        ge=-90,
        le=90,
        description="angle of the cords from the belt's length in degrees, positive to the left of forward",
    )
    angle_std_deg: float = within(1.0, 0, 30, "standard error of angle_deg in degrees")
    thickness_mm: float = Field(ge=0.05, le=20, description="thickness of the ply with its rubber in mm")
    thickness_std_mm: float = within(0.05, 0, 5, "standard error of thickness_mm in mm")
    cord_gpa: float = Field(
        ge=0.1, le=1000, description="modulus of the cords along themselves in GPa: steel about 200, nylon about 4"
    )
    cord_std_gpa: float | None = within(None, 0, 500, "standard error of cord_gpa in GPa; default: 10 % of it")
    cord_share_percent: float = Field(
        ge=0, le=90, description="volume share of the cords in percent; 0 for a layer of rubber"
    )
    cord_share_std_percent: float = within(2.0, 0, 50, "standard error of cord_share_percent in percent of the volume")

    def ply(self) -> StatedPly:
        """Return the ply in SI."""
        values = si_values(self)
        if self.cord_std_gpa is None:
            values["cord_std_pa"] = CORD_STD * self.cord_gpa * 1e9
        return StatedPly(**values)


class LaminateTable(AddedTable):
    """`[tire.laminate]`: plies of the belt, for the ply steer that follows from them."""

    rubber_mpa: float = Field(ge=0.1, le=500, description="modulus of the rubber between the cords in MPa")
    rubber_std_mpa: float | None = within(None, 0, 250, "standard error of rubber_mpa in MPa; default: 20 % of it")
    ply: tuple[PlyTable, ...] = Field(
        strict=False, min_length=2, max_length=12, description="plies from the inside out, at least two"
    )

    def data(self) -> BeltLaminate:
        """Return the belt in SI."""
        rubber_std_mpa = RUBBER_STD * self.rubber_mpa if self.rubber_std_mpa is None else self.rubber_std_mpa
        return BeltLaminate(tuple(ply.ply() for ply in self.ply), self.rubber_mpa * 1e6, rubber_std_mpa * 1e6)


SLIP_CALIBRATION: Final = AddedKey(SlipCalibrationTable, "slope of the streamline over the slip angle")
SIDE_FORCE_CALIBRATION: Final = AddedKey(
    SideForceCalibrationTable, "side force and aligning moment over the displacement of the belt"
)
LAMINATE: Final = AddedKey(LaminateTable, "plies of the belt with their tolerances")
