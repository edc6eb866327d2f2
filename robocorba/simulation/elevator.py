"""An elevator: robots call it, drive in, ride and drive out, one session for each ride.

The call that has waited longest leads: the cabin fetches it, takes it to its floor, and then turns to the next. On the
way it stops for whoever goes the same way and still fits in. So nobody is passed over for good, and `longest_wait`
says for how long at most. A robot that does not come, or does not leave in time, loses its session: the doors close.

Robots that call as a party have the cabin for themselves. The party counts as one that called with its first: the
others may call as long as the doors are open for it, and these stay open until all of it are in, or the limit is over.
"""

from __future__ import annotations

import math
from collections.abc import Container
from enum import Enum
from typing import NamedTuple

from robocorba.errors.simulation import ElevatorFull, InvalidRide, NoRide
from robocorba.maps.model import Elevator
from robocorba.planning.elevators import travel_time, travelled
from robocorba.simulation.world_record import CabinRecord, RideRecord
from robocorba.spatial.elevator_state import Doors, ElevatorState

#: A robot has so long to drive in, and so long to drive out, while the doors are open, s.
BOARDING_LIMIT_S = 15.0
#: Nobody begins to drive in when the doors have been open for so long, s: others wait elsewhere.
OPEN_LIMIT_S = 2 * BOARDING_LIMIT_S
#: Robots that wait at most.
MOST_CALLS = 200
#: Characters of a party's name, at most.
MOST_PARTY_NAME = 200
_TOLERANCE_M = 1e-9


class Phase(Enum):
    """Of a ride."""

    WAITING = 0
    BOARDING = 1
    RIDING = 2
    ALIGHTING = 3


_INSIDE = (Phase.RIDING, Phase.ALIGHTING)


class RideSession:
    """A robot's ride; with `party`, that of `size` robots who ride together, if it is not empty."""

    def __init__(
        self,
        robot: str,
        origin: str,
        destination: str,
        radius_m: float,
        called_at: float,
        party: str = "",
        size: int = 1,
    ) -> None:
        self.robot, self.origin, self.destination = robot, origin, destination
        self.radius_m, self.called_at = radius_m, called_at
        self.party, self.size = party, size
        self.phase = Phase.WAITING
        self.since = called_at

    def enter_phase(self, phase: Phase, now: float) -> None:
        self.phase, self.since = phase, now


class RideStatus(NamedTuple):
    """A ride as its robot is told; `ahead`: robots that wait, and called before."""

    phase: Phase
    elevator: str
    origin: str
    destination: str
    ahead: int


