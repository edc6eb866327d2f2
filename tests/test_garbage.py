"""Searches for cycles pause while somebody makes many objects, and go on afterwards."""

from __future__ import annotations

import gc
from contextlib import suppress

from robocorba import garbage
from robocorba.garbage import collections_paused


def test_searches_go_on_when_the_last_pause_ends() -> None:
    with collections_paused():
        with suppress(ValueError), collections_paused():
            raise ValueError
        assert not gc.isenabled()
    assert gc.isenabled()


def test_what_was_made_meanwhile_is_not_searched_at_once() -> None:
    searched: list[str] = []
    gc.callbacks.append(lambda phase, about: searched.append(phase))
    frozen = gc.get_freeze_count()
    try:
        with collections_paused():
            made: list[list[int]] = [[] for _ in range(garbage.MANY + 1000)]
            assert searched == []
        more: list[list[int]] = [[] for _ in range(100)]
        assert searched == []
        assert gc.get_freeze_count() - frozen > garbage.MANY
        del made, more
    finally:
        gc.callbacks.pop()
        gc.unfreeze()
