"""Physics of one floor: robots that follow velocity commands, objects that are pushed and carried, static obstacles.

Bodies are read and written in one batch. pymunk reorders them whenever one is removed; `_names` maps rows to names.

One thread owns a floor: pymunk releases the interpreter's lock while it steps, and concurrent access would crash it.
Any thread may call `command` and `brake`, which take effect in the next step, and read `snapshot`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import repeat
from struct import Struct
from typing import NamedTuple

import numpy as np
import pymunk
import shapely
from shapely import LineString
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.spatial.floor_state import FloorState, in_own_frames
from robocorba.map_editor.spatial.grids import segments_of
from robocorba.map_editor.spatial.pose import Limits
from robocorba.simulation.bodies import Bodies
from robocorba.simulation.static_parts import StaticChange, StaticPart, StaticParts, changes_between, static_parts
from robocorba.simulation.substeps import MAX_PENETRATION_M, STEP_S, RobotMasses, max_penetration_m, substeps_for
from robocorba.simulation.velocity_control import BRAKING_M_S2, BRAKING_RAD_S2, control, limit_speeds

#: Packs a command: velocity ahead, to the left [m/s] and turn [rad/s], and the time until which it is valid [s].
_pack_command = Struct("4d").pack
#: Stop within the robot's limits.
_NO_COMMAND = _pack_command(0.0, 0.0, 0.0, math.inf)
#: Stop as fast as ground friction allows, regardless of the robot's limits.
_BRAKE = _pack_command(0.0, 0.0, 0.0, -math.inf)
#: Steps between checks whether a floor is still.
STILL_CHECK_STEPS = 16
#: Distance between the two hands of a robot on an edge [m].
HANDS_APART_M = 0.4
#: Share of the error of a grip that remains after a second: hands are stiff.
_STIFF = 1e-6


class StepResult(NamedTuple):
    """Outcome of a step. contacts: pairs of bodies that began to touch, by name; empty for a static obstacle. lost:
    robots whose grip slipped."""

    contacts: list[tuple[str, str]]
    lost: list[str]


@dataclass
class _Grip:
    """A joint between a robot and an object. payload_kg: share of the object's mass that the robot carries [kg].
    heading: the joint by which a robot that carries the object alone holds its heading, with both hands."""

    held: str
    joint: pymunk.PivotJoint
    payload_kg: float
    heading: pymunk.GearJoint | None = None

    @property
    def arm(self) -> LineString:
        """From the robot's centre to its hand."""
        robot = self.joint.a
        return LineString([robot.position, robot.local_to_world(self.joint.anchor_a)])


