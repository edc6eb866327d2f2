"""What clients open and may forget: how long it has been idle, and which of it makes room for others."""

from __future__ import annotations

from collections.abc import Collection
from typing import TypeVar

from robocorba.errors.maps import TooManyTransactions


class Opened:
    """Something that a client has opened, open until its client closes it or it has been idle for too long.

    used_at: time of its last use [s]."""

    def __init__(self, now: float) -> None:
        self.used_at, self.is_open = now, True


AnyOpened = TypeVar("AnyOpened", bound=Opened)


def idle_since(group: Collection[AnyOpened], oldest: float) -> list[AnyOpened]:
    """Those that have not been used after the time `oldest` [s]."""
    return [each for each in group if each.used_at <= oldest]


def longest_idle(group: Collection[AnyOpened], limit: int, oldest: float) -> AnyOpened:
    """The member of a full group that has been idle for longest.

    limit: of the group, for the error. Raises TooManyTransactions if it was used after the time `oldest` [s]."""
    forgotten = min(group, key=lambda each: each.used_at)
    if forgotten.used_at > oldest:
        raise TooManyTransactions(limit)
    return forgotten
