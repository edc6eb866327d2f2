"""Proposals to the map editor: obstacles that several robots have seen and no map has.

A thing is proposed once two robots have seen it at one place for a moment: who walks by is not. A proposal is open
until somebody accepts or rejects it, its object is drawn, or nobody confirms it any more. Meanwhile paths lead around
it, since the path planning agent plans on the building with the proposed objects."""

from __future__ import annotations

import functools
import logging
import math
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import msgspec
import numpy as np
import shapely
from shapely import STRtree
from shapely.geometry.base import BaseGeometry

from robocorba.errors.maps import InvalidElement, UnknownElement
from robocorba.map_editor.author_history import author_violations
from robocorba.map_editor.changes import Change
from robocorba.map_editor.edits import MapChange
from robocorba.map_editor.element_rules import violations
from robocorba.map_editor.geometry import Obstacle, obstacles
from robocorba.map_editor.lineage import Lineage
from robocorba.map_editor.model import Building, ElementKind, MapObject, PolygonShape
from robocorba.map_editor.sightings import SAME_THING_M, SeenObstacle, corners, same_things, shape_of
from robocorba.map_editor.spatial.pose import XY
from robocorba.system.decoding import decode_json


class ProposalPolicy(NamedTuple):
    """When things are proposed, and for how long.

    standing_s: for which robots must see a thing at one place before it is proposed [s]. certainty: that they must have
    together. moved_m: how far its middle may deviate, since robots see more and more of it [m]. kept_s: how long a
    proposal stays that nobody confirms [s]. rejected_s: how long a rejected thing is not proposed again after it was
    seen [s]. most: number of things. accept_robots, accept_s: number of robots that must have seen a
    proposal, and its age [s], to be accepted by rule; 0 robots: none is."""

    standing_s: float = 3.0
    certainty: float = 0.5
    moved_m: float = 0.35
    kept_s: float = 300.0
    rejected_s: float = 3600.0
    most: int = 200
    accept_robots: int = 0
    accept_s: float = 0.0


DEFAULT_POLICY = ProposalPolicy()
#: Number of robots whose views of a thing are kept, the last ones.
MAX_VIEWS = 20
_log = logging.getLogger(__name__)


class Proposal(NamedTuple):
    """An object on offer. name: what the object would be called. outline: around all that was seen of it [m].
    certainty: 0 to 1. age_s, unseen_s: since it was proposed, and since it was seen [s]."""

    name: str
    floor: str
    outline: tuple[XY, ...]
    certainty: float
    seen_by: tuple[str, ...]
    age_s: float
    unseen_s: float

    @property
    def element(self) -> MapObject:
        """The object that it proposes. It can't be pushed, as far as anybody knows."""
        middle = shapely.Polygon(self.outline).centroid
        points = tuple((x - middle.x, y - middle.y) for x, y in self.outline)
        return MapObject(self.name, PolygonShape(points), (middle.x, middle.y))


class Thing(msgspec.Struct):
    """Something that robots see at one place. views: the last one of each robot. first, outline: of what was seen where
    it stands at first, and of all of it [m]. Times are monotonic [s]: since when it stands there, when it was seen
    last, and when it was proposed, None if it was not."""

    name: str
    floor: str
    views: dict[str, SeenObstacle]
    first: tuple[XY, ...]
    outline: tuple[XY, ...]
    since: float
    seen: float
    proposed: float | None = None
    is_rejected: bool = False

    @property
    def is_open(self) -> bool:
        return self.proposed is not None and not self.is_rejected

    @property
    def shape(self) -> BaseGeometry:
        return _polygon(self.outline)

    @property
    def certainty(self) -> float:
        return 1.0 - math.prod(1.0 - view.certainty for view in self.views.values())


