"""The simulated building: floors with their physics, robots and objects on them, elevators between them, and simulated
time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial

from shapely import Point, Polygon

from robocorba.map_editor.geometry import is_in_shaft
from robocorba.map_editor.lineage import SAME_NAMES, Lineage
from robocorba.map_editor.model import Building
from robocorba.map_editor.movable import fixed_obstacles, movables
from robocorba.map_editor.spatial.pose import XY, Pose
from robocorba.simulation.body_names import owner
from robocorba.simulation.elevators import Elevators
from robocorba.simulation.occupants import Occupants
from robocorba.simulation.physics import STEP_S, FloorPhysics, StepResult
from robocorba.simulation.registry import Description
from robocorba.simulation.reservations import AreaRequest, Reservations
from robocorba.simulation.simulated_robot import SimulatedRobot
from robocorba.simulation.simulation_event import SimulationEvent
from robocorba.simulation.static_parts import static_parts
from robocorba.simulation.world_record import WorldRecord


class SimulatedBuilding:
    """Simulation of `building`; movable objects start at their poses on the map.

    One thread may use it; methods marked as thread-safe and SimulatedRobot are exceptions."""

    def __init__(self, building: Building) -> None:
        self.building = Building(building.name)
        self.occupants = Occupants(self._why_inaccessible)
        self.elevators = Elevators(self.occupants)
        #: Areas reserved by robots; reservations on a removed floor block nobody.
        self.reservations = Reservations()
        self._steps = 0
        #: The building for which obstacles have been changed already, and the physics of its new floors.
        self._prepared: tuple[Building | None, dict[str, FloorPhysics]] = (None, {})
        self.update(building)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._steps * STEP_S

    # ---- the map ----

    def preparations(self, building: Building, lineage: Lineage = SAME_NAMES) -> Iterator[Callable[[], None]]:
        """Calls that make most of the work of `update`, each within milliseconds: the simulation goes on between them,
        and obstacles appear one after the other. Any thread may ask for the next one while no other updates the map."""
        kept = lineage.floors(building.floors)
        for before, physics in self.occupants.floors.items():
            if before in kept and self._obstacles_differ(building, kept[before], self.building, before):
                for change in physics.changes_to(static_parts(fixed_obstacles(building, kept[before]))):
                    yield partial(physics.change_obstacles, change)
        stayed = {kept[before] for before in self.occupants.floors if before in kept}
        added = {
            name: FloorPhysics(fixed_obstacles(building, name), 0, name) for name in building.floors.keys() - stayed
        }
        self._prepared = building, added

    def _obstacles_differ(self, building: Building, floor: str, before: Building, former: str) -> bool:
        return building.floors[floor] is not before.floors.get(former) or (
            building.elevators_through(floor) != before.elevators_through(former)
        )

    def robots_on_lost_floors(self, building: Building, lineage: Lineage = SAME_NAMES) -> list[str]:
        """The robots on floors that an edited map does not have any more; see `update`."""
        kept = lineage.floors(building.floors)
        return [robot.name for robot in self.occupants.robots.values() if robot.floor not in kept]

    def update(self, building: Building, lineage: Lineage = SAME_NAMES) -> list[SimulationEvent]:
        """Use an edited map; return the events. lineage: which of its elements are those of the present map.

        Nothing moves that the edit does not move. Robots on lost floors are removed, rides of a changed elevator are
        lost."""
        if self._prepared[0] is not building:
            for prepare in self.preparations(building, lineage):
                prepare()
        (_, added), self._prepared = self._prepared, (None, {})
        before, self.building = self.building, building
        kept = {former: now for former, now in lineage.floors(building.floors).items() if former in before.floors}
        for robot in self.robots_on_lost_floors(building, lineage):
            self.remove(robot)
        for physics in added.values():
            physics.set_steps(self._steps)
        floors = {kept[former]: physics for former, physics in self.occupants.floors.items() if former in kept} | added
        self.occupants.use_floors({name: floors[name] for name in building.floors}, kept)
        lost = self.occupants.update_objects(movables(building), lineage)
        self.reservations.rename_floors(kept)
        self.elevators.update(building, self.time, lineage, kept)
        self.refresh(looks_into_cabins=True)
        reason = "the map was edited"
        return [SimulationEvent(self.time, floor, "grip lost", (robot,), reason) for robot, floor in lost]

    # ---- robots ----

    def add(self, description: Description) -> SimulatedRobot:
        """Add a robot at the pose of its description; its name must be free. Raises UnknownFloor, PlaceTaken."""
        return self.occupants.add_robot(description)

    def remove(self, name: str) -> None:
        """Remove a robot with its ride, grip and reservation. Raises UnknownRobot."""
        self.occupants.remove_robot(name)
        self.elevators.cancel(name)
        self.reservations.release(name)

    def fall_silent(self, name: str) -> None:
        """A robot is about to be removed since it fell silent. What it has reserved is kept for a while if it holds an
        object, which others may hold, too."""
        if self.occupants.held_by(name):
            self.reservations.fall_silent(name)

    def place(self, name: str, pose: Pose) -> list[SimulationEvent]:
        """Put a robot or a movable object at a pose, at rest; grips of it and by it are released. Returns the events.

        A ride and a reservation of the robot stay. Raises UnknownBody, UnknownFloor, PlaceTaken, InvalidChoice."""
        reason = f"{name} was placed elsewhere"
        events = [
            SimulationEvent(self.time, floor, "grip lost", (holder,), reason)
            for holder, floor in self.occupants.place(name, pose)
        ]
        self.refresh(looks_into_cabins=True)
        return [*events, SimulationEvent(self.time, pose.floor, "placed", (name,))]

    def _why_inaccessible(self, pose: Pose) -> str:
        """Why no body can get to a pose of a floor: it is outside of the floor, or in a shaft whose cabin belongs to
        another one. Empty if one can, unless something stands there."""
        outline = self.building.floors[pose.floor].floor.outline
        if outline and not _ground(outline).contains(Point(pose.x, pose.y)):
            return f"it is outside of the outline of {pose.floor}"
        for elevator in self.building.elevators_through(pose.floor):
            cabin_floor = self.elevators.cabins[elevator.name].floor
            if cabin_floor != pose.floor and is_in_shaft(elevator, pose.x, pose.y):
                return f"it is in the shaft of {elevator.name}, whose cabin is on {cabin_floor}"
        return ""

    def reserve(self, name: str, alternatives: Sequence[AreaRequest]) -> int:
        """Request one of several alternatives for a robot; return its index. Raises UnknownRobot, InvalidReservation,
        ReservationsFull."""
        self.occupants.robot(name)
        return self.reservations.reserve(name, alternatives)

    # ---- time ----

    def step(self) -> list[SimulationEvent]:
        """Advance time by STEP_S; return the events."""
        self._steps += 1
        floors = self.occupants.floors
        events = []
        for name, (contacts, lost) in zip(floors, self._step_floors(), strict=True):
            for first, second in contacts:
                self.occupants.count_collision(first, second)
                self.occupants.count_collision(second, first)
                bodies = tuple(self.occupants.name_of(body) for body in (first, second) if body)
                events.append(SimulationEvent(self.time, name, "collision", bodies))
            for robot in lost:
                events.append(SimulationEvent(self.time, name, "grip lost", (owner(robot),)))
        events += self.elevators.step(self.time)
        for ended in self.reservations.advance(self.time):
            silent = ended.kept_until is not None
            reason = "the robot fell silent" if silent else f"its limit of {ended.limit_s:g} s is over"
            events.append(SimulationEvent(self.time, ended.areas[0][0], "reservation over", (ended.owner,), reason))
        return events

    def _step_floors(self) -> list[StepResult]:
        """The results of a step, floor by floor. Raises the first error of a floor, after all others have made their
        step."""
        results: list[StepResult] = []
        first_error = None
        for physics in self.occupants.floors.values():
            try:
                results.append(physics.step())
            except Exception as error:
                first_error = first_error or error
        if first_error:
            raise first_error
        return results

    def refresh(self, looks_into_cabins: bool = False) -> None:
        """Update the published state after bodies or calls changed, also while time is paused. looks_into_cabins: see
        Elevators.refresh."""
        self.occupants.refresh()
        self.elevators.refresh(looks_into_cabins)

    # ---- records ----

    def record(self) -> WorldRecord:
        """Everything that the map does not hold, for `restore`."""
        return WorldRecord(
            self._steps,
            self.occupants.robot_records(),
            self.occupants.object_records(),
            self.elevators.records(),
            reservations=self.reservations.record(),
        )

    def restore(self, world: WorldRecord, robots: list[Description]) -> None:
        """Restore a record with these robots in a new building; all bodies start at rest.

        Skips what the map no longer has. Robots that are not in the record get their start poses."""
        self._steps = world.steps
        for physics in self.occupants.floors.values():
            physics.set_steps(world.steps)
        for name, record in world.objects.items():
            self.occupants.restore_object(name, record)
        for description in robots:
            self.occupants.restore_robot(description, world.robots.get(description.name))
        # A robot that is not in the record may have the name of an earlier one, which has left.
        same = world.robots.keys() & self.occupants.robots.keys()
        self.elevators.restore(world.cabins, self.time, same)
        self.reservations.restore(world.reservations, self.time, same)
        self.refresh(looks_into_cabins=True)


@lru_cache(256)
def _ground(outline: Sequence[XY]) -> Polygon:
    """The inside of a floor's outline: each robot that logs on asks for the same ones."""
    return Polygon(outline)
