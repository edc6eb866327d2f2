"""Elevators: rides from call to the end, times as planned, nobody passed over, whoever dies or dawdles."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.errors import ElevatorFull, InvalidRide, NoRide
from robocorba.maps.model import Building, Elevator, ElevatorDoor, Floor, FloorMap
from robocorba.planning.elevators import ride, travel_time, travelled
from robocorba.simulation.elevator import BOARDING_LIMIT_S, MOST_CALLS, Cabin, Doors, Phase, fits

HEIGHTS = {f"L{level}": 4.0 * level for level in range(1, 6)}
LIFT = Elevator("E1", (0.0, 0.0), (1.8, 1.8), tuple(ElevatorDoor(name) for name in HEIGHTS), speed=1.5, door_time=3.0)
STEP_S = 0.1


def cabin() -> Cabin:
    return Cabin(LIFT, dict(HEIGHTS))


def until(lift: Cabin, robot: str, phase: Phase, limit_s: float = 300.0) -> float:
    """Let time pass until the robot's ride has come so far; the time it took."""
    began = lift.now
    while lift.sessions[robot].phase is not phase:
        lift.advance(STEP_S)
        assert lift.now - began < limit_s
    return lift.now - began


def test_a_ride_from_call_to_end() -> None:
    lift = cabin()
    lift.call("A", "L3", "L1", 0.4)
    until(lift, "A", Phase.BOARDING)
    assert (lift.floor, lift.doors) == ("L3", Doors.OPEN)
    lift.enter("A")
    assert lift.moment().riders == ("A",)
    until(lift, "A", Phase.ALIGHTING)
    assert (lift.floor, lift.doors) == ("L1", Doors.OPEN)
    lift.leave("A")
    for _ in range(100):
        lift.advance(STEP_S)
    assert lift.doors is Doors.CLOSED
    assert not lift.sessions
    assert not lift.ended


def test_a_ride_takes_as_long_as_the_planner_says() -> None:
    floors = {name: FloorMap(Floor(name, level, HEIGHTS[name])) for level, name in enumerate(HEIGHTS)}
    building = Building("B", floors, {"E1": LIFT})
    planned = ride(building, LIFT, "L2", "L5")
    waits = []
    for start in HEIGHTS:
        lift = cabin()
        if start != lift.floor:  # bring it there
            lift.call("X", "L1", start, 0.4)
            until(lift, "X", Phase.BOARDING)
            lift.enter("X")
            until(lift, "X", Phase.ALIGHTING)
            lift.leave("X")
            for _ in range(100):
                lift.advance(STEP_S)
        lift.call("A", "L2", "L5", 0.4)
        waits.append(until(lift, "A", Phase.BOARDING))
        lift.enter("A")
        assert until(lift, "A", Phase.ALIGHTING) == pytest.approx(planned.travel, abs=2 * STEP_S)
    assert sum(waits) / len(waits) == pytest.approx(planned.wait, abs=2 * STEP_S)


@given(st.floats(-60, 60), st.floats(0.1, 3), st.floats(0, 1))
def test_a_cabin_goes_all_its_way_and_never_faster_than_it_may(climb: float, speed: float, share: float) -> None:
    lift = Elevator("E", (0.0, 0.0), (2.0, 2.0), (), speed=speed)
    total = travel_time(lift, climb)
    assert travelled(lift, climb, 0.0) == 0.0
    assert travelled(lift, climb, total) == climb
    now = share * total
    gone = abs(travelled(lift, climb, now))
    later = abs(travelled(lift, climb, now + 0.01))
    assert gone <= later + 1e-9
    assert later <= gone + speed * 0.01 + 1e-6
    assert gone <= abs(climb) + 1e-9


def test_whoever_goes_the_same_way_is_taken_along() -> None:
    lift = cabin()
    lift.call("A", "L1", "L5", 0.4)
    until(lift, "A", Phase.BOARDING)
    lift.enter("A")
    lift.call("B", "L3", "L4", 0.4)
    lift.call("C", "L4", "L2", 0.4)  # the other way
    until(lift, "B", Phase.BOARDING)
    assert lift.sessions["A"].phase is Phase.RIDING
    lift.enter("B")
    until(lift, "B", Phase.ALIGHTING)
    assert lift.sessions["C"].phase is Phase.WAITING
    lift.leave("B")
    until(lift, "A", Phase.ALIGHTING)
    lift.leave("A")
    until(lift, "C", Phase.BOARDING)


