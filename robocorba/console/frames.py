"""Binary frames of floors for the browser: a JSON header, then a row for each body that moved.

A frame is, little-endian: the length of the header [bytes], the header in UTF-8, padded with spaces to a multiple of 4,
and rows of ROW. `static/live.js` reads them.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robocorba.map_editor.spatial.elevator_state import ElevatorState
from robocorba.map_editor.spatial.floor_update import WHOLE, Body, FloorUpdate, FloorView

#: A body that moved: its number, x, y [m], heading [rad], velocity along the floor's axes [m/s], turn [rad/s].
ROW = np.dtype([("number", "<u4"), *((name, "<f4") for name in ("x", "y", "heading", "vx", "vy", "turn"))])
Rows = NDArray[np.void]


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
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<I", len(text)) + text + with_fields(ROW, update.motions).tobytes()


def whole_update(view: FloorView) -> FloorUpdate:
    """The update that replaces all that a browser has of a floor."""
    bodies, elevators = list(view.bodies.values()), dict(view.elevators)
    return FloorUpdate(
        view.floor, WHOLE, view.version, view.time, view.map_version, bodies, [], view.motions, elevators
    )


def with_fields(dtype: np.dtype[np.void], rows: Rows) -> Rows:
    """Rows of ROW or MOTION as rows of the other type."""
    found = np.empty(len(rows), dtype)
    for name in dtype.names or ():
        found[name] = rows[name]
    return found


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