class FloorPhysics:
    """Physics of the floor `name`, beginning after `steps` steps. obstacles: static lines and polygons."""

    #: State after the last step, without bodies that were added since.
    snapshot: FloorState
    #: Whether nothing moves nor touches, so that steps change nothing but the time until somebody commands or changes
    #: something. Found within half a second.
    is_still = False

    def __init__(self, obstacles: Iterable[BaseGeometry] = (), steps: int = 0, name: str = "") -> None:
        self.name = name
        self._space = pymunk.Space()
        self._space.collision_slop = 0.001  # overlap that Chipmunk tolerates between touching bodies [m]
        self._space.on_collision(begin=self._contact_began)
        self._ground = self._space.static_body  # pymunk creates it at the first access
        self._bodies: dict[str, pymunk.Body] = {}
        self._robots: dict[str, Limits] = {}
        self._masses = RobotMasses()
        self._grips: dict[str, _Grip] = {}
        self._names: list[str] = []
        self._static: dict[StaticPart, list[pymunk.Shape]] = {}
        self._doors: dict[str, list[pymunk.Shape]] = {}
        self._batched = Bodies(self._space)
        self._contacts: list[tuple[str, str]] = []
        self.set_steps(steps)
        #: Last command of each robot, packed: replacing one needs no lock, reading all of them needs no loop.
        self._packed_commands: dict[str, bytes] = {}
        self._name_of: dict[int, str] = {}
        #: By name: how far each body may move in a substep [m], and its mass and moment of inertia [kg, kg m^2].
        self._reach_m: dict[str, float] = {}
        self._inertia_of: dict[str, tuple[float, float]] = {}
        self._is_moving = False
        self._rebuild_rows()
        self.set_obstacles(obstacles)

    # ---- obstacles and bodies ----

    def set_obstacles(self, obstacles: Iterable[BaseGeometry]) -> None:
        """Replace the static obstacles: lines, and solid polygons."""
        for change in self.changes_to(static_parts(obstacles)):
            self.change_obstacles(change)

    def changes_to(self, parts: StaticParts) -> Iterator[StaticChange]:
        """The changes that replace the static obstacles by these parts, each little work. Any thread may ask for them
        while no other replaces obstacles."""
        return changes_between(self._static, parts)

    def change_obstacles(self, change: StaticChange) -> None:
        """Make one of the changes of `changes_to`."""
        self.is_still = False
        removed, added = change
        for part in removed:
            self._space.remove(*self._static.pop(part))
        for part in added:
            if isinstance(part, bytes):
                polygons = convex_parts(shapely.from_wkb(part))
                self._static[part] = [pymunk.Poly(self._ground, polygon) for polygon in polygons]
            else:
                self._static[part] = [self._segment(part)]
            self._space.add(*self._static[part])

    def _segment(self, row: tuple[float, float, float, float]) -> pymunk.Shape:
        return pymunk.Segment(self._ground, row[:2], row[2:], 0.0)

    def close_door(self, name: str, line: BaseGeometry) -> None:
        """Add a static line that `open_door` removes."""
        self.open_door(name)
        self._doors[name] = self._segments(line)
        self._space.add(*self._doors[name])

    def open_door(self, name: str) -> None:
        """Remove the line of a closed door, if any."""
        self.is_still = False
        self._space.remove(*self._doors.pop(name, ()))

    def is_crossed(self, line: BaseGeometry) -> bool:
        """Whether a body lies across a line, such as that of an open door, or a robot reaches across it for what it
        holds."""
        return bool(self._across(line)) or any(line.intersects(grip.arm) for grip in self._grips.values())

    def is_obstructed(self, line: BaseGeometry) -> bool:
        """Whether an object that no robot holds lies across a line."""
        return not self._across(line) <= self._robots.keys() | {grip.held for grip in self._grips.values()}

    def objects_within(self, area: shapely.Polygon) -> list[str]:
        """Names of the objects whose origins are within an area."""
        near = self._space.bb_query(pymunk.BB(*area.bounds), pymunk.ShapeFilter())
        found = {self._owner_of(shape) for shape in near} - self._robots.keys() - {""}
        return [name for name in sorted(found) if area.contains(shapely.Point(self._bodies[name].position))]

    def _across(self, line: BaseGeometry) -> set[str]:
        """Names of the bodies across a line."""
        found = {self._owner_of(info.shape) for part in self._segments(line) for info in self._space.shape_query(part)}
        return found - {""}

    def _segments(self, line: BaseGeometry) -> list[pymunk.Shape]:
        """Static segments along a line."""
        return [self._segment(row) for row in segments_of(np.array([line], object))[0].tolist()]

    def add_robot(
        self, name: str, pose: tuple[float, float, float], radius_m: float, mass_kg: float, limits: Limits
    ) -> None:
        """Add a disc that is stationary until commanded. Raises KeyError if the name is taken."""
        body = pymunk.Body(mass_kg, pymunk.moment_for_circle(mass_kg, 0.0, radius_m))
        self._add(name, body, [pymunk.Circle(body, radius_m)], pose, limits, max_penetration_m(radius_m))
        self._masses.add(name, body, mass_kg)

    def add_object(self, name: str, pose: tuple[float, float, float], outline: BaseGeometry, mass_kg: float) -> None:
        """Add a movable object; `outline` is a polygon in its own frame [m]. Raises KeyError if the name is taken."""
        parts = [pymunk.Poly(None, part) for part in convex_parts(outline)]
        total = sum(part.area for part in parts)
        for part in parts:
            part.mass = mass_kg * part.area / total
        body = pymunk.Body()
        for part in parts:
            part.body = body
        half_width_m = shapely.maximum_inscribed_circle(outline).length
        self._add(name, body, parts, pose, None, max(MAX_PENETRATION_M, half_width_m / 2))

    def remove(self, name: str) -> None:
        """Remove a robot or an object with its grips. Raises KeyError for an unknown name."""
        body = self._bodies.pop(name)
        del self._name_of[body.id], self._reach_m[name]
        self._inertia_of.pop(name, None)
        self._robots.pop(name, None)
        self._masses.remove(name)
        self._packed_commands.pop(name, None)
        for robot in [robot for robot, grip in self._grips.items() if name in (robot, grip.held)]:
            self._remove_grip(robot)
        self._space.remove(body, *body.shapes)
        self._has_changed = True

    def grip(self, robot: str, object_name: str, at: tuple[float, float], force_n: float, payload_kg: float) -> None:
        """Connect a robot to an object at a point of the floor [m], with at most `force_n`.

        The object is lifted as soon as the payloads of its holders add up to its mass. A robot holds one object and
        releases its previous one. Raises KeyError for an unknown robot or object."""
        if robot not in self._robots or object_name in self._robots:
            raise KeyError(f"{robot} is no robot, or {object_name} no object")
        hand, held = self._bodies[robot], self._bodies[object_name]
        if robot in self._grips:
            self._remove_grip(robot)
        joint = pymunk.PivotJoint(hand, held, hand.world_to_local(at), held.world_to_local(at))
        joint.max_force, joint.collide_bodies = force_n, False
        joint.error_bias = _STIFF
        self._space.add(joint)
        self._grips[robot] = _Grip(object_name, joint, payload_kg)
        self._has_changed = True

    def release(self, robot: str) -> None:
        """Release the object that a robot holds, if any."""
        if robot in self._grips:
            self._remove_grip(robot)
            self._has_changed = True

    def held(self, robot: str) -> tuple[str, tuple[float, float]] | None:
        """The object that a robot holds, and the grip point on the floor [m]; None without a grip."""
        grip = self._grips.get(robot)
        if grip is None:
            return None
        x, y = grip.joint.a.local_to_world(grip.joint.anchor_a)
        return grip.held, (x, y)

    def distance(self, name: str, at: tuple[float, float]) -> float:
        """Distance from a point to a body [m]; 0 or negative inside. Raises KeyError."""
        return float(min(shape.point_query(at).distance for shape in self._bodies[name].shapes))

    def _remove_grip(self, robot: str) -> None:
        grip = self._grips.pop(robot)
        self._space.remove(grip.joint, *([grip.heading] if grip.heading else []))

    def _hold_headings(self) -> None:
        """Have robots that carry an object alone hold its heading; the hands of several hold it anyway."""
        holders = Counter(grip.held for grip in self._grips.values())
        for grip in self._grips.values():
            is_alone = holders[grip.held] == 1 and grip.payload_kg >= self._bodies[grip.held].mass
            if is_alone and grip.heading is None:
                hand, held = grip.joint.a, grip.joint.b
                grip.heading = pymunk.GearJoint(hand, held, held.angle - hand.angle, 1.0)
                grip.heading.max_force, grip.heading.error_bias = grip.joint.max_force * HANDS_APART_M / 2, _STIFF
                self._space.add(grip.heading)
            elif not is_alone and grip.heading:
                self._space.remove(grip.heading)
                grip.heading = None

    def _drop_slipped_grips(self) -> list[str]:
        lost = []
        for robot, grip in self._grips.items():
            hand = grip.joint.a.local_to_world(grip.joint.anchor_a)
            held = grip.joint.b.local_to_world(grip.joint.anchor_b)
            if hand.get_distance(held) > 0.05:  # the grip slips beyond 5 cm
                lost.append(robot)
        for robot in lost:
            self._remove_grip(robot)
        if lost:
            self._has_changed = True
        return lost

    def _limits_of(self, name: str) -> Limits:
        """Motion limits of a body."""
        if name in self._robots:
            return self._robots[name]
        if not name:  # the static body
            return Limits(0.0, 0.0, 0.0, 0.0)
        lifted_kg = sum(grip.payload_kg for grip in self._grips.values() if grip.held == name)
        if lifted_kg >= self._bodies[name].mass > 0.0:  # it follows its carriers, with a little damping
            return Limits(0.0, 0.0, 0.1, 0.1)
        return Limits(0.0, 0.0, BRAKING_M_S2, BRAKING_RAD_S2)  # it slides on the floor

    def _add(
        self,
        name: str,
        body: pymunk.Body,
        shapes: Sequence[pymunk.Shape],
        pose: tuple[float, float, float],
        limits: Limits | None,
        reach_m: float,
    ) -> None:
        if name in self._bodies:
            raise KeyError(f"a body {name} exists already")
        body.position, body.angle = pose[:2], pose[2]
        for shape in shapes:
            shape.friction = 0.3
        self._space.add(body, *shapes)
        self._bodies[name], self._name_of[body.id], self._reach_m[name] = body, name, reach_m
        if limits:
            self._robots[name] = limits
            self._packed_commands[name] = _NO_COMMAND  # drops a command of an earlier robot of this name
        self._has_changed = True

    def _rebuild_rows(self) -> None:
        """Rebuild names, limits and commands in pymunk's current order of bodies."""
        self._hold_headings()
        names = [self._name_of.get(id, "") for id in self._batched.rebuild()]  # includes the static body
        self._names, self._row_of = names, {name: row for row, name in enumerate(names)}
        self._limits = np.array([self._limits_of(name) for name in names]).reshape(-1, 4)
        self._adapt_to_bodies()
        self._held = {robot: grip.held for robot, grip in self._grips.items()}
        self._commands = np.empty((len(names), 4))
        self._commanded = [name if name in self._robots else "" for name in names]
        self._has_changed, self._has_new_commands, self.is_still = False, True, False
        self._rows_at_check = b""
        self._take_snapshot()

    def _adapt_to_bodies(self) -> None:
        """Choose substeps and iterations by the bodies that are present."""
        for name in self._masses.apply():
            self._inertia_of.pop(name, None)
        self._space.iterations = self._masses.iterations
        reach_m = np.array([self._reach_m.get(name, math.inf) for name in self._names])
        self._substeps = substeps_for(self._limits[:, 0].max(), reach_m.min())
        substep_s = STEP_S / self._substeps
        self._caps = reach_m / substep_s
        for name in self._bodies.keys() - self._inertia_of.keys():
            self._inertia_of[name] = self._bodies[name].mass, self._bodies[name].moment
        inertia = [self._inertia_of.get(name, (0.0, 0.0)) for name in self._names]
        self._inertia = np.array(inertia).reshape(-1, 2) / substep_s

    def touching(self, x: float, y: float, radius_m: float, but: str | None = None) -> str | None:
        """Name of the nearest body that a disc would touch, empty for a static obstacle; None if the disc is free.

        but: name of a body that does not count."""
        found = self._space.point_query((x, y), radius_m, pymunk.ShapeFilter())
        near = sorted(found, key=lambda info: info.distance)
        return next((name for info in near if (name := self._owner_of(info.shape)) != but), None)

    def overlapping(
        self, outline: BaseGeometry, pose: tuple[float, float, float], but: str | None = None
    ) -> str | None:
        """As `touching`, for a polygon in its own frame [m] at a pose; any of the bodies that it would touch."""
        body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        body.position, body.angle = pose[:2], pose[2]
        parts = [pymunk.Poly(body, part) for part in convex_parts(outline)]
        found = (info.shape for part in parts for info in self._space.shape_query(part))
        return next((name for shape in found if (name := self._owner_of(shape)) != but), None)

    def _owner_of(self, shape: pymunk.Shape | None) -> str:
        """Name of the body that a shape belongs to; empty for a static obstacle."""
        return self._name_of.get(shape.body.id, "") if shape and shape.body else ""

    # ---- time ----

    def command(self, name: str, ahead: float, left: float, turn: float, valid_s: float = math.inf) -> None:
        """Set a robot's velocity ahead, to the left [m/s] and turn [rad/s] for `valid_s`. Thread-safe.

        Beyond the robot's limits the speed is reduced and the direction kept. Ignores an unknown robot."""
        self._packed_commands[name] = _pack_command(ahead, left, turn, self.time + valid_s)
        self._has_new_commands = True

    def brake(self, name: str) -> None:
        """Stop a robot as fast as ground friction allows, until its next command. Ignores an unknown robot."""
        self._packed_commands[name] = _BRAKE
        self._has_new_commands = True

    def rename(self, name: str) -> None:
        """Take another name."""
        if name != self.name:
            self.name = name
            self.renew()

    def renew(self) -> None:
        """Let readers of `snapshot` look at all bodies again."""
        self._has_changed = True

    def step(self) -> StepResult:
        """Advance by STEP_S."""
        self.refresh()
        has_new_commands = self._has_new_commands
        if has_new_commands:
            self._take_commands()
        self._steps += 1
        self.time = self._steps * STEP_S
        if has_new_commands or not self.is_still:
            self._limit_speeds()
            self._control()
        if self.is_still:
            rows = self.snapshot.rows
            self.snapshot = FloorState(self.name, self.time, self._names, self._row_of, rows, self._held)
            return StepResult([], [])
        self._space.step(STEP_S / self._substeps)
        for _ in range(1, self._substeps):
            self._batched.read()
            self._limit_speeds()
            self._space.step(STEP_S / self._substeps)
        self._take_snapshot()
        if self._steps % STILL_CHECK_STEPS == 0:
            self._check_whether_still()
        contacts = self._contacts
        if contacts:
            self._contacts = []
        lost = self._drop_slipped_grips() if self._grips else []
        self.refresh()
        return StepResult(contacts, lost)

    def _check_whether_still(self) -> None:
        """Set `is_still` once all bodies have rested between two checks and Chipmunk remembers no contact.

        Then a step is a function without memory that gave its input: further ones cannot give anything else."""
        if self._grips or self._is_moving:
            self._rows_at_check = b""
            return
        before, self._rows_at_check = self._rows_at_check, self.snapshot.rows.tobytes()
        self.is_still = before == self._rows_at_check and not self._batched.has_contacts()

    def _control(self) -> None:
        """Let the bodies follow their commands in the next step.

        By forces, since Chipmunk first moves bodies by their velocities, then finds contacts, then applies forces: what
        leads into an obstacle is taken away before anything moves."""
        bodies = self._batched
        rows = bodies.state, bodies.velocities, self._commands, self._limits, self._inertia
        self._is_moving = control(*rows, self.time, bodies.forces)
        self.is_still = self.is_still and not self._is_moving
        bodies.write_forces()

    def _limit_speeds(self) -> None:
        """Slow down bodies that others push faster than a substep holds."""
        bodies = self._batched
        if limit_speeds(bodies.state, self._caps, bodies.velocities):
            bodies.write_velocities()

    def set_steps(self, steps: int) -> None:
        """Set the number of passed steps, and the time accordingly."""
        self._steps, self.time = steps, steps * STEP_S
        self._has_changed = True

    def _take_commands(self) -> None:
        """Take over the pending commands; a concurrent command takes effect in the next step."""
        self._has_new_commands = False  # reset before reading, so that no command is missed
        packed = b"".join(map(self._packed_commands.get, self._commanded, repeat(_NO_COMMAND)))
        self._commands[:] = np.frombuffer(packed).reshape(-1, 4)

    def refresh(self) -> None:
        """Update `snapshot` after bodies were added or removed, also while time is paused."""
        if self._has_changed:
            self._rebuild_rows()

    def row(self, name: str) -> tuple[float, ...]:
        """Current x, y [m], heading [rad], velocity along x and y [m/s], turn [rad/s] of a body. Raises KeyError."""
        self.refresh()
        return tuple(self._batched.state[self._row_of[name]].tolist())

    def pose(self, name: str) -> tuple[float, float, float]:
        """Current x, y [m], heading [rad] of a body. Raises KeyError."""
        x, y, heading = self.row(name)[:3]
        return x, y, heading

    def state(self) -> dict[str, tuple[float, ...]]:
        """Rows as of `row` for all bodies, by name."""
        self.refresh()
        return {name: tuple(row) for name, row in zip(self._names, self._batched.state.tolist(), strict=True) if name}

    def _take_snapshot(self) -> None:
        self._batched.read()
        rows = self._batched.state.copy()
        self.snapshot = FloorState(self.name, self.time, self._names, self._row_of, rows, self._held)

    def _contact_began(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: object) -> None:
        """Record a contact; pymunk calls this within a step."""
        first, second = arbiter.shapes
        self._contacts.append((self._owner_of(first), self._owner_of(second)))


def warm_up() -> None:
    """Compile or load the kernels, so that the first step takes no longer than the others."""
    physics = FloorPhysics()
    physics.add_robot("fast", (0.0, 0.0, 0.0), 0.05, 1.0, Limits(speed=1.0))  # needs substeps
    physics.step()
    in_own_frames(physics.snapshot.rows)


def convex_parts(outline: BaseGeometry) -> list[list[tuple[float, float]]]:
    """Decompose a polygon into convex polygons."""
    hull = outline.convex_hull
    if hull.area - outline.area < 1e-9 * hull.area:
        return [list(hull.exterior.coords[:-1])]
    triangles = shapely.constrained_delaunay_triangles(outline)
    return [list(part.exterior.coords[:-1]) for part in shapely.get_parts(triangles)]