class Proposals:
    """Safe from any thread. What `propose` and `reject` have answered is written; what robots see, and new names of
    floors, by the next `save`.

    replan: called with the building, the open proposals' objects in it, and its version, whenever that has changed, in
    order; it must be quick, and neither raise nor call this. stored: what `write` got last before a restart; it may
    raise MapFileError. clock: returns the time [s]."""

    def __init__(
        self,
        snapshot: tuple[Building, int],
        replan: Callable[[Building, int], None] = lambda building, version: None,
        stored: bytes = b"",
        write: Callable[[bytes], None] = lambda content: None,
        policy: ProposalPolicy = DEFAULT_POLICY,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._building, self._version = snapshot
        self._replan, self._write = replan, write
        self._policy, self._clock = policy, clock
        self._lock, self._writing = threading.Lock(), threading.Lock()
        #: By name, in the order in which they were seen first.
        self._things: dict[str, Thing] = {}
        #: Those that paths lead around, as they were when that was planned last.
        self._planned: dict[str, Proposal] = {}
        #: What was proposed: floor, whether it is rejected, and by whom it was seen.
        self._kept: dict[str, tuple[str, bool, list[str]]] = {}
        #: Counts changes of that and of outlines: the last one, and the last one that was written.
        self._edition = self._saved = 0
        #: By floor, the obstacles of the map, and its objects among them.
        self._mapped: dict[str, tuple[Sequence[Obstacle], STRtree]] = {}
        now = clock()
        for thing in _read(stored):
            thing.since = thing.seen = thing.proposed = now
            self._things[thing.name] = thing
        self._settle()
        self._update()

    # ---- what is seen ----

    def correlate(self, seen: Mapping[str, Sequence[SeenObstacle]]) -> None:
        """Take in what two robots, by their names, see at the same time."""
        if len(seen) != 2:  # one robot's events
            return
        (one, ones), (other, others) = seen.items()
        with self._lock:
            for its, theirs in same_things(ones, others):
                self._see(its.floor, {one: its, other: theirs})
            self._update()

    def propose(self, floor: str, outline: Sequence[XY], certainty: float, seen_by: str) -> str:
        """Propose an object, or confirm a proposal, without waiting for others. Returns its name. Raises UnknownElement
        for the floor, InvalidElement, MapFileError."""
        for reason in _wrong(outline, certainty, seen_by):
            raise InvalidElement(ElementKind.OBJECT.value, floor, "proposal", reason)
        middle, hull = (shape := shape_of(outline)).centroid, corners(shape)
        view = SeenObstacle(0, floor, middle.x, middle.y, hull, certainty)
        with self._lock:
            if floor not in self._building.floors:
                raise UnknownElement(ElementKind.FLOOR.value, "", floor)
            thing = self._see(floor, {seen_by: view})
            if thing is None:
                reason = f"the map has an object there, or {self._policy.most} proposals are open"
                raise InvalidElement(ElementKind.OBJECT.value, floor, "proposal", reason)
            thing.proposed, thing.is_rejected = thing.proposed or self._clock(), False
            name = thing.name
            self._update()
        self.save()
        return name

    def _see(self, floor: str, views: dict[str, SeenObstacle]) -> Thing | None:
        """The thing that robots see so; None if the map has it, or too many are known."""
        now, seen = self._clock(), shape_of(point for view in views.values() for point in view.outline)
        if floor not in self._building.floors or self._is_mapped(floor, seen):
            return None
        if thing := self._known(floor, seen):
            if shape_of(thing.first).centroid.distance(seen.centroid) > self._policy.moved_m:
                thing.views, thing.first, thing.since = {}, corners(seen), now
                thing.proposed, thing.is_rejected = None, False
            others = {robot: view for robot, view in thing.views.items() if robot not in views}
            thing.views, thing.seen = dict([*others.items(), *views.items()][-MAX_VIEWS:]), now
            thing.outline = corners(shape_of(point for view in thing.views.values() for point in view.outline))
            return thing
        if len(self._things) >= self._policy.most:
            least = min(self._things.values(), key=lambda each: (each.is_open, each.is_rejected, each.seen))
            if least.is_open:
                return None
            del self._things[least.name]
        outline = corners(seen)
        thing = Thing(self._free_name(), floor, views, outline, outline, now, now)
        self._things[thing.name] = thing
        return thing

    def _known(self, floor: str, seen: BaseGeometry) -> Thing | None:
        """The thing of which a shape can be, the nearest one."""
        here = [thing for thing in self._things.values() if thing.floor == floor]
        shapes = np.array([thing.shape for thing in here], object)
        near = [here[row] for row in np.flatnonzero(shapely.dwithin(shapes, seen, SAME_THING_M))]
        return min(near, key=lambda each: each.shape.centroid.distance(seen.centroid), default=None)

    def _free_name(self) -> str:
        used = set(self._things).union(*(entry.geometrical.objects for entry in self._building.floors.values()))
        return next(name for number in range(1, len(used) + 2) if (name := f"seen {number}") not in used)

    def _is_mapped(self, floor: str, shape: BaseGeometry) -> bool:
        """Whether objects of the map cover most of a shape, with what is at most 0.1 m beside them."""
        beside_m, found = 0.1, obstacles(self._building, floor)
        if floor not in self._mapped or self._mapped[floor][0] is not found:
            objects = [each.geometry for each in found if each.kind == ElementKind.OBJECT.value]
            self._mapped[floor] = found, STRtree(objects)
        tree = self._mapped[floor][1]
        near = tree.geometries[tree.query(shape, "dwithin", beside_m)]
        covered = shapely.union_all(shapely.buffer(near, beside_m)).intersection(shape)
        return bool(covered.area > 0.5 * shape.area)

    # ---- what becomes of it ----

    def open(self) -> list[Proposal]:
        """The open proposals, oldest first."""
        with self._lock:
            return [self._proposal(thing) for thing in self._things.values() if thing.is_open]

    def find(self, name: str) -> Proposal:
        """An open proposal. Raises UnknownElement."""
        with self._lock:
            return self._proposal(self._find(name))

    def reject(self, name: str) -> None:
        """Close a proposal; the thing is not proposed again while robots see it there. Raises UnknownElement,
        MapFileError."""
        with self._lock:
            self._find(name).is_rejected = True
            self._update()
        self.save()

    def due(self) -> list[Proposal]:
        """The proposals that the policy's rule accepts."""
        robots, seconds = self._policy.accept_robots, self._policy.accept_s
        return [one for one in self.open() if robots and len(one.seen_by) >= robots and one.age_s >= seconds]

    def follow(self, building: Building, version: int, changes: Iterable[Change] = ()) -> None:
        """The building was edited: proposals whose object it has now, such as accepted ones, are settled; others stay
        on their floors, whatever these are called now."""
        made = [MapChange(each.version, each.kind, each.floor, each.element) for each in changes]
        names = Lineage(made).floors(building.floors)
        with self._lock:
            self._building, self._version = building, version
            for thing in self._things.values():
                thing.floor = names.get(thing.floor, "")
            self._settle()
            self._update(is_edited=True)

    def end_unseen(self) -> None:
        """Close the proposals that nobody has confirmed for long."""
        with self._lock:
            self._update()

    def save(self) -> None:
        """Write what must outlast a restart, if that has changed since. Raises MapFileError."""
        with self._writing:
            with self._lock:
                edition, kept = self._edition, [each for each in self._things.values() if each.proposed is not None]
                content = msgspec.json.encode(kept) if edition != self._saved else b""
            if content:
                self._write(content)
                self._saved = edition

    def _settle(self) -> None:
        """Forget what the map has now, and leave names to its objects."""
        for thing in list(self._things.values()):
            entry = self._building.floors.get(thing.floor)
            if entry is None or self._is_mapped(thing.floor, thing.shape):
                del self._things[thing.name]
            elif thing.name in entry.geometrical.objects:  # somebody's new one
                del self._things[thing.name]
                thing.name = self._free_name()
                self._things[thing.name] = thing

    def _find(self, name: str) -> Thing:
        thing = self._things.get(name)
        if thing is None or not thing.is_open:
            raise UnknownElement(ElementKind.OBJECT.value, "", name)
        return thing

    def _proposal(self, thing: Thing) -> Proposal:
        now = self._clock()
        age_s, seen_by = now - (thing.proposed or now), tuple(sorted(thing.views))
        return Proposal(thing.name, thing.floor, thing.outline, thing.certainty, seen_by, age_s, now - thing.seen)

    def _update(self, is_edited: bool = False) -> None:
        """Propose what is certain by now, forget what is not seen any more, and plan around the rest."""
        now, policy = self._clock(), self._policy
        for thing in list(self._things.values()):
            kept_s = policy.rejected_s if thing.is_rejected else policy.kept_s
            if now - thing.seen > kept_s:
                del self._things[thing.name]
            elif thing.proposed is None and thing.seen - thing.since >= policy.standing_s:
                thing.proposed = now if thing.certainty >= policy.certainty else None
        known = [thing for thing in self._things.values() if thing.proposed is not None]
        kept = {thing.name: (thing.floor, thing.is_rejected, sorted(thing.views)) for thing in known}
        planned = {thing.name: self._proposal(thing) for thing in known if thing.is_open}
        is_other = _differ(planned, self._planned)
        if is_other or kept != self._kept:
            self._kept, self._edition = kept, self._edition + 1
        if is_edited or is_other:
            self._planned = planned
            objects = [(ElementKind.OBJECT, each.floor, each.name, each.element) for each in planned.values()]
            self._replan(self._building.with_changes(objects) if objects else self._building, self._version)


def _wrong(outline: Sequence[XY], certainty: float, seen_by: str) -> Iterable[str]:
    """Why nothing can be proposed so."""
    yield from violations(MapObject("proposal", PolygonShape(tuple(outline)), (0.0, 0.0)))
    if not 0.0 <= certainty <= 1.0:
        yield f"the certainty is 0 to 1, not {certainty}"
    yield from author_violations("the name of who has seen it", seen_by)


def _read(stored: bytes) -> list[Thing]:
    try:
        return decode_json(stored, list[Thing]) if stored else []
    except msgspec.DecodeError as error:  # robots see what is there again
        _log.warning("the proposals of before the restart are lost: %s", error)
        return []


@functools.lru_cache(maxsize=1000)
def _polygon(outline: tuple[XY, ...]) -> BaseGeometry:
    return shapely.Polygon(outline)


def _differ(some: Mapping[str, Proposal], others: Mapping[str, Proposal]) -> bool:
    """Whether these are other proposals, or an outline differs by more than sensors deviate."""
    outlines = [(each.outline, others[name].outline) for name, each in some.items() if name in others]
    changed = [(_polygon(one), _polygon(other)) for one, other in outlines if one is not other]
    return some.keys() != others.keys() or any(one.hausdorff_distance(other) > 0.03 for one, other in changed)
