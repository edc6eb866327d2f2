"""What clients open and may forget: it ends when it has been idle for too long, or makes room for others."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Generic, TypeVar

from robocorba.errors.maps import TooManyTransactions


class Opened:
    """Something that a client has opened: open until its client closes it or it has been idle for too long."""

    used_at = 0.0
    is_open = True

    def end(self) -> None:
        """Close it. A client may keep the closed object."""
        self.is_open = False


AnyOpened = TypeVar("AnyOpened", bound=Opened)


class OpenedByClients(Generic[AnyOpened]):
    """All of a kind that clients have opened. The lock of its owner is held in each call.

    clock: returns the time [s]. timeout_s: after which an idle one ends. forgotten_s: after which an idle one ends if
    another client needs its place."""

    def __init__(self, clock: Callable[[], float], timeout_s: float, forgotten_s: float) -> None:
        self._clock, self._timeout_s, self._forgotten_s = clock, timeout_s, forgotten_s
        self.all: set[AnyOpened] = set()

    def add(self, opened: AnyOpened) -> None:
        """One was opened."""
        opened.used_at = self._clock()
        self.all.add(opened)

    def use(self, opened: AnyOpened) -> bool:
        """Start the timeout of one again, after all that have timed out were closed; false if it is closed."""
        self.end_idle()
        opened.used_at = self._clock()
        return opened.is_open

    def close(self, opened: AnyOpened) -> None:
        """Close one."""
        self.all.discard(opened)
        opened.end()

    def timed_out(self) -> list[AnyOpened]:
        """Those that have been idle for too long."""
        return self._idle_for(self._timeout_s)

    def forgotten(self) -> list[AnyOpened]:
        """Those that may be closed if another client needs their place."""
        return self._idle_for(self._forgotten_s)

    def end_idle(self) -> None:
        """Close those that have timed out."""
        for each in self.timed_out():
            self.close(each)

    def make_place(self, group: Collection[AnyOpened], limit: int) -> None:
        """Close the one of a full group that has been idle for longest. limit: of the group.

        Raises TooManyTransactions if it is not forgotten."""
        longest = min(group, key=lambda each: each.used_at)
        if longest not in self.forgotten():
            raise TooManyTransactions(limit)
        self.close(longest)

    def _idle_for(self, time_s: float) -> list[AnyOpened]:
        oldest = self._clock() - time_s
        return [each for each in self.all if each.used_at <= oldest]
