"""A robot's data pool beside edits of the map, robots that come and go, servers that are away or start again, and
updates that are missed. A pool without a problem is as the Omni database; once all answer, it has none, and the walls
of the map; and it knows what has become of the floor on which it has seen its robot last."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule
from omniORB import CORBA

from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import InvalidRide, PlaceTaken
from robocorba.map_editor.edits import MapChange
from robocorba.map_editor.lineage import Lineage
from robocorba.map_editor.map_building_agent import BuildingEditor
from robocorba.map_editor.model import ElementKind, Floor, Wall
from robocorba.map_editor.spatial.floor_update import FloorView
from robocorba.map_editor.spatial.pose import Pose
from robocorba.map_editor.store import MapLimits, MapStore
from robocorba.robot.corba.remote_data_pool import PoolFollower
from robocorba.robot.data_pool.pool import DataPool
from robocorba.simulation.building import SimulatedBuilding
from tests.orb.test_map_editor import Editor
from tests.robot.data_pool.places import Place, furnished, same
from tests.simulation.places import robot

#: Edits that the map editor remembers.
COMMITS = 5
FLOOR = ElementKind.FLOOR
NAMES = ("L1", "L2", "lobby", "roof")
ROBOTS = "ABCD"
who, number = st.sampled_from(ROBOTS), st.integers(0, 9)


class MapEditor(Editor):
    """References to it survive a restart."""

    is_away = False

    def __getattr__(self, name: str) -> Any:
        if self.is_away:
            raise CORBA.COMM_FAILURE(0, CORBA.COMPLETED_NO)
        return super().__getattr__(name)


class Following(RuleBasedStateMachine):
    """A is the robot of the pool; its session learns of a new name of its floor before the pool does, or later."""

    def __init__(self) -> None:
        super().__init__()
        self._closing = contextlib.ExitStack()
        folder = Path(self._closing.enter_context(tempfile.TemporaryDirectory()))
        self.store = self._closing.enter_context(MapStore.create(folder / "map", furnished()))
        self.editor = BuildingEditor(self.store, MapLimits(commits=COMMITS))
        self.remote = MapEditor(self.editor)
        self.place = Place(self.editor.building)
        self.place.database.map_version = self.followed = self.editor.version
        #: Names by numbers of floors, in each version of the map.
        self.names = {self.editor.version: {0: "L1", 1: "L2"}}
        self.count = 9
        self.session_floor = "L1"
        orb: Any = self.remote
        self.follower = PoolFollower(orb, "L1", "A", lambda: self.session_floor)
        self.pool = DataPool(self.place.changes, self.follower._map.of, "L1", "A", self.place.clock)
        self.follower.pool = self.pool
        #: The floor on which the pool has seen A last, and the version of the map then.
        self.seen: tuple[str, int] | None = None
        #: Of one that reads the pool.
        self.view = FloorView("L1")

    def teardown(self) -> None:
        self._closing.close()

    # ---- the map ----

    @property
    def floors(self) -> dict[int, str]:
        return self.names[self.editor.version]

    def edit(self, floors: dict[int, str], change: Callable[..., object], *arguments: object) -> None:
        if self.editor.version - self.followed == COMMITS:
            self.simulation_follows()
        change(*arguments)
        self.names[self.editor.version] = floors

    @rule(which=number, name=st.sampled_from(NAMES))
    def rename(self, which: int, name: str) -> None:
        number = self.chosen(which)
        if name not in self.floors.values():
            before = self.floors[number], name, self.version_of(self.floors[number])
            self.edit({**self.floors, number: name}, self.editor.rename, FLOOR, "", *before)

    @rule()
    def exchange_names(self) -> None:
        first, second = list(self.floors.values())[:2]
        for which, name in ((0, "meanwhile"), (1, first), (0, second)):
            self.rename(which, name)

    @rule(name=st.sampled_from(NAMES))
    def remove_or_add_attic(self, name: str) -> None:
        """The others are served by the elevator."""
        if len(self.floors) == 3:
            number, before = list(self.floors.items())[-1]
            left = {each: name for each, name in self.floors.items() if each != number}
            self.edit(left, self.editor.remove, FLOOR, "", before, self.version_of(before))
        elif name not in self.floors.values():
            self.count += 1
            floor = Floor(name, self.count, 4.0 * self.count)
            self.edit({**self.floors, self.count: name}, self.editor.create, "", floor)

    @rule(which=number)
    def draw(self, which: int) -> None:
        self.count += 1
        wall = Wall(f"W{self.count}", (9.0, 1.0 + 0.01 * self.count), (9.5, 4.0))
        self.edit(self.floors, self.editor.create, self.floors[self.chosen(which)], wall)

    def chosen(self, which: int) -> int:
        return list(self.floors)[which % len(self.floors)]

    def version_of(self, floor: str) -> int:
        return self.editor.read(FLOOR, "", floor)[1]

    @rule()
    def map_editor_starts_again(self) -> None:
        self.remote.__init__(BuildingEditor(self.store, MapLimits(commits=COMMITS)))  # type: ignore[misc]
        self.editor = self.remote.editor

    # ---- the simulation ----

    @property
    def world(self) -> SimulatedBuilding:
        return self.place.world

    @rule()
    def simulation_follows(self) -> None:
        changes = self.editor.changes_since(self.followed)
        lineage = Lineage(MapChange(each.version, each.kind, each.floor, each.element) for each in changes)
        self.world.update(self.editor.building, lineage)
        self.followed = self.place.database.map_version = self.editor.version

    @rule(is_other=st.booleans())
    def simulation_starts_again(self, is_other: bool) -> None:
        """The Omni database does, perhaps with other numbers for all bodies, and without robots."""
        if is_other:
            self.place.world = SimulatedBuilding(self.editor.building)
            self.followed = self.editor.version
        self.world.refresh()
        self.place.start_again()
        self.place.database.map_version = self.followed

    @rule(name=who, which=number)
    def put(self, name: str, which: int) -> None:
        floor, x = list(self.world.building.floors)[which % len(self.world.building.floors)], 4.0 + ROBOTS.index(name)
        with contextlib.suppress(PlaceTaken):
            if name in self.world.occupants.robots:
                self.world.place(name, Pose(floor, x, 1.0, 0.0))
            else:
                self.world.add(robot(name, floor, x, 1.0))
        self.world.refresh()

    @precondition(lambda self: self.world.occupants.robots)
    @rule(name=who, what=st.sampled_from(["drives", "rides", "leaves"]), steps=number)
    def robot_acts(self, name: str, what: str, steps: int) -> None:
        robots = self.world.occupants.robots
        found = robots.get(name) or next(iter(robots.values()))
        if what == "leaves":
            self.world.remove(found.name)
        elif what == "drives":
            found.command(0.05 * steps, 0.1, 0.5, 0.5)
        else:
            with contextlib.suppress(InvalidRide):
                others = [floor for floor in self.world.building.floors if floor != found.floor]
                self.world.elevators.call(found.name, "E1", others[0] if others else "")
        self.place.run(0.1 * steps)
        self.world.refresh()

    # ---- the pool ----

    @rule(database=st.booleans(), editor=st.booleans())
    def servers_are_away(self, database: bool, editor: bool) -> None:
        self.place.is_away, self.remote.is_away = database, editor

    @rule()
    def session_looks(self) -> None:
        if found := self.world.occupants.robots.get("A"):
            self.session_floor = found.floor

    @rule(with_map=st.booleans())
    def follow(self, with_map: bool) -> None:
        if with_map:
            self.follower._follow_map()
        before = self.pool.snapshot()
        self.follower._follow()
        if self.pool.problem:
            assert self.pool.snapshot() is before or not self.pool.snapshot().is_known
            return
        assert not self.place.is_away and same(self.pool, self.place)
        found = self.world.occupants.robots.get("A")
        if found and found.floor == self.pool.floor:
            self.seen = found.floor, self.followed

    @precondition(lambda self: self.pool.snapshot().is_known)
    @rule()
    def read_changes(self) -> None:
        """However seldom."""
        snapshot = self.pool.snapshot()
        if self.view.floor != snapshot.floor:
            self.view = FloorView(snapshot.floor)
        whole = FloorView(snapshot.floor)
        self.view.apply(snapshot.changes(self.view.version))
        whole.apply(snapshot.as_update())
        for name in ("version", "time", "map_version", "bodies", "elevators"):
            assert getattr(self.view, name) == getattr(whole, name)
        assert sorted(self.view.motions.tolist()) == sorted(whole.motions.tolist())

    @rule()
    def all_answer(self) -> None:
        self.servers_are_away(False, False)
        self.simulation_follows()
        self.put("A", 0)
        self.session_looks()
        self.follow(False)
        self.follow(True)
        floor, snapshot = self.world.occupants.robots["A"].floor, self.pool.snapshot()
        assert (snapshot.floor, self.pool.problem) == (floor, "")
        assert snapshot.walls and snapshot.walls.match(self.editor.building)

    @invariant()
    def the_floor_of_the_robot_is_known(self) -> None:
        if self.remote.is_away and self.seen:
            with pytest.raises(NotReachable):
                self.follower.floors_since(self.seen[0])
            return
        for floor in (*NAMES, "meanwhile"):
            names: dict[str, str] = {}
            if self.seen and self.seen[0] == floor:
                then = self.names[self.seen[1]]
                names = {then[each]: name for each, name in self.floors.items() if each in then}
                if self.editor.version - self.seen[1] > COMMITS:  # nobody knows
                    names = {name: name for name in self.floors.values()}
            assert self.follower.floors_since(floor) == names


TestFollowing = Following.TestCase
TestFollowing.settings = settings(max_examples=12, stateful_step_count=40, deadline=None)
