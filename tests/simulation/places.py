"""A small building and robots for tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from robocorba.map_editor.model import BoxShape, Building, Element, Elevator, ElevatorDoor, Floor, MapObject, Wall
from robocorba.map_editor.spatial.pose import Pose
from robocorba.map_editor.spatial.posture import Posture
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.physics import STEP_S
from robocorba.simulation.recording import Recorder, Recording
from robocorba.simulation.registry import Description
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.simulation_event import SimulationEvent
from robocorba.simulation.store import SimulationStore
from testkit.buildings import with_all


def tower() -> Building:
    """Two floors of 10 x 10 m, an elevator in the middle with its door to the front, a table and a shelf below."""
    square = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))
    doors = (ElevatorDoor("L1"), ElevatorDoor("L2"))
    elements: list[tuple[str, Element]] = [
        ("", Floor("L1", 1, 0.0, outline=square)),
        ("", Floor("L2", 2, 4.0, outline=square)),
        ("", Elevator("E1", (5.0, 5.0), (2.0, 2.0), doors, speed=2.0, door_time=1.0)),
        ("L1", Wall("W1", (3.0, 0.0), (3.0, 3.0))),
        ("L1", MapObject("T1", BoxShape((1.0, 0.6)), (2.0, 2.0), 0.3, movable=True)),
        ("L1", MapObject("S1", BoxShape((1.0, 0.6)), (8.0, 8.0))),
    ]
    return with_all(Building("tower"), elements)


def robot(name: str, floor: str = "L1", x: float = 7.0, y: float = 2.0, heading: float = 0.0) -> Description:
    return Description(name, Pose(floor, x, y, heading))


def scan(robot: str = "A", time: float = 1.0, floor: str = "L1", ahead: float = 0.0, **others: Any) -> RobotScan:
    """A laser's scan, `others` being different."""
    at, mount = Pose(floor, 1.0, 2.0, 0.0), (ahead, 0.0, 0.0)
    nothing = np.full(5, 8.0), np.zeros(5, bool)
    return RobotScan(robot, time, at, mount, -1.0, 0.5, 8.0, 0.0, (0.0, 0.0, 0.0, 0), *nothing)._replace(**others)


#: What robot A reports in a recording.
POSTURE = Posture("A", 0.5, tuple(0.1 * number for number in range(len(JOINTS))))
SCAN = scan("A", 0.5, ahead=0.1, distances=np.array([1.25, 2.5, 8.0, 3.0, 8.0]), hits=np.array([1, 1, 0, 1, 0], bool))


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
