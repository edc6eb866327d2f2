"""The stand-in for the actual SmartPal: its units with their public interface, in the robot's own naming service."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

from robocorba.errors.services import ServiceError
from robocorba.orb.orb import Orb
from robocorba.robot.kinematics.smartpal import Side
from robocorba.robot.realtime import raise_process_priority, use_realtime_scheduling
from robocorba.system import logs
from robocorba.system.extras import require_extra
from robocorba.system.printing import fail
from robocorba.system.private_files import claim_state
from robocorba.system.repeating import Repeating
from robocorba.system.settings import SmartPalSettings


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
            }
        )
        orb.run()


if __name__ == "__main__":
    main()
