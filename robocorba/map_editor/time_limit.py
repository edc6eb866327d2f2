"""Time limits of long work in the map editor: its client stops waiting some time, and does not say so."""

from __future__ import annotations

import time
from collections.abc import Callable

from robocorba.errors.maps import TooSlow


def time_limit(what: str, limit_s: float = 50.0, clock: Callable[[], float] = time.monotonic) -> Callable[[], None]:
    """A check that raises TooSlow once `what`, such as "the topological map of L1", takes longer than the limit [s].

    The default is that of a topological map or a check of the building: our clients wait for 60 s, of which a call may
    wait for 8 s for others; so they receive the error."""
    deadline = clock() + limit_s

    def check() -> None:
        if clock() > deadline:
            raise TooSlow(what, limit_s)

    return check


def no_limit() -> None:
    """The check where there is no limit."""
