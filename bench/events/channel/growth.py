"""How a federation grows: full mesh, star, tree and ring as processes, and further in a simulation.

Each event goes from a random channel to another one. Costs of a local delivery and of a hop are those measured with two
channels, of an idle channel and a renewal those with two and ten; the simulation of the same events is compared with
what the others measure, then has up to 1,000 channels. In a mesh, one channel hangs at the end."""

from __future__ import annotations

import itertools
import random
import statistics
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
import psutil

from bench.common.harness import folder_of_bench
from bench.events.channel.simulated import Simulation, renewals_per_s
from robocorba.errors.services import NotReachable
from robocorba.events.corba.event_client import Event, EventClient
from robocorba.stubs import RoboCorba
from testkit.federation import Channels, channels
from testkit.json_process import Cpu
from testkit.processes import eventually
from testkit.report import PROGRESS, at_most, summarize

SIZES, SIMULATED = (2, 5, 10, 20, 30), (50, 100, 200, 500, 1000)
EVENTS, IDLE_S = 600, 10.0
#: The largest full mesh that is simulated: routes take a time that grows with the cube of the channels.
LARGEST_MESH = 100
RATE_HZ = 100.0
#: Timeout for links, and time before a measurement [s].
LINK_LIMIT_S, SETTLE_S = 300.0, 5.0
#: Maximum CPU of the largest idle mesh [% of a core], and time until all others show their links with a channel that
#: hangs as down [s], as docs/operations.md says.
MAX_CPU_PERCENT, MAX_NOTICE_S = 30.0, 3.5
#: How far simulated latencies and processor times may be from measured ones.
TOLERANCE = 0.15


