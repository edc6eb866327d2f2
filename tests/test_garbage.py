"""Searches for cycles pause while somebody makes many objects, and go on afterwards."""

from __future__ import annotations

import gc
from contextlib import suppress

from robocorba.garbage import collections_paused


def test_searches_go_on_when_the_last_pause_ends() -> None:
    with collections_paused():
        with suppress(ValueError), collections_paused():
            raise ValueError
        assert not gc.isenabled()
    assert gc.isenabled()


def test_nothing_is_searched_meanwhile_and_all_of_it_afterwards() -> None:
    searched: list[str] = []
    gc.callbacks.append(lambda phase, about: searched.append(phase))
    try:
        with collections_paused():
            made: list[list[object]] = [[] for _ in range(2000)]
            for each in made:
                each.append(each)
            assert searched == []
        del made, each
        assert gc.collect() >= 2000
    finally:
        gc.callbacks.pop()
