"""A robot in one process: a real simulated building, a real sensor, and the adaptor that docs/adaptors.md shows."""

from __future__ import annotations

import contextlib
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from robocorba.errors.robots import MotionFailed, RobotHeld, RobotLost
from robocorba.errors.simulation import InvalidCommand, SessionExpired
from robocorba.map_editor.model import MapObject
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.topology import topological_map
from robocorba.planning.planner import PathPlanner
from robocorba.robot.adaptor import RobotAdaptor
from robocorba.robot.high_controller import HighController
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.model_switcher import AdaptorContext
from robocorba.robot.motion.robot_state import Velocity
from robocorba.robot.programs.icons import Icon
from robocorba.robot.robot import Robot
from robocorba.robot.runner import ReceivedEvent
from robocorba.robot.senses import Ranges, RangeSensor, Reading, Senses
from robocorba.robot.session import SessionState
from robocorba.robot.simulated_adaptor import SimulatedAdaptor
from robocorba.simulation.emergency_stops import EmergencyStops, StopAnswer, StopHold
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.registry import Description, Pose
from robocorba.simulation.sensing.scan import Mount, ScanSpec
from robocorba.simulation.sensing.virtual_sensor import VirtualSensor
from robocorba.simulation.simulated_robot import STOPPED
from robocorba.simulation.store import SimulationStore
from testkit import processes
from testkit.buildings import with_all
from tests.simulation.places import tower

DOCS = Path(__file__).resolve().parents[2] / "docs"
PATIENCE_S = 60.0


def documented_adaptor() -> Callable[[AdaptorContext], RobotAdaptor]:
    """The factory in docs/adaptors.md."""
    (source,) = re.findall(r"```python\n(.*?)```", (DOCS / "adaptors.md").read_text(), re.DOTALL)
    assert len(source.splitlines()) < 60
    found: dict[str, Any] = {}
    exec(compile(source, "docs/adaptors.md", "exec"), found)
    factory: Callable[[AdaptorContext], RobotAdaptor] = found["adaptor"]
    return factory


class Place:
    """The tower of the simulation's tests in real time, with a session for one robot and a sensor that follows it.
    items: objects on its lower floor."""

    def __init__(self, folder: Path, *items: MapObject) -> None:
        self.building = with_all(tower(), [("L1", item) for item in items])
        for name, floor in self.building.floors.items():
            roads = topological_map(self.building, name)
            self.building.floors[name] = msgspec.structs.replace(floor, topological=roads)
        self._closing = contextlib.ExitStack()
        store = self._closing.enter_context(SimulationStore(folder / "simulation.sqlite"))
        self.agent = ManagementAgent(
            *(self.building, 1, store),
            session_began=lambda session: self.stops.admit(session),
            session_ended=lambda session: self.stops.forget(session),
        )
        self.stops = EmergencyStops(
            *(folder / "stops.json", lambda: list(self.agent.sessions.values()), lambda: False),
            lambda target, reason, number: StopAnswer(False, False),
        )
        self.stops.start()
        self.agent.start()
        self._sensor = VirtualSensor()
        self._sensor.set_map(self.building)
        self.planner = PathPlanner(self.building)

    def session(self, name: str = "A", at: Pose = Pose("L1", 7.0, 2.0, 0.0)) -> InProcessSession:  # noqa: B008
        return InProcessSession(self, Description(name, at))

    def scan(self, at: Pose, mount: Mount, spec: ScanSpec, carrier: str) -> Floats:
        for floor in self._sensor.floors:
            asked_at = time.monotonic()
            self._sensor.follow(self.agent.database.changes(floor, self._sensor.version(floor)), asked_at)
        seen = self._sensor.scan(at.floor, np.array([at[1:]]), mount, spec, carrier)
        distances: Floats = seen.distances[0]
        return distances

    def close(self) -> None:
        self.stops.close()
        self.agent.close()
        self._closing.close()


