"""The stand-in for the actual SmartPal: its units with their public interface, in the robot's own naming service."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

from robocorba.errors.services import ServiceError
from robocorba.map_editor.formats import read_map
from robocorba.map_editor.geometry import obstacles
from robocorba.orb.orb import Orb
from robocorba.robot.corba.adaptor_servant import RobotSensorsServant
from robocorba.robot.kinematics.smartpal import Side
from robocorba.robot.realtime import raise_process_priority, use_realtime_scheduling
from robocorba.robot.smartpal_stand_in.world import World
from robocorba.simulation.sensing.scan import Noise
from robocorba.system import logs
from robocorba.system.extras import require_extra
from robocorba.system.printing import fail
from robocorba.system.private_files import claim_state
from robocorba.system.repeating import Repeating
from robocorba.system.settings import InvalidSetting, SmartPalSettings


def world_of(settings: SmartPalSettings) -> World | None:
    """What stands around the robot; None without a file. Raises MapFileError, InvalidSetting."""
    if settings.world is None:
        return None
    building = read_map(settings.world).building
    floor = settings.world_floor or next(iter(building.floors), "")
    if floor not in building.floors:
        reason = f"{settings.world} has the floors {', '.join(building.floors) or 'none'}"
        raise InvalidSetting("--world-floor", floor, reason)
    shapes = [obstacle.geometry for obstacle in obstacles(building, floor)]
    world = World(shapes, settings.world_at, Noise(settings.range_noise_m, lost=settings.range_lost), settings.seed)
    world.ranges("laser")  # compiles the kernels
    return world


def main(arguments: Sequence[str] | None = None) -> None:
    settings = SmartPalSettings.read(arguments, __doc__ or "")
    try:
        require_extra("smartpal", "stand-ins for SmartPal")
    except ServiceError as error:
        fail(f"smartpal: {error}")
    from robocorba.robot.corba.smartpal_unit_servants import (
        ArmServant,
        FaultsServant,
        GripperServant,
        LumbarServant,
        MobilityServant,
    )
    from robocorba.robot.smartpal_stand_in.robot import SmartPal
    from robocorba.robot.smartpal_stand_in.unit import UnitPolicy

    claim_state(settings.server.state)
    logs.setup("smartpal", settings.server.state / "logs")
    raise_process_priority()
    policy = UnitPolicy(settings.restores_servo, settings.unlocks_by_power, settings.limit_slack)
    robot = SmartPal(settings.seed, settings.start, policy)
    robot.warm_up()
    world = world_of(settings)
    if world:
        robot.dynamics.allowed = world.allowed
    use_realtime_scheduling()  # inherited by threads started later; a robot's own computers do nothing else
    faults = robot.faults
    with (
        Orb(settings.server.naming, settings.server.endpoint, context="") as orb,
        contextlib.closing(faults),
        contextlib.closing(Repeating("dynamics", robot.catch_up, 0.003)) as clock,
    ):
        clock.start()
        orb.serve(
            {
                "Mobility.Unit": MobilityServant(robot.mobility, faults),
                "MnpR": ArmServant(robot.arms[Side.RIGHT], faults),
                "MnpL": ArmServant(robot.arms[Side.LEFT], faults),
                "GripperR": GripperServant(robot.grippers[Side.RIGHT], faults),
                "GripperL": GripperServant(robot.grippers[Side.LEFT], faults),
                "Lumbar": LumbarServant(robot.lumbar, faults),
                "Faults": FaultsServant(faults),
                **({"Sensors": RobotSensorsServant(lambda: world)} if world else {}),
            }
        )
        orb.run()


if __name__ == "__main__":
    main()
