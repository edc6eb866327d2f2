"""Conversion of floor updates and their parts from and to the IDL."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from robocorba.map_editor.spatial.elevator_state import Doors, ElevatorState
from robocorba.map_editor.spatial.floor_update import MOTION, Body, BodyKind, FloorUpdate
from robocorba.stubs import RoboCorba

#: Structs of bodies that are kept: they never change, and making them is most of the cost of reading a whole floor.
KEPT_BODIES = 4096

_KINDS = {BodyKind.ROBOT: RoboCorba.ROBOT_BODY, BodyKind.OBJECT: RoboCorba.OBJECT_BODY}
_DOORS = {
    Doors.CLOSED: RoboCorba.CLOSED,
    Doors.OPENING: RoboCorba.DOORS_OPENING,
    Doors.OPEN: RoboCorba.OPEN,
    Doors.CLOSING: RoboCorba.DOORS_CLOSING,
}
_KIND_OF = {struct: kind for kind, struct in _KINDS.items()}
_DOORS_OF = {struct: doors for doors, struct in _DOORS.items()}


def update(value: FloorUpdate) -> Any:
    return RoboCorba.FloorUpdate(*_head(value), value.motions.tobytes(), elevators(value.elevators))


def typed_update(value: FloorUpdate) -> Any:
    """A TypedFloorUpdate: its rows are structs."""
    motions = [RoboCorba.Motion(*row) for row in value.motions.tolist()]
    return RoboCorba.TypedFloorUpdate(*_head(value), motions, elevators(value.elevators))


def _head(value: FloorUpdate) -> tuple[Any, ...]:
    """The members before the rows."""
    return (
        value.floor,
        value.since,
        value.version,
        value.time,
        value.map_version,
        list(map(_body, value.came)),
        value.went,
    )


@lru_cache(maxsize=KEPT_BODIES)
def _body(body: Body) -> Any:
    outline = [RoboCorba.XY(x, y) for x, y in body.outline]
    return RoboCorba.Body(body.number, _KINDS[body.kind], body.name, body.radius_m, outline, body.mass_kg)


def update_of(struct: Any) -> FloorUpdate:
    return FloorUpdate(
        struct.floorName,
        struct.since,
        struct.current,
        struct.time,
        struct.mapVersion,
        [
            Body(
                body.number,
                _KIND_OF[body.kind],
                body.name,
                body.radius,
                tuple((point.x, point.y) for point in body.outline),
                body.mass,
            )
            for body in struct.came
        ],
        struct.went,
        np.frombuffer(struct.motions, MOTION),
        elevators_of(struct.elevators),
    )


def elevators(states: dict[str, ElevatorState]) -> list[Any]:
    return [
        RoboCorba.ElevatorState(
            name,
            state.floor,
            state.height,
            _DOORS[state.doors],
            state.opening,
            list(state.riders),
            list(state.queue),
        )
        for name, state in states.items()
    ]


def elevators_of(structs: list[Any]) -> dict[str, ElevatorState]:
    return {
        one.name: ElevatorState(
            one.height, one.cabin, _DOORS_OF[one.doors], one.opening, tuple(one.riders), tuple(one.queue)
        )
        for one in structs
    }
