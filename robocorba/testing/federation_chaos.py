"""Kills of channels and of the naming service under traffic, and what became of every event."""

from __future__ import annotations

import random
import threading
import time
from typing import Any, NamedTuple

from robocorba.errors.events import Unconfirmed
from robocorba.errors.services import NotReachable
from robocorba.testing.federation import LIMIT_S, Channels, Consumer, Counts
from robocorba.testing.processes import eventually

LINKS = ("AB", "BC")
NAMING = "omniNames"
PAUSE_S = 0.002


class Outcome(NamedTuple):
    """Of one kill. Times in s: from the start of the new process to its first answer, and until all links are up.

    lost: copies that did not come to a consumer, of events whose supplier was told that they were taken. in_victim: as
    many as the accounts of the survivors say that the killed process had taken over and not passed on. lost_later: of
    those lost, the ones said when the killed process was gone."""

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
        """Nothing twice, nothing out of order, and nothing lost but what died with the process that held it."""
        return not (self.duplicates or self.disorder or self.lost_later) and self.lost == self.in_victim


class Speaker(threading.Thread):
    """Pushes numbers at one channel. said: those taken, and when; doubtful: those perhaps taken."""

    def __init__(self, at: Channels, name: str, first: int) -> None:
        super().__init__(name=f"speaker at {name}", daemon=True)
        self.said: dict[int, float] = {}
        self.doubtful: set[int] = set()
        self._client, self._number = at.clients[name], first
        self._ended = threading.Event()

    def run(self) -> None:
        while not self._ended.wait(PAUSE_S):
            self._number += 1
            began = time.monotonic()
            try:
                self._client.push("t", self._number, retry_s=LIMIT_S)
                self.said[self._number] = began
            except (Unconfirmed, NotReachable):
                self.doubtful.add(self._number)

    def end(self) -> None:
        self._ended.set()
        self.join(2 * LIMIT_S)
        assert not self.is_alive()


class Chaos:
    """Channels A - B - C in a chain; each has a supplier, and a consumer of everything."""

    def __init__(self, at: Channels, seed: int) -> None:
        self.at, self._random = at, random.Random(seed)
        at.shape(*LINKS)
        self.consumers = {name: Consumer(client, ("t", "probe")) for name, client in at.clients.items()}
        at.wait_reaches(self.consumers, "ABC")
        self._last = 0

    def round(self, victim: str) -> Outcome:
        """Kill a channel, or the naming service, and start it again; wait until all is quiet."""
        self._settle({})
        for consumer in self.consumers.values():
            consumer.events.clear()
        before = self._delivered_to(victim)
        speakers = {name: Speaker(self.at, name, self._last) for name in self.consumers}
        for speaker in speakers.values():
            speaker.start()
        try:
            time.sleep(self._random.uniform(0.2, 0.6))
            (self.at.kill_naming if victim == NAMING else lambda: self.at.kill(victim))()
            killed = time.monotonic()
            time.sleep(0.1)  # what the killed process had sent has been handled
            taken = {name: consumer.events[:] for name, consumer in self.consumers.items()}
            time.sleep(self._random.uniform(0.0, 0.4))
            to_ready_s, to_links_s = self._start_again(victim)
            time.sleep(0.3)
        finally:
            for speaker in speakers.values():
                speaker.end()
        said = {name: speaker.said for name, speaker in speakers.items()}
        self._last = max(max(numbers) for numbers in said.values()) + 1000
        self._settle(said)

        lost = self._lost(said)
        return Outcome(
            victim,
            to_ready_s,
            to_links_s,
            sum(map(len, said.values())),
            sum(len(got) - len(set(got)) for got in self._all_got().values()),
            sum(got != sorted(got) for got in self._all_got().values()),
            len(lost),
            self._died_with(victim, before, taken, lost) if victim != NAMING else 0,
            sum(said[origin][number] > killed for _, origin, number in lost),
        )

    def _start_again(self, victim: str) -> tuple[float, float]:
        began = time.monotonic()
        if victim == NAMING:
            assert self.at.is_up(*LINKS)  # links need it for nothing
            self.at.start_naming()
            eventually(self._is_naming_back, LIMIT_S, "the names")
            return time.monotonic() - began, time.monotonic() - began
        self.at.spawn(victim)
        self.at.wait_ready(victim)
        ready = time.monotonic()
        eventually(lambda: self.at.is_up(*LINKS), LIMIT_S, "all links")
        return ready - began, time.monotonic() - began

    def _is_naming_back(self) -> bool:
        try:
            self.at.orb.check_naming()
        except NotReachable:
            return False
        return True

    def _all_got(self) -> dict[tuple[str, str], list[int]]:
        return {
            (name, origin): consumer.payloads(origin)
            for name, consumer in self.consumers.items()
            for origin in self.consumers
        }

    def _lost(self, said: dict[str, dict[int, float]]) -> list[tuple[str, str, int]]:
        """Consumer, origin and number of what did not come."""
        got = {way: set(numbers) for way, numbers in self._all_got().items()}
        return [(n, o, number) for (n, o) in got for number in said[o] if number not in got[n, o]]

    def _settle(self, said: dict[str, dict[int, float]]) -> None:
        """Until nothing is on its way: the last event has come everywhere, all links and proxies are empty."""

        def is_quiet() -> bool:
            for name, origin in self._all_got():
                got = self.consumers[name].payloads(origin)
                if said and (not got or got[-1] < max(said[origin])):
                    return False
            states = [self.at.channel(name).state() for name in self.consumers]
            accounts = [part.events for state in states for part in [*state.links, *state.proxies]]
            assert all(Counts.of(account).is_exact for account in accounts)
            return not any(account.queued for account in accounts)

        eventually(is_quiet, LIMIT_S, "quiet")

    def _delivered_to(self, victim: str) -> dict[str, int]:
        return {n: self.at.outgoing(n, victim).events.delivered for n in self._neighbours(victim)}

    @staticmethod
    def _neighbours(victim: str) -> list[str]:
        return [pair.replace(victim, "") for pair in LINKS if victim in pair]

    def _died_with(
        self,
        victim: str,
        before: dict[str, int],
        taken: dict[str, list[Any]],
        lost: list[tuple[str, str, int]],
    ) -> int:
        """How many copies the killed process had taken over and not passed on. What it took over: a neighbour's
        delivered, less what the new process received; and what its own supplier was told. What it passed on to its
        consumer and to the other neighbour: what came there until it was gone."""
        took = {
            neighbour: delivered - before[neighbour] - self.at.incoming(victim, neighbour).events.received
            for neighbour, delivered in self._delivered_to(victim).items()
        }
        missing = 0
        # Toward its own consumer: what came from other channels.
        missing += sum(took.values()) - sum(event.origin != victim and event.type == "t" for event in taken[victim])
        # Toward the far side of each neighbour, at every consumer there.
        for neighbour, count in took.items():
            for there in self.consumers:
                if there != victim and not self._is_behind(there, neighbour, victim):
                    origins = [o for o in self.consumers if o != victim and self._is_behind(o, neighbour, victim)]
                    missing += count - sum(event.origin in origins and event.type == "t" for event in taken[there])
        # What its own supplier was told that it took, and that stayed in it.
        missing += sum(origin == victim for _, origin, _ in lost)
        return missing

    @staticmethod
    def _is_behind(name: str, neighbour: str, victim: str) -> bool:
        """Whether a channel lies on that neighbour's side of the victim in the chain."""
        return name == neighbour or (name < neighbour < victim) or (victim < neighbour < name)
