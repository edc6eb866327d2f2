"""Those who do nothing wrong while others attack: driving robots, missions, names that lead to the right objects."""

from __future__ import annotations

import math
import re
import threading
import time
from collections.abc import Sequence

import CosNaming
from omniORB import CORBA

from bench.chaos.attackers import EMPTY_FLOOR, EMPTY_FLOOR_M, HERE, ROBOT, THERE
from bench.chaos.beside import Complaints
from bench.missions.many import Room, building
from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.model import Building, Floor, FloorMap
from robocorba.robot.agent_state import AgentCondition, ProgramResult
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.icons import Destination
from robocorba.robot.programs.program import dumps
from robocorba.system.names import CHANNELS, ROBOTS
from robocorba.system.repeating import Repeating
from testkit.missions import FLOOR, MissionSystem, RobotStart

#: Rooms in which tables are carried; robots drive in the other ones, each on its own lane.
CARRYING = (0, 2)
#: Lanes in a room without a mission, their distance, and their length away from the door [m].
LANES, LANE_M, LENGTH_M = 5, 1.1, 1.6
#: Largest distance of a carried table from its goal [m], and time limit for one mission [s].
NEAR_M, MISSION_S = 0.05, 300.0
#: Interval between two looks at all driving robots, and at all names: one that is stolen for less is no harm [s].
LOOK_INTERVAL_S, NAME_INTERVAL_S = 2.0, 0.1
#: What the simulation server logs of a robot, whose name is the group.
EXPIRED = re.compile(r"(\S+) logged off: its lease of .* expired")


def two_floors(of: Sequence[Room]) -> Building:
    """The rooms, of which only some have a table; above them an empty floor."""
    found = building(of, [room.item for room in of if room.number not in CARRYING])
    size = EMPTY_FLOOR_M
    outline = ((0.0, 0.0), (size, 0.0), (size, size), (0.0, size))
    found.floors[EMPTY_FLOOR] = FloorMap(Floor(EMPTY_FLOOR, 2, 4.0, outline=outline))
    return found


def places(of: Sequence[Room], drivers: int) -> dict[str, RobotStart]:
    """Three robots in each room with a table, and one on each lane until there are enough."""
    found: dict[str, RobotStart] = {}
    for room in (room for room in of if room.number in CARRYING):
        corners = [(-2.3, 1.7, 0.0), (2.3, 1.7, math.pi), (2.3, -1.7, math.pi)]
        for number, (x, y, heading) in enumerate(corners):
            name = room.leader if number == 0 else f"c{room.number}-{number}"
            found[name] = RobotStart(room.x + x, room.y + y, heading, (HERE, THERE)[number % 2])
    for number, (x, y) in enumerate(lanes(of)[:drivers]):
        found[f"d{number}"] = RobotStart(x, y - LENGTH_M / 2, math.pi / 2, (HERE, THERE)[number % 2])
    return found


def lanes(of: Sequence[Room]) -> list[tuple[float, float]]:
    """The middles of all lanes."""
    offsets = [(number - (LANES - 1) / 2) * LANE_M for number in range(LANES)]
    return [(room.x + each, room.y) for room in of if room.number not in CARRYING for each in offsets]


class Drivers:
    """Robots that drive to and fro by paths of the planner."""

    def __init__(self, place: MissionSystem, of: Sequence[Room], count: int, complain: Complaints) -> None:
        self._complain = complain
        self._agents = [place.agent(f"d{number}") for number in range(count)]  # once: attackers steal names
        for agent, (x, y) in zip(self._agents, lanes(of), strict=False):
            builder = ProgramBuilder("to and fro")
            with builder.repeat(10_000):
                builder.mbase_path(FLOOR, x, y + LENGTH_M / 2).mbase_path(FLOOR, x, y - LENGTH_M / 2)
            agent.load(dumps(builder.program()))
            agent.run()
        self._looking = Repeating("drivers", self._look, LOOK_INTERVAL_S).start()
        self.close = self._looking.close

    def _look(self) -> None:
        for agent in self._agents:
            try:
                state = agent.state()
                if state.condition is not AgentCondition.RUNNING:
                    reason = state.program.reason or state.reason
                    self._complain.add(f"{agent.name} is {state.condition.name}: {reason}")
                    agent.run()
            except RoboCorbaError as error:
                self._complain.add(f"{agent.name}: {error}")


class Carrier(threading.Thread):
    """A mission that is given again and again: a table is carried to and fro. seconds: durations of those that brought
    it to its goal; failed: the number of the others."""

    def __init__(self, place: MissionSystem, room: Room, complain: Complaints) -> None:
        super().__init__(daemon=True)
        self._place, self._room, self._complain = place, room, complain
        self._ending = threading.Event()
        self.seconds: list[float] = []
        self.failed = 0

    def run(self) -> None:
        goals = [self._room.goal, (*self._room.start, 0.0)]
        while not self._ending.is_set():
            try:
                fault = self._carry(goals[0])
            except (RoboCorbaError, AssertionError) as error:
                fault = str(error)
            if fault:
                self.failed += 1
                self._complain.add(f"mission of {self._room.leader}: {fault}")
            if self._off_m(goals[0]) < 0.3:
                goals.reverse()

    def _off_m(self, goal: tuple[float, float, float]) -> float:
        return math.dist(self._place.body(self._room.item)[:2], goal[:2])

    def _carry(self, goal: tuple[float, float, float]) -> str:
        """Carry the table; returns what was wrong."""
        agent = self._place.agent(self._room.leader)
        agent.load(dumps(ProgramBuilder("carry").move_table(self._room.item, Destination(FLOOR, *goal)).program()))
        agent.run()
        deadline = time.monotonic() + MISSION_S
        while (report := agent.state().program).result is ProgramResult.NO_RESULT:
            if time.monotonic() > deadline:
                agent.abort()
                return f"no end within {MISSION_S:g} s"
            time.sleep(0.5)
        if report.result is not ProgramResult.DONE:
            return report.reason
        if (off_m := self._off_m(goal)) >= NEAR_M:
            return f"the table is {1000 * off_m:.0f} mm off"
        self.seconds.append(report.seconds)
        return ""

    def end(self) -> None:
        """Wait for the end of the last mission."""
        self._ending.set()
        self.join(MISSION_S)


class Names:
    """Names that a client resolves again and again. wrong_s: the longest time for which one led to somebody else."""

    def __init__(self, place: MissionSystem) -> None:
        names = ("PathPlanner", "SimulationServer", "MapEditor", f"{CHANNELS}/{HERE}", f"{ROBOTS}/{ROBOT}")
        uri = f"corbaloc::{place.running.naming}/NameService"
        self._orb, self._root = place.orb, place.orb.reference(uri, CosNaming.NamingContext)
        self._right = {name: self._bound(name) for name in names}
        self._since: dict[str, float] = {}
        self.wrong_s = 0.0
        self._looking = Repeating("names", self._look, NAME_INTERVAL_S).start()
        self.close = self._looking.close

    def _bound(self, name: str) -> str:
        parts = [CosNaming.NameComponent(part, "") for part in ("RoboCorba", *name.split("/"))]
        return self._orb.uri(self._root.resolve(parts))

    def _look(self) -> None:
        for name, right in self._right.items():
            try:
                is_right = self._bound(name) == right
            except CORBA.Exception:
                is_right = False
            now = time.monotonic()
            if is_right:
                self._since.pop(name, None)
            else:
                self.wrong_s = max(self.wrong_s, now - self._since.setdefault(name, now))