class Cabin:
    """heights: of the floors that the elevator serves, m. It begins at the lowest, with its doors closed."""

    def __init__(self, elevator: Elevator, heights: dict[str, float], now: float = 0.0) -> None:
        self.elevator, self.heights = elevator, heights
        self.now = now
        self.doors = Doors.CLOSED
        self.floor = min(heights, key=lambda name: heights[name])
        #: Where it goes, empty where it stands.
        self._target = ""
        self._since = now
        #: When a party began to drive in.
        self._party_since = now
        self.sessions: dict[str, RideSession] = {}
        #: Of the sessions that ended before the robot was out: the robot, and why.
        self.ended: list[tuple[str, str]] = []

    # ---- what robots do ----

    def call(
        self, robot: str, origin: str, destination: str, radius_m: float, party: str = "", size: int = 1
    ) -> RideSession:
        """Reserve a ride, alone or in a party of so many. Raises InvalidRide, ElevatorFull."""
        for field, floor in (("origin", origin), ("destination", destination)):
            if floor not in self.heights:
                raise InvalidRide(field, f"{self.elevator.name} does not serve {floor}")
        if origin == destination:
            raise InvalidRide("destination", f"{destination} is where the ride begins")
        if robot in self.sessions:
            raise InvalidRide("robot", f"{robot} has called already")
        if not radius_m > 0.0 or not fits(self.elevator, [radius_m]):
            raise InvalidRide("radius", f"a robot of {radius_m} m does not fit into {self.elevator.name}")
        if party:
            self._check_party(party, size, origin, destination, radius_m)
        if len(self.sessions) >= MOST_CALLS:
            raise ElevatorFull(self.elevator.name, MOST_CALLS)
        session = RideSession(robot, origin, destination, radius_m, self.now, party, size if party else 1)
        self.sessions[robot] = session
        if party and self.doors is Doors.OPEN:
            self._start_alighting_and_boarding()
        return session

    def _check_party(self, party: str, size: int, origin: str, destination: str, radius_m: float) -> None:
        """Whether one more robot may ride with a party. Raises InvalidRide."""
        if len(party) > MOST_PARTY_NAME:
            raise InvalidRide("party", f"has {len(party)} characters, more than {MOST_PARTY_NAME}")
        if not 1 <= size <= MOST_CALLS:
            raise InvalidRide("partySize", f"{size} is not 1 to {MOST_CALLS}")
        others = self._party(party)
        radii = [radius_m] * (size - len(others)) + [other.radius_m for other in others]
        if radii and not fits(self.elevator, radii):
            raise InvalidRide("partySize", f"{size} robots of {max(radii):g} m don't fit into {self.elevator.name}")
        for other in others:
            if (other.origin, other.destination) != (origin, destination):
                raise InvalidRide("party", f"{party[:80]} rides from {other.origin} to {other.destination}")
            if other.size != size:
                raise InvalidRide("partySize", f"{size} is not {other.size}, which {other.robot} said")
        if len(others) >= size:
            raise InvalidRide("party", f"all {size} of {party[:80]} have called already")
        is_in_time = origin == self.floor and self._is_party_in_time()
        if any(other.phase in _INSIDE for other in others) and not is_in_time:
            raise InvalidRide("party", f"{party[:80]} has left already")

    def enter(self, robot: str) -> None:
        """It stands in the cabin. Raises NoRide where its doors are not open for it."""
        self._session(robot, Phase.BOARDING).enter_phase(Phase.RIDING, self.now)

    def leave(self, robot: str) -> None:
        """It is out, at its floor. Raises NoRide."""
        self._session(robot, Phase.ALIGHTING)
        del self.sessions[robot]

    def cancel(self, robot: str, reason: str = "") -> None:
        """End a robot's ride in whatever phase: it died, or thought better of it. Raises NoRide where it has none."""
        if robot not in self.sessions:
            raise NoRide(robot, self.elevator.name)
        del self.sessions[robot]
        if reason:
            self.ended.append((robot, reason))

    def _session(self, robot: str, phase: Phase) -> RideSession:
        session = self.sessions.get(robot)
        if session is None or session.phase is not phase:
            raise NoRide(robot, self.elevator.name)
        return session

    # ---- what is kept ----

    def record(self) -> CabinRecord:
        """To go on from."""
        rides = [
            RideRecord(s.robot, s.origin, s.destination, s.radius_m, s.called_at, s.phase in _INSIDE, s.party, s.size)
            for s in self.sessions.values()
        ]
        return CabinRecord(self.floor, rides)

    def restore(self, record: CabinRecord, now: float, robots: Container[str]) -> None:
        """Go on from a record, with the rides of these robots: the cabin stands, its doors are shut.

        They open at once for the rest of a party that has not left yet."""
        self.floor, self.now, self._since = record.floor, now, now
        for ride in record.rides:
            if ride.robot in robots and {ride.origin, ride.destination} <= self.heights.keys():
                about = (ride.robot, ride.origin, ride.destination, ride.radius_m, ride.called_at)
                session = self.sessions[ride.robot] = RideSession(*about, ride.party, ride.size)
                session.phase = Phase.RIDING if ride.inside else Phase.WAITING
        if any(self._is_incomplete(session) for session in self.sessions.values()):
            self._set_doors(Doors.OPENING)
            self._party_since = now + self.elevator.door_time

    # ---- time ----

    def advance(self, seconds: float) -> None:
        """Let time pass, at most a second at once."""
        end = self.now + seconds
        if self.is_idle:
            self.now = end
        while self.now < end:
            done = self._phase_end()
            if done > end:
                self.now = end
                return
            self.now = max(self.now, done)
            if not self._start_next_phase():
                self.now = end

    @property
    def is_idle(self) -> bool:
        """Nobody wants it, and it stands."""
        return not self.sessions and self.doors is Doors.CLOSED and not self._target

    def state(self) -> ElevatorState:
        """What there is to see now."""
        height, past = self.heights[self.floor], self.now - self._since
        if self._target:
            height += travelled(self.elevator, self.heights[self._target] - height, past)
        share = {Doors.CLOSED: 0.0, Doors.OPEN: 1.0}.get(self.doors)
        if share is None:
            share = min(1.0, past / self.elevator.door_time) if self.elevator.door_time else 1.0
            share = share if self.doors is Doors.OPENING else 1.0 - share
        inside = tuple(s.robot for s in self.sessions.values() if s.phase in _INSIDE)
        queue = tuple(s.robot for s in self.sessions.values() if s.phase is Phase.WAITING)
        return ElevatorState(height, "" if self._target else self.floor, self.doors, share, inside, queue)

    def rides(self) -> dict[str, RideStatus]:
        """Of the robots that it serves, by name."""
        rides, ahead = {}, 0
        for session in self.sessions.values():
            is_waiting = session.phase is Phase.WAITING
            place = (self.elevator.name, session.origin, session.destination, ahead if is_waiting else 0)
            rides[session.robot] = RideStatus(session.phase, *place)
            ahead += is_waiting
        return rides

    def longest_wait(self, ahead: int) -> float:
        """How long a robot may have to wait, at most, for doors that open for it, with so many calls before it, s."""
        span = max(self.heights.values()) - min(self.heights.values())
        stops = len(self.heights) + 1
        # Out, then in: who begins to drive in last has the limit still.
        at_a_stop = 2 * self.elevator.door_time + OPEN_LIMIT_S + BOARDING_LIMIT_S
        # Each call before it may lead once: there and back over the whole height, with a stop at every floor.
        return (ahead + 1) * 2 * (travel_time(self.elevator, span) * stops + stops * at_a_stop)

    def _phase_end(self) -> float:
        """When what happens now is over; now, where the cabin can turn to something else at any moment."""
        if self._target:
            return self._since + travel_time(self.elevator, self.heights[self._target] - self.heights[self.floor])
        if self.doors in (Doors.OPENING, Doors.CLOSING):
            return self._since + self.elevator.door_time
        if self.doors is Doors.OPEN:
            waits = [s.since + BOARDING_LIMIT_S for s in self._moving_through_doors()]
            if self._is_waiting_for_party():
                waits.append(self._party_since + BOARDING_LIMIT_S)
            return min(waits, default=self.now)
        return self.now

    def _start_next_phase(self) -> bool:
        """Begin what comes next; False where there is nothing to do."""
        if self._target:
            self.floor, self._target = self._target, ""
            self._set_doors(Doors.OPENING)
        elif self.doors is Doors.OPENING:
            self._set_doors(Doors.OPEN)
            self._start_alighting_and_boarding()
        elif self.doors is Doors.OPEN:
            for session in self._moving_through_doors():
                if self.now >= session.since + BOARDING_LIMIT_S:
                    way = "in" if session.phase is Phase.BOARDING else "out"
                    self.cancel(session.robot, f"did not drive {way} within {BOARDING_LIMIT_S:g} s")
            if not self._start_alighting_and_boarding():
                self._set_doors(Doors.CLOSING)
        elif self.doors is Doors.CLOSING:
            self._set_doors(Doors.CLOSED)
        else:
            stop = self._next_stop()
            if stop is None:
                return False
            if stop == self.floor:
                self._set_doors(Doors.OPENING)
            else:
                self._target, self._since = stop, self.now
        return True

    def _set_doors(self, doors: Doors) -> None:
        self.doors, self._since = doors, self.now

    def _moving_through_doors(self) -> list[RideSession]:
        return [s for s in self.sessions.values() if s.phase in (Phase.BOARDING, Phase.ALIGHTING)]

    def _start_alighting_and_boarding(self) -> bool:
        """Tell those who may drive now, first out, then in; whether the doors are open for anybody."""
        for session in self.sessions.values():
            if session.phase is Phase.RIDING and session.destination == self.floor:
                session.enter_phase(Phase.ALIGHTING, self.now)
        is_anybody_leaving = any(s.phase is Phase.ALIGHTING for s in self.sessions.values())
        if not is_anybody_leaving and self.now < self._since + OPEN_LIMIT_S:
            for session in self._next_to_board():
                if session.party and not self._aboard():
                    self._party_since = self.now
                session.enter_phase(Phase.BOARDING, self._party_since if session.party else self.now)
        return bool(self._moving_through_doors()) or self._is_waiting_for_party()

    def _next_to_board(self) -> list[RideSession]:
        """Those who wait here, go where the cabin goes, and fit in, longest waiting first."""
        aboard = self._aboard()
        leader = self._leader()
        chosen: list[RideSession] = []
        for session in self.sessions.values():
            if session.phase is not Phase.WAITING or session.origin != self.floor:
                continue
            is_taken = leader is None or session is leader or self._fits_leader_ride(session, leader)
            if is_taken and self._has_room(session, aboard):
                aboard.append(session)
                chosen.append(session)
        return chosen

    def _aboard(self) -> list[RideSession]:
        """Those who are in the cabin, or drive in now, and stay."""
        return [s for s in self.sessions.values() if s.phase in (Phase.BOARDING, Phase.RIDING)]

    def _has_room(self, session: RideSession, aboard: list[RideSession]) -> bool:
        """Whether a robot fits in with these: a party rides without others."""
        if any(other.party != session.party for other in aboard):
            return False
        return fits(self.elevator, [session.radius_m, *(other.radius_m for other in aboard)])

    # ---- parties ----

    def _party(self, name: str) -> list[RideSession]:
        return [s for s in self.sessions.values() if s.party == name]

    def _is_incomplete(self, session: RideSession) -> bool:
        """Whether a robot is in where its party boards, and others of it are not."""
        is_in_here = session.phase is Phase.RIDING and session.origin == self.floor
        return is_in_here and bool(session.party) and not self._is_complete(self._party(session.party))

    @staticmethod
    def _is_complete(party: list[RideSession]) -> bool:
        """Whether all of a party are in the cabin."""
        return sum(s.phase in _INSIDE for s in party) >= party[0].size

    def _is_party_in_time(self) -> bool:
        """Whether the doors are open for the rest of a party, some of which are in, or about to be."""
        return self.doors in (Doors.OPENING, Doors.OPEN) and self.now < self._party_since + BOARDING_LIMIT_S

    def _is_waiting_for_party(self) -> bool:
        """Whether some of a party are in, and the doors stay open for the others."""
        return self._is_party_in_time() and any(map(self._is_incomplete, self.sessions.values()))

    def _leader(self) -> RideSession | None:
        """Whose ride decides where the cabin goes: of those inside, then of those who wait, the first to call."""
        inside = [s for s in self.sessions.values() if s.phase is not Phase.WAITING]
        return min(inside or self.sessions.values(), key=lambda s: s.called_at, default=None)

    def _fits_leader_ride(self, session: RideSession, leader: RideSession) -> bool:
        """Whether a ride from here lies within what is left of the leader's, in its direction."""
        if leader.phase is Phase.WAITING and leader.origin != self.floor:
            return False
        here, there, to = (self.heights[name] for name in (self.floor, leader.destination, session.destination))
        return (to - here) * (there - here) > 0 and abs(to - here) <= abs(there - here) + _TOLERANCE_M

    def _next_stop(self) -> str | None:
        """The floor to go to; the one where the cabin stands, where somebody gets on here."""
        leader = self._leader()
        if leader is None:
            return None
        goal = leader.origin if leader.phase is Phase.WAITING else leader.destination
        if goal == self.floor:
            return goal
        here, there = self.heights[self.floor], self.heights[goal]
        stops = {s.destination for s in self.sessions.values() if s.phase is Phase.RIDING} | {goal}
        if leader.phase is not Phase.WAITING:
            aboard = self._aboard()
            stops |= {
                s.origin
                for s in self.sessions.values()
                if s.phase is Phase.WAITING
                and self._has_room(s, aboard)
                and (self.heights[s.destination] - self.heights[s.origin]) * (there - here) > 0
                and abs(self.heights[s.destination] - here) <= abs(there - here) + _TOLERANCE_M
            }
        between = [
            floor
            for floor in stops
            if floor != self.floor
            and (self.heights[floor] - here) * (there - here) >= 0
            and abs(self.heights[floor] - here) <= abs(there - here) + _TOLERANCE_M
        ]
        return min(between, key=lambda floor: abs(self.heights[floor] - here))


def fits(elevator: Elevator, radii_m: list[float]) -> bool:
    """Whether robots of these radii have room in the cabin, each in a square as wide as the widest of them."""
    width = 2 * max(radii_m)
    places = math.floor(elevator.size[0] / width + _TOLERANCE_M) * math.floor(elevator.size[1] / width + _TOLERANCE_M)
    return len(radii_m) <= places
