"""A robot's data pool is followed closely only while somebody needs it."""

from __future__ import annotations

import contextlib
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
