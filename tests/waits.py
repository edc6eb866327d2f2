"""The waits of tests for which there is no condition, by what they are for. All others are
`testkit.processes.eventually`; tests/test_structure.py sees to it."""

from __future__ import annotations

import asyncio
import dataclasses
import time
from collections.abc import Callable
from typing import TypeVar


def _slowness() -> float:
    """How many times as long as on an idle machine a thread takes to be woken, 1 to 5."""
    began, naps, nap_s = time.monotonic(), 40, 0.001
    for _ in range(naps):
        time.sleep(nap_s)
    return min(5.0, max(1.0, (time.monotonic() - began) / (naps * nap_s * 1.5)))


#: Of this machine when the tests began.
SLOWNESS = _slowness()
Policy = TypeVar("Policy")


def patient(policy: Policy) -> Policy:
    """A policy of a test, its timeouts longer on a slow machine. policy: a dataclass."""
    names = [field.name for field in dataclasses.fields(policy) if field.name.endswith("timeout_s")]  # type: ignore[arg-type]
    return dataclasses.replace(policy, **{name: SLOWNESS * getattr(policy, name) for name in names})  # type: ignore[type-var]


def pause(seconds: float) -> None:
    """Between two calls or measurements of a test [s]: how far they are apart is what it tries."""
    time.sleep(seconds)


def work_for(seconds: float) -> None:
    """A callee that takes its time [s], as the test wants it to."""
    time.sleep(seconds)


def outlast(limit_s: float) -> None:
    """Until a time limit of the product has passed for certain: an expiry, a lease, an interval [s]."""
    time.sleep(1.1 * limit_s + 0.01)


def head_start(seconds: float = 0.1) -> None:
    """For a call to another process that another thread has begun: it usually waits there then [s]. The test passes,
    and tries less, where it does not."""
    time.sleep(seconds)


def stays(condition: Callable[[], object], for_s: float = 0.1) -> None:
    """Fails the test unless a condition holds now and for a while [s], in which what must not come usually would."""
    until = time.monotonic() + for_s
    while True:
        is_last = time.monotonic() >= until
        assert condition()
        if is_last:
            return
        time.sleep(min(0.02, for_s))


async def until(condition: Callable[[], object]) -> None:
    """Until a condition holds, in an event loop that goes on meanwhile."""

    async def poll() -> None:
        while not condition():
            await asyncio.sleep(0.005)

    await asyncio.wait_for(poll(), 60.0)
