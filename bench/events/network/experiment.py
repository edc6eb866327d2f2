"""The experiment: all set-ups on one network, with their runs in random order.

Standard: all robots on one central channel, which is in sub-network I, in II, or with the servers. Federated: a channel
in I and one in II, linked with each other. All channels are the same program. All set-ups run all the time; a run uses
one of them.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import random
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from bench.events.network import mission
from bench.events.network.load import Core
from bench.events.network.networks import ADDRESS_OF, SUBNET_OF, Link, Network
from bench.events.network.robot import GRID, LEADERS, OWN_EVENTS, POLLING, PUSHED
from robocorba.system.supervision.launch import module_command
from testkit.json_process import Process, checkout_command

#: The set-ups: the federation, and a central channel by its host.
FEDERATED, PLACES = "federated", ("I", "II", "servers")
SET_UPS = (FEDERATED, *PLACES)
#: Ports of the servers; every robot has its own host.
PORTS = {"naming": 28090, "central": 28091, "room": 28092, "robot": 28093}
START_LIMIT_S = 60.0
#: Time from the command to the start of a run, and from there until events count [s].
HEAD_START_S, WARM_UP_S = 0.03, 0.2
#: Settling time after a change of the load or the link [s].
SETTLE_S = 1.0


class Case(NamedTuple):
    """Conditions of a run. leader: one of LEADERS; scans: a key of mission.SCANS; load of the leader's core (share)."""

    leader: str
    link: Link
    scans: str
    load: float


class Plan(NamedTuple):
    """Extent of the measurement: `runs` of `run_s` for every case and set-up."""

    cases: Sequence[Case]
    runs: int
    run_s: float = 0.9
    set_ups: Sequence[str] = SET_UPS

    @property
    def total(self) -> int:
        return len(self.cases) * len(self.set_ups) * self.runs


PAPER = Link("10BASE-T", mbit_s=10.0)
DELAYS = tuple(Link(f"{delay_ms:g} ms", delay_us=1000 * delay_ms) for delay_ms in (0.0, 0.2, 1.0, 5.0))
#: The load at which the paper gives its figures.
PAPER_LOAD = 0.6


def plan_of(network: str, leader: str, quick: bool) -> Plan:
    """The plan of the bench: with the leader PUSHED the paper's figure on its network, "paper", or with "delays"; with
    another one of LEADERS, or "all", the falling curve."""
    runs = 3 if quick else 10
    if leader != PUSHED:
        runs = min(runs, 8)  # the slower leaders also make runs longer
        loads = (0.3, 0.6, 0.9) if quick else (0.2, 0.4, 0.6, 0.8, 0.9)
        leaders = LEADERS if leader == "all" else (leader,)
        links = (PAPER,) if network == "paper" else DELAYS[:1]
        return Plan(_cases(leaders, links, ("A, B",), loads), runs, set_ups=(FEDERATED, "servers"))
    if network == "delays":
        loads = (0.0, 0.6) if quick else (0.0, 0.3, 0.6, 0.9)
        return Plan(_cases((PUSHED,), DELAYS[::2] if quick else DELAYS, ("A, B",), loads), runs)
    curve = _cases((PUSHED,), (PAPER,), ("A, B",), (0.0, 0.3, 0.6, 0.9) if quick else [n / 10 for n in range(10)])
    others = [scans for scans in mission.SCANS if scans != "A, B"]
    return Plan([*curve, *_cases((PUSHED,), (PAPER,), others, (PAPER_LOAD,))], runs)


def _cases(leaders: Sequence[str], links: Sequence[Link], scans: Sequence[str], loads: Sequence[float]) -> list[Case]:
    return [Case(*one) for one in itertools.product(leaders, links, scans, loads)]


class Outcome(NamedTuple):
    """One run. us: latencies of the mission's events [us] by supplier and consumer. packets, bytes: between
    sub-networks; dropped: packets that found a full queue."""

    case: Case
    set_up: str
    busy: float
    us: Mapping[tuple[str, str], Sequence[float]]
    lost: int
    packets: int
    bytes: int
    dropped: int
    #: Events that gateways received, and events that a robot in the other sub-network subscribed to.
    forwarded: int
    wanted_across: int

    def latencies_us(self, which: str = "all") -> np.ndarray:
        """Of "all" events; of those between robots of one sub-network ("local"), of two ("remote"); of those that the
        "leader" receives."""
        wanted = {
            "all": lambda supplier, consumer: True,
            "local": lambda supplier, consumer: SUBNET_OF[supplier] == SUBNET_OF[consumer],
            "remote": lambda supplier, consumer: SUBNET_OF[supplier] != SUBNET_OF[consumer],
            "leader": lambda supplier, consumer: consumer == mission.LEADER,
        }[which]
        return np.concatenate([some for pair, some in self.us.items() if wanted(*pair)])