def test_no_more_get_in_than_there_is_room_for() -> None:
    lift = cabin()
    assert fits(LIFT, [0.4] * 4)
    assert not fits(LIFT, [0.4] * 5)
    for name in "ABCDE":
        lift.call(name, "L1", "L2", 0.4)
    until(lift, "A", Phase.BOARDING)
    assert [lift.sessions[name].phase for name in "ABCDE"] == [Phase.BOARDING] * 4 + [Phase.WAITING]


def test_whoever_does_not_come_or_leave_loses_the_ride_and_the_others_go_on() -> None:
    lift = cabin()
    lift.call("A", "L1", "L3", 0.4)
    lift.call("B", "L1", "L3", 0.4)
    lift.call("C", "L2", "L1", 0.4)
    until(lift, "B", Phase.BOARDING)
    lift.enter("B")
    until(lift, "B", Phase.ALIGHTING)
    assert lift.ended == [("A", f"did not drive in within {BOARDING_LIMIT_S:g} s")]
    until(lift, "C", Phase.BOARDING)
    assert lift.ended[1:] == [("B", f"did not drive out within {BOARDING_LIMIT_S:g} s")]
    lift.give_up("C")
    for _ in range(100):
        lift.advance(STEP_S)
    assert lift.doors is Doors.CLOSED


floors = st.sampled_from(list(HEIGHTS))
behaviours = st.sampled_from(["goes", "no", "stays"])
calls = st.lists(
    st.tuples(
        st.floats(0, 120), floors, floors, st.sampled_from([0.3, 0.4, 0.6]), st.sampled_from(["goes", "no", "stays"])
    ).filter(lambda call: call[1] != call[2]),
    min_size=1,
    max_size=25,
)


@settings(deadline=None, max_examples=60)
@given(calls)
def test_nobody_waits_longer_than_the_bound_whatever_others_do(
    calls: list[tuple[float, str, str, float, str]],
) -> None:
    lift = cabin()
    due = sorted(calls)
    bounds: dict[str, tuple[float, float]] = {}
    behaviour: dict[str, str] = {}
    arrived = 0
    while due or lift.sessions:
        while due and due[0][0] <= lift.now:
            _, origin, destination, radius, does = due.pop(0)
            name = f"R{len(bounds)}"
            behaviour[name] = does
            bounds[name] = (lift.now, lift.longest_wait(len(lift.sessions)))
            lift.call(name, origin, destination, radius)
        lift.advance(STEP_S)
        inside = [s.radius_m for s in lift.sessions.values() if s.phase is not Phase.WAITING]
        assert not inside or fits(LIFT, inside)
        for session in list(lift.sessions.values()):
            if session.phase is Phase.WAITING:
                since, longest = bounds[session.robot]
                assert lift.now - since <= longest
            elif session.phase is Phase.BOARDING and behaviour[session.robot] != "no":
                assert (lift.floor, lift.doors) == (session.origin, Doors.OPEN)
                lift.enter(session.robot)
            elif session.phase is Phase.ALIGHTING and behaviour[session.robot] == "goes":
                assert (lift.floor, lift.doors) == (session.destination, Doors.OPEN)
                lift.leave(session.robot)
                arrived += 1
    assert arrived == list(behaviour.values()).count("goes")
    assert len(lift.ended) == len(behaviour) - arrived


def test_what_can_not_be_is_refused_by_name() -> None:
    lift = cabin()
    lift.call("A", "L1", "L2", 0.4)
    for field, call in (
        ("origin", ("B", "roof", "L1", 0.4)),
        ("destination", ("B", "L1", "roof", 0.4)),
        ("destination", ("B", "L1", "L1", 0.4)),
        ("robot", ("A", "L1", "L3", 0.4)),
        ("radius", ("B", "L1", "L2", 1.5)),
        ("radius", ("B", "L1", "L2", float("nan"))),
        ("radius", ("B", "L1", "L2", -1.0)),
    ):
        with pytest.raises(InvalidRide) as refused:
            lift.call(*call)
        assert refused.value.field == field
    for act in (lambda: lift.enter("A"), lambda: lift.leave("A"), lambda: lift.enter("X"), lambda: lift.give_up("X")):
        with pytest.raises(NoRide):
            act()
    for number in range(MOST_CALLS - 1):
        lift.call(f"R{number}", "L1", "L2", 0.4)
    with pytest.raises(ElevatorFull):
        lift.call("last", "L1", "L2", 0.4)
