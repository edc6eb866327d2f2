"""Robots of a sub-network that publish events at random times: python -m bench.events.advice_robots SETTINGS

SETTINGS is JSON: name (of the sub-network), naming and endpoint (HOST:PORT), channels (names by set-up), peers (other
channels of the federation). Commands are lines of JSON on stdin, each answered by a line on stdout:
  {"do": "start", "number": N, "set_up": S, "shares": {"I": 0.8}}   publish, each event for a sub-network at random
  {"do": "stop"}                                                    stop; the number of events, by sub-network
  {"do": "collect", "number": N, "expect": M}                       wait for M events; latencies of those received [ms]
"""

from __future__ import annotations

import contextlib
import json
import random
import sys
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Mapping

from bench.events.network.experiment import FEDERATED
from robocorba.errors.services import NotReachable
from robocorba.events.corba.event_client import Event, EventClient
from robocorba.orb.orb import Orb
from robocorba.system.settings import Address
from testkit.json_process import answer_commands

ROBOTS = 2
#: Mean rate of the events of each robot [1/s].
RATE_HZ = 40.0
#: Timeout for the last events of a run [s].
LAST_EVENTS_S = 10.0


class Robots:
    """clients: by set-up. peers: the channels that must know the subscriptions of the federation. Raises
    NotReachable."""

    def __init__(self, name: str, clients: Mapping[str, EventClient], peers: list[str]) -> None:
        self._clients, self._stop, self._lock = clients, threading.Event(), threading.Lock()
        self._threads: list[threading.Thread] = []
        self._sent: Counter[str] = Counter()
        #: Latencies by run: a robot of another sub-network may begin one before this one does [ms].
        self._ms: defaultdict[int, list[float]] = defaultdict(list)
        for set_up, client in clients.items():
            subscription = client.subscribe(self._receive, f"to.{name}")
            if set_up == FEDERATED and not all(subscription.wait_in_force(peer, 30.0) for peer in peers):
                raise NotReachable(f"the channel of {name} is not linked with {', '.join(peers)}")

    def start(self, number: int, set_up: str, shares: Mapping[str, float]) -> None:
        """Publish through the channel of a set-up from now on."""
        self._sent.clear()
        self._stop.clear()
        arguments = (self._clients[set_up], number, shares)
        self._threads = [threading.Thread(target=self._publish, args=arguments) for _ in range(ROBOTS)]
        for thread in self._threads:
            thread.start()

    def stop(self) -> Mapping[str, int]:
        """Stop publishing; the number of events for each sub-network."""
        self._stop.set()
        for thread in self._threads:
            thread.join()
        return self._sent

    def collect(self, number: int, expect: int) -> list[float]:
        """Wait for the events of this run; their latencies [ms]."""
        deadline = time.monotonic() + LAST_EVENTS_S
        while len(self._ms[number]) < expect and time.monotonic() < deadline:
            time.sleep(0.002)
        return self._ms[number]

    def _publish(self, client: EventClient, number: int, shares: Mapping[str, float]) -> None:
        chance, due = random.Random(), time.monotonic()
        while not self._stop.wait(due - time.monotonic()):
            due = max(due + chance.expovariate(RATE_HZ), time.monotonic() - 1.0)
            (target,) = chance.choices([*shares], [*shares.values()])
            with self._lock:
                self._sent[target] += 1
            client.push(f"to.{target}", {"run": number, "made_ns": time.monotonic_ns()})

    def _receive(self, event: Event) -> None:
        came_ns = time.monotonic_ns()
        self._ms[event.payload["run"]].append((came_ns - event.payload["made_ns"]) / 1e6)


def main() -> None:
    settings = json.loads(sys.argv[1])
    endpoint = {"endPoint": f"giop:tcp:{settings['endpoint']}"}
    with Orb(Address.parse(settings["naming"]), options=endpoint) as orb, contextlib.ExitStack() as stack:
        clients = {
            set_up: stack.enter_context(EventClient(orb, channel, settings["name"], timeout_s=30.0))
            for set_up, channel in settings["channels"].items()
        }
        robots = Robots(settings["name"], clients, settings["peers"])
        answer_commands(robots.start, robots.stop, robots.collect)


if __name__ == "__main__":
    main()
