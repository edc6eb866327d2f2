"""A small building and robots for tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from robocorba.map_editor.model import (
    BoxShape,
    Building,
    Elevator,
    ElevatorDoor,
    Floor,
    FloorMap,
    GeometricalMap,
    MapObject,
    Wall,
)
from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.physics import STEP_S
from robocorba.simulation.recording import Recorder, Recording
from robocorba.simulation.registry import Description
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.simulation_event import SimulationEvent
from robocorba.simulation.store import SimulationStore


def tower() -> Building:
    """Two floors of 10 x 10 m, an elevator in the middle with its door to the front, a table and a shelf below."""
    lift = Elevator("E1", (5.0, 5.0), (2.0, 2.0), (ElevatorDoor("L1"), ElevatorDoor("L2")), speed=2.0, door_time=1.0)
    table = MapObject("T1", BoxShape((1.0, 0.6)), (2.0, 2.0), 0.3, movable=True)
    shelf = MapObject("S1", BoxShape((1.0, 0.6)), (8.0, 8.0))
    square = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))
    plan = GeometricalMap({"W1": Wall("W1", (3.0, 0.0), (3.0, 3.0))}, {"T1": table, "S1": shelf})
    floors = {
        "L1": FloorMap(Floor("L1", 1, 0.0, outline=square), plan),
        "L2": FloorMap(Floor("L2", 2, 4.0, outline=square)),
    }
    return Building("tower", floors, {"E1": lift})


def robot(name: str, floor: str = "L1", x: float = 7.0, y: float = 2.0, heading: float = 0.0) -> Description:
    return Description(name, Pose(floor, x, y, heading))


def scan(robot: str = "A", time: float = 1.0, floor: str = "L1", ahead: float = 0.0, **others: Any) -> RobotScan:
    """A laser's scan, `others` being different."""
    known: dict[str, Any] = {
        "first_rad": -1.0,
        "step_rad": 0.5,
        "range_m": 8.0,
        "rim_m": 0.0,
        "noise": (0.0, 0.0, 0.0, 0),
        "distances": np.full(5, 8.0),
        "hits": np.zeros(5, bool),
    }
    return RobotScan(robot, time, Pose(floor, 1.0, 2.0, 0.0), (ahead, 0.0, 0.0), **{**known, **others})


#: What happens at a moment of a recording: gets its recorder, the agent of its simulation, and the POSIX time [s].
Happening = Callable[[Recorder, ManagementAgent, float], None]


def recorded_drive(
    folder: Path, other: str, velocity: tuple[float, float, float], happenings: Mapping[int, Happening]
) -> Recording:
    """Robot A drives at a velocity for two seconds, another robot leaves after one, C stands on L2. happenings: by
    the twentieth of a second in which they happen."""
    with SimulationStore(folder / "simulation.sqlite") as store, Recorder(folder / "a.mcap", tower()) as recorder:
        agent = ManagementAgent(tower(), 7, store)
        driver, leaver = agent.register(robot("A", x=1.0)), agent.register(robot(other, x=5.0, y=3.0))
        agent.register(robot("C", "L2"))
        versions = dict.fromkeys(agent.database.floors, 0)
        for step in range(40):
            at_s = 1.7e9 + step * 0.05
            driver.command(*velocity, 1.0)
            if step in happenings:
                happenings[step](recorder, agent, at_s)
            if step == 20:
                leaver.deregister()
            for floor in versions:
                update = agent.database.changes(floor, versions[floor])
                versions[floor] = update.version
                recorder.write(update, at_s)
            for _ in range(round(0.05 / STEP_S)):
                agent.step()
    return Recording(folder / "a.mcap")


def enter(world: SimulatedBuilding, name: str, floor: str, x: float, y: float, heading: float = 0.0) -> None:
    """Add a robot."""
    world.add(Description(name, Pose(floor, x, y, heading)))


def run(world: SimulatedBuilding, seconds: float) -> list[SimulationEvent]:
    """Advance the simulated time [s]; the events."""
    return [event for _ in range(round(seconds / STEP_S)) for event in world.step()]
