"""A robot of the experiment, connected to the channels of all set-ups: python -m bench.events.network.robot SETTINGS

SETTINGS is JSON: name, naming and endpoint (HOST:PORT), channels and peers (names by set-up), leader (one of LEADERS),
core (of the leader). Commands are lines of JSON on stdin, each answered by a line on stdout:
  {"do": "prepare", ...}   a run, with the fields of Run
  {"do": "play"}           plays the mission until the end of that run
  {"do": "sent"}           events sent in that run: [type, source, count], ...
  {"do": "collect", ...}   waits for `expect` events; their number, and [type, source, latency in us], ...
  {"do": "links", ...}     events that gateways received over the links of its channel in a `set_up`
  {"do": "want", ...}      a leader that loads its own core: the `share` of it
"""

from __future__ import annotations

import contextlib
import gc
import json
import queue
import sys
import threading
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import msgpack

from bench.events.network import mission, timers
from bench.events.network.load import Core, Governor, start_turns
from robocorba.errors.services import NotReachable
from robocorba.events.corba import events
from robocorba.events.corba.event_client import Event, EventClient
from robocorba.events.subscription import checked
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.settings import Address
from testkit.json_process import answer_commands

#: Timeout for another robot, and for the last events of a run [s].
ANSWER_LIMIT_S = 10.0
#: How the leader receives, and what loads its core. The first is the usual one, the others are hypotheses about the
#: paper's falling curve:
PUSHED, POLLING, GRID, OWN_EVENTS = LEADERS = ("pushed", "polling", "grid", "own-events")
#: Work of a turn of a leader that polls once in a turn, such as to draw its 3D scene [s]: chosen so that its latency at
#: 60 % is about the paper's; results are the curve's form and the difference of the set-ups. Work for one event of a
#: leader whose own events are its load [s].
POLLING_WORK_S, EVENT_WORK_S = 0.013, 0.001
#: Pause between the polls of a leader with the timers of Windows XP [s], before it is rounded up.
GRID_PAUSE_S = 0.001


class Run(NamedTuple):
    """Times of a run: start, start of the measurement, end [s, time.monotonic]. scan: type of the scans, or ""."""

    number: int
    set_up: str
    scan: str
    begin: float
    count_from: float
    end: float


