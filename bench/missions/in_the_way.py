"""Who and what stands in the way of robots that carry: a free robot, a stranger, a chair."""

from __future__ import annotations

import contextlib
import math
import random
from collections.abc import Iterator

from bench.missions.sites import CHAIR
from robocorba.simulation.registry import Pose
from robocorba.stubs import RoboCorba
from testkit.heartbeats import heartbeats
from testkit.missions import FLOOR, MissionSystem
from testkit.simulation import about

STRANGER, ROBOT = "stranger", "free robot"
#: Who or what, and when it is put in the way: before the mission, or while the table is carried.
CASES = (*(f"{who} {when}" for who in (ROBOT, STRANGER, CHAIR) for when in ("before", "meanwhile")), "stranger at goal")
#: Reach of table and carriers from the table's middle [m], and gap to what comes in their way meanwhile [m].
REACH_M, GAPS_M = 1.6, (0.4, 1.2)


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

    def put(self, stack: contextlib.ExitStack, case: str, item: Pose, goal: Pose) -> None:
        """Put something on the way or at the goal, or before the item, which moves on. A stranger leaves with the
        stack."""
        at = (0.4 * item.x + 0.6 * goal.x, goal.y + self._random.uniform(-0.8, 0.8)) if "before" in case else goal[1:3]
        if "meanwhile" in case:
            towards = math.atan2(goal.y - item.y, goal.x - item.x)
            ahead_m, aside_m = REACH_M + self._random.uniform(*GAPS_M), self._random.uniform(-1.0, 1.0)
            c, s = math.cos(towards), math.sin(towards)
            at = item.x + ahead_m * c - aside_m * s, item.y + ahead_m * s + aside_m * c
        if STRANGER in case:
            stack.enter_context(self._stranger(at))
        else:
            self._put(CHAIR if CHAIR in case else self._other, at)

    def restore(self) -> None:
        for name, pose in self._places.items():
            self._put(name, pose[1:3])

    @contextlib.contextmanager
    def _stranger(self, at: tuple[float, float]) -> Iterator[None]:
        """A robot that answers no requests, at a point or as near to it as there is room."""
        for x, y in _spiral(at):
            with contextlib.suppress(RoboCorba.PlaceTaken):
                session = self._place.server.registerRobot(about(STRANGER, x, y, mass=500.0))
                break
        else:
            raise AssertionError(f"no room for a stranger at {at}")
        with contextlib.closing(heartbeats(lambda: [session])):
            yield
        session.deregister()

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
