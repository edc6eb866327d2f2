"""Proposals of what robots have seen: when a thing is proposed, and what becomes of it, also against a model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from robocorba.errors.maps import InvalidElement, MapFileError, UnknownElement
from robocorba.map_editor.changes import Change, EditorState, ElementKey, apply
from robocorba.map_editor.map_building_agent import BuildingEditor
from robocorba.map_editor.model import BoxShape, Building, ElementKind, Floor, MapObject
from robocorba.map_editor.proposals import DEFAULT_POLICY, Proposals
from robocorba.map_editor.renaming import rename_changes
from robocorba.map_editor.sightings import SeenObstacle, same_things, seen_of
from robocorba.map_editor.spatial.pose import XY
from robocorba.map_editor.validation import problems
from testkit.buildings import two_floors
from tests.clock import Clock

CHAIR = ((-0.25, -0.25), (0.25, -0.25), (0.25, 0.25), (-0.25, 0.25))
POLICY = DEFAULT_POLICY._replace(accept_robots=3, accept_s=20.0)


def seen(x: float, y: float, corners: Sequence[XY] = CHAIR, floor: str = "L1", certainty: float = 0.8) -> SeenObstacle:
    outline = tuple((x + dx, y + dy) for dx, dy in corners)
    return SeenObstacle(1, floor, x, y, outline, certainty)


class Place:
    """Proposals on a building of two floors, and what was planned last."""

    def __init__(
        self, building: Building | None = None, stored: bytes = b"", policy: Any = POLICY, now: float = 100.0
    ) -> None:
        self.clock, self.planned, self.written = Clock(now), [building or two_floors()], [stored]
        self.proposals = Proposals(
            (self.planned[0], 1),
            lambda planned, version: self.planned.append(planned),
            stored,
            self.written.append,
            policy,
            self.clock,
        )

    def watch(self, *things: SeenObstacle, robots: str = "AB", seconds: float = 4.0) -> None:
        """Two robots see these things for some time, once a second."""
        for _ in range(round(seconds) + 1):
            self.proposals.correlate(dict.fromkeys(robots, things))
            self.clock.now += 1.0

    def objects(self, floor: str = "L1") -> dict[str, MapObject]:
        return self.planned[-1].floors[floor].geometrical.objects


@pytest.fixture
def place() -> Place:
    return Place()


def test_what_two_robots_see_for_a_moment_is_proposed_and_planned_around(place: Place) -> None:
    chair = seen(5.0, 3.0)
    place.watch(chair, robots="A", seconds=10.0)
    assert place.proposals.open() == []
    place.watch(chair, seconds=2.0)  # not long enough
    assert (place.proposals.open(), len(place.planned)) == ([], 1)
    place.watch(chair, robots="BC", seconds=2.0)
    (proposal,) = place.proposals.open()
    assert (proposal.name, proposal.floor, proposal.seen_by) == ("seen 1", "L1", ("A", "B", "C"))
    assert proposal.certainty == pytest.approx(1.0 - 0.2**3)
    drawn = place.objects()["seen 1"]
    assert drawn == proposal.element and not drawn.movable
    assert drawn.at == pytest.approx((5.0, 3.0))
    assert len(place.planned) == 2  # planned anew once, not for each sighting
    assert not problems(place.planned[-1])
    place.watch(chair, seconds=20.0)
    assert [each.name for each in place.proposals.due()] == ["seen 1"]


def test_who_walks_by_and_what_the_map_has_is_not_proposed(place: Place) -> None:
    for step in range(30):
        place.proposals.correlate({robot: [seen(2.0 + 0.4 * step, 3.0)] for robot in "AB"})
        place.clock.now += 1.0
    assert place.proposals.open() == []
    place.proposals.follow(place.planned[0].with_element("L1", MapObject("desk", BoxShape((1.0, 1.0)), (5.0, 6.0))), 2)
    place.watch(seen(5.0, 6.0), seen(1.0, 1.0, floor="L9"))
    assert place.proposals.open() == []
    place.watch(seen(8.0, 6.0, certainty=0.2))
    assert place.proposals.open() == []


def test_things_near_each_other_are_not_mixed_up() -> None:
    ones = [seen(5.0, 3.0), seen(5.0, 3.7), seen(9.0, 3.0)]
    others = [seen(5.02, 3.72), seen(9.0, 3.0, floor="L2"), seen(5.02, 2.98)]
    found = {(round(a.x, 1), round(a.y, 1)): (b.x, b.y) for a, b in same_things(ones, others)}
    assert found == {(5.0, 3.0): (5.02, 2.98), (5.0, 3.7): (5.02, 3.72)}


def test_a_payload_that_is_not_valid_says_nothing() -> None:
    valid = {"number": 3, "floor": "L1", "x": 1.0, "y": 2.0, "outline": [[1.0, 2.0]], "certainty": 0.5, "more": 1}
    assert seen_of({"obstacles": [valid]})[0].outline == ((1.0, 2.0),)
    for wrong in (
        *(None, b"\x01", {}, {"obstacles": 3}, {"obstacles": [valid] * 101}),
        *({"obstacles": [{**valid, **change}]} for change in ({"x": math.nan}, {"certainty": 1.1}, {"outline": []})),
        *({"obstacles": [{**valid, **change}]} for change in ({"outline": [[math.inf, 0.0]]}, {"unseen_s": -1.0})),
    ):
        assert seen_of(wrong) == ()


def test_anybody_proposes_what_they_are_sure_of(place: Place) -> None:
    outline = [(5.0 + dx, 3.0 + dy) for dx, dy in CHAIR]
    name = place.proposals.propose("L1", outline, 0.9, "Ada")
    assert place.proposals.find(name).seen_by == ("Ada",)
    place.proposals.reject(name)
    assert place.proposals.propose("L1", outline, 0.9, "Ben") == name
    assert place.proposals.find(name).seen_by == ("Ada", "Ben")
    for floor, points, certainty, who in (
        ("L1", outline[:2], 0.9, "Ada"),
        ("L1", [(0.0, math.nan), *outline], 0.9, "Ada"),
        ("L1", outline, 1.5, "Ada"),
        *(("L1", outline, 0.5, who) for who in ("", "a\nb", "x" * 61)),
    ):
        with pytest.raises(InvalidElement, match="object 'proposal' on L1: "):
            place.proposals.propose(floor, points, certainty, who)
    for number in range(30):
        place.proposals.propose("L1", outline, 0.9, f"camera {number:02}")
    assert place.proposals.find(name).seen_by == tuple(f"camera {number}" for number in range(10, 30))
    with pytest.raises(UnknownElement, match="no floor 'L9'"):
        place.proposals.propose("L9", outline, 0.9, "Ada")
    desk = MapObject("desk", BoxShape((1.0, 1.0)), (5.0, 3.0))
    place.proposals.follow(place.planned[0].with_element("L1", desk), 2)
    with pytest.raises(InvalidElement, match="the map has an object there"):
        place.proposals.propose("L1", outline, 0.9, "Ada")


def test_there_are_not_too_many_and_what_was_proposed_or_rejected_is_kept() -> None:
    place = Place(policy=DEFAULT_POLICY._replace(most=3))
    place.watch(seen(1.0, 3.0), seen(3.0, 3.0))
    place.proposals.reject("seen 1")
    for x in (5.0, 7.0, 9.0):
        place.proposals.correlate({robot: [seen(x, 3.0)] for robot in "AB"})
        place.clock.now += 0.1
    place.watch(seen(1.0, 3.0), seen(9.0, 3.0))
    assert [each.element.at[0] for each in place.proposals.open()] == pytest.approx([3.0, 9.0])
    place.proposals.propose("L1", [(5.0, 6.0), (6.0, 6.0), (6.0, 7.0)], 1.0, "Ada")
    with pytest.raises(InvalidElement, match="or 3 proposals are open"):
        place.proposals.propose("L1", [(11.0, 1.0), (12.0, 1.0), (12.0, 2.0)], 1.0, "Ada")


def test_a_decision_that_can_not_be_written_is_an_error_and_written_later(editor: BuildingEditor) -> None:
    is_full = [True]

    def write(content: bytes) -> None:
        if is_full[0]:
            raise MapFileError("map.sqlite", 0, "", "the disk is full")
        editor.save_proposals(content)

    proposals = Proposals(editor.snapshot, stored=editor.proposals(), write=write)
    with pytest.raises(MapFileError, match="the disk is full"):
        proposals.propose("L1", [(11.0, 1.0), (12.0, 1.0), (12.0, 2.0)], 1.0, "Ada")
    is_full[0] = False
    proposals.save()
    assert [each.name for each in Proposals(editor.snapshot, stored=editor.proposals()).open()] == ["seen 1"]
    assert Proposals(editor.snapshot, stored=b"[{").open() == []


SPOTS = {number: (2.0 + 3.0 * number, 3.0) for number in range(4)}
#: So far a chair is moved in x [m]: it may be the same one.
MOVED_M = 0.45
spots = st.sets(st.sampled_from(sorted(SPOTS)), min_size=1)
pairs = st.sampled_from(("AB", "BC", "AC"))


class Known(NamedTuple):
    """What is known of a chair. state: new, open or rejected. is_moved: where it was seen."""

    robots: set[str]
    since: float
    last: float
    state: str
    is_moved: bool


class ProposalMachine(RuleBasedStateMachine):
    """The model knows for each spot who has seen a chair there, since when and when last, and what was decided."""

    def __init__(self) -> None:
        super().__init__()
        self.place = Place()
        self.building, self.version = self.place.planned[0], 1
        self.model: dict[int, Known] = {}
        #: The spots whose chairs stand MOVED_M beside them.
        self.moved: set[int] = set()
        #: Empty if the floor is removed.
        self.floor = "L1"
        #: Floor and model as they were written last.
        self.written: tuple[str, dict[int, Known]] = self.floor, {}

    @rule(spots=spots, robots=pairs, is_watched=st.booleans())
    def see(self, spots: set[int], robots: str, is_watched: bool = False) -> None:
        """is_watched: for long enough."""
        if is_watched:
            self.see(spots, robots)
            self.wait(POLICY.standing_s)
        things = [seen(*self.at(spot, spot in self.moved), floor=self.floor) for spot in sorted(spots)]
        self.place.proposals.correlate(dict.fromkeys(robots, things))
        for spot in self.unmapped(spots):
            before = self.known(spot)
            is_ripe = before.state == "new" and self.now - before.since >= POLICY.standing_s
            state = "open" if is_ripe else before.state
            self.model[spot] = before._replace(robots=before.robots | set(robots), last=self.now, state=state)

    @rule(spots=spots)
    def move(self, spots: set[int]) -> None:
        """Somebody moves chairs, or moves them back."""
        self.moved ^= spots

    @rule(seconds=st.sampled_from((0.5, 2.0, 100.0, 301.0, 3601.0)))
    def wait(self, seconds: float) -> None:
        self.place.clock.now += seconds
        self.place.proposals.end_unseen()
        for spot, known in list(self.model.items()):
            if self.now - known.last > (POLICY.rejected_s if known.state == "rejected" else POLICY.kept_s):
                del self.model[spot]

    @precondition(lambda self: self.open())
    @rule(data=st.data())
    def reject(self, data: st.DataObject) -> None:
        spot = data.draw(st.sampled_from(self.open()))
        self.place.proposals.reject(self.name(spot))
        self.model[spot] = self.model[spot]._replace(state="rejected")
        self.written = self.floor, dict(self.model)

    @rule(spot=st.sampled_from(sorted(SPOTS)))
    def propose(self, spot: int) -> None:
        """Somebody proposes what stands there, seen already or not."""
        (x, y), who = self.at(spot, spot in self.moved), "D"
        outline = [(x + dx, y + dy) for dx, dy in CHAIR]
        if not self.unmapped({spot}):
            with pytest.raises(InvalidElement if self.floor else UnknownElement):
                self.place.proposals.propose(self.floor, outline, 0.8, who)
            return
        self.place.proposals.propose(self.floor, outline, 0.8, who)
        before = self.known(spot)
        self.model[spot] = before._replace(robots=before.robots | {who}, last=self.now, state="open")
        self.written = self.floor, dict(self.model)

    @precondition(lambda self: self.open())
    @rule(data=st.data())
    def accept(self, data: st.DataObject) -> None:
        """As the map editor does: the object is drawn, and it follows."""
        spot = data.draw(st.sampled_from(self.open()))
        proposal = self.place.proposals.find(self.name(spot))
        self.edit(self.building.with_element(proposal.floor, proposal.element))
        with pytest.raises(UnknownElement):
            self.place.proposals.find(proposal.name)

    @precondition(lambda self: self.floor)
    @rule(spot=st.sampled_from(sorted(SPOTS)), name=st.sampled_from(("desk", "seen 1", "seen 2")))
    def draw(self, spot: int, name: str) -> None:
        """Somebody draws an object there, also by the name of a proposal."""
        drawn = MapObject(name, BoxShape((0.6, 0.6)), self.at(spot, spot in self.moved))
        self.edit(self.building.with_element(self.floor, drawn))

    @precondition(lambda self: self.mapped())
    @rule(data=st.data())
    def remove(self, data: st.DataObject) -> None:
        name = data.draw(st.sampled_from(sorted(self.building.floors[self.floor].geometrical.objects)))
        self.edit(self.building.without(ElementKind.OBJECT, self.floor, name))

    @rule()
    def edit_something_else(self) -> None:
        self.edit(self.building.with_element("", Floor("L5", 5, 20.0 + self.version)))

    @precondition(lambda self: self.floor)
    @rule(name=st.sampled_from(("L1", "ground")))
    def rename_floor(self, name: str) -> None:
        state = EditorState(self.building, self.version, {}, 0)
        key = ElementKey(ElementKind.FLOOR, "", self.floor)
        changes = rename_changes(state, key, name, state.version_of(key))
        self.floor = name
        self.edit(apply(self.building, changes), changes)

    @rule(name=st.sampled_from(("", "L1", "ground")))
    def remove_or_add_floor(self, name: str) -> None:
        """One that is added after the removal is another one, also by the same name."""
        building, changes = self.building, []
        if self.floor:
            before = building.floors[self.floor].floor
            changes.append(Change(self.version + 1, ElementKey(ElementKind.FLOOR, "", self.floor), before, None))
            building = building.without(ElementKind.FLOOR, "", self.floor)
        if name:
            added = Floor(name, 1, 0.0)
            changes.append(Change(self.version + 2, ElementKey(ElementKind.FLOOR, "", name), None, added))
            building = building.with_element("", added)
        self.floor, self.model = name, {}
        self.edit(building, changes)

    @rule()
    def save(self) -> None:
        self.place.proposals.save()
        written = len(self.place.written)
        self.place.proposals.save()
        assert len(self.place.written) == written, "nothing has changed since"
        self.written = self.floor, dict(self.model)

    @rule()
    def kill_and_restart(self) -> None:
        """What was decided is there again; of what robots have seen since the last `save` nothing is. A floor that was
        renamed since then has nothing."""
        self.place = Place(self.building, self.place.written[-1], now=self.now)
        floor, model = self.written
        self.model = {
            spot: known._replace(since=self.now, last=self.now)
            for spot, known in model.items()
            if known.state != "new" and floor == self.floor and (spot, known.is_moved) not in self.mapped()
        }

    def edit(self, building: Building, changes: Sequence[Change] = ()) -> None:
        self.building, self.version = building, self.version + 2
        self.place.proposals.follow(building, self.version, changes)
        mapped = self.mapped()
        self.model = {spot: known for spot, known in self.model.items() if (spot, known.is_moved) not in mapped}

    @property
    def now(self) -> float:
        return self.place.clock.now

    def at(self, spot: int, is_moved: bool) -> XY:
        x, y = SPOTS[spot]
        return x + MOVED_M * is_moved, y

    def known(self, spot: int) -> Known:
        """What was known of a chair that is seen. Nothing is if it was moved."""
        is_moved = spot in self.moved
        found = self.model.get(spot)
        return found if found and found.is_moved is is_moved else Known(set(), self.now, self.now, "new", is_moved)

    def mapped(self) -> set[tuple[int, bool]]:
        entry = self.building.floors.get(self.floor)
        places = [each.at for each in entry.geometrical.objects.values()] if entry else []
        stand = product(SPOTS, (False, True))
        return {each for each in stand if any(math.dist(self.at(*each), place) < 0.1 for place in places)}

    def unmapped(self, spots: set[int]) -> set[int]:
        """Where the floor is there, and no object of it."""
        mapped = self.mapped()
        return {spot for spot in spots if self.floor and (spot, spot in self.moved) not in mapped}

    def open(self) -> list[int]:
        return sorted(spot for spot, known in self.model.items() if known.state == "open")

    def place_of(self, spot: int) -> XY:
        return self.at(spot, self.model[spot].is_moved)

    def name(self, spot: int) -> str:
        found = self.place.proposals.open()
        return next(each.name for each in found if math.dist(each.element.at, self.place_of(spot)) < 0.1)

    @invariant()
    def the_open_ones_are_those_of_the_model(self) -> None:
        found = {each.element.at[0]: each for each in self.place.proposals.open()}
        assert sorted(found) == pytest.approx([self.place_of(spot)[0] for spot in self.open()])
        for spot, proposal in zip(self.open(), (found[x] for x in sorted(found)), strict=True):
            known = self.model[spot]
            assert (set(proposal.seen_by), proposal.floor) == (known.robots, self.floor)
            assert proposal.unseen_s == pytest.approx(self.now - known.last)

    @invariant()
    def paths_are_planned_around_the_map_and_the_open_ones(self) -> None:
        proposed = {each.name: each.element for each in self.place.proposals.open()}
        assert self.place.planned[-1].floors.keys() == self.building.floors.keys()
        if self.floor:
            drawn = dict(self.building.floors[self.floor].geometrical.objects)
            assert not drawn.keys() & proposed.keys()
            assert self.place.objects(self.floor) == {**drawn, **proposed}


ProposalMachine.TestCase.settings = settings(max_examples=25, stateful_step_count=30, deadline=None)
TestProposals = ProposalMachine.TestCase