class InProcessSession:
    """A BuildingSession without CORBA. `is_away`: the server does not answer."""

    def __init__(self, place: Place, about: Description) -> None:
        self._place, self._about = place, about
        self._session: Any = None
        self._latest: SessionState | None = None
        self.is_away = False

    @property
    def latest(self) -> SessionState:
        if self._latest is None:
            raise RobotLost("not logged on")
        return self._latest

    def log_on(self, at: Pose | None = None) -> None:
        if self.is_away:
            raise RobotLost("nobody answers")
        if self._session is None:
            self._session = self._place.agent.register(replace(self._about, pose=at or self._about.pose))
            self.state()

    def log_off(self) -> None:
        if self._session is not None:
            with contextlib.suppress(SessionExpired):
                self._session.deregister()
        self._session = None

    def state(self) -> SessionState:
        session = self._answer()
        try:
            found = session.state()
        except SessionExpired as error:
            raise RobotLost(str(error)) from None
        robot = session.robot
        self._latest = SessionState(
            found.time, found.pose, found.velocity, robot.holding, session.ride, robot.collisions, robot.touched
        )
        return self._latest

    def command(self, velocity: Velocity, valid_s: float) -> None:
        try:
            self._answer().command(*velocity, valid_s)
        except InvalidCommand as error:
            raise RobotHeld(error.reason) if error.field == STOPPED else error from None

    def announce_body(self, is_robot: bool) -> None:
        self._answer().heartbeat()

    def hold(self) -> StopHold:
        return self._place.stops.hold(self._answer())

    def report_stop(self, reason: str) -> tuple[bool, StopHold]:
        return self._place.stops.report_stop(self._answer(), reason)

    def end_stops(self, number: int) -> StopHold:
        return self._place.stops.end(self._answer(), number)

    def scan(self, at: Pose, mount: Mount, spec: ScanSpec) -> Floats:
        self._answer()
        return self._place.scan(at, mount, spec, self._about.name)

    def grip(self, what: str, x: float, y: float) -> None:
        self._answer().grip(what, (x, y))

    def __getattr__(self, name: str) -> Callable[..., Any]:
        """A call that the session gets as it is."""
        return lambda *parts, **named: getattr(self._answer(), name)(*parts, **named)

    def _answer(self) -> Any:
        if self.is_away:
            raise RobotLost("nobody answers")
        if self._session is None:
            raise RobotLost("not logged on")
        return self._session


class Measured(Senses):
    """Sensors with distances from the test."""

    def __init__(self, *measured: tuple[RangeSensor, Floats]) -> None:
        self._measured = {sensor.name: (sensor, distances) for sensor, distances in measured}

    @property
    def sensors(self) -> Sequence[RangeSensor]:
        return [sensor for sensor, _ in self._measured.values()]

    def ranges(self, name: str) -> Ranges:
        return Ranges(1.0, self._measured[self.sensor(name).name][1])

    def readings(self) -> Sequence[Reading]:
        return []


class Channel:
    """Records the events that a program publishes and the missions that it leads, and delivers events to it."""

    def __init__(self) -> None:
        self.missions: list[str] = []
        self.said: list[tuple[str, Any]] = []
        self.patterns: Sequence[tuple[str, str]] = ()
        self.receive: Callable[[ReceivedEvent], None] = lambda event: None

    def subscribe(self, patterns: Sequence[tuple[str, str]], receive: Callable[[ReceivedEvent], None]) -> None:
        self.patterns, self.receive = patterns, receive

    def publish(self, type: str, payload: Any) -> None:
        self.said.append((type, payload))

    def cooperate(self, icon: Icon, mission: str = "") -> None:
        self.missions.append(mission)
        raise MotionFailed("nobody else is here")


def robot(place: Place, session: InProcessSession) -> Robot:
    """A virtual SmartPal that is started."""
    session.log_on()
    high = HighController(SimulatedAdaptor(session))
    high.start(())
    return Robot(high, session, InverseKinematics(), place.planner)


def eventually(is_so: Callable[[], bool], what: str) -> None:
    processes.eventually(is_so, PATIENCE_S, what)
