"""What robots report to each other of what they see and their maps lack."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from shapely import Point

from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.sightings import MAX_SEEN, ObstaclesSeen, SeenObstacle, corners, is_same, seen_of, shape_of
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.temporary_obstacles import NO_OBSTACLES, TemporaryObstacles
from robocorba.robot.perception import SeenThing

#: Interval of the calls of `update`, the shortest between two events [s].
INTERVAL_S = 0.5
#: Interval at which what has not changed is published again [s]: it must be within the window of a correlation.
REPEAT_S = 2.0
#: Changes of a place or outline [m], and of a certainty, that are published at once.
MOVED_M, SURER = 0.05, 0.2
#: Expiry of the events [s].
EXPIRY_S = 10.0
#: What others report is an obstacle from this certainty on, for this time after their last event [s], at this distance
#: at least [m]: what is nearer a robot sees itself. Number of such obstacles, the nearest ones.
SHARED_CERTAINTY, SHARED_S, SHARED_FROM_M, MAX_SHARED = 0.6, 5.0, 1.0, 10

_log = logging.getLogger(__name__)


class SightingReport:
    """Publishes what `see` returns, all of it in each event. publish: may raise RoboCorbaError. clock: returns the time
    [s].

    Call `update` every INTERVAL_S in a thread of its own: a channel that hangs must not stop the robot."""

    def __init__(
        self,
        see: Callable[[], Sequence[SeenObstacle]],
        publish: Callable[[ObstaclesSeen], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._see, self._publish, self._clock = see, publish, clock
        self._published: Mapping[int, SeenObstacle] = {}
        self._published_at = -math.inf

    def update(self) -> None:
        """Publish what is seen if it is news, or was published some time ago."""
        now = self._clock()
        surest = sorted(self._see(), key=lambda each: -each.certainty)[:MAX_SEEN]
        seen = {each.number: each for each in surest}
        if self._is_news(seen) or (seen and now - self._published_at >= REPEAT_S):
            try:
                self._publish(ObstaclesSeen(tuple(seen.values())))
                self._published, self._published_at = seen, now
            except RoboCorbaError as error:  # the next call tries again
                _log.debug("what is seen was not published: %s", error)

    def _is_news(self, seen: Mapping[int, SeenObstacle]) -> bool:
        if seen.keys() != self._published.keys():
            return True
        return any(_differ(each, self._published[number]) for number, each in seen.items())


def _differ(one: SeenObstacle, other: SeenObstacle) -> bool:
    if one.floor != other.floor or abs(one.certainty - other.certainty) > SURER:
        return True
    return bool(shape_of(one.outline).hausdorff_distance(shape_of(other.outline)) > MOVED_M)


def seen_obstacles(things: Sequence[SeenThing], now: float) -> list[SeenObstacle]:
    """What a robot sees, as it publishes it. now: time.time [s]."""
    return [
        SeenObstacle(
            thing.number,
            thing.floor,
            *thing.at,
            corners(shape_of(thing.outline.tolist())),
            thing.certainty,
            max(0.0, now - thing.first_seen),
            max(0.0, now - thing.last_seen),
        )
        for thing in things
    ]


class SharedSightings:
    """What the robot `name` sees, `own`, and what others report. Thread-safe. own: the same object until it changes.
    where: returns the robot's place [m]. clock: returns the time [s]."""

    def __init__(
        self,
        name: str,
        own: Callable[[], TemporaryObstacles],
        where: Callable[[], XY],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._name, self._own, self._where, self._clock = name, own, where, clock
        self._lock = threading.Lock()
        #: By robot: when it reported, and what [s].
        self._shared: dict[str, tuple[float, Sequence[SeenObstacle]]] = {}
        #: The last answer, and what it was made from.
        self._made_from: tuple[TemporaryObstacles, Sequence[float]] = NO_OBSTACLES, ()
        self._made = NO_OBSTACLES

    def receive(self, type: str, source: str, payload: Any, origin: str) -> None:
        """An event of what a robot sees."""
        with self._lock:
            if source != self._name:
                self._shared[source] = self._clock(), seen_of(payload)

    @property
    def obstacles(self) -> TemporaryObstacles:
        """Obstacles for paths: the same object until it changes."""
        with self._lock:
            now, own = self._clock(), self._own()
            self._shared = {robot: one for robot, one in self._shared.items() if now - one[0] <= SHARED_S}
            made_from = own, [when for when, _ in self._shared.values()]
            if self._made_from[0] is not own or self._made_from[1] != made_from[1]:
                self._made_from, self._made = made_from, self._beside(own)
            return self._made

    def _beside(self, own: TemporaryObstacles) -> TemporaryObstacles:
        """What the robot sees, and what others report that it does not see itself."""
        here, shapes = self._where(), [(floor, shape_of(outline)) for floor, outline in own.forbidden_areas]
        reported = [(robot, each) for robot, (_, seen) in self._shared.items() for each in seen]
        found = []
        for robot, each in sorted(reported, key=lambda one: math.dist((one[1].x, one[1].y), here)):
            shape = shape_of(each.outline)
            is_known = any(floor == each.floor and is_same(other, shape) for floor, other in shapes)
            if each.certainty >= SHARED_CERTAINTY and not is_known and shape.distance(Point(here)) >= SHARED_FROM_M:
                found.append((f"{robot}'s thing {each.number}", (each.floor, corners(shape))))
                shapes.append((each.floor, shape))
        names, areas = tuple(name for name, _ in found[:MAX_SHARED]), tuple(area for _, area in found[:MAX_SHARED])
        if not names:
            return own
        return own._replace(forbidden_areas=own.forbidden_areas + areas, names=own.names + names)
