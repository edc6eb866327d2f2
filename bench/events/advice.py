"""Is `robocorba events advise` right? python -m bench.events.advice [--quick]; it needs root.

On each of six networks it measures the federation and a central channel in each sub-network, and asks for advice while
the federation works. "keep" is right if the federation is faster than every central channel, "as good" if it takes as
long within the band of the advice, a central channel if that one is faster."""

from __future__ import annotations

import contextlib
import json
import random
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from bench.common.harness import NotMeasured, folder_of_bench, progress, run
from bench.events.network.experiment import FEDERATED, START_LIMIT_S
from bench.events.network.networks import Link, Network
from bench.events.network.report import Interval, ratio
from robocorba.events.advice import AS_GOOD
from robocorba.system.supervision.launch import module_command
from testkit.json_process import Process, checkout_command
from testkit.report import at_least, summarize

#: The hosts of each sub-network: of its channels, and of its robots.
HOSTS = {
    "I": ("192.168.0.2", "192.168.0.3"),
    "II": ("192.168.8.2", "192.168.8.3"),
    "III": ("192.168.16.2", "192.168.16.3"),
}
NAMING = f"{HOSTS['I'][0]}:28090"
CHANNEL_PORTS = {FEDERATED: 28091, "central": 28092}
#: Time for which the robots exchange events before a run counts [s]; duration of the advice's measurement [s].
WARM_UP_S, ADVICE_S = 0.3, 6.0


class Case(NamedTuple):
    """A network. local: share of the events for the own sub-network; the others get equal parts of the rest.
    far_ms: one-way delay to and from single sub-networks, added to that of all links."""

    name: str
    delay_ms: float
    local: float
    subnets: Sequence[str] = ("I", "II")
    far_ms: Mapping[str, float] = {}


CASES = (
    Case("0 ms, 80 % local", 0.0, 0.8),
    Case("0 ms, 10 % local", 0.0, 0.1),
    Case("0.2 ms, 80 % local", 0.2, 0.8),
    Case("1 ms, 80 % local", 1.0, 0.8),
    Case("5 ms, 10 % local", 5.0, 0.1),
    Case("three: 0.7, 2.2 and 2.7 ms, 50 % local", 0.2, 0.5, ("I", "II", "III"), {"II": 0.5, "III": 2.0}),
)


class Measured(NamedTuple):
    """ms: the mean latency of each run, by set-up: FEDERATED, or the place of a central channel."""

    case: Case
    ms: Mapping[str, Sequence[float]]
    advice: Mapping[str, Any]

    def ratio_to(self, place: str) -> Interval:
        """The federation's latency to that of a central channel."""
        return ratio(np.array(self.ms[FEDERATED]), np.array(self.ms[place]))

    @property
    def best(self) -> str:
        """The place of the fastest central channel."""
        return min(self.case.subnets, key=lambda place: float(np.mean(self.ms[place])))

    @property
    def is_right(self) -> bool:
        measured = self.ratio_to(self.best).value
        if self.advice["verdict"] == "change":
            place = str(self.advice["best"]).rpartition("-")[2]
            return place in self.case.subnets and self.ratio_to(place).value > 1.0
        return measured < 1.0 if self.advice["verdict"] == "keep" else abs(measured - 1.0) <= AS_GOOD

    def row(self) -> dict[str, Any]:
        return {
            "network": self.case.name,
            "federated, ms": float(np.mean(self.ms[FEDERATED])),
            "best central, ms": float(np.mean(self.ms[self.best])),
            "in": self.best,
            "ratio (95 %)": str(self.ratio_to(self.best)),
            "advised": self.advice["verdict"],
            "predicted ratio": self.advice["ratio"],
            "right": self.is_right,
            "sentence": self.advice["sentence"],
        }


