"""How far a carry is: the leader's rhythm, and each carrier's progress by the orders that it has received.

The carried body's trajectory time [s] is a function of the leader's clock only while orders come. Without them it
stands still, for the leader as for its members, and it goes on from there: a pause is no progress."""

from __future__ import annotations

import threading
from typing import NamedTuple

#: Without orders from the leader the body slows down from this time on [s] and stands after the other one [s]: orders
#: are due every 0.1 s, so it stands 0.3 s after the first missing one. From 0.25 m/s that takes the base's 1 m/s^2.
SLOWS_DOWN_AFTER_S, STANDS_AFTER_S = 0.15, 0.4
#: A carrier whose place differs from the ordered one moves there at this rate at most, relative to the planned
#: speed. More than 1, so that it catches up while the others go on; little more, since carries are planned for 1.
CATCH_UP_RATE = 1.25


class Rhythm(NamedTuple):
    """The trajectory time [s] at `since` of the leader's clock [s], and its rate from then on."""

    since: float = 0.0
    trajectory_s: float = 0.0
    rate: float = 0.0

    def at(self, now: float) -> float:
        return self.trajectory_s + self.rate * max(0.0, now - self.since)


class CarryProgress:
    """The trajectory time of a carrier. Times are by the leader's clock [s].

    It never jumps: it changes by CATCH_UP_RATE at most, whatever orders were lost. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        #: The rhythm in force, and the next one.
        self._now, self._next = Rhythm(), Rhythm()
        #: When the leader sent its latest order.
        self._last_sent = 0.0
        #: The latest trajectory time that was given out, and when; None before the first one.
        self._reached_s = 0.0
        self._reached_at: float | None = None

    def hold(self, trajectory_s: float = 0.0) -> None:
        """Stand at this trajectory time until the next orders: of another trajectory, or of a new leader, whose clock
        may differ."""
        with self._lock:
            self._now = self._next = Rhythm(0.0, trajectory_s, 0.0)
            self._last_sent = 0.0
            self._reached_s, self._reached_at = trajectory_s, None

    def follow(self, since: float, trajectory_s: float, rate: float, sent: float) -> None:
        """Take over an order that the leader sent at `sent`, which may be a moment to come by this robot's clock."""
        with self._lock:
            if self._reached_at is None:
                self._reach(sent)
            if since > self._next.since:
                stood_at = self._last_sent + STANDS_AFTER_S
                if sent > stood_at:  # orders were lost, one of them perhaps to stop
                    self._now = Rhythm(stood_at, self._ordered(stood_at)[0], 0.0)
                else:
                    self._now = self._next
                self._next = Rhythm(since, trajectory_s, rate)
            self._last_sent = max(self._last_sent, sent)

    def at(self, now: float) -> tuple[float, float]:
        """Trajectory time at `now` [s], and its rate, which falls to 0 without orders."""
        with self._lock:
            return self._reach(now)

    def ordered_s(self, now: float) -> float:
        """The trajectory time at `now` [s] if the latest order is still in force: where the others are as long as only
        this carrier receives none."""
        with self._lock:
            return self._rhythm(now).at(now)

    def _reach(self, now: float) -> tuple[float, float]:
        ordered_s, rate = self._ordered(now)
        if self._reached_at is None:
            self._reached_at = now
        most_s = CATCH_UP_RATE * max(0.0, now - self._reached_at)
        reached_s = min(max(ordered_s, self._reached_s - most_s), self._reached_s + most_s)
        self._reached_s, self._reached_at = reached_s, now
        if reached_s == ordered_s:
            return reached_s, rate
        return reached_s, CATCH_UP_RATE if reached_s < ordered_s else -CATCH_UP_RATE

    def _ordered(self, now: float) -> tuple[float, float]:
        """Trajectory time and rate by the latest orders, which standing carriers reach."""
        since, trajectory_s, rate = self._rhythm(now)
        moved_until_s, share = _coasting(now - self._last_sent)
        moved_since_s, _ = _coasting(since - self._last_sent)
        return trajectory_s + rate * max(0.0, moved_until_s - moved_since_s), rate * share

    def _rhythm(self, now: float) -> Rhythm:
        return self._next if now >= self._next.since else self._now


class LeaderRhythm:
    """The rhythm of a carry that a leader orders. Times are by its own clock [s].

    It begins at `since` with this rate. lead_s: time ahead of a change, for its order to reach all members.
    duration_s: of the trajectory."""

    def __init__(
        self, since: float, lead_s: float, duration_s: float, trajectory_s: float = 0.0, rate: float = 1.0
    ) -> None:
        self._latest = Rhythm(since, trajectory_s, rate)
        self._lead_s, self._duration_s = lead_s, duration_s
        #: When the latest order was sent; None before the first one.
        self._sent: float | None = None
        #: What a member does that receives every order.
        self._members = CarryProgress()
        self._members.hold(trajectory_s)

    def at(self, now: float) -> float:
        """The trajectory time [s] of members that have received every order."""
        return self._latest.trajectory_s if self._sent is None else self._members.at(now)[0]

    def set_rate(self, rate: float, now: float) -> bool:
        """Continue at this rate, from a time in the future that all members will know in advance. Returns whether it
        changes, so that an order is due."""
        if rate == self._latest.rate or now < self._latest.since:
            return False
        if self._stands(now):
            self._resume(rate, now)
        else:
            since = now + self._lead_s
            self._latest = Rhythm(since, min(self._duration_s, self._latest.at(since)), rate)
        return True

    def order(self, now: float) -> Rhythm:
        """What an order says that is sent now."""
        if self._stands(now):
            self._resume(self._latest.rate, now)
        return self._latest

    def note_sent(self, rhythm: Rhythm, now: float) -> None:
        """An order of this rhythm was accepted by the channel at `now`; one that was not moves nobody."""
        self._sent = now
        self._members.at(now)
        self._members.follow(*rhythm, sent=now)

    def _stands(self, now: float) -> bool:
        """Whether the members stand, since this leader was silent."""
        return self._sent is not None and now > self._sent + STANDS_AFTER_S

    def _resume(self, rate: float, now: float) -> None:
        """Go on from where the members stand: time has passed, but not in the carry."""
        self._latest = Rhythm(now + self._lead_s, self.at(now), rate)


def _coasting(silent_s: float) -> tuple[float, float]:
    """How far the trajectory time advances at full rate within `silent_s` of the last order [s], and the share of the
    rate that is left then."""
    if silent_s <= SLOWS_DOWN_AFTER_S:
        return silent_s, 1.0
    duration_s = STANDS_AFTER_S - SLOWS_DOWN_AFTER_S
    left = max(0.0, (STANDS_AFTER_S - silent_s) / duration_s)
    return SLOWS_DOWN_AFTER_S + duration_s * (1.0 - left * left) / 2.0, left
