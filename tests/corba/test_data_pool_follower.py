"""A robot's data pool is followed closely only while somebody needs it."""

from __future__ import annotations

import contextlib
import itertools
import threading
from typing import Any

import pytest

from robocorba.corba.remote import data_pool
from robocorba.corba.remote.data_pool import PoolFollower
from robocorba.testing.processes import eventually
from tests.data_pool.places import Place


class NoOrb:
    """Nothing is called: the pool has a source of its own."""

    def __getattr__(self, name: str) -> Any:
        return lambda *arguments, **options: None


def test_a_reader_wakes_a_pool_that_rests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(data_pool, "REST_INTERVAL_S", 600.0)
    monkeypatch.setattr(data_pool, "ATTENTION_S", 0.0)
    monkeypatch.setattr(data_pool, "ATTEND_LIMIT_S", 60.0)
    place, follower = Place(), PoolFollower(NoOrb(), "L1", rests=lambda: True)  # type: ignore[arg-type]
    follower.pool = place.pool()
    with contextlib.closing(follower.start()):
        eventually(lambda: follower.pool.snapshot(), 60.0, "the first content")
        for _ in range(3):
            place.clock.now += 5.0
            assert follower.pool.lag_s >= 5.0
            follower.attend()
            assert follower.pool.lag_s == 0.0


def test_a_reader_waits_for_an_update_that_begins_after_it_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is under way has read before."""
    monkeypatch.setattr(data_pool, "REST_INTERVAL_S", 600.0)
    monkeypatch.setattr(data_pool, "ATTEND_LIMIT_S", 60.0)
    place, follower = Place(), PoolFollower(NoOrb(), "L1", rests=lambda: True)  # type: ignore[arg-type]
    follower.pool = place.pool()
    follow, begun = follower.pool.follow, itertools.count()
    have_read, may_end = [threading.Event() for _ in range(2)], [threading.Event() for _ in range(2)]

    def slow() -> None:
        number = min(next(begun), 1)
        follow()
        have_read[number].set()
        assert may_end[number].wait(60.0)

    monkeypatch.setattr(follower.pool, "follow", slow)
    with contextlib.closing(follower.start()):
        assert have_read[0].wait(60.0)
        place.clock.now += 5.0
        reader = threading.Thread(target=follower.attend)
        reader.start()
        eventually(lambda: not follower._is_resting, 60.0, "the reader's question")
        may_end[0].set()
        assert have_read[1].wait(60.0)
        assert reader.is_alive()
        may_end[1].set()
        reader.join(60.0)
        assert not reader.is_alive()
        assert follower.pool.lag_s == 0.0
