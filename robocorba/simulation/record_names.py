"""The names in a record of the simulated building, after edits of the map that were made meanwhile."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec.structs import replace

from robocorba.map_editor.lineage import Lineage
from robocorba.map_editor.model import Building, ElementKind
from robocorba.map_editor.movable import full_name, movables
from robocorba.simulation.reservations import GONE
from robocorba.simulation.world_record import CabinRecord, ObjectRecord, RobotRecord, WorldRecord


def with_present_names(world: WorldRecord, building: Building, lineage: Lineage) -> WorldRecord:
    """A record with the names of an edited building; what it does not have any more is GONE, or on no floor.

    lineage: which of its elements are those of the building when the record was made."""
    floors = lineage.floors(building.floors)
    elevators = {
        origin.name: name
        for name in building.elevators
        if (origin := lineage.origin(ElementKind.ELEVATOR, "", name)) is not None
    }
    objects = {
        full_name(origin.floor, origin.name): full_name(floor, item.name)
        for item, floor in movables(building).values()
        if (origin := lineage.origin(ElementKind.OBJECT, floor, item.name)) is not None
    }
    return replace(
        world,
        robots={name: _robot(record, floors, objects) for name, record in world.robots.items()},
        objects={objects[name]: _object(record, floors) for name, record in world.objects.items() if name in objects},
        cabins={elevators[name]: _cabin(record, floors) for name, record in world.cabins.items() if name in elevators},
        reservations=[
            replace(record, areas=tuple((floors.get(floor, GONE), polygon) for floor, polygon in record.areas))
            for record in world.reservations
        ],
    )


def _robot(record: RobotRecord, floors: Mapping[str, str], objects: Mapping[str, str]) -> RobotRecord:
    grip = (objects.get(record.grip[0], GONE), *record.grip[1:]) if record.grip else None
    return replace(record, floor=floors.get(record.floor, GONE), grip=grip)


def _object(record: ObjectRecord, floors: Mapping[str, str]) -> ObjectRecord:
    map_pose = record.map_pose and (floors.get(record.map_pose[0], GONE), *record.map_pose[1:])
    return replace(record, floor=floors.get(record.floor, GONE), map_pose=map_pose)


def _cabin(record: CabinRecord, floors: Mapping[str, str]) -> CabinRecord:
    rides = [
        replace(ride, origin=floors.get(ride.origin, GONE), destination=floors.get(ride.destination, GONE))
        for ride in record.rides
    ]
    return replace(record, floor=floors.get(record.floor, GONE), rides=rides)
