"""Declaration of the feature."""

from typing import Final

from gateway.feature import CommandLine, Feature, Registry

FEATURE: Final = Feature(
    commands={
        "calibrate": CommandLine(
            "gateway.cli.calibrate:calibrate", "Calibrate load, reference numbers and slip of a tire."
        ),
    },
    adds={
        Registry.ESTIMATORS: {
            "longitudinal-force": "gateway.estimators.longitudinal_force:LongitudinalForceEstimator",
            "ply-steer": "gateway.estimators.ply_steer:PlySteerEstimator",
            "slip-angle": "gateway.estimators.slip_angle:SlipAngleEstimator",
            "side-force": "gateway.estimators.side_force:SideForceEstimator",
            "friction": "gateway.estimators.friction_use:FrictionUseEstimator",
            "asynchronous": "gateway.estimators.nonsynchronous:NonsynchronousEstimator",
            "cavity": "gateway.estimators.cavity:CavityEstimator",
            "road": "gateway.estimators.road_roughness:RoadRoughnessEstimator",
        },
    },
)
