"""Who and what stands in the way of robots that carry: a free or a busy robot, a stranger, a chair."""

from __future__ import annotations

import contextlib
import math
import random
import time
from collections.abc import Iterator

from omniORB import CORBA

from bench.missions.sites import CHAIR
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.simulation.registry import Pose
from robocorba.stubs import RoboCorba
from robocorba.system.repeating import Repeating
from testkit.missions import FLOOR, MissionSystem
from testkit.simulation import about

STRANGER = "stranger"
#: Who or what, and when it is put in the way: before the mission, or while the table is carried.
CASES = (
    *(f"{who} before" for who in ("free robot", "busy robot", STRANGER, CHAIR)),
    *(f"{who} meanwhile" for who in ("free robot", "busy robot", STRANGER, CHAIR, f"{CHAIR} for 5 s")),
    "free robot drives into it meanwhile",
)
#: Reach of table and carriers from the table's middle [m], and gap to what comes in their way meanwhile [m].
REACH_M, GAPS_M = 1.6, (0.4, 1.2)
#: Where a program of the robot in the way goes on [s].
BUSY_S = 300.0


class Obstacles:
    """Puts things in the way. other: the robot for it."""

    def __init__(self, place: MissionSystem, chance: random.Random, other: str) -> None:
        self._place, self._random, self._other = place, chance, other
        self._administrator = place.orb.reference(
            (place.running.state / "administrator.ior").read_text(), RoboCorba.SimulationAdministrator
        )
        before = place.poses()
        self._places = {name: before[name] for name in (other, CHAIR) if name in before}

    def names(self, case: str) -> tuple[str, ...]:
        """Those of which a refused mission must name one."""
        return (CHAIR,) if CHAIR in case else (self._other, STRANGER)

    def before(self, stack: contextlib.ExitStack, case: str, item: Pose, goal: Pose) -> None:
        """Put something on the way."""
        at = 0.4 * item.x + 0.6 * goal.x, goal.y + self._random.uniform(-0.8, 0.8)
        stack.enter_context(self._blocked(case, at))

    def meanwhile(self, stack: contextlib.ExitStack, case: str, item: Pose, goal: Pose) -> None:
        """Put something before the item, which moves on."""
        towards = math.atan2(goal.y - item.y, goal.x - item.x)
        ahead_m, aside_m = REACH_M + self._random.uniform(*GAPS_M), self._random.uniform(-1.0, 1.0)
        c, s = math.cos(towards), math.sin(towards)
        at = item.x + ahead_m * c - aside_m * s, item.y + ahead_m * s + aside_m * c
        if "drives" in case:
            self._put(self._other, (at[0] + 0.5 * c, at[1] + (1.5 if at[1] < goal.y else -1.5)))
            self._run(ProgramBuilder("across").mbase_to(*at, speed=0.3))
            return
        stack.enter_context(self._blocked(case, at))
        if "for 5 s" in case:
            time.sleep(5.0)
            self._put(CHAIR, self._places[CHAIR][1:3])

    def restore(self) -> None:
        for name, pose in self._places.items():
            self._put(name, pose[1:3])

    @contextlib.contextmanager
    def stranger(self, at: tuple[float, float]) -> Iterator[None]:
        """A robot that answers no requests, at a point or as near to it as there is room."""
        for x, y in _spiral(at):
            with contextlib.suppress(RoboCorba.PlaceTaken):
                session = self._place.server.registerRobot(about(STRANGER, x, y, mass=500.0))
                break
        else:
            raise AssertionError(f"no room for a stranger at {at}")

        def keep() -> None:
            with contextlib.suppress(CORBA.Exception):
                session.heartbeat()

        with contextlib.closing(Repeating("lease of the stranger", keep, 0.3).start()):
            yield
        with contextlib.suppress(CORBA.OBJECT_NOT_EXIST):
            session.deregister()

    @contextlib.contextmanager
    def _blocked(self, case: str, at: tuple[float, float]) -> Iterator[None]:
        with contextlib.ExitStack() as stack:
            if STRANGER in case:
                stack.enter_context(self.stranger(at))
            else:
                self._put(CHAIR if CHAIR in case else self._other, at)
            if "busy" in case:
                builder = ProgramBuilder("standing")
                builder.wait(BUSY_S)
                self._run(builder)
                stack.callback(self._place.agent(self._other).abort)
            yield

    def _run(self, builder: ProgramBuilder) -> None:
        agent = self._place.agent(self._other)
        agent.load(dumps(builder.program()))
        agent.run()

    def _put(self, body: str, at: tuple[float, float]) -> None:
        for point in _spiral(at):
            with contextlib.suppress(RoboCorba.PlaceTaken):
                self._administrator.place(body, RoboCorba.Pose(FLOOR, *point, 0.0))
                return
        raise AssertionError(f"no room for {body} at {at}")


def _spiral(at: tuple[float, float]) -> Iterator[tuple[float, float]]:
    """Points around a point, the nearest ones first."""
    for number in range(40):
        yield at[0] + 0.05 * number * math.cos(2.4 * number), at[1] + 0.05 * number * math.sin(2.4 * number)
