"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature, Registry

FEATURE: Final = Feature(
    commands={
        "calibrate": CommandLine(
            "gateway.forces.commands.calibrate:calibrate", "Calibrate a tire: load, wear, slip, side force."
        ),
    },
    adds={
        Registry.VEHICLE_KEYS: {
            "tire.slip_calibration": "gateway.forces.tire_tables:SLIP_CALIBRATION",
            "tire.side_force_calibration": "gateway.forces.tire_tables:SIDE_FORCE_CALIBRATION",
            "tire.laminate": "gateway.forces.tire_tables:LAMINATE",
        },
        Registry.QUANTITIES: {
            "longitudinal-force": "gateway.forces.quantities:LONGITUDINAL_FORCE",
            "ply-steer": "gateway.forces.quantities:PLY_STEER",
            "turning": "gateway.forces.quantities:TURNING",
            "grade": "gateway.forces.quantities:GRADE",
            "slip-angle": "gateway.forces.quantities:SLIP_ANGLE",
            "side-force": "gateway.forces.quantities:SIDE_FORCE",
            "friction": "gateway.forces.quantities:FRICTION",
            "asynchronous": "gateway.forces.quantities:ASYNCHRONOUS",
            "cavity": "gateway.forces.quantities:CAVITY",
            "road": "gateway.forces.quantities:ROAD",
        },
        Registry.PARTS: {"shared turn": "gateway.forces.shared_turn:SharedTurn"},
        Registry.ESTIMATORS: {
            "longitudinal-force": "gateway.forces.longitudinal_force:LongitudinalForceEstimator",
            "ply-steer": "gateway.forces.ply_steer:PlySteerEstimator",
            "turning": "gateway.forces.turning:TurningEstimator",
            "grade": "gateway.forces.road_grade:RoadGradeEstimator",
            "slip-angle": "gateway.forces.slip_angle:SlipAngleEstimator",
            "side-force": "gateway.forces.side_force:SideForceEstimator",
            "friction": "gateway.forces.friction_use:FrictionUseEstimator",
            "asynchronous": "gateway.forces.nonsynchronous:NonsynchronousEstimator",
            "cavity": "gateway.forces.cavity:CavityEstimator",
            "road": "gateway.forces.road_roughness:RoadRoughnessEstimator",
        },
    },
)
