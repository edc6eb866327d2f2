"""Kills of channels and of the naming service under traffic, with an account of every event."""

from __future__ import annotations

import random
import threading
import time
from typing import Any, NamedTuple

from robocorba.errors.events import Unconfirmed
from robocorba.errors.services import NotReachable
from testkit.federation import LIMIT_S, Channels, Consumer, Counts
from testkit.processes import eventually

LINKS = ("AB", "BC")
NAMING = "omniNames"
#: Pause between two events of a supplier [s].
PAUSE_S = 0.002


class Outcome(NamedTuple):
    """The result of one kill.

    to_ready_s, to_links_s: from the restart to the first answer, and until all links are up. said: events that channels
    accepted. duplicates: copies delivered twice. disorder: streams delivered out of order. lost: copies of accepted
    events that did not reach a consumer. in_victim: copies that, by the accounts of the survivors, the killed process
    had accepted and not passed on. lost_later: lost copies of events pushed after the kill."""

    victim: str
    to_ready_s: float
    to_links_s: float
    said: int
    duplicates: int
    disorder: int
    lost: int
    in_victim: int
    lost_later: int

    @property
    def links_after_ready_s(self) -> float:
        return max(0.0, self.to_links_s - self.to_ready_s)

    @property
    def is_right(self) -> bool:
        """No duplicates, no disorder, and no losses except what the killed process held."""
        return not (self.duplicates or self.disorder or self.lost_later) and self.lost == self.in_victim


class Supplier(threading.Thread):
    """Pushes numbers at one channel. accepted: the accepted numbers with their times; unconfirmed: the others."""

    def __init__(self, at: Channels, name: str, first: int) -> None:
        super().__init__(name=f"supplier at {name}", daemon=True)
        self.accepted: dict[int, float] = {}
        self.unconfirmed: set[int] = set()
        self._client, self._number = at.clients[name], first
        self._ended = threading.Event()

    def run(self) -> None:
        while not self._ended.wait(PAUSE_S):
            self._number += 1
            began = time.monotonic()
            try:
                self._client.push("t", self._number, retry_s=LIMIT_S)
                self.accepted[self._number] = began
            except (Unconfirmed, NotReachable):
                self.unconfirmed.add(self._number)

    def end(self) -> None:
        self._ended.set()
        self.join(2 * LIMIT_S)
        assert not self.is_alive()


