"""A process with the data pool of a robot, for tests: python data_pool_server.py HOST:PORT FLOOR ROBOT

It serves the robot's agent, of which only the pool answers, keeps a plan, and goes to each floor that it reads a line
with."""

from __future__ import annotations

import contextlib
import sys
import threading
from typing import Any

import msgpack

from robocorba.corba.orb import Orb
from robocorba.corba.remote.data_pool import PoolFollower
from robocorba.corba.servants.data_pool import DataPoolServant
from robocorba.data_pool.plans import Plans
from robocorba.names import ROBOTS
from robocorba.settings import Address
from robocorba.stubs import RoboCorba__POA


class Agent(RoboCorba__POA.RobotAgent):
    def __init__(self, pool: Any) -> None:
        self._pool = pool

    def _get_pool(self) -> Any:
        return self._pool


def main(naming: str, floor: str, robot: str) -> None:
    plans = Plans()
    plans.put("carry", msgpack.packb("first thoughts"))
    plans.put("carry", msgpack.packb({"table": "T1", "robots": [robot, "other"]}), 1)
    with Orb(Address.parse(naming)) as orb, contextlib.closing(PoolFollower(orb, floor, robot)) as follower:
        follower.start()
        pool = orb.activate(DataPoolServant(follower.pool, plans, follower.postures))
        orb.serve({f"{ROBOTS}/{robot}": Agent(pool)})

        def obey() -> None:
            for line in sys.stdin:
                print(follower.pool.change_floor(line.strip()), flush=True)
            orb.stop()

        threading.Thread(target=obey, daemon=True).start()
        orb.run()


if __name__ == "__main__":
    main(*sys.argv[1:])