class Experiment:
    """Robots in three sub-networks on `network`."""

    def __init__(self, network: Network, robots: Mapping[str, Process]) -> None:
        self._network, self._robots, self._number = network, robots, 0

    def measure(self, case: Case, runs: int, run_s: float) -> Measured:
        """All set-ups in random order; then the federation again, and the advice."""
        far_us = {HOSTS[name][0].rpartition(".")[0]: 1000 * ms for name, ms in case.far_ms.items()}
        self._network.change(Link(case.name, delay_us=1000 * case.delay_ms), far_us=far_us)
        ms: dict[str, list[float]] = {set_up: [] for set_up in (FEDERATED, *case.subnets)}
        for set_up in random.Random(7).sample([*ms] * runs, len(ms) * runs):
            with self._playing(case, set_up) as latencies_ms:
                time.sleep(WARM_UP_S + run_s)
            ms[set_up].append(float(np.mean(latencies_ms)))
        rooms = [f"room-{name}" for name in case.subnets]
        ask = ("robocorba", "events", "advise", *rooms, "--seconds", str(ADVICE_S), "--json", "--naming", NAMING)
        with self._playing(case, FEDERATED):
            command = self._network.hosts["I"].command(*module_command(*ask))
            answer = subprocess.run(command, capture_output=True, text=True, timeout=START_LIMIT_S)
        if answer.returncode:
            raise NotMeasured(f"robocorba events advise: {answer.stderr}")
        return Measured(case, ms, json.loads(answer.stdout))

    @contextlib.contextmanager
    def _playing(self, case: Case, set_up: str) -> Iterator[list[float]]:
        """Exchange events; afterwards the latencies of all are in what was yielded. Raises NotMeasured."""
        self._number += 1
        others = len(case.subnets) - 1
        for name in case.subnets:
            shares = {other: case.local if other == name else (1 - case.local) / others for other in case.subnets}
            self._robots[name].ask({"do": "start", "number": self._number, "set_up": set_up, "shares": shares})
        latencies_ms: list[float] = []
        yield latencies_ms
        sent = [self._robots[name].ask({"do": "stop"}) for name in case.subnets]
        for name in case.subnets:
            expect = sum(one.get(name, 0) for one in sent)
            received = self._robots[name].ask(
                {"do": "collect", "number": self._number, "expect": expect}, START_LIMIT_S
            )
            if len(received) != expect:
                raise NotMeasured(f"{expect - len(received)} events were lost: {case.name}, {set_up}")
            latencies_ms += received


@contextlib.contextmanager
def experiment() -> Iterator[Experiment]:
    """Start all hosts and processes. Raises OSError without the right to create namespaces."""
    addresses = {
        f"{name}{at}": address for name, both in HOSTS.items() for at, address in zip(("", "r"), both, strict=True)
    }
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(folder_of_bench())
        network = stack.enter_context(Network(folder, (), addresses))
        network.start_naming("I", NAMING)
        for host in HOSTS:
            for of, port in CHANNEL_PORTS.items():
                peers = [f"--peer=room-{peer}" for peer in HOSTS if of == FEDERATED and peer < host]
                address, name = f"{HOSTS[host][0]}:{port}", f"{'room' if of == FEDERATED else of}-{host}"
                stack.enter_context(network.start_channel(host, name, address, NAMING, *peers))
        robots = {}
        for host in HOSTS:
            settings = {"name": host, "naming": NAMING, "endpoint": f"{HOSTS[host][1]}:28093"}
            channels = {FEDERATED: f"room-{host}", **{place: f"central-{place}" for place in HOSTS}}
            more = {"channels": channels, "peers": [f"room-{peer}" for peer in HOSTS if peer != host]}
            program = checkout_command("bench.events.advice_robots", json.dumps({**settings, **more}))
            robots[host] = stack.enter_context(network.start(f"{host}r", f"robots-{host}", *program))
        for process in robots.values():
            process.receive(START_LIMIT_S)
        yield Experiment(network, robots)


def main(quick: bool = False) -> bool:
    """Raises NotMeasured without network namespaces."""
    try:
        with experiment() as running:
            extent = (3, 1.5) if quick else (6, 2.0)
            found = [running.measure(case, *extent) for case in progress(CASES, "networks", len(CASES))]
    except OSError as error:
        raise NotMeasured(f"network namespaces are not available ({error}); run it as root") from None
    rows = [one.row() for one in found]
    print(*(f"{row['network']}: {row['sentence']}" for row in rows), sep="\n")
    marks = [at_least("networks with the right advice", sum(one.is_right for one in found), len(found))]
    samples = {f"{one.case.name}, {set_up}": ms for one in found for set_up, ms in one.ms.items()}
    return summarize("event_advice", "Advice and truth", rows, marks, samples, "ms", list(rows[0])[:-1])


if __name__ == "__main__":
    run(main, quick="shorter runs")
