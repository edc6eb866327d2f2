"""The processor cores that threads run on."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable

import pytest

from robocorba import cores


def in_a_thread(call: Callable[[], None]) -> None:
    """So that the threads of other tests keep their cores."""
    thread = threading.Thread(target=call)
    thread.start()
    thread.join()


@pytest.fixture(autouse=True)
def none_shared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cores, "_cores", None)


def test_a_thread_and_those_that_it_starts_share_a_core() -> None:
    found = []

    def share() -> None:
        cores.share_one()
        found.append(os.sched_getaffinity(0))
        in_a_thread(lambda: found.append(os.sched_getaffinity(0)))
        cores.share_one()
        found.append(os.sched_getaffinity(0))

    in_a_thread(share)
    assert [len(each) for each in found] == [1, 1, 1]
    assert found[0] == found[1] <= os.sched_getaffinity(0)


def test_a_thread_leaves_it() -> None:
    found = []

    def share() -> None:
        cores.share_one()
        found.append(cores.usable())
        cores.use_all()
        found.append(os.sched_getaffinity(0))

    in_a_thread(share)
    assert found == [os.sched_getaffinity(0)] * 2
    assert cores.usable() == os.sched_getaffinity(0)
