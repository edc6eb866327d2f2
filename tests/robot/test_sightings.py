"""What a robot publishes of what it sees."""

from __future__ import annotations

from collections.abc import Sequence
from unittest.mock import MagicMock

import msgspec
import numpy as np

from robocorba.errors.services import NotReachable
from robocorba.map_editor.sightings import MAX_SEEN, ObstaclesSeen, SeenObstacle, seen_of
from robocorba.planning.temporary_obstacles import NO_OBSTACLES, TemporaryObstacles
from robocorba.robot.perception import SeenThing
from robocorba.robot.sightings import MAX_SHARED, SHARED_S, SharedSightings, SightingReport, seen_obstacles
from tests.clock import Clock


def seen(number: int, x: float = 1.0, certainty: float = 0.5) -> SeenObstacle:
    outline = ((x - 0.2, 0.0), (x + 0.2, 0.0), (x, 0.3))
    return SeenObstacle(number, "L1", x, 0.1, outline, certainty)


def test_news_are_published_at_once_and_all_of_it_again_after_a_while() -> None:
    clock, sights, events = Clock(), [seen(1)], list[ObstaclesSeen]()
    report = SightingReport(lambda: sights, events.append, clock)

    def published(*now: SeenObstacle) -> Sequence[int] | None:
        """The numbers of what is published half a second later, when this is seen; None for no event."""
        clock.now += 0.5
        sights[:], before = now, len(events)
        report.update()
        return [each.number for each in events[-1].obstacles] if len(events) > before else None

    assert published() is None
    assert published(seen(1)) == [1]
    assert published(seen(1, 1.04, 0.6)) is None
    assert published(seen(1, 1.06)) == [1]  # by small steps, it has moved
    assert published(seen(1, 1.06), seen(2, 4.0, 0.6)) == [2, 1]
    assert [published(seen(1, 1.06), seen(2, 4.0, 0.6)) for _ in range(4)] == [None, None, None, [2, 1]]
    assert published(seen(1, 1.06, 0.75), seen(2, 4.0, 0.6)) == [1, 2]
    assert published(seen(2, 4.0, 0.6)) == [2]
    assert published() == []
    assert [published() for _ in range(6)] == [None] * 6
    assert len(published(*(seen(number) for number in range(MAX_SEEN + 5))) or ()) == MAX_SEEN


def test_what_could_not_be_published_is_published_later_and_a_thing_with_its_age() -> None:
    publish = MagicMock(side_effect=[NotReachable("no channel"), None])
    report = SightingReport(lambda: [seen(1)], publish, Clock())
    report.update()
    report.update()
    assert seen_of(msgspec.to_builtins(publish.call_args[0][0])) == (seen(1),)
    outline = np.array([[1.0, 2.0], [2.0, 2.0], [1.5, 2.5]])
    thing = SeenThing(7, "L1", outline, (1.5, 2.2), 0.9, 100.0, 103.0)
    (found,) = seen_obstacles([thing], 104.0)
    assert (found.number, found.floor, found.x, found.y, found.certainty) == (7, "L1", 1.5, 2.2, 0.9)
    assert (found.known_s, found.unseen_s, sorted(found.outline)) == (4.0, 1.0, [(1.0, 2.0), (1.5, 2.5), (2.0, 2.0)])
    assert seen_of(msgspec.to_builtins(ObstaclesSeen((found,)))) == (found,)


def test_a_robot_avoids_what_others_tell_unless_it_sees_better() -> None:
    clock = Clock()
    own = [TemporaryObstacles((("L1", ((1.0, 0.0), (1.4, 0.0), (1.4, 0.4))),), names=("seen thing 1",))]
    shared = SharedSightings("A", lambda: own[0], lambda: (0.0, 0.0), clock)
    assert shared.obstacles is own[0]

    def report(robot: str, *seen: SeenObstacle) -> None:
        shared.receive("obstacle.seen", robot, msgspec.to_builtins(ObstaclesSeen(seen)), "lab")

    report("A", seen(1, 9.0, 0.9))
    report("B", seen(1, 1.3, 0.9), seen(2, 4.0, 0.9), seen(3, 6.0, 0.5), seen(4, 0.8, 0.9))
    assert shared.obstacles.names == ("seen thing 1", "B's thing 2")
    assert shared.obstacles is shared.obstacles
    report("C", seen(5, 4.1, 0.9), seen(6, 7.0, 0.9))
    assert set(shared.obstacles.names) == {"seen thing 1", "B's thing 2", "C's thing 6"}
    assert dict(zip(shared.obstacles.names, shared.obstacles.forbidden_areas, strict=True))["C's thing 6"][0] == "L1"
    own[0] = NO_OBSTACLES
    assert set(shared.obstacles.names) == {"B's thing 1", "B's thing 2", "C's thing 6"}
    clock.now += SHARED_S + 0.1
    report("C", *(seen(number, 3.0 + number, 0.9) for number in range(20)))
    assert shared.obstacles.names == tuple(f"C's thing {number}" for number in range(MAX_SHARED))
    clock.now += SHARED_S + 0.1
    assert shared.obstacles == NO_OBSTACLES
