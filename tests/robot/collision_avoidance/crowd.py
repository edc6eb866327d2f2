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
from robocorba.map_editor.polygons import FloorArea
from robocorba.map_editor.spatial.pose import Pose, Pose2D
from robocorba.map_editor.topology import topological_map
from robocorba.planning.planner import PathPlanner
from robocorba.robot.collision_avoidance.neighbours import Nearby
from robocorba.robot.collision_avoidance.policy import DEFAULT_POLICY, GivingWayPolicy
from robocorba.robot.high_controller import HighController
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.motion.robot_state import Velocity
from robocorba.robot.robot import Robot
from robocorba.robot.session import SessionState
from robocorba.robot.simulated_adaptor import SimulatedAdaptor
from robocorba.simulation.physics import STEP_S
from robocorba.simulation.registry import Description
from robocorba.simulation.reservations import Reservation, area_request, canonical_areas
from tests.robot.data_pool.places import Place
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
        for name, (x, y, heading) in starts.items():
            self.world.add(Description(name, Pose(FLOOR, x, y, heading)))
        self._pools = {name: self._place.pool(FLOOR, name) for name in starts}
        for name, pool in self._pools.items():
            session = InStep(self.world, name, self._changing)
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


class InStep:
    """The part of a BuildingSession that movements and reservations use, in a building that the test steps."""

    def __init__(self, world: Any, name: str, changing: AbstractContextManager[Any]) -> None:
        self._world, self._robot, self._changing = world, world.occupants.robots[name], changing
        self.latest: SessionState

    def log_on(self, at: Pose | None = None) -> None:
        pass

    def state(self) -> SessionState:
        found, robot = self._robot.state(), self._robot
        self.latest = SessionState(
            found.time, found.pose, found.velocity, robot.holding, None, robot.collisions, robot.touched
        )
        return self.latest

    def command(self, velocity: Velocity, valid_s: float) -> None:
        self._robot.command(*velocity, valid_s)

    def brake(self) -> None:
        self._robot.brake()

    def grip(self, what: str, x: float, y: float) -> None:
        with self._changing:
            self._world.occupants.grip(self._robot.name, what, (x, y))

    def release(self) -> None:
        with self._changing:
            self._world.occupants.release(self._robot.name)

    def reserve(self, areas: Sequence[FloorArea], limit_s: float) -> None:
        with self._changing:
            self._world.reserve(self._robot.name, [area_request(areas, limit_s, self._world.occupants.floors)])

    def reserve_one_of(self, alternatives: Sequence[Sequence[FloorArea]], limit_s: float) -> int:
        with self._changing:
            return self._world.reserve(
                self._robot.name, [area_request(areas, limit_s, self._world.occupants.floors) for areas in alternatives]
            )

    def exchange_areas(self, areas: Sequence[FloorArea], least_s: float) -> bool:
        with self._changing:
            request = area_request(areas, least_s, self._world.occupants.floors)
            return self._world.reservations.exchange(self._robot.name, request, least_s)

    def take_over_areas(self, former: str) -> None:
        with self._changing:
            self._world.reservations.take_over(self._robot.name, former)

    def reservation(self) -> Reservation | None:
        return self._world.reservations.find(self._robot.name, self._world.time)

    def keep_areas(self, areas: Sequence[FloorArea]) -> None:
        with self._changing:
            self._world.reservations.keep(self._robot.name, canonical_areas(areas))

    def release_areas(self) -> None:
        with self._changing:
            self._world.reservations.release(self._robot.name)

    def cancel_elevator(self) -> None:
        pass
