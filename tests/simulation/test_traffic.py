"""Robots that reserve areas and ride an elevator, in any order and however they behave, against a model: areas as in
area_model.py, and bodies that are in a hall, in the cabin or between its doors.

Nobody drives: robots are put where they would drive to, if the doors let them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import msgspec
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from robocorba.errors.simulation import InvalidReservation, InvalidRide, UnknownRobot
from robocorba.map_editor.changes import ChangeKind
from robocorba.map_editor.edits import MapChange
from robocorba.map_editor.lineage import Lineage
from robocorba.map_editor.model import Building, Elevator, ElevatorDoor, Floor, FloorMap
from robocorba.map_editor.spatial.elevator_state import Doors
from robocorba.map_editor.spatial.pose import XY, Pose
from robocorba.simulation import building as building_module
from robocorba.simulation import elevators as elevators_module
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.elevator import BOARDING_LIMIT_S, BOARDING_MARGIN_S, RidePhase
from robocorba.simulation.reservations import GONE, area_request
from robocorba.simulation.simulation_event import SimulationEvent
from robocorba.simulation.world_record import WorldRecord
from tests.simulation.area_model import AreaModel, Box, areas
from tests.simulation.places import enter

STEP_S = 0.1
NAMES = "ABCDEF"
HALL = {name: (1.0 + 1.5 * number, 9.0) for number, name in enumerate(NAMES)}
#: As many robots of 0.4 m as fit into 2 m by 2 m.
CABIN = [(4.5, 4.5), (5.5, 4.5), (4.5, 5.5), (5.5, 5.5)]
DOORWAY = (5.0, 3.85)
#: More than a trip takes however its riders behave [s]: three stops, two legs, the doors.
LONGEST_TRIP_S = 240.0
WAITING, BOARDING, RIDING, ALIGHTING = RidePhase
CREATED, REMOVED = ChangeKind.CREATED, ChangeKind.REMOVED

who = st.integers(0, len(NAMES) - 1)
floors = st.integers(0, 2)
#: No elevator serves the attic.
ATTIC = 3
HOUSE = ("L1", "L2", "L3", "attic")
boxes = st.lists(
    st.tuples(
        st.sampled_from([0, 1, ATTIC]), st.integers(0, 3), st.integers(0, 1), st.integers(1, 3), st.integers(1, 2)
    ),
    min_size=1,
    max_size=3,
)


def house(names: Sequence[str]) -> Building:
    doors = tuple(ElevatorDoor(name) for name in names[:ATTIC] if name != GONE)
    lift = Elevator("E1", (5.0, 5.0), (2.0, 2.0), doors, speed=2.0, door_time=1.0)
    floors = {name: FloorMap(Floor(name, level, 4.0 * level)) for level, name in enumerate(names) if name != GONE}
    return Building("house", floors, {"E1": lift})


@dataclass
class Ride:
    """since: when its phase began, as far as it was seen. bound: until when it waits at most [s]."""

    origin: int
    destination: int
    party: str
    size: int
    limit_s: float
    phase: RidePhase = WAITING
    since: float = 0.0
    bound: float = math.inf
    #: Whether something was between the doors since the call.
    is_delayed: bool = False


@dataclass
class Robot:
    """is_lazy: it neither boards nor alights by itself."""

    floor: int
    at: XY
    is_lazy: bool = False
    ride: Ride | None = None

    @property
    def is_in_cabin(self) -> bool:
        return self.at in CABIN


class Traffic(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self._patch = pytest.MonkeyPatch()
        for module in (building_module, elevators_module):
            self._patch.setattr(module, "STEP_S", STEP_S)
        self.names = [*HOUSE, GONE]
        self.world = SimulatedBuilding(house(self.names))
        self.robots: dict[str, Robot] = {}
        self.areas = AreaModel()
        #: Rules since all were served.
        self.since_served = 0

    def teardown(self) -> None:
        self._patch.undo()

    @property
    def riders(self) -> dict[str, tuple[Robot, Ride]]:
        return {name: (robot, robot.ride) for name, robot in self.robots.items() if robot.ride}

    @property
    def boarding(self) -> list[str]:
        return [name for name, (_, ride) in self.riders.items() if ride.phase is BOARDING]

    @property
    def is_blocked(self) -> bool:
        return any(robot.at == DOORWAY for robot in self.robots.values())

    def can_pass(self, robot: Robot) -> bool:
        """Whether the doors on a robot's floor are open."""
        cabin = self.world.elevators.states["E1"]
        return cabin.doors is Doors.OPEN and cabin.floor == self.names[robot.floor]

    # ---- robots ----

    @initialize(
        trips=st.lists(st.tuples(floors, floors, st.booleans()), min_size=3, max_size=len(NAMES)),
        is_crowd=st.booleans(),
        parties=st.sampled_from([("",), ("", "table"), ("table", "table", "", "sofa")]),
        requests=st.lists(boxes, max_size=len(NAMES)),
    )
    def begin(
        self, trips: list[tuple[int, int, bool]], is_crowd: bool, parties: tuple[str, ...], requests: list[list[Box]]
    ) -> None:
        """Robots have called the elevator, perhaps all on one floor, and reserved areas."""
        for number, (name, (floor, destination, is_lazy)) in enumerate(zip(NAMES, trips, strict=False)):
            self.log_on(name, 0 if is_crowd else floor, is_lazy and not is_crowd)
            party = parties[number % len(parties)]
            self.call(number, 2 if is_crowd else destination, party, parties.count(party), 0.0)
        for number, wanted in enumerate(requests[: len(trips)]):
            self.reserve(number, [wanted], 60.0)

    @rule(name=st.sampled_from(NAMES), floor=floors, is_lazy=st.booleans())
    def log_on(self, name: str, floor: int, is_lazy: bool) -> None:
        if name not in self.robots and self.names[floor] != GONE:
            enter(self.world, name, self.names[floor], *HALL[name])
            self.robots[name] = Robot(floor, HALL[name], is_lazy)

    def some(self, number: int) -> tuple[str, Robot]:
        return list(self.robots.items())[number % len(self.robots)]

    @precondition(lambda self: self.robots)
    @rule(
        number=who,
        what=st.sampled_from(["the ride", "the areas", "both", "and falls silent", "to a successor"]),
        is_restarted=st.booleans(),
    )
    def give_up(self, number: int, what: str, is_restarted: bool) -> None:
        """A robot gives up what it has, or is logged off, perhaps as soon as the server has started again: one that
        boards, if there is any."""
        able = self.boarding or list(self.robots)
        name = able[number % len(able)]
        robot = self.robots[name]
        if is_restarted:
            self.restart()
        if what == "the areas":
            self.world.reservations.release(name)
            self.areas.keep(name, [])
        elif what == "the ride":
            self.world.elevators.cancel(name)
            robot.ride = None
        else:
            if what in ("and falls silent", "to a successor"):  # with an object in its hands
                self.world.reservations.fall_silent(name)
                self.areas.fall_silent(name)
            self.world.remove(name)
            self.areas.keep(name, [])
            del self.robots[name]
            if what == "to a successor" and self.robots and self.areas.kept:
                self.take_over(number, len(self.areas.kept) - 1)

    @precondition(lambda self: self.robots)
    @rule(number=who, to=st.sampled_from(["hall", "cabin", "doorway"]), steps=st.sampled_from([1, 200]))
    def drive(self, number: int, to: str, steps: int) -> None:
        """Where a robot likes, once the doors open: into the cabin before those that board, or between the doors; who
        rides stays there."""
        for _ in range(100 if self.riders else 0):
            if any(map(self.can_pass, self.robots.values())):
                break
            self.step()
        able = [name for name, robot in self.robots.items() if self.can_pass(robot)] or list(self.robots)
        name = able[number % len(able)]
        robot = self.robots[name]
        if to == "cabin":
            for each in (name, *self.boarding):
                self.board(each, self.robots[each])
            self.step()
        elif robot.ride and robot.ride.phase is RIDING:
            return
        elif to == "hall":
            self.leave(name, robot)
        elif self.can_pass(robot) and not self.is_blocked:
            self.put(name, robot, DOORWAY)
            self.pass_time(steps, False)

    def board(self, name: str, robot: Robot) -> None:
        taken = [other.at for other in self.robots.values()]
        free = [place for place in CABIN if place not in taken]
        if free and not robot.is_in_cabin and self.can_pass(robot):
            self.put(name, robot, free[0])

    def leave(self, name: str, robot: Robot) -> None:
        if robot.at != HALL[name] and self.can_pass(robot):
            self.put(name, robot, HALL[name])

    def put(self, name: str, robot: Robot, at: XY) -> None:
        self.world.place(name, Pose(self.names[robot.floor], *at))
        robot.at = at

    # ---- rides ----

    @precondition(lambda self: self.robots)
    @rule(
        number=who,
        destination=floors,
        party=st.sampled_from(["", "", "table", "sofa"]),
        size=st.integers(1, 3),
        boarding_s=st.sampled_from([0.0, 25.0, 55.0]),
    )
    def call(self, number: int, destination: int, party: str, size: int, boarding_s: float) -> None:
        """From outside, or to get out of an open cabin."""
        name, robot = self.some(number)
        if not (robot.at == HALL[name] or self.can_pass(robot)):
            return
        limit_s = max(BOARDING_LIMIT_S, boarding_s + BOARDING_MARGIN_S) if party else BOARDING_LIMIT_S
        ride = Ride(robot.floor, destination, party, size if party else 1, limit_s)
        faults, has_left = self.faults(robot, ride)
        try:
            self.world.elevators.call(name, "E1", self.names[destination], party, size, boarding_s)
        except InvalidRide as error:
            assert error.field in faults or (has_left and error.field == "party")
            return
        assert not faults
        robot.ride = ride
        assert self.world.elevators.longest_wait_s(name) <= LONGEST_TRIP_S * (len(self.riders) + 1)

    def faults(self, robot: Robot, ride: Ride) -> tuple[set[str], bool]:
        """The fields that are wrong in a call, and whether members of its party are inside: it may have left."""
        faults = {"elevator"} if robot.ride else set()
        if ride.origin == ride.destination or self.names[ride.destination] == GONE:
            faults.add("destination")
        others = [other for _, other in self.riders.values() if ride.party and other.party == ride.party]
        for other in others:
            if (other.origin, other.destination) != (ride.origin, ride.destination):
                faults.add("party")
            if other.size != ride.size:
                faults.add("partySize")
        if len(others) >= ride.size:
            faults.add("party")
        return faults, any(other.phase in (RIDING, ALIGHTING) for other in others)

    @precondition(lambda self: self.robots)
    @rule()
    def obey(self) -> None:
        """Robots do what their rides ask for; who has none leaves the cabin."""
        for name, robot in self.robots.items():
            if not robot.ride or (robot.ride.phase is ALIGHTING and not robot.is_lazy):
                self.leave(name, robot)
            elif robot.ride.phase is BOARDING and not robot.is_lazy:
                self.board(name, robot)

    # ---- reservations ----

    @precondition(lambda self: self.robots)
    @rule(number=who, alternatives=st.lists(boxes, min_size=1, max_size=3), limit_s=st.sampled_from([1.0, 7.53, 60.0]))
    def reserve(self, number: int, alternatives: list[list[Box]], limit_s: float) -> None:
        if not self.are_there(box for each in alternatives for box in each):
            return
        name, _ = self.some(number)
        wanted = [area_request(areas(each, self.names), limit_s, self.names) for each in alternatives]
        with pytest.raises(UnknownRobot):
            self.world.reserve("Z", wanted)
        if self.areas.of(name):
            with pytest.raises(InvalidReservation, match="has a reservation already"):
                self.world.reserve(name, wanted)
        else:
            assert self.world.reserve(name, wanted) == self.areas.reserve(name, alternatives, limit_s)

    def are_there(self, wanted: Iterable[Box]) -> bool:
        return all(self.names[box[0]] != GONE for box in wanted)

    def owner(self, number: int) -> str:
        """Of a request that there is, or a robot that has none."""
        names = [one.owner for one in self.areas.queue] + list(self.robots)
        return names[number % len(names)]

    @precondition(lambda self: self.areas.queue)
    @rule(number=who, which=st.sets(st.integers(0, 2)))
    def keep(self, number: int, which: set[int]) -> None:
        name = self.owner(number)
        request = self.areas.of(name)
        kept = [box for i, box in enumerate(request.boxes) if i in which] if request else []
        if request:
            self.world.reservations.keep(name, areas(kept, self.names))
            self.areas.keep(name, kept)
        else:
            with pytest.raises(InvalidReservation, match="has no reservation"):
                self.world.reservations.keep(name, ())

    @precondition(lambda self: self.areas.queue)
    @rule(number=who, wanted=boxes, least_s=st.sampled_from([0.0, 5.0]))
    def exchange(self, number: int, wanted: list[Box], least_s: float) -> None:
        if not self.are_there(wanted):
            return
        name = self.owner(number)
        request = area_request(areas(wanted, self.names), 1.0, self.names)
        found = self.world.reservations.exchange(name, request, least_s)
        assert found is self.areas.exchange(name, wanted, least_s)

    @precondition(lambda self: self.robots and self.areas.kept)
    @rule(number=who, which=who)
    def take_over(self, number: int, which: int) -> None:
        name, _ = self.some(number)
        former = [*(one.owner for one in self.areas.kept), "nobody"][which % (len(self.areas.kept) + 1)]
        if self.areas.take_over(name, former):
            self.world.reservations.take_over(name, former)
        else:
            with pytest.raises(InvalidReservation):
                self.world.reservations.take_over(name, former)

    # ---- the building ----

    @rule(floor=floors, name=st.sampled_from(["L1", "L2", "lobby", "roof"]))
    def rename_floor_or_restart(self, floor: int, name: str) -> None:
        if name in self.names or self.names[floor] == GONE:
            self.restart()
            return
        former = self.world.building.floors[self.names[floor]].floor
        self.edit(floor, name, (REMOVED, former), (CREATED, msgspec.structs.replace(former, name=name)))

    @rule(number=st.integers(0, ATTIC), name=st.sampled_from(["L1", "L2", "L3", "attic"]), is_restarted=st.booleans())
    def remove_or_add_floor(self, number: int, name: str, is_restarted: bool) -> None:
        """A floor that is added is none of those that were removed, also by the name of one of them."""
        if GONE not in self.names[:-1]:
            self.edit(number, GONE, (REMOVED, self.world.building.floors[self.names[number]].floor))
            for robot in [robot for robot, found in self.robots.items() if found.floor == number]:
                self.areas.keep(robot, [])
                del self.robots[robot]
            self.areas.remove_floor(number)
        elif name in self.names:
            return
        else:
            number = self.names.index(GONE)
            self.edit(number, name, (CREATED, Floor(name, number, 4.0 * number)))
        if number != ATTIC:  # an elevator that serves other floors has lost its rides
            for robot in self.robots.values():
                robot.ride = None
        if is_restarted:
            self.restart()

    def edit(self, number: int, name: str, *changes: tuple[ChangeKind, Floor]) -> None:
        self.names[number] = name
        self.world.update(house(self.names), Lineage(MapChange(2, kind, "", floor) for kind, floor in changes))

    def restart(self) -> None:
        """The cabin stops at its last floor."""
        record = msgspec.msgpack.decode(msgspec.msgpack.encode(self.world.record()), type=WorldRecord)
        robots = [robot.description for robot in self.world.occupants.robots.values()]
        self.world = SimulatedBuilding(self.world.building)
        self.world.restore(record, robots)
        for name, (_, ride) in self.riders.items():
            ride.phase, ride.since = self.world.elevators.rides[name].phase, self.world.time
            ride.bound = math.inf

    # ---- time ----

    @rule(steps=st.sampled_from([1, 5, 20, 100, 300]), obeys=st.booleans())
    def pass_time(self, steps: int, obeys: bool) -> None:
        for _ in range(steps):
            if obeys:
                self.obey()
            self.step()

    @precondition(lambda self: self.since_served > 15 and (self.riders or self.areas.queue))
    @rule()
    def serve(self) -> None:
        """If nobody stands in the way, all are served in a bounded time, or get to know why not."""
        for name, robot in self.robots.items():
            if robot.at == DOORWAY:
                self.leave(name, robot)
        until = self.world.time + LONGEST_TRIP_S * (len(self.riders) + 1) + 60.0 * len(self.areas.queue)
        while self.riders or self.areas.queue:
            self.obey()
            self.step()
            assert self.world.time < until, "somebody waits for ever"
        self.since_served = 0

    def step(self) -> None:
        before, was_blocked = self.world.elevators.states["E1"], self.is_blocked
        over = []
        for event in self.world.step():
            if event.kind == "reservation over":
                over.append((*event.who, event.reason))
            else:
                self.note(event)
        assert sorted(over) == sorted(self.areas.pass_time(self.world.time))
        cabin = self.world.elevators.states["E1"]
        assert cabin.floor or cabin.doors is Doors.CLOSED, "it moves with its doors open"
        if before.height != cabin.height:
            assert before.doors in (Doors.CLOSED, Doors.CLOSING) and cabin.doors in (Doors.CLOSED, Doors.OPENING)
        if was_blocked:
            assert (cabin.doors, cabin.floor) == (Doors.OPEN, before.floor), "doors close on a robot"
        for robot in self.robots.values():
            if robot.is_in_cabin and cabin.floor:
                robot.floor = self.names.index(cabin.floor)
        for name, (robot, ride) in self.riders.items():
            self.follow(name, robot, ride)
        self.check_load()

    def note(self, event: SimulationEvent) -> None:
        (name,) = event.who
        robot = self.robots[name]
        ride = robot.ride
        assert ride, f"{event.kind} without a ride"
        now = self.world.time
        if event.kind == "boarding":
            assert event.floor == self.names[ride.origin]
            assert event.waited_s is not None and event.longest_wait_s is not None
            assert 0.0 <= event.waited_s <= event.longest_wait_s + 2 * STEP_S or ride.is_delayed
        else:
            assert (event.kind, ride.phase in (BOARDING, ALIGHTING)) == ("ride lost", True)
            way = "in" if ride.phase is BOARDING else "out"
            assert event.reason == f"did not drive {way} within {ride.limit_s:g} s"
            assert ride.party or now - ride.since >= ride.limit_s - 2 * STEP_S
            robot.ride = None

    def follow(self, name: str, robot: Robot, ride: Ride) -> None:
        """What has become of a ride is possible, and in time."""
        now, status, cabin = self.world.time, self.world.elevators.rides.get(name), self.world.elevators.states["E1"]
        if status is None:
            assert (ride.phase, robot.floor, robot.is_in_cabin) == (ALIGHTING, ride.destination, False), "ride vanished"
            robot.ride = None
            return
        if status.phase is not ride.phase:
            assert (ride.phase, status.phase) in (
                *((WAITING, BOARDING), (WAITING, RIDING), (BOARDING, RIDING), (RIDING, ALIGHTING)),
            )
            ride.phase, ride.since = status.phase, now
            assert ride.phase is not RIDING or not self.has_strangers(ride), "a party boards with others"
        assert (status.origin, status.destination) == (self.names[ride.origin], self.names[ride.destination])
        if ride.phase is WAITING:
            ride.bound = min(ride.bound, now + self.world.elevators.longest_wait_s(name))
            if self.is_blocked:
                ride.bound, ride.is_delayed = math.inf, True
            assert now <= ride.bound + STEP_S, "waits longer than it was promised"
            return
        if ride.phase is RIDING:
            assert robot.is_in_cabin
            return
        stop = ride.origin if ride.phase is BOARDING else ride.destination
        assert (cabin.doors, cabin.floor) == (Doors.OPEN, self.names[stop])
        assert now - ride.since <= ride.limit_s + 2 * STEP_S
        if ride.phase is BOARDING and robot.is_in_cabin and ride.since < now:
            assert self.has_strangers(ride), "is inside and does not ride"
        elif ride.phase is ALIGHTING:
            assert robot.at != HALL[name], "is outside and still rides"

    def has_strangers(self, ride: Ride) -> bool:
        """Whether robots are in the cabin that are not of the ride's party, if it has one."""
        inside = [robot.ride for robot in self.robots.values() if robot.is_in_cabin]
        return bool(ride.party) and any(other is None or other.party != ride.party for other in inside)

    def check_load(self) -> None:
        aboard = [ride for _, ride in self.riders.values() if ride.phase is not WAITING]
        assert len(aboard) <= len(CABIN)
        riding_on = {ride.party for ride in aboard if ride.phase is not ALIGHTING}
        assert len(riding_on) <= 1 and (riding_on <= {""} or riding_on == {ride.party for ride in aboard})

    # ---- comparison ----

    @invariant()
    def as_in_the_model(self) -> None:
        self.since_served += 1
        world, cabin = self.world, self.world.elevators.states["E1"]
        assert world.occupants.robots.keys() == self.robots.keys()
        for name, robot in self.robots.items():
            assert world.occupants.pose(name) == pytest.approx(Pose(self.names[robot.floor], *robot.at)), name
        assert set(world.elevators.rides) == set(self.riders)
        for floor in world.building.elevators["E1"].floors():
            is_open = (cabin.doors, cabin.floor) == (Doors.OPEN, floor)
            assert (world.occupants.floors[floor].touching(5.0, 4.0, 0.01) != "") is is_open, "landing doors"
        self.areas.check(world.reservations.all(world.time), self.names)


Traffic.TestCase.settings = settings(max_examples=15, stateful_step_count=40, deadline=None)
TestTraffic = Traffic.TestCase
