"""Elevators: rides from call to end, planned times, bounded waits, parties, robots that fail."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocorba.errors.simulation import ElevatorFull, InvalidRide, NoRide
from robocorba.map_editor.model import Building, Elevator, ElevatorDoor, Floor, FloorMap
from robocorba.map_editor.spatial.elevator_state import Doors
from robocorba.planning.elevators import ride, travel_time, travelled
from robocorba.simulation.elevator import (
    BLOCKED_S,
    BOARDING_LIMIT_S,
    MAX_SESSIONS,
    OPEN_LIMIT_S,
    Cabin,
    Doorway,
    RidePhase,
    fits,
)

HEIGHTS = {f"L{level}": 4.0 * level for level in range(1, 6)}
LIFT = Elevator("E1", (0.0, 0.0), (1.8, 1.8), tuple(ElevatorDoor(name) for name in HEIGHTS), speed=1.5, door_time=3.0)
STEP_S = 0.1


def cabin() -> Cabin:
    return Cabin(LIFT, dict(HEIGHTS))


def until(lift: Cabin, robot: str, phase: RidePhase, limit_s: float = 300.0) -> float:
    """Advance until the robot's ride is in a phase; return the time that it took [s]."""
    began = lift.now
    while lift.sessions[robot].phase is not phase:
        lift.advance(STEP_S)
        assert lift.now - began < limit_s
    return lift.now - began


def pass_time(lift: Cabin, seconds: float) -> None:
    end = lift.now + seconds
    while lift.now < end - 1e-9:
        lift.advance(STEP_S)


def test_a_ride_takes_as_long_as_planned() -> None:
    floors = {name: FloorMap(Floor(name, level, HEIGHTS[name])) for level, name in enumerate(HEIGHTS)}
    planned = ride(Building("B", floors, {"E1": LIFT}), LIFT, "L2", "L5")
    waits = []
    for start in HEIGHTS:
        lift = cabin()
        if start != lift.floor:  # bring it there
            lift.call("X", "L1", start, 0.4)
            until(lift, "X", RidePhase.BOARDING)
            lift.enter("X")
            until(lift, "X", RidePhase.ALIGHTING)
            lift.leave("X")
            pass_time(lift, 10.0)
        lift.call("A", "L2", "L5", 0.4)
        waits.append(until(lift, "A", RidePhase.BOARDING))
        lift.enter("A")
        assert until(lift, "A", RidePhase.ALIGHTING) == pytest.approx(planned.travel, abs=2 * STEP_S)
    assert sum(waits) / len(waits) == pytest.approx(planned.wait, abs=2 * STEP_S)


@given(st.floats(-60, 60), st.floats(0.1, 3), st.floats(0, 1))
def test_a_cabin_reaches_its_floor_within_its_speed(climb: float, speed: float, share: float) -> None:
    lift = Elevator("E", (0.0, 0.0), (2.0, 2.0), (), speed=speed)
    total = travel_time(lift, climb)
    assert travelled(lift, climb, 0.0) == 0.0
    assert travelled(lift, climb, total) == climb
    gone, later = (abs(travelled(lift, climb, share * total + s)) for s in (0.0, 0.01))
    assert gone - 1e-9 <= later <= gone + speed * 0.01 + 1e-6
    assert gone <= abs(climb) + 1e-9


def test_the_cabin_stops_for_rides_in_its_direction() -> None:
    lift = cabin()
    lift.call("A", "L1", "L5", 0.4)
    until(lift, "A", RidePhase.BOARDING)
    lift.enter("A")
    lift.call("B", "L3", "L4", 0.4)
    lift.call("C", "L4", "L2", 0.4)  # the other way
    until(lift, "B", RidePhase.BOARDING)
    assert lift.sessions["A"].phase is RidePhase.RIDING
    lift.enter("B")
    until(lift, "B", RidePhase.ALIGHTING)
    assert lift.sessions["C"].phase is RidePhase.WAITING
    lift.leave("B")
    until(lift, "A", RidePhase.ALIGHTING)
    lift.leave("A")
    until(lift, "C", RidePhase.BOARDING)


# ---- parties ----


def phases(lift: Cabin, robots: str) -> list[RidePhase]:
    return [lift.sessions[name].phase for name in robots]


def test_doors_stay_open_for_late_members_of_a_party_until_the_limit() -> None:
    lift = cabin()
    lift.call("A", "L1", "L2", 0.4, "table", 3)
    until(lift, "A", RidePhase.BOARDING)
    opened = lift.now
    lift.enter("A")
    pass_time(lift, 10.0)
    lift.call("B", "L1", "L2", 0.4, "table", 3)
    assert lift.sessions["B"].phase is RidePhase.BOARDING
    lift.call("X", "L1", "L2", 0.4)
    pass_time(lift, 4.8)
    assert lift.doors is Doors.OPEN
    pass_time(lift, 0.5)
    assert lift.ended == [("B", f"did not drive in within {BOARDING_LIMIT_S:g} s")]
    assert (lift.doors, lift.now - opened < 16.0) == (Doors.CLOSING, True)
    with pytest.raises(InvalidRide) as refused:
        lift.call("B", "L1", "L2", 0.4, "table", 3)
    assert refused.value.field == "party"
    assert phases(lift, "AX") == [RidePhase.RIDING, RidePhase.WAITING]
    until(lift, "A", RidePhase.ALIGHTING)