class Experiment:
    """All set-ups, running on `network`. load: what loads the leader's core."""

    def __init__(self, network: Network, robots: Mapping[str, Process], load: Process, leaders_core: int) -> None:
        self._network, self._robots, self._load = network, robots, load
        self._core = Core(leaders_core)
        self._number = 0

    def prepare(self, case: Case) -> None:
        """Set the link, and the load of the leader's core."""
        self._network.change(case.link)
        self._load.ask({"do": "want", "share": case.load})
        time.sleep(SETTLE_S)

    def run(self, case: Case, set_up: str, run_s: float) -> Outcome:
        """Run the mission once, measured for `run_s`. Raises ProcessFailed."""
        self._number += 1
        link, forwarded = self._network.counts(), self._forwarded(set_up)
        begin = time.monotonic() + HEAD_START_S
        count_from = begin + WARM_UP_S
        end = count_from + run_s
        times = {"begin": begin, "count_from": count_from, "end": end}
        scan = mission.SCANS[case.scans]
        self._ask_all({"do": "prepare", "number": self._number, "set_up": set_up, "scan": scan, **times})
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
        latencies: dict[tuple[str, str], list[float]] = {}
        for name, answer in received.items():
            for type, source, latency_us in answer["latencies"]:
                if mission.is_mission(type):
                    latencies.setdefault((source, name), []).append(latency_us)
        return Outcome(
            case,
            set_up,
            busy,
            latencies,
            sum(wanted[name] - answer["received"] for name, answer in received.items()),
            *self._network.counts().since(link),
            self._forwarded(set_up) - forwarded,
            sum(one.number for one in sent if _is_wanted_across(one)),
        )

    def _forwarded(self, set_up: str) -> int:
        """Number of events that the gateways of a set-up received so far."""
        return sum(self._robots[robot].ask({"do": "links", "set_up": set_up}) for robot in ("A", "C"))

    def _ask_all(self, command: Mapping[str, Any]) -> dict[str, Any]:
        return {name: robot.ask(command) for name, robot in self._robots.items()}


def _is_wanted_across(one: mission.Sent) -> bool:
    return any(mission.expected(robot, [one]) for robot in mission.ROBOTS if SUBNET_OF[robot] != SUBNET_OF[one.source])


@contextlib.contextmanager
def experiment(network: Network, leaders_core: int, leader: str = PUSHED) -> Iterator[Experiment]:
    """Start all processes: the leader on its own core, the others on the network's cores. Raises ProcessFailed."""
    naming = _address("servers", "naming")
    with contextlib.ExitStack() as stack:
        folder = network.folder / leader
        folder.mkdir()

        def channel(host: str, of: str, *more: str) -> None:
            name = f"{of}-{host}"
            program = ("bench.events.network.timers",) if leader == GRID else ()
            common = ("--state", str(folder / name), "--endpoint", _address(host, of), "--naming", naming)
            command = (*program, "robocorba.servers.event_channel", *common, "--name", name, *more)
            run = checkout_command if program else module_command
            stack.enter_context(network.start(host, f"{leader}/{name}", *run(*command)))

        for place in PLACES:
            channel(place, "central")
        channel("I", "room", "--peer", "room-II")
        channel("II", "room", "--peer", "room-I")
        robots = {}
        for name in mission.ROBOTS:
            own_subnet, other = ("I", "II") if SUBNET_OF[name] == "I" else ("II", "I")
            channels = {FEDERATED: f"room-{own_subnet}", **{place: f"central-{place}" for place in PLACES}}
            settings = {
                **{"name": name, "naming": naming, "endpoint": _address(name, "robot"), "channels": channels},
                **{"peers": {FEDERATED: f"room-{other}"}, "leader": leader, "core": leaders_core},
            }
            program = checkout_command("bench.events.network.robot", json.dumps(settings))
            on = (leaders_core,) if name == mission.LEADER else ()
            robots[name] = stack.enter_context(network.start(name, f"{leader}/robot-{name}", *program, cores=on))
        working = checkout_command("bench.events.network.load", str(leaders_core))
        load = stack.enter_context(Process(working, folder / "load.log", (leaders_core,)))
        for process in (*robots.values(), load):
            process.receive(START_LIMIT_S)
        loads_itself = leader in (POLLING, OWN_EVENTS)
        yield Experiment(network, robots, robots[mission.LEADER] if loads_itself else load, leaders_core)


def _address(host: str, of: str) -> str:
    """HOST:PORT of a server (key of PORTS) on a host."""
    return f"{ADDRESS_OF[host]}:{PORTS[of]}"


def split_cores() -> tuple[int, list[int]]:
    """The leader's core, and the cores of all other processes; the same one on a machine with one core."""
    cores = sorted(os.sched_getaffinity(0))
    return cores[-1], cores[:-1] or cores


def conduct(network: Network, leaders_core: int, plan: Plan, seed: int = 7) -> Iterator[Outcome]:
    """All runs of a plan, with cases and set-ups in random order."""
    chance = random.Random(seed)
    network.start_naming("servers", _address("servers", "naming"))
    for leader in sorted({case.leader for case in plan.cases}):
        cases = [case for case in plan.cases if case.leader == leader]
        with experiment(network, leaders_core, leader) as running:
            for case in chance.sample(cases, len(cases)):
                running.prepare(case)
                for set_up in chance.sample([*plan.set_ups] * plan.runs, len(plan.set_ups) * plan.runs):
                    yield running.run(case, set_up, plan.run_s)