class Robot:
    """Publishes and receives events through `clients`, one for each set-up; one that polls is a pull consumer.

    Its subscriptions are in force at the peers, given by the set-up. Raises NotReachable."""

    def __init__(
        self, name: str, clients: Mapping[str, EventClient], peers: Mapping[str, str], polls: bool = False
    ) -> None:
        self.name = name
        self.clients = clients
        self._run = Run(-1, "", "", 0.0, 0.0, 0.0)
        self._sent: Counter[str] = Counter()
        self._lock = threading.Lock()
        self._received: list[tuple[str, str, int, bool]] = []
        self._inbox: queue.SimpleQueue[Event] = queue.SimpleQueue()
        patterns = mission.INTERESTS[name]
        self._polled = {set_up: pull_proxy(client.channel, patterns) for set_up, client in clients.items() if polls}
        for set_up, client in clients.items():
            subscription = client.subscribe(partial(self._receive, set_up), *patterns)
            if set_up in peers and not subscription.wait_in_force(peers[set_up], 30.0):
                raise NotReachable(f"the channel of {set_up} is not linked with {peers[set_up]}")
            if polls:  # the proxy that is polled has the same subscription
                subscription.end()

    # ---- a run ----

    def prepare(self, **run: Any) -> None:
        """Discard the events of the last run."""
        with self._lock:
            self._run, self._received = Run(**run), []
        self._sent.clear()
        while not self._inbox.empty():
            self._inbox.get()

    def play(self) -> None:
        """Play the mission until the end of the run."""
        time.sleep(max(0.0, self._run.begin - time.monotonic()))
        publishing = threading.Thread(target=self._publish_states)
        publishing.start()
        (self._lead if self.name == mission.LEADER else self._help)()
        publishing.join()

    def _lead(self) -> None:
        step, due = 0, self._run.begin
        while due < self._run.end:
            time.sleep(max(0.0, due - time.monotonic()))
            for helper in mission.HELPERS:
                self._publish(f"{mission.SUBPLAN}.{helper}", mission.subplan(helper, step))
            self._wait_for_all(mission.READY, step)
            self._publish(mission.GO, {"step": step})
            self._wait_for_all(mission.RESULT, step)
            step += 1
            due = max(due + 1 / mission.STEP_HZ, time.monotonic())
        self._publish(mission.DONE, {"steps": step})

    def _wait_for_all(self, type: str, step: int) -> None:
        """Wait for the answers of all helpers. Raises queue.Empty if one does not answer."""
        missing = {*mission.HELPERS}
        while missing:
            event = self._inbox.get(timeout=ANSWER_LIMIT_S)
            if event.type == type and event.payload["step"] == step:
                missing.discard(event.source)

    def _help(self) -> None:
        while (event := self._inbox.get(timeout=ANSWER_LIMIT_S)).type != mission.DONE:
            step = event.payload["step"]
            if event.type == mission.GO:
                self._publish(mission.RESULT, {"step": step, "done": True, "problem": ""})
            else:
                self._publish(mission.READY, {"step": step})

    def _publish_states(self) -> None:
        """Publish states and scans alternately, half a period apart; the robots have different phases."""
        scan = self._run.scan
        half = 0.5 / mission.STATE_HZ
        due = self._run.begin + mission.ROBOTS.index(self.name) / len(mission.ROBOTS) * half
        turn = 0
        while due < self._run.end:
            time.sleep(max(0.0, due - time.monotonic()))
            count, is_scan = divmod(turn, 2)
            if not is_scan:
                self._publish(mission.STATE, mission.state(self.name, count))
            elif scan:
                self._publish(scan, mission.scan(self.name, count))
            turn += 1
            due = max(due + half, time.monotonic() - half)

    # ---- what a leader does once in a turn ----

    def poll(self) -> None:
        """Pull all events that wait."""
        set_up = self._run.set_up
        while set_up:
            value, has_event = self._polled[set_up].try_pull()
            if not has_event:
                return
            one = value.value()
            header = one.header
            payload = msgpack.unpackb(one.payload)
            self._receive(set_up, Event(header.type, header.source, payload, header.time, header.origin, header.number))

    def publish_own(self) -> None:
        """During a run, publish an event that nobody subscribes to."""
        if self._run.begin < time.monotonic() < self._run.end:
            self._publish(mission.OWN, {"step": 0})

    # ---- events ----

    def _publish(self, type: str, content: dict[str, Any]) -> None:
        run = self._run
        with self._lock:
            self._sent[type] += 1
        content["run"] = run.number
        content["counts"] = time.monotonic() >= run.count_from
        client = self.clients[run.set_up]
        content["made_ns"] = time.monotonic_ns()
        client.push(type, content)

    def _receive(self, set_up: str, event: Event) -> None:
        came_ns = time.monotonic_ns()
        content = event.payload
        run = self._run
        if (content["run"], set_up) != (run.number, run.set_up):
            return
        with self._lock:
            self._received.append((event.type, event.source, came_ns - content["made_ns"], content["counts"]))
        if event.type.startswith("mission."):
            self._inbox.put(event)

    # ---- afterwards ----

    def sent(self) -> list[mission.Sent]:
        """Number of sent events of each type."""
        with self._lock:
            return [mission.Sent(type, self.name, count) for type, count in self._sent.items()]

    def collect(self, expect: int) -> dict[str, Any]:
        """Number of received events, and the latencies of those that count [us]."""
        deadline = time.monotonic() + ANSWER_LIMIT_S
        while len(self._received) < expect and time.monotonic() < deadline:
            time.sleep(0.002)
        with self._lock:
            received = self._received
        latencies = [[type, source, ns / 1e3] for type, source, ns, counts in received if counts]
        return {"received": len(received), "latencies": latencies}

    def links(self, set_up: str) -> int:
        """Number of events that a channel's gateways received."""
        links = self.clients[set_up].channel.state().links
        return sum(link.events.received + link.repeated for link in links if link.direction == RoboCorba.INCOMING)


def pull_proxy(channel: Any, patterns: Sequence[tuple[str, str]]) -> Any:
    """A connected proxy of a channel that is polled for the events with these patterns."""
    proxy = channel.for_consumers().obtain_pull_supplier()._narrow(RoboCorba.EventProxyPullSupplier)
    proxy.changeSubscription(events.subscription(checked([([pattern], 0.0) for pattern in patterns])))
    proxy.connect_pull_consumer(None)
    return proxy


def lead(robot: Robot, leader: str, governor: Governor, core: int) -> None:
    """Start what a leader does besides the mission, in a thread."""

    def poll_on_the_grid() -> None:
        while True:
            robot.poll()
            time.sleep(GRID_PAUSE_S)

    if leader == POLLING:
        start_turns(governor, Core(core), POLLING_WORK_S, robot.poll)
    elif leader == OWN_EVENTS:
        start_turns(governor, Core(core), EVENT_WORK_S, robot.publish_own)
    elif leader == GRID:
        threading.Thread(target=poll_on_the_grid, daemon=True).start()


def main() -> None:
    settings = json.loads(sys.argv[1])
    name, leader = settings["name"], settings["leader"]
    if leader == GRID:
        timers.use_grid()
    naming = Address.parse(settings["naming"])
    with Orb(naming, options={"endPoint": f"giop:tcp:{settings['endpoint']}"}) as orb, contextlib.ExitStack() as stack:
        clients = {
            set_up: stack.enter_context(EventClient(orb, channel, name, timeout_s=30.0))
            for set_up, channel in settings["channels"].items()
        }
        governor, leads = Governor(), name == mission.LEADER
        robot = Robot(name, clients, settings["peers"], leads and leader in (POLLING, GRID))
        if leads:
            lead(robot, leader, governor, settings["core"])
        gc.freeze()
        answer_commands(robot.prepare, robot.play, robot.sent, robot.collect, robot.links, governor.want)


if __name__ == "__main__":
    main()
