"""Binary frames of floors for the browser: a JSON header, then a row for each body that moved.

A frame is, little-endian: the length of the header [bytes], the header in UTF-8, padded with spaces to a multiple of 4,
and rows of ROW. `static/live.js` reads them.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robocorba.map_editor.spatial.elevator_state import ElevatorState
from robocorba.map_editor.spatial.floor_update import WHOLE, Body, FloorUpdate, Motions

#: A body that moved: its number, x, y [m], heading [rad], velocity along the floor's axes [m/s], turn [rad/s].
ROW = np.dtype([("number", "<u4"), *((name, "<f4") for name in ("x", "y", "heading", "vx", "vy", "turn"))])
Rows = NDArray[np.void]
_LENGTH = struct.Struct("<I")


def update_frame(update: FloorUpdate) -> bytes:
    """The frame of an update."""
    header = {
        "floor": update.floor,
        "time": update.time,
        "map": update.map_version,
        "whole": update.since == WHOLE,
        "came": [_body(body) for body in update.came],
        "went": list(update.went),
        "elevators": {name: _elevator(state) for name, state in update.elevators.items()},
    }
    return _frame(header, rows_of(update.motions))


def whole_frame(
    floor: str,
    time_s: float,
    map_version: int,
    bodies: Iterable[Body],
    elevators: Mapping[str, ElevatorState],
    rows: Rows,
) -> bytes:
    """The frame that replaces all that a browser has of a floor. rows: of ROW, one for each body."""
    header = {
        "floor": floor,
        "time": time_s,
        "map": map_version,
        "whole": True,
        "came": [_body(body) for body in bodies],
        "went": [],
        "elevators": {name: _elevator(state) for name, state in elevators.items()},
    }
    return _frame(header, rows)


def rows_of(motions: Motions) -> Rows:
    """Rows of ROW from rows of MOTION."""
    rows = np.empty(len(motions), ROW)
    for name in ROW.names or ():
        rows[name] = motions[name]
    return rows


def _frame(header: dict[str, Any], rows: Rows) -> bytes:
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    return _LENGTH.pack(len(text)) + text + rows.tobytes()


def _body(body: Body) -> dict[str, Any]:
    return {
        "number": body.number,
        "kind": body.kind.name.lower(),
        "name": body.name,
        "radius": body.radius_m,
        "outline": body.outline,
    }


def _elevator(state: ElevatorState) -> dict[str, Any]:
    return {
        "cabin": state.floor,
        "height": state.height,
        "doors": state.doors.name.lower(),
        "opening": state.opening,
        "riders": list(state.riders),
        "queue": list(state.queue),
    }
