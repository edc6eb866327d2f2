"""What a robot publishes of what it sees."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from robocorba.errors.services import NotReachable
from robocorba.map_editor.sightings import MAX_SEEN, ObstaclesSeen, SeenObstacle, seen_of
from robocorba.robot.sightings import SightingReport
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


def test_what_could_not_be_published_is_published_later() -> None:
    events: list[ObstaclesSeen] = []
    failing = [True]

    def publish(event: ObstaclesSeen) -> None:
        if failing.pop():
            raise NotReachable("no channel")
        events.append(event)

    report = SightingReport(lambda: [seen(1)], publish, Clock())
    report.update()
    assert events == []
    failing.append(False)
    report.update()
    assert seen_of(msgspec.to_builtins(events[0])) == (seen(1),)
