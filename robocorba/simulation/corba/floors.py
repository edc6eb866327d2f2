"""Conversion of floor updates and their parts from and to the IDL."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from robocorba.map_editor.spatial.elevator_state import Doors, ElevatorState
from robocorba.map_editor.spatial.floor_update import MOTION, Body, BodyKind, FloorUpdate
from robocorba.orb.structs import enumeration
from robocorba.stubs import RoboCorba

_KIND = enumeration(BodyKind, suffix="_BODY")
_DOORS = {
    Doors.CLOSED: RoboCorba.CLOSED,
    Doors.OPENING: RoboCorba.DOORS_OPENING,
    Doors.OPEN: RoboCorba.OPEN,
    Doors.CLOSING: RoboCorba.DOORS_CLOSING,
}
_doors_of = {found: doors for doors, found in _DOORS.items()}


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


@lru_cache(maxsize=4096)  # bodies never change, and this is most of the cost of reading a whole floor
def _body(body: Body) -> Any:
    outline = [RoboCorba.XY(x, y) for x, y in body.outline]
    return RoboCorba.Body(body.number, _KIND.to_idl(body.kind), body.name, body.radius_m, outline, body.mass_kg)


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
                _KIND.from_idl(body.kind),
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
            name, state.floor, state.height, _DOORS[state.doors], state.opening, list(state.riders), list(state.queue)
        )
        for name, state in states.items()
    ]


def elevators_of(structs: list[Any]) -> dict[str, ElevatorState]:
    return {
        one.name: ElevatorState(
            one.height, one.cabin, _doors_of[one.doors], one.opening, tuple(one.riders), tuple(one.queue)
        )
        for one in structs
    }
