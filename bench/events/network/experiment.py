"""The experiment: both set-ups on one network, with their runs in random order.

Standard: all robots on one channel on the server computer, in sub-network II. Federated: a channel in each sub-network,
linked with each other. All channels are the same program. Both set-ups run all the time; a run uses one of them.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from bench.events.network import mission
from bench.events.network.load import Core
from bench.events.network.networks import SUBNET_OF, Network, address
from robocorba.system.supervision.launch import module_command
from robocorba.system.supervision.system import find_omninames
from testkit.json_process import Process, checkout_command

STANDARD, FEDERATED = "standard", "federated"
SET_UPS = (STANDARD, FEDERATED)
#: The channel of the standard set-up, and those of the federation by sub-network.
CENTRAL, CHANNEL_OF = "central", {"I": "room-I", "II": "room-II"}
START_LIMIT_S = 60.0
#: Time from the command to the start of a run, and from there until events count [s].
HEAD_START_S, WARM_UP_S = 0.03, 0.2
#: Settling time after a change of the load, and of the delay [s].
SETTLE_LOAD_S, SETTLE_DELAY_S = 1.0, 0.2
SILENCE_S = 2.0


class Plan(NamedTuple):
    """Extent of the measurement: `runs` of `run_s` for every set-up, load (share) and one-way delay."""

    delays_us: Sequence[int]
    loads: Sequence[float]
    runs: int
    run_s: float

    @property
    def total(self) -> int:
        return len(self.delays_us) * len(self.loads) * len(SET_UPS) * self.runs


FULL = Plan((0, 200, 1000, 5000), tuple(load / 10 for load in range(10)), 10, 1.3)
QUICK = Plan((0, 1000), (0.0, 0.3, 0.6, 0.9), 4, 1.3)


class Outcome(NamedTuple):
    """One run. Latencies of the mission's events [us]; local: supplier and consumer are in the same sub-network."""

    set_up: str
    delay_us: int
    load: float
    busy: float
    local_us: np.ndarray
    remote_us: np.ndarray
    lost: int
    packets: int
    bytes: int
    #: Events and bytes that the gateways received, and events that were not sent to them.
    forwarded: int
    forwarded_bytes: int
    unseen: int
    #: Events that were sent, and those of them that a robot in the other sub-network subscribed to.
    sent: int
    wanted_across: int

    @property
    def all_us(self) -> np.ndarray:
        return np.concatenate([self.local_us, self.remote_us])


class Experiment:
    """Both set-ups, running on `network`."""

    def __init__(self, network: Network, robots: Mapping[str, Process], load: Process, leaders_core: int) -> None:
        self._network, self._robots, self._load = network, robots, load
        self._core = Core(leaders_core)
        self._number = 0
        self._delay_us, self._wanted = 0, 0.0

    def set_delay(self, delay_us: int) -> None:
        """Set the one-way delay of packets between the sub-networks."""
        self._delay_us = delay_us
        self._network.counts(delay_us=delay_us)
        time.sleep(SETTLE_DELAY_S)

    def set_load(self, share: float) -> None:
        """Set the load of the leader's core."""
        self._wanted = share
        self._load.ask(share)
        time.sleep(SETTLE_LOAD_S)

    def run(self, set_up: str, run_s: float) -> Outcome:
        """Run the mission once, measured for `run_s`. Raises ProcessFailed."""
        self._number += 1
        link, forwarded_before = self._network.counts(), self._forwarded(set_up)
        begin = time.monotonic() + HEAD_START_S
        count_from = begin + WARM_UP_S
        end = count_from + run_s
        run = {"number": self._number, "set_up": set_up, "begin": begin, "count_from": count_from, "end": end}
        self._ask_all({"do": "prepare", **run})
        for robot in self._robots.values():
            robot.send({"do": "play"})
        time.sleep(max(0.0, count_from - time.monotonic()))
        self._core.busy()
        time.sleep(max(0.0, end - time.monotonic()))
        busy = self._core.busy()
        for robot in self._robots.values():
            robot.receive(START_LIMIT_S)
        sent = [mission.Sent(*one) for answer in self._ask_all({"do": "sent"}).values() for one in answer]
        wanted = {name: mission.expected(name, sent) for name in self._robots}
        received = {
            name: robot.ask({"do": "collect", "expect": wanted[name]}, START_LIMIT_S)
            for name, robot in self._robots.items()
        }
        crossed = self._network.counts().since(link)
        forwarded = [now - then for now, then in zip(self._forwarded(set_up), forwarded_before, strict=True)]
        latencies: dict[bool, list[float]] = {True: [], False: []}
        for name, answer in received.items():
            for type, source, latency_us in answer["latencies"]:
                if mission.is_mission(type):
                    latencies[SUBNET_OF[source] == SUBNET_OF[name]].append(latency_us)
        return Outcome(
            set_up,
            self._delay_us,
            self._wanted,
            busy,
            np.array(latencies[True]),
            np.array(latencies[False]),
            sum(wanted[name] - answer["received"] for name, answer in received.items()),
            *crossed,
            forwarded[0],
            forwarded[1],
            forwarded[2],
            sum(one.number for one in sent),
            sum(one.number for one in sent if _is_wanted_across(one)),
        )

    def _forwarded(self, set_up: str) -> tuple[int, int, int]:
        """Events and bytes that the federation's gateways received so far, and events that were not sent to them."""
        if set_up != FEDERATED:
            return (0, 0, 0)
        links = [link for robot in ("A", "C") for link in self._robots[robot].ask({"do": "links", "set_up": set_up})]
        events, size, unseen = (sum(link[key] for link in links) for key in ("came", "came_bytes", "unseen"))
        return events, size, unseen

    def _ask_all(self, command: Mapping[str, Any]) -> dict[str, Any]:
        return {name: robot.ask(command) for name, robot in self._robots.items()}


