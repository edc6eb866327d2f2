"""A simulated building with its Omni database, and data pools of it."""

from __future__ import annotations

from collections.abc import Callable

from robocorba.errors.services import NotReachable
from robocorba.map_editor.model import BoxShape, Building, MapObject, PolygonShape, SegmentShape, Wall
from robocorba.map_editor.spatial.floor_update import FloorUpdate
from robocorba.robot.data_pool.pool import DataPool
from robocorba.robot.motion.robot_state import Velocity
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.omni_database import OmniDatabase
from robocorba.simulation.physics import STEP_S
from tests.clock import Clock
from tests.simulation.places import robot, tower


class Place:
    """The source of pools, which answers unless `is_away`; its map is `building`."""

    def __init__(self, building: Building | None = None) -> None:
        self.world = SimulatedBuilding(building or furnished())
        self.database = OmniDatabase(self.world)
        self.clock = Clock()
        self.is_away = self.is_editor_away = False
        #: Called once, during the next request.
        self.meanwhile: Callable[[], object] | None = None

    def changes(self, floor: str, since: int) -> FloorUpdate:
        if self.is_away:
            raise NotReachable("the Omni database does not answer (away)")
        update = self.database.changes(floor, since)
        happens, self.meanwhile = self.meanwhile, None
        if happens:
            happens()
        return update

    def map_of(self, floor: str) -> Building:
        if self.is_editor_away:
            raise NotReachable("the map editor does not answer (away)")
        return self.world.building

    def pool(self, floor: str = "L1", own_name: str = "") -> DataPool:
        return DataPool(self.changes, self.map_of, floor, own_name, self.clock)

    def loaded_pool(self, floor: str = "L1", own_name: str = "") -> DataPool:
        pool = self.pool(floor, own_name)
        pool.follow()
        return pool

    def drive(self, robot: str, seconds: float, velocity: Velocity = (0.3, 0.0, 0.0)) -> None:
        """A command for a second of which some time passes."""
        self.world.occupants.robots[robot].command(*velocity, 1.0)
        self.run(seconds)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.world.step()

    def start_again(self) -> None:
        """The database of another process, with the same building."""
        self.database = OmniDatabase(self.world)


def populated(*names: str) -> Place:
    """With robots on the lower floor, a metre apart."""
    place = Place()
    for index, name in enumerate(names):
        place.world.add(robot(name, x=7.0, y=1.0 + index))
    place.world.refresh()
    return place


def furnished() -> Building:
    """The tower with more on its upper floor: a wall, a rail, and movable objects, one of them not convex."""
    hook = ((-0.6, -0.6), (0.6, -0.6), (0.6, -0.2), (-0.2, -0.2), (-0.2, 0.6), (-0.6, 0.6))
    building = tower()
    for element in (
        Wall("W2", (0.0, 7.0), (4.0, 9.0)),
        MapObject("rail", SegmentShape(2.0), (8.0, 1.0), 0.5),
        MapObject("plank", BoxShape((2.0, 0.1)), (8.0, 7.5), 0.7, movable=True),
        MapObject("box", BoxShape((0.6, 0.6)), (8.3, 8.6), 0.2, movable=True),
        MapObject("plate", PolygonShape(hook), (2.0, 4.0), 0.4, movable=True),
    ):
        building = building.with_element("L2", element)
    return building


def same(pool: DataPool, place: Place) -> bool:
    """Whether a pool's content equals the database's for its floor."""
    mine, whole = pool.snapshot().as_update(), place.database.floor(pool.floor)
    assert (mine.floor, mine.version, mine.time, mine.elevators) == (
        whole.floor,
        whole.version,
        whole.time,
        whole.elevators,
    )
    assert sorted(mine.came) == sorted(whole.came)
    assert sorted(mine.motions.tolist()) == sorted(whole.motions.tolist())
    assert [body.number for body in mine.came] == mine.motions["number"].tolist()
    return True
