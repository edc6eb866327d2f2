"""Robots that drive in one simulated building, which runs as fast as the computer can."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

import msgspec

from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.pose import Pose, Pose2D
from robocorba.map_editor.topology import topological_map
from robocorba.planning.planner import PathPlanner
from robocorba.robot.collision_avoidance.neighbours import Nearby
from robocorba.robot.collision_avoidance.policy import DEFAULT_POLICY, GivingWayPolicy
from robocorba.robot.high_controller import HighController
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.robot import Robot
from robocorba.robot.simulated_adaptor import SimulatedAdaptor
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.physics import STEP_S
from robocorba.simulation.registry import Description, RobotClient
from robocorba.simulation.session import Session
from tests.robot.data_pool.places import Place
from tests.robot.places import InProcessSession
from tests.waits import pause

FLOOR = "L1"
#: Simulated time passes faster than the clock, so robots check their conditions at this interval [s].
CHECK_INTERVAL_S = 0.002
#: Number of steps between updates of the data pools.
FOLLOW_STEPS = 3
_KINEMATICS = InverseKinematics()


class Crowd:
    """Robots by name, from their start poses. touched: bodies of each collision."""

    def __init__(
        self, building: Building, starts: Mapping[str, Pose2D], policy: GivingWayPolicy = DEFAULT_POLICY
    ) -> None:
        for name, floor in building.floors.items():
            building.floors[name] = msgspec.structs.replace(floor, topological=topological_map(building, name))
        _warm_up()
        self._place = Place(building)
        #: Held while the building changes, by a step or by a robot, as changes wait for their turn in the product.
        self._changing = threading.RLock()
        self.world, planner = self._place.world, PathPlanner(building)
        self.robots: dict[str, Robot] = {}
        self._controllers: list[Stepped] = []
        descriptions = [Description(name, Pose(FLOOR, *at)) for name, at in starts.items()]
        for about in descriptions:
            self.world.add(about)
        self._pools = {name: self._place.pool(FLOOR, name) for name in starts}
        for about in descriptions:
            name, pool = about.name, self._pools[about.name]
            session = InStep(self.world, about, self._changing)
            session.state()
            controller = Stepped(SimulatedAdaptor(session))
            controller.start(())
            self._controllers.append(controller)
            nearby = Nearby(pool, name, policy)
            self.robots[name] = Robot(controller, session, _KINEMATICS, planner, nearby)
            self.robots[name].execution.check_interval_s = CHECK_INTERVAL_S
        self.touched: list[tuple[str, ...]] = []
        for _ in range(FOLLOW_STEPS):
            self._step()

    @property
    def time(self) -> float:
        return self.world.time

    def at(self, name: str) -> Pose2D:
        return self.world.occupants.pose(name)[1:]

    def carried(self, thing: str, to: tuple[float, float]) -> None:
        """Move an object to another place."""
        with self._changing:
            item = self.world.occupants.objects[thing]
            self.world.occupants.move_object(thing, Pose(item.floor, *to, item.map_object.heading))
        for _ in range(FOLLOW_STEPS):
            self._step()

    def run(self, limit_s: float, **parts: Callable[[Robot], None]) -> dict[str, str]:
        """Run all robots' parts to their ends; return the errors by name. Fails after `limit_s` of simulated time."""
        wrong: dict[str, str] = {}

        def do(name: str, part: Callable[[Robot], None]) -> None:
            try:
                part(self.robots[name])
            except RoboCorbaError as error:
                wrong[name] = str(error)

        threads = {name: threading.Thread(target=do, args=(name, part), daemon=True) for name, part in parts.items()}
        for thread in threads.values():
            thread.start()
        deadline = self.time + limit_s
        while any(thread.is_alive() for thread in threads.values()):
            if self.time > deadline:
                raise AssertionError(f"not done within {limit_s} s: {[n for n, t in threads.items() if t.is_alive()]}")
            self._step()
            if any(t.is_alive() and not self.robots[n].controller.is_moving for n, t in threads.items()):  # type: ignore[attr-defined]
                pause(0.004)  # a robot plans or waits
        return wrong

    def _step(self) -> None:
        with self._changing:
            happened = self.world.step()
        self.touched += [each.who for each in happened if each.kind == "collision"]
        self._place.clock.now += STEP_S
        for number, pool in enumerate(self._pools.values()):
            if (round(self.time / STEP_S) + number) % FOLLOW_STEPS == 0:
                pool.follow()
        for controller in self._controllers:
            controller.tick()


@functools.cache
def _warm_up() -> None:
    """Compile kernels before simulated time passes."""
    PathPlanner(Building("")).warm_up()


class Stepped(HighController):
    """Its ticks are called by the crowd."""

    def start(self, argv: Sequence[str]) -> None:
        self._begin()

    def tick(self) -> None:
        self._tick()

    @property
    def is_moving(self) -> bool:
        return self._motion is not None


class InStep(InProcessSession):
    """A session in a building that the test steps. changing: held while a robot changes it."""

    def __init__(self, world: SimulatedBuilding, about: Description, changing: AbstractContextManager[Any]) -> None:
        super().__init__(None, about)  # type: ignore[arg-type]

        def change_at_once(change: Callable[[], None], undo: object = None) -> None:
            with changing:
                change()

        client = RobotClient(about, about.name, 0.0, lambda: 0.0)
        robot = world.occupants.robots[about.name]
        self._session = Session(client, robot, world, change_at_once, lambda client: None)
