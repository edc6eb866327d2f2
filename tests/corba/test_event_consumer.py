"""The consumer of an event client ignores calls that it has had before."""

from __future__ import annotations

from typing import Any

import msgpack
import pytest

from robocorba.corba.event_client import REMEMBERED_CALLS, Event, _EventConsumerServant
from robocorba.stubs import RoboCorba


class Receiver:
    """A servant, and what it has passed on."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.together: list[tuple[int, list[Event]]] = []
        self.servant = _EventConsumerServant(
            self.events.append, lambda which, found: self.together.append((which, found))
        )

    @property
    def payloads(self) -> list[Any]:
        return [event.payload for event in self.events]


def header(number: int, time: float = 1.0, origin: str = "lab") -> Any:
    return RoboCorba.EventHeader("t", "A", origin, number, time, 0, 0.0, RoboCorba.MSGPACK)


def run(number: int, *payloads: int, time: float = 1.0, origin: str = "lab") -> Any:
    packed = [msgpack.packb(payload) for payload in payloads]
    return RoboCorba.EventRun(header(number, time, origin), [time] * len(packed), packed)


def test_a_repeated_call_is_ignored() -> None:
    receiver = Receiver()
    for call in ([run(1, 10, 11), run(5, 12)], [run(6, 13)], [run(1, 10, 11), run(5, 12)], [run(6, 13)], []):
        receiver.servant.pushRuns(call)
    assert receiver.payloads == [10, 11, 12, 13]


@pytest.mark.parametrize("other", [run(1, 20, origin="hall"), run(2, 20), run(1, 20, time=2.0)])
def test_other_events_are_none_that_were_had(other: Any) -> None:
    receiver = Receiver()
    receiver.servant.pushRuns([run(1, 10)])
    receiver.servant.pushRuns([other])
    assert receiver.payloads == [10, 20]


def test_a_repeated_conjunction_is_ignored_and_one_of_another_clause_is_not() -> None:
    receiver = Receiver()
    pair = [RoboCorba.Event(header(number), msgpack.packb(number)) for number in (1, 2)]
    for which in (0, 1, 0):
        receiver.servant.pushTogether(which, pair)
    assert [(which, [event.payload for event in found]) for which, found in receiver.together] == [
        (0, [1, 2]),
        (1, [1, 2]),
    ]


def test_what_it_remembers_is_bounded() -> None:
    receiver = Receiver()
    for number in range(1, 2 * REMEMBERED_CALLS):
        receiver.servant.pushRuns([run(number, number)])
    assert len(receiver.servant._known) == len(receiver.servant._recent) == REMEMBERED_CALLS
    receiver.servant.pushRuns([run(REMEMBERED_CALLS, 0)])  # the oldest that it remembers
    assert receiver.payloads == list(range(1, 2 * REMEMBERED_CALLS))
