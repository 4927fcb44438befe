"""Description of a run from the vehicle file and the options of the session."""

from gateway.config.vehicle import Tire, VehicleConfig
from gateway.errors import ConfigError
from gateway.nearest_name import did_you_mean
from gateway.recording.run_description import RunDescription, TireIdentity


def stated_run(vehicle: VehicleConfig | None, statement: RunDescription) -> RunDescription:
    """Return what the vehicle file states of the run, overridden by what the session's options give.

    Raises:
        ConfigError: the options give a tire at a position that the vehicle does not have.
    """
    if vehicle is None:
        return statement
    check_tires(vehicle, statement)
    table = vehicle.test
    tires = {wheel.position: _identity(vehicle.tire_of(wheel)) for wheel in vehicle.wheel}
    stated = RunDescription(
        table.name or "",
        table.driver or "",
        table.comment or "",
        table.tags or (),
        {position: tire for position, tire in tires.items() if tire != TireIdentity()},
    )
    return stated.overridden_by(statement)


def check_tires(vehicle: VehicleConfig | None, run: RunDescription) -> None:
    """Check that tires of a run are at wheels of the vehicle.

    Raises:
        ConfigError: one is not.
    """
    positions = [wheel.position for wheel in vehicle.wheel] if vehicle is not None else list(run.tires)
    for position in run.tires:
        if position not in positions:
            raise ConfigError(
                f"a tire is given at '{position}', but the vehicle has no such wheel",
                f"{did_you_mean(position, positions)}It has: {', '.join(positions)}.",
            )


def with_given_wear(vehicle: VehicleConfig | None, statement: RunDescription) -> VehicleConfig | None:
    """Return the vehicle with the wear that the session's options give, which the estimates use."""
    wear_mm = {position: tire.wear_m * 1e3 for position, tire in statement.tires.items() if tire.wear_m is not None}
    if vehicle is None or not wear_mm:
        return vehicle
    wheels = tuple(
        wheel.model_copy(update={"tire": wheel.tire.model_copy(update={"wear_mm": wear_mm[wheel.position]})})
        if wheel.position in wear_mm
        else wheel
        for wheel in vehicle.wheel
    )
    return vehicle.model_copy(update={"wheel": wheels})


def _identity(tire: Tire) -> TireIdentity:
    return TireIdentity(
        tire.maker or "",
        tire.dot or "",
        None if tire.wear_mm is None else tire.wear_mm * 1e-3,
        None if tire.run_in_km is None else tire.run_in_km * 1e3,
    )