def links_of(shape: str, count: int) -> list[tuple[int, int]]:
    """The links of a mesh, star, tree (of two branches each) or ring."""
    if shape == "mesh":
        return list(itertools.combinations(range(count), 2))
    chain = {(number, (number + 1) % count) for number in range(count)}
    parents = {"star": lambda number: 0, "tree": lambda number: (number - 1) // 2}
    pairs = chain if shape == "ring" else {(parents[shape](number), number) for number in range(1, count)}
    return sorted({(min(pair), max(pair)) for pair in pairs})


SHAPES = ("mesh", "star", "tree", "ring")


def events_of(names: Sequence[str], are_local: bool = False) -> list[tuple[float, str, str]]:
    """Random times [s], origins and targets: other channels, or the same one."""
    chance, at_s, result = random.Random(len(names)), 0.0, []
    for _ in range(EVENTS):
        at_s += chance.expovariate(RATE_HZ)
        origin, other = chance.sample(names, 2)
        result.append((at_s, origin, origin if are_local else other))
    return result


def measure(shape: str, count: int, are_local: bool = False) -> dict[str, Any]:
    """Channels as processes: latencies [ms], messages over links, CPU when idle [% of a core] and for each event [ms],
    memory of a channel [MiB]."""
    names = [f"c{number}" for number in range(count)]
    pairs = [(names[a], names[b]) for a, b in links_of(shape, count)]
    with folder_of_bench() as folder, channels(folder) as federation:
        for name in names:
            federation.spawn(name)
        for name in names:
            federation.wait_ready(name)
        for a, b in pairs:
            federation.channel(a).addPeer(RoboCorba.PeerAddress(b, "", False))
        eventually(lambda: federation.is_up(*pairs), LINK_LIMIT_S, "links")
        latencies_ms: list[float] = []

        def receive(event: Event) -> None:
            latencies_ms.append((time.monotonic() - event.payload) * 1e3)

        clients = {name: EventClient(federation.orb, name, name, timeout_s=LINK_LIMIT_S) for name in names}
        subscriptions = {name: client.subscribe(receive, f"to.{name}") for name, client in clients.items()}
        for name, peer in pairs:
            if not subscriptions[name].wait_in_force(peer, LINK_LIMIT_S):
                raise NotReachable(f"{name} is not linked with {peer}")
        time.sleep(SETTLE_S)
        cpu = Cpu([process.pid for process in federation.processes.values()])
        time.sleep(IDLE_S)
        idle = [spent_s / IDLE_S for spent_s in cpu.spent_s()]
        for origin, target in itertools.product(names, names):  # connections, and code that runs for the first time
            clients[origin].push(f"to.{target}", time.monotonic())
        eventually(lambda: len(latencies_ms) == count**2, LINK_LIMIT_S, "all events of the warm-up")
        before = _crossed(federation, names)
        latencies_ms.clear()
        cpu.spent_s()
        began = time.monotonic()
        for at_s, origin, target in events_of(names, are_local):
            time.sleep(max(0.0, began + at_s - time.monotonic()))
            clients[origin].push(f"to.{target}", time.monotonic())
        eventually(lambda: len(latencies_ms) == EVENTS, LINK_LIMIT_S, "all events")
        busy_s = sum(cpu.spent_s()) - sum(idle) * (time.monotonic() - began)
        pids = [process.pid for process in federation.processes.values()]
        memory = statistics.median(psutil.Process(pid).memory_info().rss / 2**20 for pid in pids)
        crossed = _crossed(federation, names) - before
        for client in clients.values():
            client.close()
        noticed_s = _noticed_s(federation, names) if shape == "mesh" else None
    return {
        "messages": crossed,
        **latencies(latencies_ms),
        **{"idle, % of a core": 100 * sum(idle), "idle, busiest": 100 * max(idle)},
        **{"CPU of an event, ms": 1e3 * busy_s / EVENTS, "MiB of one": memory, "noticed, s": noticed_s},
    }


def latencies(values_ms: Sequence[float]) -> dict[str, float]:
    """The columns of latencies."""
    median, p95 = np.quantile(values_ms, (0.5, 0.95))
    return {"median, ms": float(median), "mean, ms": float(np.mean(values_ms)), "p95, ms": float(p95)}


def _crossed(federation: Channels, names: Sequence[str]) -> int:
    """Copies of events that all links together have carried."""
    links = (one for name in names for one in federation.channel(name).state().links)
    return sum(one.events.received for one in links if one.direction == RoboCorba.OUTGOING)


def _noticed_s(federation: Channels, names: Sequence[str]) -> float:
    """Time from SIGSTOP of the last channel until all others show both directions of its link as down [s]."""
    victim, others = names[-1], set(names[:-1])
    with federation.stopped(victim):
        began = time.monotonic()
        while others:
            for name in list(others):
                states = [federation.outgoing(name, victim), federation.incoming(name, victim)]
                if all(state.condition == RoboCorba.DOWN for state in states):
                    others.remove(name)
            assert time.monotonic() < began + LINK_LIMIT_S, f"{victim} hangs, unnoticed by {sorted(others)}"
        return time.monotonic() - began


def growth(quick: bool) -> bool:
    """Whether every mark was reached."""
    local, remote = measure("mesh", 2, are_local=True), measure("mesh", 2)
    hop_ms = remote["median, ms"] - local["median, ms"]
    hop_cpu_ms = remote["CPU of an event, ms"] - local["CPU of an event, ms"]
    few, many = (one["idle, % of a core"] for one in (remote, measure("mesh", 10)))
    renewal_percent = (many - 5 * few) / (renewals_per_s([9] * 10) - 5 * renewals_per_s([1, 1]))
    own_percent = (few - renewal_percent * renewals_per_s([1, 1])) / 2
    rows, wrong, off = [], 0, {"median, ms": [0.0], "CPU of an event, ms": [0.0], "idle, % of a core": [0.0]}
    for shape, count in itertools.product(SHAPES, (*SIZES[: 3 if quick else None], *SIMULATED[: 2 if quick else None])):
        if shape == "mesh" and count > LARGEST_MESH:
            continue
        names, links = [f"c{number}" for number in range(count)], links_of(shape, count)
        simulation = Simulation(names, [(names[a], names[b]) for a, b in links], hop_ms / 1e3, hop_cpu_ms / 1e3)
        simulated_ms = 1e3 * np.array(simulation.run(events_of(names), local["median, ms"] / 1e3))
        degrees = Counter(itertools.chain.from_iterable(links))
        simulated = {
            **latencies(simulated_ms),
            "messages": simulation.messages,
            "renewals/s": renewals_per_s(degrees.values()),
            "CPU of an event, ms": local["CPU of an event, ms"] + hop_cpu_ms * simulation.messages / EVENTS,
            "idle, % of a core": own_percent * count + renewal_percent * renewals_per_s(degrees.values()),
            "idle, busiest": own_percent + renewal_percent * renewals_per_s([max(degrees.values())]),
        }
        about = {"shape": shape, "channels": count}
        rows.append({**about, "how": "simulated", **simulated, "messages an event": simulation.messages / EVENTS})
        if count in SIZES:
            measured = measure(shape, count)
            rows.append({**about, "how": "measured", **measured, "messages an event": measured["messages"] / EVENTS})
            wrong += measured["messages"] != simulation.messages
            for what, shares in off.items():
                shares.append(abs(simulated[what] / measured[what] - 1.0))
        PROGRESS.print(f"growth: {shape} of {count} channels")
    meshes = [row for row in rows if (row["shape"], row["how"]) == ("mesh", "measured")]
    marks = [
        at_most("CPU of the largest idle mesh, % of a core", meshes[-1]["idle, % of a core"], MAX_CPU_PERCENT),
        at_most("a channel that hangs is noticed by all, s", max(row["noticed, s"] for row in meshes), MAX_NOTICE_S),
    ]
    marks += [at_most("sums of messages that differ from the simulation", wrong, 0)]
    marks += [at_most(f"{what}: simulated to measured, off by", max(shares), TOLERANCE) for what, shares in off.items()]
    title = "Federations of several shapes; each event goes from one channel to another"
    return summarize("event_channel_growth", title, rows, marks)
