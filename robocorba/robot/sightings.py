"""What a robot publishes of what it sees and its map lacks."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence

from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.sightings import MAX_SEEN, ObstaclesSeen, SeenObstacle, shape_of

#: Interval of the calls of `update`, the shortest between two events [s].
INTERVAL_S = 0.5
#: Interval at which what has not changed is published again [s]: it must be within the window of a correlation.
REPEAT_S = 2.0
#: Changes of a place or outline [m], and of a certainty, that are published at once.
MOVED_M, SURER = 0.05, 0.2

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
