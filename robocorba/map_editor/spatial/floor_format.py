"""Floor updates in msgpack, for events and recordings: RoboCorba::FloorUpdate of omni_database.idl, where a struct is a
map from member names to values and an enumerator is its number, counted from 0."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from robocorba.map_editor.spatial.elevator_state import Doors, ElevatorState
from robocorba.map_editor.spatial.floor_update import MOTION, Body, BodyKind, FloorUpdate
from robocorba.system.decoding import decode_msgpack


class _XY(msgspec.Struct):
    x: float
    y: float


class _Body(msgspec.Struct):
    number: int
    kind: BodyKind
    name: str
    radius: float
    outline: list[_XY]
    mass: float


class _Elevator(msgspec.Struct):
    name: str
    cabin: str
    height: float
    doors: Doors
    opening: float
    riders: tuple[str, ...]
    queue: tuple[str, ...]


class FloorUpdateMap(msgspec.Struct, rename="camel"):
    """The payload of floor.changed. since: 0 for the whole floor. time: simulated [s]. went: numbers of bodies.
    motions: rows of MOTION, 40 bytes each."""

    floor_name: str
    since: int
    current: int
    time: float
    map_version: int
    came: list[_Body]
    went: list[int]
    motions: bytes
    elevators: list[_Elevator]


def dumps(update: FloorUpdate) -> bytes:
    """Encode an update as msgpack."""
    return msgspec.msgpack.encode(_wire(update))


def as_map(update: FloorUpdate) -> dict[str, Any]:
    """An update as plain maps and lists, to embed in a larger msgpack document."""
    builtins: dict[str, Any] = msgspec.to_builtins(_wire(update), builtin_types=(bytes,))
    return builtins


def loads(data: bytes) -> FloorUpdate:
    """Decode what `dumps` encoded. Raises ValueError."""
    wire = decode_msgpack(data, FloorUpdateMap)
    return FloorUpdate(
        wire.floor_name,
        wire.since,
        wire.current,
        wire.time,
        wire.map_version,
        [
            Body(body.number, body.kind, body.name, body.radius, tuple((p.x, p.y) for p in body.outline), body.mass)
            for body in wire.came
        ],
        wire.went,
        np.frombuffer(wire.motions, MOTION),
        {
            state.name: ElevatorState(state.height, state.cabin, state.doors, state.opening, state.riders, state.queue)
            for state in wire.elevators
        },
    )


def _wire(update: FloorUpdate) -> FloorUpdateMap:
    """An update in the structure of the IDL."""
    came = [
        _Body(body.number, body.kind, body.name, body.radius_m, [_XY(x, y) for x, y in body.outline], body.mass_kg)
        for body in update.came
    ]
    elevators = [
        _Elevator(name, state.floor, state.height, state.doors, state.opening, state.riders, state.queue)
        for name, state in update.elevators.items()
    ]
    floor, since, version, time, map_version = update[:5]
    motions = update.motions.tobytes()
    return FloorUpdateMap(floor, since, version, time, map_version, came, update.went, motions, elevators)
