"""Judges the planner's answers to requests with all their options by shapely, scipy and networkx; see plain_plan.py.

Every path must obey what path_planner.idl says of its mode. A refusal must be justified: the judge refutes it only with
a path that exists by any reading of the rules."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

from shapely import LineString, Point

from robocorba.errors.paths import NoPath, NotFree
from robocorba.map_editor.geometry import shaft_polygon
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Criterion, Path, PathPoint, PathRequest, Place, PointKind, RouteMode
from tests.planning.plain_plan import TOLERANCE_M, FloorPlan, Plan
from tests.planning.visibility import VisibilityGraph

#: Tolerance of costs [m or s]: a strip beside an edge that is 1 um narrower makes a drive at 0.2 m/s faster.
COST_TOLERANCE = 1e-4
NOWHERE = Place("", 0.0, 0.0)


class Verdict(NamedTuple):
    """What is wrong with the planner's answer. outcome: found, NoPath, NotFree or the name of another exception.
    length_m: of the best path, 0 without one."""

    outcome: str
    objections: tuple[str, ...]
    length_m: float = 0.0


class Judge:
    """Judges answers for one building."""

    def __init__(self, building: Building) -> None:
        self.building = building
        self._floors: dict[PathRequest, dict[str, FloorPlan]] = {}
        self._exact: dict[float, VisibilityGraph] = {}

    def plan(self, request: PathRequest) -> Plan:
        """The building for a request."""
        options = request._replace(start=NOWHERE, goal=NOWHERE, alternatives=0)
        options = options._replace(mode=RouteMode.SMOOTHED, best=Criterion.SHORTEST_DISTANCE)
        if options not in self._floors:
            self._floors[options] = {name: FloorPlan(self.building, name, options) for name in self.building.floors}
        return Plan(self.building, request, self._floors[options])

    def fits(self, place: Place, radius_m: float) -> bool:
        """Whether a robot of a radius fits at a place."""
        return self.plan(PathRequest(place, place, radius=radius_m)).fits(place, -TOLERANCE_M)

    def verdict(self, planner: PathPlanner, request: PathRequest) -> Verdict:
        """Query the planner and judge its answer."""
        plan = self.plan(request)
        try:
            paths = planner.paths(request)
        except NotFree as refusal:
            place = request.start if refusal.which == "start" else request.goal
            return Verdict("NotFree", ("NotFree, but the robot fits",) if plan.fits(place, TOLERANCE_M) else ())
        except NoPath:
            return Verdict("NoPath", tuple(_refused_wrongly(plan)))
        except Exception as error:  # the planner must not raise any other exception
            return Verdict(type(error).__name__, (repr(error)[:200],))
        found = [f"path {i}: {text}" for i, path in enumerate(paths) for text in _wrong(plan, path)]
        return Verdict("found", (*found, *_costs(planner, plan, paths)), paths[0].distance)

    def exact_length(self, request: PathRequest) -> float:
        """Length of the shortest path by a visibility graph [m]; NaN if the graph cannot decide.

        For small buildings: it takes a second for 300 corners a floor."""
        if request.radius not in self._exact:
            self._exact[request.radius] = VisibilityGraph(self.building, request.radius)
        return self._exact[request.radius].length(request.start, request.goal)


def errors(building: Building, path: Path, request: PathRequest) -> list[str]:
    """What is wrong with a path, one sentence for each."""
    return list(_wrong(Judge(building).plan(request), path))


# Refusals.


def _refused_wrongly(plan: Plan) -> Iterator[str]:
    request = plan.request
    if request.mode is not RouteMode.GEOMETRIC and plan.certain_road():
        yield "NoPath, but the roads lead there"
    if not on_roads(request) and plan.certain_way():
        yield "NoPath, but free space leads there"


def on_roads(request: PathRequest) -> bool:
    return request.mode is RouteMode.TOPOLOGICAL or (request.mode is RouteMode.SMOOTHED and bool(request.graph))


# Costs.


def cost(request: PathRequest, path: Path) -> float:
    return path.duration if request.best is Criterion.SHORTEST_TIME else path.distance


def _costs(planner: PathPlanner, plan: Plan, paths: list[Path]) -> Iterator[str]:
    request = plan.request
    costs = [cost(request, path) for path in paths]
    if len(paths) > 1 + request.alternatives:
        yield f"{len(paths)} paths, {request.alternatives} alternatives asked"
    if costs != sorted(costs):
        yield f"the paths are not sorted: {costs}"
    if len({tuple(point[1:5] for point in path.points) for path in paths}) < len(paths):
        yield "two paths are the same"
    if request.alternatives:
        (alone, *_) = planner.paths(request._replace(alternatives=0))
        if costs[0] > cost(request, alone) + 1e-9:  # another road may be shorter once its corners are cut
            yield f"with alternatives the best costs {costs[0]}, without {cost(request, alone)}"
    if request.mode is RouteMode.GEOMETRIC:
        try:
            smoothed = cost(request, planner.paths(request._replace(mode=RouteMode.SMOOTHED, graph=""))[0])
        except (NotFree, NoPath):
            return
        if costs[0] > smoothed + COST_TOLERANCE:
            yield f"costs {costs[0]}, smoothed {smoothed}"
    else:
        expected = plan.road_cost()
        if expected is None or expected == math.inf:
            return
        if on_roads(request) and not math.isclose(costs[0], expected, rel_tol=0.0, abs_tol=COST_TOLERANCE):
            yield f"costs {costs[0]}, by networkx {expected}"
        if costs[0] > expected + COST_TOLERANCE:
            yield f"costs {costs[0]}, along the roads {expected}"
    start, goal = request.start, request.goal
    if not on_roads(request) and plan.is_straight(request.mode is not RouteMode.GEOMETRIC):
        length = math.dist(start[1:], goal[1:])
        best = length / request.speed if request.best is Criterion.SHORTEST_TIME else length
        if costs[0] > best + COST_TOLERANCE:
            yield f"costs {costs[0]}, straight {best}"


# Paths.


def _wrong(plan: Plan, path: Path) -> Iterator[str]:
    points, request = path.points, plan.request
    for point, place, kind in ((points[0], request.start, PointKind.START), (points[-1], request.goal, PointKind.GOAL)):
        if point.kind is not kind or Place(point.floor, point.x, point.y) != place:
            yield f"the {kind.name.lower()} is {point}"
    driven = seconds = 0.0
    for a, b in pairwise(points):
        where = f"{a.floor}:{a.x:.3f},{a.y:.3f} to {b.floor}:{b.x:.3f},{b.y:.3f}"
        if a.kind is PointKind.ELEVATOR_ENTRY:
            yield from (f"{where}: {text}" for text in _wrong_ride(plan, a, b))
            driven += abs(plan.height[a.floor] - plan.height[b.floor])
            if a.elevator in plan.building.elevators:
                seconds += sum(plan.ride_s(plan.building.elevators[a.elevator], a.floor, b.floor))
        elif a.floor != b.floor:
            yield f"{where}: changes the floor without an elevator"
        else:
            at, to = (a.x, a.y), (b.x, b.y)
            if not plan.floors[a.floor].is_free(at, to, -TOLERANCE_M):
                yield f"{where}: {plan.floors[a.floor].clearance(at, to):.4f} m clearance"
            driven += math.dist(at, to)
            least = math.dist(at, to) / request.speed
            if request.mode is not RouteMode.GEOMETRIC:
                faults, least = _judged_drive(plan, a, b)
                yield from (f"{where}: {text}" for text in faults)
            took = b.time - a.time
            if took < least * (1 - 1e-6) - 1e-6:
                yield f"{where}: takes {took:.3f} s, at least {least:.3f} s needed"
            if request.mode is RouteMode.GEOMETRIC and took > least + 1e-6:
                yield f"{where}: takes {took:.3f} s instead of {least:.3f} s"
            seconds += took
        if not b.distance >= a.distance - 1e-12 or not b.time >= a.time - 1e-12 or not math.isfinite(b.heading):
            yield f"{where}: distance or time falls, or a value is not finite"
        node = plan.floors[b.floor].nodes.get(b.node)
        if b.node and (node is None or math.dist(node.at, (b.x, b.y)) > 1e-9):
            yield f"{where}: node {b.node!r} is elsewhere"
        if not math.isclose(driven, b.distance, rel_tol=1e-9, abs_tol=1e-6):
            yield f"{where}: {driven} m, {b.distance} m reported"
    if not math.isclose(seconds, path.duration, rel_tol=1e-9, abs_tol=1e-6):
        yield f"{seconds} s, {path.duration} s reported"
    if on_roads(request):
        yield from _off_roads(plan, points)


def _wrong_ride(plan: Plan, a: PathPoint, b: PathPoint) -> Iterator[str]:
    lift = plan.building.elevators.get(a.elevator)
    if lift is None or b.kind is not PointKind.ELEVATOR_EXIT or a.elevator != b.elevator:
        yield f"rides in {a.elevator!r}, then {b.kind.name} {b.elevator!r}"
        return
    if lift.name in plan.request.avoid_elevators:
        yield f"rides in {lift.name}, which the request avoids"
    if not {a.floor, b.floor} <= {door.floor for door in lift.doors}:
        yield f"{lift.name} does not serve both floors"
    if math.dist((a.x, a.y), (b.x, b.y)) > TOLERANCE_M:
        yield f"moves by {math.dist((a.x, a.y), (b.x, b.y)):.3f} m during the ride"
    if shaft_polygon(lift).distance(Point(a.x, a.y)) > TOLERANCE_M:
        yield f"rides outside of the shaft of {lift.name}"


def _judged_drive(plan: Plan, a: PathPoint, b: PathPoint) -> tuple[list[str], float]:
    """The rules that a drive breaks, and its least time [s]. What lies on usable edges is judged by their rules, the
    rest by the edges that it follows."""
    floor, speed = plan.floors[a.floor], plan.request.speed
    at, to = (a.x, a.y), (b.x, b.y)
    length = math.dist(at, to)
    if length < 1e-9:
        return [], 0.0
    roads = sorted(_roads_below(plan, floor, at, to), reverse=True)
    spans: list[tuple[float, float, float]] = [(0.0, length, 0.0)]
    for limit, low, high in roads:  # the fastest first: it is the planner's choice
        spans = [
            piece
            for x, y, known in spans
            for piece in (
                ((x, min(y, low), known), (max(x, low), min(y, high), limit), (max(x, high), y, known))
                if known == 0.0
                else ((x, y, known),)
            )
            if piece[1] > piece[0] + 1e-9
        ]
    faults, least = [], 0.0
    for x, y, limit in spans:
        if limit:
            is_followed = (a.node and b.node) or y - x > 2 * plan.request.radius + TOLERANCE_M
            least += (y - x) / (min(speed, limit) if is_followed else speed)
            continue
        ends = [
            (at[0] + share * (to[0] - at[0]), at[1] + share * (to[1] - at[1])) for share in (x / length, y / length)
        ]
        for lane, direction, _ in floor.followed(*ends):
            if lane.is_closed(direction, plan.request.radius):
                (px, py), (qx, qy) = lane.line.coords
                faults.append(
                    f"follows the edge {px:.2f},{py:.2f} - {qx:.2f},{qy:.2f}, closed in direction {direction}"
                )
        least += floor.slowest(*ends)
    return faults, least


def _roads_below(plan: Plan, floor: FloorPlan, at: XY, to: XY) -> Iterator[tuple[float, float, float]]:
    """The usable edges that lie on a drive, in its direction: limit [m/s], and where they begin and end [m]."""
    length = math.dist(at, to)
    if length < 1e-9:
        return
    ux, uy = (to[0] - at[0]) / length, (to[1] - at[1]) / length
    for edge in floor.edges:
        ends = [floor.nodes[name].at for name in (edge.a, edge.b)]
        if any(abs((y - at[1]) * ux - (x - at[0]) * uy) > 1e-6 for x, y in ends):
            continue
        first, last = ((x - at[0]) * ux + (y - at[1]) * uy for x, y in ends)
        if (edge.one_way and last < first) or not floor.is_open(edge):
            continue
        low, high = max(min(first, last), 0.0), min(max(first, last), length)
        if high - low > 1e-9 and min(first, last) > -1e-6 and max(first, last) < length + 1e-6:
            yield edge.speed_limit or math.inf, low, high


def _off_roads(plan: Plan, points: list[PathPoint]) -> Iterator[str]:
    """Where a path leaves the roads between its first and its last node, and ties that cross closed edges."""
    named = [i for i, point in enumerate(points) if point.node]
    if not named:
        yield "reaches no node"
        return
    for a, b in pairwise(points[named[0] : named[-1] + 1]):
        if a.kind is PointKind.ELEVATOR_ENTRY or (a.x, a.y) == (b.x, b.y):
            continue
        if not (a.node and b.node):
            lifts = [shaft_polygon(lift) for lift in plan.building.elevators.values()]
            if not any(lift.distance(Point(end.x, end.y)) < 1e-6 for lift in lifts for end in (a, b)):
                yield f"leaves the roads between {a} and {b}"
            continue
        edges = [
            edge
            for edge in plan.floors[a.floor].edges
            if ((edge.a, edge.b) == (a.node, b.node) or (not edge.one_way and (edge.b, edge.a) == (a.node, b.node)))
            and plan.floors[a.floor].is_open(edge)
        ]
        if not edges:
            yield f"no open edge leads from {a.node} to {b.node}"
    for tie, place in ((points[: named[0] + 1], points[0]), (points[named[-1] :], points[-1])):
        for a, b in pairwise(tie):
            if plan.floors[place.floor].crosses_closed((place.x, place.y), (a.x, a.y), (b.x, b.y)):
                yield f"the tie {LineString([(a.x, a.y), (b.x, b.y)])} crosses a closed edge"
