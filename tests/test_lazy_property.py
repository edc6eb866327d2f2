"""Properties that are computed at their first access, without a lock."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from robocorba.lazy_property import lazy_property

#: Time limit of threads that wait for each other [s].
LIMIT_S = 30.0


class Thing:
    def __init__(self, compute: Callable[[], object]) -> None:
        self._compute = compute

    @lazy_property
    def value(self) -> object:
        """What `compute` returns."""
        return self._compute()


def test_it_is_computed_once() -> None:
    first, second = Thing(object), Thing(object)
    assert first.value is first.value
    assert first.value is not second.value
    assert Thing.value.__doc__ == "What `compute` returns."


def test_instances_do_not_wait_for_each_other() -> None:
    """As they would with functools.cached_property of Python 3.10 and 3.11."""
    both_compute = threading.Barrier(2)
    with ThreadPoolExecutor(2) as threads:
        things = [Thing(lambda: both_compute.wait(LIMIT_S)) for _ in range(2)]
        assert sorted(threads.map(lambda thing: thing.value, things, timeout=LIMIT_S)) == [0, 1]


def test_threads_that_are_first_together_get_the_same_object() -> None:
    both_compute = threading.Barrier(2)

    def compute() -> object:
        both_compute.wait(LIMIT_S)
        return object()

    thing = Thing(compute)
    with ThreadPoolExecutor(2) as threads:
        first, second = threads.map(lambda _: thing.value, range(2), timeout=LIMIT_S)
    assert first is second is thing.value
