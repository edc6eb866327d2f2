"""A bench process with data pools, controlled by lines of JSON on its stdin.

python -m bench.robots.data_pool_client HOST:PORT

HOST:PORT is the naming service. The process prints a line when it is ready, and a line for each line on stdin; it ends
with its stdin. Times are of CLOCK_MONOTONIC, which processes of one machine share."""

from __future__ import annotations

import contextlib
import gc
import json
import sys
import threading
import time
import types
from collections.abc import Sequence
from typing import Any

import psutil
import shapely
from shapely.geometry.base import BaseGeometry

from robocorba.corba.orb import Orb
from robocorba.corba.remote.data_pool import PoolFollower
from robocorba.settings import Address
from robocorba.testing.report import timed_ms

LOAD_TIMEOUT_S = 30.0
#: Interval at which readers read the pool [s].
LOOK_S = 0.002
#: Types of objects that a pool references and does not own.
NOT_ITS_OWN = (types.ModuleType, type, types.FunctionType, types.BuiltinFunctionType, threading.Thread, Orb)


class Pools:
    """The pools of this process. All methods except `close` return the answer."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
        self._followers: list[PoolFollower] = []

    def follow(self, floors: Sequence[str]) -> dict[str, Any]:
        """Start a pool for each floor. uss: unique set size of the process [bytes], before and after."""
        before = uss()
        for floor in floors:
            self._followers.append(PoolFollower(self._orb, floor, "nobody").start())
        deadline = time.monotonic() + LOAD_TIMEOUT_S
        while not all(follower.pool.snapshot().is_known for follower in self._followers):
            if time.monotonic() > deadline:
                raise RuntimeError(self._followers[-1].pool.problem)
            time.sleep(0.01)
        return {"uss": [before, uss()]}

    def look(self, begin: float, seconds: float) -> dict[str, Any]:
        """Read the first pool from a time on.

        looks: time [s], the snapshot's simulation time [s], and the pool's own figure of its age [s]. moving: share of
        robots that moved in the last snapshot. cpu: share of a core that this process used."""
        pool, looks = self._followers[0].pool, []
        worked = time.process_time()
        while (now := time.monotonic()) < begin + seconds:
            if now >= begin:
                looks.append((round(now, 5), round(pool.snapshot().time, 5), round(pool.lag_s, 5)))
            time.sleep(LOOK_S)
        robots = pool.snapshot().robots
        moving = sum(abs(robot.vx) + abs(robot.vy) + abs(robot.turn) > 0.05 for robot in robots) / max(1, len(robots))
        return {"looks": looks, "moving": moving, "cpu": (time.process_time() - worked) / seconds}

    def go(self, floors: Sequence[str], begin: float, seconds: float, every_s: float) -> dict[str, Any]:
        """Switch the first pool to these floors in turn, every `every_s`. change: duration of each switch [ms]."""
        pool, took = self._followers[0].pool, []
        number = 0
        time.sleep(max(0.0, begin - time.monotonic()))
        while time.monotonic() < begin + seconds:
            number += 1
            is_known, ms = timed_ms(pool.change_floor, floors[number % len(floors)])
            snapshot = pool.snapshot()
            if not is_known or snapshot.floor != floors[number % len(floors)] or not snapshot.robots:
                raise RuntimeError(f"{snapshot.floor}: {pool.problem}")
            took.append(ms)
            time.sleep(every_s)
        return {"change": took}

    def go_home(self, floor: str) -> dict[str, Any]:
        """Switch the first pool to this floor."""
        self._followers[0].pool.change_floor(floor)
        return {}

    def memory(self) -> dict[str, Any]:
        """Stop following. bytes: memory of all pools. uss: unique set size of the process [bytes]."""
        self.close()  # otherwise a concurrent change counts objects twice
        return {"bytes": bytes_of([follower.pool for follower in self._followers]), "uss": uss()}

    def close(self) -> None:
        for follower in self._followers:
            follower.close()


def uss() -> int:
    """Unique set size of this process [bytes]."""
    gc.collect()
    return int(psutil.Process().memory_full_info().uss)


def bytes_of(roots: Sequence[Any]) -> int:
    """Memory of all objects that these own, each counted once; geometries count by their coordinates."""
    total, seen, waiting = 0, set(), list(roots)
    while waiting:
        one = waiting.pop()
        if id(one) in seen or isinstance(one, NOT_ITS_OWN):
            continue
        seen.add(id(one))
        total += sys.getsizeof(one)
        if isinstance(one, BaseGeometry):
            total += len(shapely.to_wkb(one))
        waiting += gc.get_referents(one)
        if type(one).__name__ == "ndarray" and one.dtype == object:
            waiting += one.tolist()
    return total


def main(naming: str) -> None:
    with Orb(Address.parse(naming)) as orb, contextlib.closing(Pools(orb)) as pools:
        methods = {name: getattr(pools, name) for name in ("follow", "look", "go", "go_home", "memory")}
        print("{}", flush=True)
        for line in sys.stdin:
            command = json.loads(line)
            print(json.dumps(methods[command.pop("do")](**command)), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
