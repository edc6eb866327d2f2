"""The actual robots A and B, stand-ins, on a computer of their own: prints `ready` and the naming service of each, and
ends with its input: FOLDER."""

from __future__ import annotations

import sys
from pathlib import Path

from robocorba.clients.robot_processes import ActualRobot
from robocorba.orb.orb import Orb
from robocorba.system.settings import Address


def main(folder: Path) -> None:
    with Orb(Address("127.0.0.1", 2809)) as orb, ActualRobot(folder / "A") as one, ActualRobot(folder / "B") as other:
        one.wait_ready(orb)
        other.wait_ready(orb)
        print("ready", one.naming, other.naming, flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