# ---- something between the doors ----


class BlockedLift:
    """A lift that has opened on L1 for X, which does not board, and stands between its doors."""

    def __init__(self) -> None:
        self.has = Doorway.IN_USE
        self.lift = Cabin(LIFT, dict(HEIGHTS), doorway=lambda: self.has)
        self.lift.call("X", "L1", "L2", 0.4)
        until(self.lift, "X", RidePhase.BOARDING)
        self.lift.cancel("X")

    def others_call(self) -> None:
        """One on another floor, then a party of two on L1."""
        self.lift.call("Y", "L3", "L2", 0.4)
        for name in "AB":
            self.lift.call(name, "L1", "L2", 0.4, "table", 2)

    def carry_away(self) -> None:
        """The party of two rides with what was between the doors."""
        for name in "AB":
            self.lift.enter(name)
        self.has = Doorway.FREE
        until(self.lift, "B", RidePhase.ALIGHTING)
        for name in "AB":
            self.lift.leave(name)


def test_what_keeps_the_doors_open_can_be_carried_away() -> None:
    """A party boards, although Y has called before and the doors have been open for longer than OPEN_LIMIT_S."""
    blocked = BlockedLift()
    pass_time(blocked.lift, 2 * OPEN_LIMIT_S)
    blocked.lift.call("Z", "L1", "L2", 0.4)
    until(blocked.lift, "Z", RidePhase.BOARDING)
    blocked.others_call()
    pass_time(blocked.lift, 5.0)
    blocked.lift.cancel("Z")  # and stays between the doors, which were not blocked while it boarded
    pass_time(blocked.lift, BLOCKED_S - 1.0)
    assert phases(blocked.lift, "YAB") == [RidePhase.WAITING] * 3
    assert until(blocked.lift, "A", RidePhase.BOARDING) < 1.0 + 2 * STEP_S
    assert phases(blocked.lift, "YAB") == [RidePhase.WAITING, RidePhase.BOARDING, RidePhase.BOARDING]
    blocked.carry_away()
    until(blocked.lift, "Y", RidePhase.BOARDING)


def test_what_just_passes_the_doors_lets_nobody_board_out_of_turn() -> None:
    blocked = BlockedLift()
    blocked.others_call()
    pass_time(blocked.lift, BLOCKED_S - 1.0)
    blocked.lift.call("Z", "L1", "L5", 0.4)
    blocked.has = Doorway.FREE
    until(blocked.lift, "Y", RidePhase.BOARDING)
    assert phases(blocked.lift, "ABZ") == [RidePhase.WAITING] * 3


# ---- limits ----


def test_invalid_calls_name_the_field() -> None:
    lift = cabin()
    assert fits(LIFT, [0.4] * 4) and not fits(LIFT, [0.4] * 5)
    lift.call("A", "L1", "L2", 0.4)
    lift.call("P", "L1", "L2", 0.4, "table", 2)
    for field, call in (
        ("origin", ("B", "roof", "L1", 0.4)),
        ("destination", ("B", "L1", "roof", 0.4)),
        ("destination", ("B", "L1", "L1", 0.4)),
        ("robot", ("A", "L1", "L3", 0.4)),
        ("radius", ("B", "L1", "L2", 1.5)),
        ("radius", ("B", "L1", "L2", math.nan)),
        ("radius", ("B", "L1", "L2", -1.0)),
        ("party", ("B", "L1", "L2", 0.4, "x" * 201, 2)),
        *(("partySize", ("B", "L1", "L2", 0.4, "other", size)) for size in (0, 5, 2**32 - 1)),
        ("partySize", ("B", "L1", "L2", 0.8, "table", 2)),
        *(("boardingTime", ("B", "L1", "L2", 0.4, "table", 2, needs_s)) for needs_s in (-1.0, 55.1, math.nan)),
    ):
        with pytest.raises(InvalidRide) as refused:
            lift.call(*call)
        assert refused.value.field == field, call
    for act in (lambda: lift.enter("A"), lambda: lift.leave("A"), lambda: lift.enter("X"), lambda: lift.cancel("X")):
        with pytest.raises(NoRide):
            act()
    for number in range(MAX_SESSIONS - 2):
        lift.call(f"R{number}", "L1", "L2", 0.4)
    with pytest.raises(ElevatorFull):
        lift.call("last", "L1", "L2", 0.4)
