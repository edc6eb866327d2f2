"""A crowd for viewers: robots that wander on one floor, some with lasers and arms, and the simulation's clock."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from bench.common.harness import System, sampled, system
from bench.simulation.robots_client import Clients
from testkit.generated_buildings import office
from testkit.generated_buildings import robots as robots_in
from testkit.json_process import Cpu

FLOOR = "L1"
#: Robots that scan and move their arms.
SENSING = 8
#: Rate of commands, scans and postures of each robot [1/s].
RATE = 10.0
#: Interval at which simulated time is sampled [s].
SAMPLE_S = 0.02


class Crowd(NamedTuple):
    """samples: when the simulation reached which simulated time [s]."""

    place: System
    samples: list[tuple[float, float]]

    def at(self, simulated: Sequence[float]) -> np.ndarray:
        """POSIX times of simulated times [s]."""
        monotonic, times = np.array(self.samples).T
        return np.interp(simulated, times, monotonic) + time.time() - time.monotonic()

    def measured(self, seconds: float, *pids: int) -> dict[str, float]:
        """Simulated seconds per second, and busy cores of processes, from now on for this time [s]."""
        since, cpu = len(self.samples) - 1, Cpu(pids)
        time.sleep(seconds)
        (began, first), (ended, last) = self.samples[since], self.samples[-1]
        return {"pace": (last - first) / (ended - began), "cores": sum(cpu.spent_s()) / seconds}


@contextlib.contextmanager
def crowded_system(count: int, *options: str) -> Iterator[Crowd]:
    """Servers, started with these options of `robocorba up`, beside `count` driving robots."""
    building = office()
    crowd = [about for about in robots_in(building, 6 * count) if about.pose.floor == FLOOR][:count]
    ended = threading.Event()
    with (
        system(*options, building=building) as place,
        Clients(place.orb.naming, 1) as clients,
        ThreadPoolExecutor(1) as driver,
    ):
        server = place.resolve("SimulationServer")
        clients.log_on(crowd, count, SENSING)

        def drive() -> None:
            while not ended.is_set():
                clients.all("drive", time.monotonic(), 5.0, RATE, 4)

        with sampled(lambda: float(server._get_state().time), SAMPLE_S) as samples:
            driving = driver.submit(drive)
            try:
                yield Crowd(place, samples)
            finally:
                ended.set()
                driving.result()
