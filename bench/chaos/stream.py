"""A client that sends numbered events from one sub-network to the other, and checks that each arrives once.

    python -m bench.chaos.stream NAMING FROM TO

FROM, TO: names of event channels. It prints `null`, then answers lines of JSON on stdin: `news` returns the longest
time for an event since the last question [s], and what went wrong; `last` waits for the last events."""

from __future__ import annotations

import sys
import threading
import time

from bench.chaos.beside import MAX_CALL_S
from robocorba.errors.events import Unconfirmed
from robocorba.events.corba.event_client import Event, EventClient
from robocorba.orb.orb import Orb
from robocorba.system.repeating import Repeating
from robocorba.system.settings import Address
from testkit.json_process import answer_commands

#: Type and source of the numbered events.
EVENTS = ("chaos.count", "client")
#: Interval between two numbered events [s].
INTERVAL_S = 0.2
#: Number of events of which the time until they were accepted is kept.
KEPT = 1000
#: Time limits for the subscription to reach the other channel, and for the last events to arrive [s].
JOIN_LIMIT_S, LAST_EVENTS_S = 60.0, 30.0


class NumberedEvents:
    """Numbered events from one channel to the other, until `last`."""

    def __init__(self, sending: EventClient, receiving: EventClient, sender: str) -> None:
        self._lock = threading.Lock()
        self._sending = sending
        self._next, self._number = 0, 0
        self._longest_s = 0.0
        self._slow: dict[int, float] = {}
        #: How long the last calls took that pushed an event, by number [s].
        self._pushed: dict[int, float] = {}
        self._wrong: list[str] = []
        self._unconfirmed: set[int] = set()
        self._subscription = receiving.subscribe(self._receive, EVENTS)
        self._subscription.wait_in_force(sender, JOIN_LIMIT_S)
        self._pushing = Repeating("events", self._push, INTERVAL_S).start()

    def news(self) -> tuple[float, list[str], list[str]]:
        """Since the last question: the longest time for an event [s], events that took long, and what went wrong."""
        with self._lock:
            slow = [
                f"event {number} took {took_s:.2f} s, {self._pushed.get(number, 0.0):.2f} s of it until it was accepted"
                for number, took_s in self._slow.items()
            ]
            found = (self._longest_s, slow, self._wrong)
            self._longest_s, self._slow, self._wrong = 0.0, {}, []
        return found

    def last(self) -> tuple[float, list[str], list[str]]:
        """Send no more, wait for the last events, and return the last news."""
        self._pushing.close()
        deadline = time.monotonic() + LAST_EVENTS_S
        while self._next < self._number and time.monotonic() < deadline:
            time.sleep(0.1)
        if self._next < self._number:
            self._complain(f"events from {self._next} to {self._number} have not arrived")
        return self.news()

    def _complain(self, what: str) -> None:
        with self._lock:
            self._wrong.append(what)

    def _push(self) -> None:
        began = time.monotonic()
        try:
            self._sending.push(EVENTS[0], [self._number, time.time()])
        except Unconfirmed as error:
            self._complain(f"event {self._number}: {error}")
            self._unconfirmed.add(self._number)
        with self._lock:
            self._pushed[self._number] = time.monotonic() - began
            self._pushed.pop(self._number - KEPT, None)
        self._number += 1

    def _receive(self, event: Event) -> None:
        number, sent = event.payload
        took_s = time.time() - sent
        if missed := set(range(self._next, number)) - self._unconfirmed:
            self._complain(f"events lost: {sorted(missed)[:10]}")
        if number < self._next:
            self._complain(f"event {number} came again")
        self._next = max(self._next, number + 1)
        with self._lock:
            self._longest_s = max(self._longest_s, took_s)
            if took_s > MAX_CALL_S:
                self._slow[number] = took_s


def main(naming: str, here: str, there: str) -> None:
    with (
        Orb(Address.parse(naming)) as orb,
        EventClient(orb, here, EVENTS[1]) as sending,
        EventClient(orb, there, EVENTS[1]) as receiving,
    ):
        events = NumberedEvents(sending, receiving, here)
        answer_commands(events.news, events.last)


if __name__ == "__main__":
    main(*sys.argv[1:])
