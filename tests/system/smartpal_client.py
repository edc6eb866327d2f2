"""A process that drives the robot of a naming service in a circle until it is ended: smartpal_client.py HOST:PORT."""

from __future__ import annotations

import sys
import time

from robocorba.control.smartpal_adaptor import SmartPalAdaptor
from robocorba.corba.orb import Orb
from robocorba.corba.remote.smartpal_units import units_at
from robocorba.motion.robot_state import ActorCommand, RobotState
from robocorba.settings import Address


def main() -> None:
    with Orb(Address.parse(sys.argv[1])) as orb:
        adaptor = SmartPalAdaptor(units_at(orb))
        adaptor.start(["--naming", sys.argv[1]])
        state = RobotState()
        for tick in range(1500):
            adaptor.read(state)
            adaptor.write(ActorCommand((0.3, 0.0, 0.5)))
            if tick == 40:
                print("driving", flush=True)
            time.sleep(0.02)


if __name__ == "__main__":
    main()
