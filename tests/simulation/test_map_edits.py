"""Edits of the map beside moved and held objects and robots: nothing moves that the edit does not move.

The model knows floors and objects by numbers of its own, whatever their names are."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from robocorba.map_editor import native
from robocorba.map_editor.edits import MapChange
from robocorba.map_editor.lineage import Lineage
from robocorba.map_editor.map_building_agent import BuildingEditor
from robocorba.map_editor.model import (
    BoxShape,
    Building,
    ElementKind,
    Elevator,
    ElevatorDoor,
    Floor,
    FloorMap,
    MapObject,
)
from robocorba.map_editor.spatial.pose import Pose
from robocorba.map_editor.store import MapStore
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.record_names import with_present_names
from robocorba.simulation.registry import Description
from robocorba.simulation.reservations import area_request

FLOOR, OBJECT, ELEVATOR = ElementKind.FLOOR, ElementKind.OBJECT, ElementKind.ELEVATOR
FLOOR_NAMES = ("L1", "L2", "L3", "lobby", "roof")
OBJECT_NAMES = ("table", "chair", "L1/table")
ELEVATOR_NAMES = ("E1", "lift")
WAITING = "W"
SHAFT = (-50.0, 0.0)
AREA = ((-40.0, 0.0), (-38.0, 0.0), (-38.0, 2.0))
numbers = st.integers(0, 99)


@dataclass
class Thing:
    """An object of the model: its floor (number) and place, now and on the map. half_m: half its width. Each place is
    used once."""

    name: str
    map_floor: int
    map_place: int
    floor: int
    place: int
    half_m: float = 0.4
    height_m: float = 1.0
    mass_kg: float = 0.0
    is_held: bool = False


def at(place: int) -> tuple[float, float]:
    return 3.0 * (place % 20), 3.0 * (place // 20 + 1)


class MapEdits(RuleBasedStateMachine):
    """Several edits may be made before the simulation follows them."""

    def __init__(self) -> None:
        super().__init__()
        self._folder = tempfile.TemporaryDirectory()
        self.floors = {number: f"L{number + 1}" for number in range(3)}
        self.elevator = "E1"
        self.things: dict[int, Thing] = {}
        #: Robots beside an object or alone: floor and place.
        self.robots: dict[str, tuple[int, int]] = {}
        self._count = 0
        lift = Elevator("E1", SHAFT, (2.0, 2.0), (ElevatorDoor("L1"), ElevatorDoor("L2")))
        entries = {name: FloorMap(Floor(name, number, 4.0 * number)) for number, name in self.floors.items()}
        self._store = MapStore.create(Path(self._folder.name) / "map", Building("house", entries, {"E1": lift}))
        self.editor = BuildingEditor(self._store)
        self.world = SimulatedBuilding(self.editor.building)
        self.followed = self.editor.version
        self.world.add(Description(WAITING, Pose("L2", -45.0, 0.0, 0.0)))
        self.world.elevators.call(WAITING, "E1", "L1")
        self.world.reserve(WAITING, [area_request([("L2", AREA)], 600.0, self.world.building.floors)])

    def teardown(self) -> None:
        self._store.close()
        self._folder.cleanup()

    # ---- edits ----

    @rule(floor=numbers, name=st.sampled_from(OBJECT_NAMES))
    def add(self, floor: int, name: str) -> None:
        number = self._floor(floor)
        if name not in self._names_on(number):
            place = self._next()
            thing = Thing(name, number, place, number, place)
            self.things[place] = thing
            self.editor.create(self.floors[number], self._on_map(thing))

    @precondition(lambda self: self.things)
    @rule(which=numbers)
    def remove(self, which: int) -> None:
        key, thing = self._thing(which)
        self.editor.remove(OBJECT, self.floors[thing.map_floor], thing.name, self._version(thing))
        del self.things[key]

    @precondition(lambda self: self.things)
    @rule(which=numbers, name=st.sampled_from(OBJECT_NAMES))
    def rename(self, which: int, name: str) -> None:
        _, thing = self._thing(which)
        if name not in self._names_on(thing.map_floor):
            self.editor.rename(OBJECT, self.floors[thing.map_floor], thing.name, name, self._version(thing))
            thing.name = name

    @precondition(lambda self: self.things)
    @rule(which=numbers, height_m=st.sampled_from((0.5, 1.0, 2.0)))
    def change_height(self, which: int, height_m: float) -> None:
        _, thing = self._thing(which)
        thing.height_m = height_m
        self._change(thing)

    @precondition(lambda self: self.things)
    @rule(which=numbers, mass_kg=st.sampled_from((0.0, 2.0, 4.0)))
    def weigh(self, which: int, mass_kg: float) -> None:
        _, thing = self._thing(which)
        thing.mass_kg = mass_kg
        self._change(thing)

    @precondition(lambda self: self.things)
    @rule(which=numbers, half_m=st.sampled_from((0.2, 0.4, 0.44)))
    def resize(self, which: int, half_m: float) -> None:
        _, thing = self._thing(which)
        thing.half_m = half_m
        self._change(thing)
        thing.is_held = thing.is_held and half_m != 0.2  # else its edge is out of the hands

    @precondition(lambda self: self.things)
    @rule(which=numbers)
    def move(self, which: int) -> None:
        _, thing = self._thing(which)
        thing.place = thing.map_place = self._next()
        thing.floor, thing.is_held = thing.map_floor, False
        self._change(thing)

    @rule(floor=numbers, name=st.sampled_from(FLOOR_NAMES))
    def rename_floor(self, floor: int, name: str) -> None:
        number = self._floor(floor)
        if name not in self.floors.values():
            before = self.floors[number]
            self.editor.rename(FLOOR, "", before, name, self.editor.read(FLOOR, "", before)[1])
            self.floors[number] = name

    @rule(name=st.sampled_from(ELEVATOR_NAMES))
    def rename_elevator(self, name: str) -> None:
        version = self.editor.read(ELEVATOR, "", self.elevator)[1]
        self.editor.rename(ELEVATOR, "", self.elevator, name, version)
        self.elevator = name

    @precondition(lambda self: len(self.floors) == 3)
    @rule()
    def remove_floor(self) -> None:
        number = max(self.floors)
        name = self.floors.pop(number)
        self.editor.remove(FLOOR, "", name, self.editor.read(FLOOR, "", name)[1])
        self.things = {key: thing for key, thing in self.things.items() if thing.map_floor != number}
        self.robots = {robot: where for robot, where in self.robots.items() if where[0] != number}
        for thing in self.things.values():
            if thing.floor == number:
                thing.floor, thing.place, thing.is_held = thing.map_floor, thing.map_place, False

    @precondition(lambda self: len(self.floors) == 2)
    @rule(name=st.sampled_from(FLOOR_NAMES))
    def add_floor(self, name: str) -> None:
        if name not in self.floors.values():
            number = self._next()
            self.editor.create("", Floor(name, number, 4.0 * number))
            self.floors[number] = name

    # ---- undo, redo, import ----

    @rule(floor=numbers, name=st.sampled_from(FLOOR_NAMES), follows=st.booleans(), redoes=st.booleans())
    def undo_a_rename(self, floor: int, name: str, follows: bool, redoes: bool) -> None:
        number = self._floor(floor)
        before = self.floors[number]
        self.rename_floor(floor, name)
        if self.floors[number] != before:
            self._undo(follows)
            if redoes:
                self.editor.redo(self.editor.version)
            else:
                self.floors[number] = before

    @precondition(lambda self: self.things)
    @rule(which=numbers, follows=st.booleans())
    def undo_a_removal(self, which: int, follows: bool) -> None:
        key, thing = self._thing(which)
        self.remove(which)
        self._undo(follows)
        thing.floor, thing.place, thing.is_held = thing.map_floor, thing.map_place, False
        self.things[key] = thing

    @precondition(lambda self: self.things)
    @rule(which=numbers, follows=st.booleans())
    def undo_a_move(self, which: int, follows: bool) -> None:
        """What nobody has followed has not moved anything."""
        _, thing = self._thing(which)
        before = replace(thing)
        self.move(which)
        self._undo(follows)
        thing.map_place = before.map_place
        thing.floor, thing.place, thing.is_held = before.floor, before.place, before.is_held
        if follows:
            thing.floor, thing.place, thing.is_held = thing.map_floor, thing.map_place, False

    @rule(floor=numbers, name=st.sampled_from(FLOOR_NAMES))
    def import_a_renamed_floor(self, floor: int, name: str) -> None:
        """The whole building from a file in which one floor has another name: one edit."""
        number = self._floor(floor)
        if name not in self.floors.values():
            before, exported = self.floors[number], native.loads(native.dumps(self.editor.building))
            with tempfile.TemporaryDirectory() as folder, MapStore.create(Path(folder) / "map", exported) as store:
                other = BuildingEditor(store)
                other.rename(FLOOR, "", before, name, other.read(FLOOR, "", before)[1])
                self.editor.replace(native.loads(native.dumps(other.building)), self.editor.version)
            self.floors[number] = name

    def _undo(self, follows: bool) -> None:
        """Undo the last edit, which the simulation may have followed."""
        if follows:
            self.follow()
        self.editor.undo(self.editor.version)

    # ---- the simulation ----

    @rule()
    def follow(self) -> None:
        lineage = self._lineage()
        for prepare in self.world.preparations(self.editor.building, lineage):
            prepare()
        self.world.update(self.editor.building, lineage)
        self.followed = self.editor.version

    @rule()
    def restart(self) -> None:
        """The server was killed, and starts with the edited map."""
        record = with_present_names(self.world.record(), self.editor.building, self._lineage())
        robots = [each.description for each in self.world.occupants.robots.values()]
        self.world = SimulatedBuilding(self.editor.building)
        self.world.restore(record, robots)
        self.followed = self.editor.version

    @precondition(lambda self: self.is_followed and self.things)
    @rule(which=numbers, floor=numbers)
    def place(self, which: int, floor: int) -> None:
        _, thing = self._thing(which)
        thing.floor, thing.place, thing.is_held = self._floor(floor), self._next(), False
        x, y = at(thing.place)
        self.world.place(f"{self.floors[thing.map_floor]}/{thing.name}", Pose(self.floors[thing.floor], x, y, 0.0))

    @precondition(lambda self: self.is_followed and any(not thing.is_held for thing in self.things.values()))
    @rule(which=numbers)
    def grip(self, which: int) -> None:
        """A robot that has just come grips an object."""
        _, thing = self._thing(which)
        robot = f"R{self._next()}"
        x, y = at(thing.place)
        if thing.is_held or (thing.floor, thing.place) in self.robots.values():
            return
        floor = self.floors[thing.floor]
        self.world.add(Description(robot, Pose(floor, x - 1.0, y, 0.0), 0.3))
        self.world.occupants.grip(robot, f"{self.floors[thing.map_floor]}/{thing.name}", (x - thing.half_m, y))
        self.robots[robot] = (thing.floor, thing.place)
        thing.is_held = True

    @precondition(lambda self: self.is_followed)
    @rule()
    def step(self) -> None:
        self.world.occupants.refresh()

    @property
    def is_followed(self) -> bool:
        return self.followed == self.editor.version

    @invariant()
    def nothing_else_has_moved(self) -> None:
        if not self.is_followed:
            return
        occupants = self.world.occupants
        assert set(self.world.building.floors) == set(self.floors.values())
        found = {(each.map_floor, each.map_object.name): each.name for each in occupants.objects.values()}
        assert len(found) == len(occupants.objects)
        expected = {(self.floors[thing.map_floor], thing.name): thing for thing in self.things.values()}
        assert found.keys() == expected.keys()
        held = {robot.holding for robot in occupants.robots.values()} - {""}
        for key, thing in expected.items():
            assert occupants.object_pose(found[key]) == pytest.approx(Pose(self.floors[thing.floor], *at(thing.place)))
            assert (found[key] in held) == thing.is_held
            item = occupants.objects[found[key]]
            assert item.map_object == self._on_map(thing)
            kg = occupants.floors[item.floor]._bodies[item.body].mass
            assert kg == pytest.approx(thing.mass_kg or 9.0 * (2 * thing.half_m) ** 2)
            assert occupants.published[item.body].mass_kg == pytest.approx(kg)
        robots = dict(occupants.robots)
        waiting = robots.pop(WAITING)
        assert robots.keys() == self.robots.keys()
        for name, (floor, place) in self.robots.items():
            x, y = at(place)
            assert occupants.pose(name) == pytest.approx(Pose(self.floors[floor], x - 1.0, y, 0.0))
        ride = self.world.elevators.rides[WAITING]
        assert self.world.elevators.states[self.elevator].floor in (self.floors[0], self.floors[1])
        assert (ride.elevator, ride.origin, ride.destination) == (self.elevator, self.floors[1], self.floors[0])
        assert waiting.state().pose == pytest.approx(Pose(self.floors[1], -45.0, 0.0, 0.0))
        (reserved,) = self.world.reservations.all(self.world.time)
        assert reserved.areas == ((self.floors[1], AREA),)
        assert reserved.status.granted

    # ---- the model ----

    def _lineage(self) -> Lineage:
        changes = self.editor.changes_since(self.followed)
        return Lineage(MapChange(each.version, each.kind, each.floor, each.element) for each in changes)

    def _next(self) -> int:
        self._count += 1
        return self._count + 2

    def _floor(self, which: int) -> int:
        return list(self.floors)[which % len(self.floors)]

    def _thing(self, which: int) -> tuple[int, Thing]:
        return list(self.things.items())[which % len(self.things)]

    def _names_on(self, floor: int) -> set[str]:
        return {thing.name for thing in self.things.values() if thing.map_floor == floor}

    def _version(self, thing: Thing) -> int:
        return self.editor.read(OBJECT, self.floors[thing.map_floor], thing.name)[1]

    def _change(self, thing: Thing) -> None:
        self.editor.change(self.floors[thing.map_floor], self._on_map(thing), self._version(thing))

    def _on_map(self, thing: Thing) -> MapObject:
        width = 2 * thing.half_m
        return MapObject(
            thing.name, BoxShape((width, width)), at(thing.map_place), 0.0, thing.height_m, True, thing.mass_kg
        )


MapEdits.TestCase.settings = settings(max_examples=12, stateful_step_count=30, deadline=None)
TestMapEdits = MapEdits.TestCase