def _is_wanted_across(one: mission.Sent) -> bool:
    return any(mission.expected(robot, [one]) for robot in mission.ROBOTS if SUBNET_OF[robot] != SUBNET_OF[one.source])


@contextlib.contextmanager
def experiment(network: Network, leaders_core: int) -> Iterator[Experiment]:
    """Start all processes: the leader on its own core, the others on the network's cores. Raises ProcessFailed."""
    naming = address("server", "naming")
    with contextlib.ExitStack() as stack:

        def channel(host: str, of: str, name: str, *more: str) -> None:
            common = ("--state", str(network.folder / name), "--endpoint", address(host, of), "--naming", naming)
            command = (*module_command("robocorba.servers.event_channel"), *common, "--name", name, *more)
            stack.enter_context(network.start(host, name, *command))

        data = network.folder / "naming"
        data.mkdir()
        own = ("-start", naming.rsplit(":", 1)[1], "-always", "-nohostname", "-datadir", str(data))
        command = (find_omninames(), *own, "-ORBendPoint", f"giop:tcp:{naming}")
        stack.enter_context(network.start("server", "omniNames", *command))
        channel("server", "central", CENTRAL)
        channel("server", "channel", CHANNEL_OF["II"], "--peer", CHANNEL_OF["I"])
        channel("channel", "channel", CHANNEL_OF["I"], "--peer", CHANNEL_OF["II"])
        robots = {}
        for name in mission.ROBOTS:
            own_subnet, other = ("I", "II") if SUBNET_OF[name] == "I" else ("II", "I")
            settings = {
                "name": name,
                "naming": naming,
                "endpoint": address(name, "robot"),
                "channels": {STANDARD: CENTRAL, FEDERATED: CHANNEL_OF[own_subnet]},
                "peers": {FEDERATED: CHANNEL_OF[other]},
            }
            program = checkout_command("bench.events.network.robot", json.dumps(settings))
            on = (leaders_core,) if name == mission.LEADER else ()
            robots[name] = stack.enter_context(network.start(name, f"robot-{name}", *program, cores=on))
        working = checkout_command("bench.events.network.load", str(leaders_core))
        load = stack.enter_context(Process(working, network.folder / "load.log", (leaders_core,)))
        for process in (*robots.values(), load):
            process.receive(START_LIMIT_S)
        yield Experiment(network, robots, load, leaders_core)


def split_cores() -> tuple[int, list[int]]:
    """The leader's core, and the cores of all other processes; the same one on a machine with one core."""
    cores = sorted(os.sched_getaffinity(0))
    return cores[-1], cores[:-1] or cores


def conduct(experiment: Experiment, plan: Plan, seed: int = 7) -> Iterator[Outcome]:
    """All runs of a plan, with delays, loads and set-ups in random order."""
    chance = random.Random(seed)
    for delay_us in chance.sample(plan.delays_us, len(plan.delays_us)):
        experiment.set_delay(delay_us)
        for load in chance.sample(plan.loads, len(plan.loads)):
            experiment.set_load(load)
            for set_up in chance.sample(SET_UPS * plan.runs, len(SET_UPS) * plan.runs):
                yield experiment.run(set_up, plan.run_s)
