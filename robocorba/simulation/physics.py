"""One floor's physics: robots that follow velocity commands, objects that are pushed and carried, and what stands.

Bodies are read and written all at once, which costs a thirtieth of doing it one by one. The order in which pymunk
keeps them changes whenever one goes; `_names` says which row is whose.

Only one thread at a time may use a floor; it holds its own lock for each call.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import pymunk
import shapely
from pymunk.batch import ArbiterFields, BodyFields, Buffer, get_space_arbiters, get_space_bodies, set_space_bodies
from shapely.geometry.base import BaseGeometry

from robocorba.grids import Floats, segments_of
from robocorba.kernels import kernel

#: The time of a step, s.
STEP_S = 0.02
#: Of what slides on the floor; ours.
GROUND_FRICTION, GRAVITY_M_S2 = 0.5, 9.81
_SLOP_M = 0.001
_STATE = BodyFields.POSITION | BodyFields.ANGLE | BodyFields.VELOCITY | BodyFields.ANGULAR_VELOCITY
_MOTION = BodyFields.VELOCITY | BodyFields.ANGULAR_VELOCITY
_CONTACT = ArbiterFields.BODY_A_ID | ArbiterFields.BODY_B_ID | ArbiterFields.IS_FIRST_CONTACT


class Limits(NamedTuple):
    """Of a robot's base: m/s, rad/s, m/s^2, rad/s^2."""

    speed: float = 1.0
    turn: float = math.radians(100)
    acceleration: float = 1.0
    turn_acceleration: float = math.radians(100)


#: What is not a robot slows down by friction, or stands.
SLIDING = Limits(0.0, 0.0, GROUND_FRICTION * GRAVITY_M_S2, 4 * GROUND_FRICTION * GRAVITY_M_S2)
STANDING = Limits(0.0, 0.0, 0.0, 0.0)


class Contact(NamedTuple):
    """Two bodies that have begun to touch; names of robots and objects, empty for what stands."""

    first: str
    second: str


