"""A process of a bench with data pools, told what to do by lines of JSON on its stdin.

python -m bench.robots.data_pool_client HOST:PORT

Its address is that of the naming service. It answers every line by one line on stdout, the first one when it can be
told something, and ends with its stdin. Times are of CLOCK_MONOTONIC, which processes of one machine share."""

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

LOAD_LIMIT_S = 30.0
#: Readers look at the pool so often, s.
LOOK_S = 0.002
#: What a pool holds of others, or shares with all of its process.
NOT_ITS_OWN = (types.ModuleType, type, types.FunctionType, types.BuiltinFunctionType, threading.Thread, Orb)


class Pools:
    """The pools of this process. All methods but `close` return what is answered."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
        self._followers: list[PoolFollower] = []

    def follow(self, floors: Sequence[str]) -> dict[str, Any]:
        """Begin pools, one for each of the floors. uss: bytes that are this process's alone, before and after."""
        before = uss()
        for floor in floors:
            self._followers.append(PoolFollower(self._orb, floor, "nobody").start())
        deadline = time.monotonic() + LOAD_LIMIT_S
        while not all(follower.pool.snapshot().is_known for follower in self._followers):
            if time.monotonic() > deadline:
                raise RuntimeError(self._followers[-1].pool.problem)
            time.sleep(0.01)
        return {"uss": [before, uss()]}

    def look(self, begin: float, seconds: float) -> dict[str, Any]:
        """What the first pool shows, from a time on.

        looks: when, s, the simulation's time in the snapshot, s, how old the pool says that is, s. moving: share of its
        robots that moved in the last one. cpu: share of a core that this process took."""
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
        """Let the first pool go to these floors in turn, so often; ms until it showed the new one."""
        pool, took = self._followers[0].pool, []
        number = 0
        time.sleep(max(0.0, begin - time.monotonic()))
        while time.monotonic() < begin + seconds:
            number += 1
            is_known, ms = timed_ms(pool.go_to, floors[number % len(floors)])
            snapshot = pool.snapshot()
            if not is_known or snapshot.floor != floors[number % len(floors)] or not snapshot.robots:
                raise RuntimeError(f"{snapshot.floor}: {pool.problem}")
            took.append(ms)
            time.sleep(every_s)
        return {"change": took}

    def go_home(self, floor: str) -> dict[str, Any]:
        """Let the first pool go there."""
        self._followers[0].pool.go_to(floor)
        return {}

    def memory(self) -> dict[str, Any]:
        """End all following. bytes: of all that the pools hold. uss: of the process."""
        self.close()  # else some of it is counted twice, before and after a change
        return {"bytes": bytes_of([follower.pool for follower in self._followers]), "uss": uss()}

    def close(self) -> None:
        for follower in self._followers:
            follower.close()


def uss() -> int:
    """Bytes that are this process's alone."""
    gc.collect()
    return int(psutil.Process().memory_full_info().uss)


def bytes_of(roots: Sequence[Any]) -> int:
    """Of all that can be reached from some objects and belongs to them, each once; geometries by their coordinates."""
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
        ways = {name: getattr(pools, name) for name in ("follow", "look", "go", "go_home", "memory")}
        print("{}", flush=True)
        for line in sys.stdin:
            command = json.loads(line)
            print(json.dumps(ways[command.pop("do")](**command)), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