class Chaos:
    """Channels A - B - C in a chain, each with a supplier and a consumer of all events."""

    def __init__(self, at: Channels, seed: int) -> None:
        self.at, self._random = at, random.Random(seed)
        at.shape(*LINKS)
        self.consumers = {name: Consumer(client, ("t", "probe")) for name, client in at.clients.items()}
        at.wait_reaches(self.consumers, "ABC")
        self._last = 0

    def round(self, victim: str) -> Outcome:
        """Kill and restart a channel or the naming service; wait until all events have arrived."""
        self._settle({})
        for consumer in self.consumers.values():
            consumer.events.clear()
        before = self._delivered_to(victim)
        suppliers = {name: Supplier(self.at, name, self._last) for name in self.consumers}
        for supplier in suppliers.values():
            supplier.start()
        try:
            time.sleep(self._random.uniform(0.2, 0.6))
            (self.at.kill_naming if victim == NAMING else lambda: self.at.kill(victim))()
            killed = time.monotonic()
            time.sleep(0.1)  # let the receivers handle what the killed process had sent
            received = {name: consumer.events[:] for name, consumer in self.consumers.items()}
            time.sleep(self._random.uniform(0.0, 0.4))
            to_ready_s, to_links_s = self._restart(victim)
            time.sleep(0.3)
        finally:
            for supplier in suppliers.values():
                supplier.end()
        accepted = {name: supplier.accepted for name, supplier in suppliers.items()}
        self._last = max(max(numbers) for numbers in accepted.values()) + 1000
        self._settle(accepted)

        lost = self._lost(accepted)
        return Outcome(
            victim,
            to_ready_s,
            to_links_s,
            sum(map(len, accepted.values())),
            sum(len(numbers) - len(set(numbers)) for numbers in self._streams().values()),
            sum(numbers != sorted(numbers) for numbers in self._streams().values()),
            len(lost),
            self._lost_in(victim, before, received, lost) if victim != NAMING else 0,
            sum(accepted[origin][number] > killed for _, origin, number in lost),
        )

    def _restart(self, victim: str) -> tuple[float, float]:
        began = time.monotonic()
        if victim == NAMING:
            assert self.at.is_up(*LINKS)  # links do not need the naming service
            self.at.start_naming()
            eventually(self._has_naming, LIMIT_S, "the naming service")
            return time.monotonic() - began, time.monotonic() - began
        self.at.spawn(victim)
        self.at.wait_ready(victim)
        ready = time.monotonic()
        eventually(lambda: self.at.is_up(*LINKS), LIMIT_S, "all links")
        return ready - began, time.monotonic() - began

    def _has_naming(self) -> bool:
        try:
            self.at.orb.check_naming()
        except NotReachable:
            return False
        return True

    def _streams(self) -> dict[tuple[str, str], list[int]]:
        """Numbers received, by consumer and origin."""
        return {
            (name, origin): consumer.payloads(origin)
            for name, consumer in self.consumers.items()
            for origin in self.consumers
        }

    def _lost(self, accepted: dict[str, dict[int, float]]) -> list[tuple[str, str, int]]:
        """Consumer, origin and number of each copy that did not arrive."""
        received = {stream: set(numbers) for stream, numbers in self._streams().items()}
        return [(n, o, number) for (n, o) in received for number in accepted[o] if number not in received[n, o]]

    def _settle(self, accepted: dict[str, dict[int, float]]) -> None:
        """Wait until no event is in transit: the last one has arrived everywhere, all links and proxies are empty."""

        def is_quiet() -> bool:
            for name, origin in self._streams():
                numbers = self.consumers[name].payloads(origin)
                if accepted and (not numbers or numbers[-1] < max(accepted[origin])):
                    return False
            states = [self.at.channel(name).state() for name in self.consumers]
            accounts = [part.events for state in states for part in [*state.links, *state.proxies]]
            assert all(Counts.of(account).is_exact for account in accounts)
            return not any(account.queued for account in accounts)

        eventually(is_quiet, LIMIT_S, "the last event everywhere")

    def _delivered_to(self, victim: str) -> dict[str, int]:
        return {n: self.at.outgoing(n, victim).events.delivered for n in self._neighbours(victim)}

    @staticmethod
    def _neighbours(victim: str) -> list[str]:
        return [pair.replace(victim, "") for pair in LINKS if victim in pair]

    def _lost_in(
        self, victim: str, before: dict[str, int], received: dict[str, list[Any]], lost: list[tuple[str, str, int]]
    ) -> int:
        """The number of copies that the killed process had accepted and not passed on.

        It accepted what its neighbours delivered, less what the new process received, and what its own supplier pushed.
        It passed on what its consumer and the other neighbour received before it was killed."""
        accepted = {
            neighbour: delivered - before[neighbour] - self.at.incoming(victim, neighbour).events.received
            for neighbour, delivered in self._delivered_to(victim).items()
        }
        missing = 0
        # Towards its own consumer: events from other channels.
        at_victim = sum(event.origin != victim and event.type == "t" for event in received[victim])
        missing += sum(accepted.values()) - at_victim
        # From each neighbour towards every consumer on the other side.
        for neighbour, count in accepted.items():
            for there in self.consumers:
                if there != victim and not self._is_behind(there, neighbour, victim):
                    origins = [o for o in self.consumers if o != victim and self._is_behind(o, neighbour, victim)]
                    missing += count - sum(event.origin in origins and event.type == "t" for event in received[there])
        # Events of its own supplier that it accepted and kept.
        missing += sum(origin == victim for _, origin, _ in lost)
        return missing

    @staticmethod
    def _is_behind(name: str, neighbour: str, victim: str) -> bool:
        """Whether a channel is on the neighbour's side of the victim in the chain."""
        return name == neighbour or (name < neighbour < victim) or (victim < neighbour < name)