class FloorPhysics:
    """obstacles: what stands, lines and polygons."""

    def __init__(self, obstacles: Iterable[BaseGeometry] = ()) -> None:
        self._lock = threading.Lock()
        self._space = pymunk.Space()
        self._space.collision_slop = _SLOP_M
        self._bodies: dict[str, pymunk.Body] = {}
        self._robots: dict[str, Limits] = {}
        self._names: list[str] = []
        self._standing: list[pymunk.Shape] = []
        self._buffer, self._motion, self._contacts = Buffer(), Buffer(), Buffer()
        self._limits = np.empty((0, 2))
        self._commands = np.empty((0, 3))
        self._state = np.empty((0, 6))
        self.stand(obstacles)

    # ---- what there is ----

    def stand(self, obstacles: Iterable[BaseGeometry]) -> None:
        """Replace what stands."""
        shapes = [shape for shape in obstacles if not shape.is_empty]
        segments = segments_of(np.array(shapes, object))[0] if shapes else np.empty((0, 4))
        with self._lock:
            self._space.remove(*self._standing)
            ground = self._space.static_body
            self._standing = [pymunk.Segment(ground, (ax, ay), (bx, by), 0.0) for ax, ay, bx, by in segments.tolist()]
            self._space.add(*self._standing)

    def add_robot(
        self, name: str, pose: tuple[float, float, float], radius_m: float, mass_kg: float, limits: Limits
    ) -> None:
        """A disc that stands still until it is commanded. Raises KeyError for a name that is there."""
        body = pymunk.Body(mass_kg, pymunk.moment_for_circle(mass_kg, 0.0, radius_m))
        self._add(name, body, [pymunk.Circle(body, radius_m)], pose, limits)

    def add_object(self, name: str, pose: tuple[float, float, float], outline: BaseGeometry, mass_kg: float) -> None:
        """A thing that can be pushed; its outline is a polygon in its own frame. Raises KeyError as above."""
        parts = [pymunk.Poly(None, part) for part in convex_parts(outline)]
        total = sum(part.area for part in parts)
        for part in parts:
            part.mass = mass_kg * part.area / total
        body = pymunk.Body()
        for part in parts:
            part.body = body
        self._add(name, body, parts, pose, None)

    def remove(self, name: str) -> None:
        """Take a robot or an object away. Raises KeyError where there is none."""
        with self._lock:
            body = self._bodies.pop(name)
            self._robots.pop(name, None)
            self._space.remove(body, *body.constraints, *body.shapes)
            self._sort()

    def _add(
        self,
        name: str,
        body: pymunk.Body,
        shapes: Sequence[pymunk.Shape],
        pose: tuple[float, float, float],
        limits: Limits | None,
    ) -> None:
        if name in self._bodies:
            raise KeyError(f"there is a body {name} already")
        body.position, body.angle = pose[:2], pose[2]
        for shape in shapes:
            shape.friction = 0.3
        with self._lock:
            self._space.add(body, *shapes)
            self._bodies[name] = body
            if limits:
                self._robots[name] = limits
            self._sort()

    def _sort(self) -> None:
        """Learn in which order pymunk keeps the bodies now, and keep what was commanded."""
        commands = dict(zip(self._names, self._commands, strict=True))
        self._buffer.clear()
        get_space_bodies(self._space, BodyFields.BODY_ID, self._buffer)
        name_of = {body.id: name for name, body in self._bodies.items()}
        ids = np.frombuffer(self._buffer.int_buf(), np.uintp).tolist()
        self._names = [name_of.get(id, "") for id in ids]  # the body of what stands is among them
        self._limits = np.array([self._robots.get(name, SLIDING if name else STANDING)[2:] for name in self._names])
        self._velocities = np.zeros((len(ids), 3))
        self._motion.set_float_buf(self._velocities)
        self._commands = np.array([commands.get(name, (0.0, 0.0, 0.0)) for name in self._names])
        self._name_of = name_of
        self._row_of = {name: row for row, name in enumerate(self._names)}
        self._read()

    # ---- time ----

    def command(self, name: str, velocity: tuple[float, float, float]) -> None:
        """From now on, move ahead, to the left and turn at these speeds, m/s and rad/s; what is beyond its limits is
        slowed down, not turned aside. Raises KeyError for an unknown robot."""
        with self._lock:
            limits = self._robots[name]
            ahead, left, turn = velocity
            share = min(1.0, limits.speed / max(math.hypot(ahead, left), 1e-12))
            self._commands[self._row_of[name]] = (
                ahead * share,
                left * share,
                min(max(turn, -limits.turn), limits.turn),
            )

    def step(self) -> list[Contact]:
        """Let STEP_S pass; what has begun to touch."""
        with self._lock:
            control(self._state, self._commands, self._limits, self._velocities)
            set_space_bodies(self._space, _MOTION, self._motion)
            self._space.step(STEP_S)
            self._read()
            return self._new_contacts()

    def state(self) -> dict[str, tuple[float, ...]]:
        """By name: x, y, heading, velocity in x and y, turn."""
        with self._lock:
            return {name: tuple(row) for name, row in zip(self._names, self._state.tolist(), strict=True) if name}

    def _read(self) -> None:
        self._buffer.clear()
        get_space_bodies(self._space, _STATE, self._buffer)
        self._state = np.frombuffer(self._buffer.float_buf(), np.float64).reshape(-1, 6)

    def _new_contacts(self) -> list[Contact]:
        self._contacts.clear()
        get_space_arbiters(self._space, _CONTACT, self._contacts)
        found = np.frombuffer(self._contacts.int_buf(), np.uintp).reshape(-1, 3)
        begun = found[found[:, 2] == 1, :2].tolist()
        return [Contact(self._name_of.get(a, ""), self._name_of.get(b, "")) for a, b in begun]


@kernel
def control(state: Floats, commands: Floats, limits: Floats, velocities: Floats) -> None:
    """Velocities (n, 3) for the next step, as far as nothing is in the way: from those in `state` (n, 6) toward the
    commands (n, 3), which are in the frame of each body, no faster than `limits` (n, 2) of acceleration allow."""
    for i in range(len(state)):
        heading = state[i, 2]
        ch, sh = math.cos(heading), math.sin(heading)
        ahead, left, turn = commands[i]
        dx = ch * ahead - sh * left - state[i, 3]
        dy = sh * ahead + ch * left - state[i, 4]
        most = limits[i, 0] * STEP_S
        share = min(1.0, most / max(math.hypot(dx, dy), 1e-12))
        velocities[i, 0] = state[i, 3] + dx * share
        velocities[i, 1] = state[i, 4] + dy * share
        most_turn = limits[i, 1] * STEP_S
        velocities[i, 2] = state[i, 5] + min(max(turn - state[i, 5], -most_turn), most_turn)


def convex_parts(outline: BaseGeometry) -> list[list[tuple[float, float]]]:
    """Convex polygons that make up a polygon."""
    hull = outline.convex_hull
    if hull.area - outline.area < 1e-9 * hull.area:
        return [list(hull.exterior.coords[:-1])]
    triangles = shapely.constrained_delaunay_triangles(outline)
    return [list(part.exterior.coords[:-1]) for part in shapely.get_parts(triangles)]
