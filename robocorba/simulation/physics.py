"""One floor's physics: robots that follow velocity commands, objects that are pushed and carried, and what stands.

Bodies are read and written all at once, which costs a thirtieth of doing it one by one. The order in which pymunk
keeps them changes whenever one goes; `_names` says which row is whose.

Only one thread at a time may use a floor; it holds its own lock for each call.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

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
#: Velocities, and until when they hold, s.
NO_COMMAND = (0.0, 0.0, 0.0, math.inf)
#: What robots have lifted goes where they go; a little is lost in their hands.
CARRIED = Limits(0.0, 0.0, 0.1, 0.1)
#: A hand that is farther from what it held has lost it, m.
SLIPPED_M = 0.05


class Contact(NamedTuple):
    """Two bodies that have begun to touch; names of robots and objects, empty for what stands."""

    first: str
    second: str


class Step(NamedTuple):
    """What happened in a step; lost: robots whose grip slipped."""

    contacts: list[Contact]
    lost: list[str]


class _Grip(NamedTuple):
    """A robot holds an object by a joint, and carries so much of it, kg."""

    thing: str
    joint: pymunk.PivotJoint
    payload_kg: float


class FloorPhysics:
    """obstacles: what stands, lines and polygons."""

    def __init__(self, obstacles: Iterable[BaseGeometry] = ()) -> None:
        self._lock = threading.Lock()
        self._space = pymunk.Space()
        self._space.collision_slop = _SLOP_M
        self._bodies: dict[str, pymunk.Body] = {}
        self._robots: dict[str, Limits] = {}
        self._grips: dict[str, _Grip] = {}
        self._names: list[str] = []
        self._standing: list[pymunk.Shape] = []
        self._gates: dict[str, list[pymunk.Segment]] = {}
        self._buffer, self._motion, self._contacts = Buffer(), Buffer(), Buffer()
        self._steps, self.time = 0, 0.0
        self._commands = np.empty((0, 4))
        self._sort()
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

    def shut(self, name: str, line: BaseGeometry) -> None:
        """Let something stand that comes and goes by itself, such as a closed door; under a name, until `open`."""
        self.open(name)
        ground = self._space.static_body
        leaves = [
            pymunk.Segment(ground, row[:2], row[2:], 0.0) for row in segments_of(np.array([line], object))[0].tolist()
        ]
        with self._lock:
            self._gates[name] = leaves
            self._space.add(*leaves)

    def open(self, name: str) -> None:
        """Take away what `shut` has put there, if it has."""
        with self._lock:
            self._space.remove(*self._gates.pop(name, ()))

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
            for robot in [robot for robot, grip in self._grips.items() if name in (robot, grip.thing)]:
                self._let_go(robot)
            self._space.remove(body, *body.shapes)
            self._sort()

    def grip(self, robot: str, thing: str, at: tuple[float, float], force_n: float, payload_kg: float) -> None:
        """Let a robot hold an object at a place in the world, x and y in m, with at most so much force.

        Held by robots whose payloads together are as heavy as itself, it is off the ground. A robot holds one thing; it
        lets go of what it held before. Raises KeyError for an unknown robot or object."""
        with self._lock:
            if robot not in self._robots or thing in self._robots:
                raise KeyError(f"{robot} is no robot, or {thing} no object")
            hand, held = self._bodies[robot], self._bodies[thing]
            if robot in self._grips:
                self._let_go(robot)
            joint = pymunk.PivotJoint(hand, held, hand.world_to_local(at), held.world_to_local(at))
            joint.max_force, joint.collide_bodies = force_n, False
            joint.error_bias = 0.01  # what a step leaves of an error in a second: hands are stiff
            self._space.add(joint)
            self._grips[robot] = _Grip(thing, joint, payload_kg)
            self._sort()

    def release(self, robot: str) -> None:
        """Let a robot let go of what it holds. Raises KeyError where it holds nothing."""
        with self._lock:
            self._let_go(robot)
            self._sort()

    def _let_go(self, robot: str) -> None:
        self._space.remove(self._grips.pop(robot).joint)

    def _slipped(self) -> list[str]:
        lost = []
        for robot, grip in self._grips.items():
            hand = grip.joint.a.local_to_world(grip.joint.anchor_a)
            held = grip.joint.b.local_to_world(grip.joint.anchor_b)
            if hand.get_distance(held) > SLIPPED_M:
                lost.append(robot)
        for robot in lost:
            self._let_go(robot)
        if lost:
            self._sort()
        return lost

    def _limits_of(self, name: str) -> Limits:
        """How a body may change its velocity by itself."""
        if name in self._robots:
            return self._robots[name]
        if not name:
            return STANDING
        lifted_kg = sum(grip.payload_kg for grip in self._grips.values() if grip.thing == name)
        return CARRIED if lifted_kg >= self._bodies[name].mass > 0.0 else SLIDING

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
        self._limits = np.array([self._limits_of(name)[2:] for name in self._names]).reshape(-1, 2)
        self._velocities = np.zeros((len(ids), 3))
        self._motion.set_float_buf(self._velocities)
        self._commands = np.array([commands.get(name, NO_COMMAND) for name in self._names]).reshape(-1, 4)
        self._cells: Any = self._commands.data
        self._name_of = name_of
        self._row_of = {name: row for row, name in enumerate(self._names)}
        self._read()

    def touching(self, x: float, y: float, radius_m: float) -> str | None:
        """What a disc there would touch: the name of the nearest body, empty for what stands; None for nothing."""
        with self._lock:
            found = self._space.point_query_nearest((x, y), radius_m, pymunk.ShapeFilter())
            return self._name_of.get(found.shape.body.id, "") if found and found.shape and found.shape.body else None

    # ---- time ----

    def command(self, name: str, velocity: tuple[float, float, float], valid_s: float = math.inf) -> None:
        """Move ahead, to the left and turn at these speeds, m/s and rad/s, for `valid_s`; what is beyond the robot's
        limits is slowed down, not turned aside. Raises KeyError for an unknown robot."""
        limits = self._robots[name]
        ahead, left, turn = velocity
        speed = math.hypot(ahead, left)
        share = limits.speed / speed if speed > limits.speed else 1.0
        turn = min(max(turn, -limits.turn), limits.turn)
        with self._lock:
            row, cells = self._row_of[name], self._cells  # a fourth of the cost of numpy's
            cells[row, 0], cells[row, 1], cells[row, 2] = ahead * share, left * share, turn
            cells[row, 3] = self.time + valid_s

    def step(self) -> Step:
        """Let STEP_S pass."""
        with self._lock:
            self._steps += 1
            self.time = self._steps * STEP_S
            control(self._state, self._commands, self._limits, self.time, self._velocities)
            set_space_bodies(self._space, _MOTION, self._motion)
            self._space.step(STEP_S)
            self._read()
            return Step(self._new_contacts(), self._slipped() if self._grips else [])

    def state(self) -> dict[str, tuple[float, ...]]:
        """By name: x, y, heading, velocity in x and y, turn."""
        with self._lock:
            return {name: tuple(row) for name, row in zip(self._names, self._state.tolist(), strict=True) if name}

    def row(self, name: str) -> tuple[float, ...]:
        """The same of one body. Raises KeyError."""
        with self._lock:
            return tuple(self._state[self._row_of[name]].tolist())

    def all(self) -> tuple[list[str], Floats]:
        """Names, empty for what stands, and the same in rows (n, 6)."""
        with self._lock:
            return self._names, self._state.copy()

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
def control(state: Floats, commands: Floats, limits: Floats, now: float, velocities: Floats) -> None:
    """Velocities (n, 3) for the next step, as far as nothing is in the way: from those in `state` (n, 6) toward the
    commands (n, 4), which are in the frame of each body and hold until a time, no faster than `limits` (n, 2) of
    acceleration allow."""
    for i in range(len(state)):
        heading = state[i, 2]
        ch, sh = math.cos(heading), math.sin(heading)
        ahead, left, turn, until = commands[i]
        if until < now:
            ahead = left = turn = 0.0
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
