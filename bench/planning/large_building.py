"""Paths in a building of 100,000 nodes over 10 floors: the planner compared to networkx's A*, and getPath over IIOP.

networkx gets the same graph and the same connections of start and goal; only its search is timed, but the planner's
whole query. networkx searches twice: with the straight line and the climb as the heuristic, which is its usual use,
and with the planner's heuristic over the best elevator. All must find the same cost, or the bench fails.
"""

from __future__ import annotations

import contextlib
import gc
import math
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from itertools import permutations
from pathlib import Path
from typing import Any, NamedTuple

import networkx as nx
import numpy as np
import psutil
import shapely
from rich.progress import track
from shapely import LineString, STRtree

from bench import RESULTS
from bench.common.buildings import grid_building
from bench.common.places import random_trips
from robocorba.clients.robot_processes import servers
from robocorba.corba.orb import Orb
from robocorba.errors.paths import NoPath
from robocorba.maps import native
from robocorba.maps.geometry import obstacles
from robocorba.maps.model import Building
from robocorba.planning.elevators import ride
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import PathRequest, Place, RouteMode
from robocorba.spatial.pose import SMARTPAL_RADIUS_M
from robocorba.stubs import RoboCorba
from robocorba.supervision.folder import StateFolder
from robocorba.testing.report import PROGRESS, quantile, summarize_samples, timed_ms

ROUNDS, TRIPS = 5, 300
#: networkx is slow: it gets one in this many trips.
PEER_EVERY = 3
#: Least ratio of the medians, and greatest median [ms].
MIN_RATIO, MAX_MEDIAN_MS = 10.0, 5.0
#: Time limit for the start of the server [s]: a map of 16 MB takes long on a slow machine.
START_LIMIT_S = "600"

#: The planner's rule for connections to the roadmap; see robocorba.planning.search.
MAX_CONNECTIONS, CONNECTION_REACH_M, MAX_CANDIDATES, ON_NODE_M = 8, 6.0, 256, 0.01

Trip = tuple[Place, Place]
Node = tuple[str, str]
START, GOAL = ("", "start"), ("", "goal")


def main() -> None:
    with PROGRESS.status("making the building, its planner and the graph for networkx"):
        building = grid_building()
        trips = random_trips(building, SMARTPAL_RADIUS_M, ROUNDS * TRIPS, seed=3)
        planner = PathPlanner(building)
        planner.warm_up()
        peer = Peer(building, SMARTPAL_RADIUS_M)
        # Otherwise the garbage collector visits millions of objects during a query.
        gc.collect()
        gc.freeze()
    missed = in_process(planner, peer, trips)
    del planner, peer
    missed += over_iiop(building, trips)
    if missed:
        sys.exit("large_building: " + "; ".join(missed))


def in_process(planner: PathPlanner, peer: Peer, trips: Sequence[Trip]) -> list[str]:
    """The planner and networkx alternately, on the shortest path along the topological map. Returns the missed
    marks."""
    rows = []
    fast: list[float] = []
    slow: list[float] = []
    informed: list[float] = []
    ratios = []
    for round_ in range(ROUNDS):
        ours: list[float] = []
        both: list[float] = []
        theirs: list[float] = []
        best_theirs: list[float] = []
        of_round = trips[round_ * TRIPS : (round_ + 1) * TRIPS]
        for i, trip in enumerate(track(of_round, f"round {round_ + 1} of {ROUNDS}", console=PROGRESS, transient=True)):
            cost, took_ms = timed_ms(_cost, planner, *trip)
            ours.append(took_ms)
            if i % PEER_EVERY == 0:
                both.append(took_ms)
                for knows_elevators, times in ((False, theirs), (True, best_theirs)):
                    expected, peer_ms = peer.cheapest(*trip, knows_elevators)
                    if not math.isclose(cost, expected, rel_tol=1e-9):
                        sys.exit(f"large_building: {trip} costs {cost} m, by networkx {expected} m")
                    times.append(peer_ms)
        ratios.append(statistics.median(theirs) / statistics.median(both))
        fast += ours
        slow += theirs
        informed += best_theirs
        rows.append(
            {
                "round": round_ + 1,
                "trips": len(ours),
                "planner median ms": statistics.median(ours),
                "planner p99 ms": quantile(ours, 0.99),
                "networkx's trips": len(theirs),
                "networkx median ms": statistics.median(theirs),
                "networkx p99 ms": quantile(theirs, 0.99),
                "ratio of medians": ratios[-1],
                "of totals": sum(theirs) / sum(both),
                "with our estimate": statistics.median(best_theirs) / statistics.median(both),
            }
        )
    median, ratio = statistics.median(fast), statistics.median(ratios)
    title = f"100,000 nodes, 10 floors: {median:.2f} ms at the median, networkx {ratio:.1f} x as long"
    samples = {"RoboCorba": fast, "networkx A*": slow, "networkx A* with our estimate": informed}
    summarize_samples(RESULTS / "large_building", title, rows, samples, "milliseconds")
    return [
        *([f"the planner's median is above {MAX_MEDIAN_MS:g} ms"] if median > MAX_MEDIAN_MS else []),
        *([f"networkx takes less than {MIN_RATIO:g} x as long"] if ratio < MIN_RATIO else []),
    ]


def _cost(planner: PathPlanner, start: Place, goal: Place) -> float:
    """Metres along the topological map, infinite if there is no path."""
    try:
        return planner.paths(PathRequest(start, goal, mode=RouteMode.TOPOLOGICAL))[0].distance
    except NoPath:
        return math.inf


class Floor(NamedTuple):
    """A floor for the peer: its nodes, obstacles, one-way edges, and the strips beside these."""

    names: list[str]
    xy: np.ndarray
    blocked: STRtree
    lanes: list[LineString]
    strips: STRtree


class Peer:
    """networkx's A* on the topological maps of a building, for one robot radius [m]."""

    def __init__(self, building: Building, radius: float) -> None:
        self.radius = radius
        self.graph: nx.DiGraph[Node] = nx.DiGraph()
        self.at: dict[Node, tuple[float, float]] = {GOAL: (0.0, 0.0)}
        self.heights = {name: entry.floor.elevation for name, entry in building.floors.items()}
        #: Places of the nodes in cabins, by floor.
        self.cabins: dict[str, list[tuple[float, float]]] = {name: [] for name in building.floors}
        self.floors = {name: self._add_floor(building, name) for name in building.floors}
        self._add_rides(building)

    def _add_floor(self, building: Building, floor: str) -> Floor:
        topological = building.floors[floor].topological
        blocked = STRtree([item.geometry for item in obstacles(building, floor)])
        nodes, edges = topological.nodes, list(topological.edges.values())
        for node in nodes.values():
            self.at[floor, node.name] = node.at
            self.graph.add_node((floor, node.name))
            if node.elevator:
                self.cabins[floor].append(node.at)
        lines = shapely.linestrings([[nodes[edge.a].at, nodes[edge.b].at] for edge in edges])
        narrow = set(blocked.query(lines, "dwithin", self.radius - 1e-9)[0].tolist())
        for i, edge in enumerate(edges):
            if i in narrow or 0.0 < edge.clearance < self.radius:
                continue
            a, b, length = (floor, edge.a), (floor, edge.b), float(lines[i].length)
            self.graph.add_edge(a, b, length=length)
            if not edge.one_way:
                self.graph.add_edge(b, a, length=length)
        lanes = [line for line, edge in zip(lines, edges, strict=True) if edge.one_way]
        strips = STRtree([lane.buffer(self.radius, cap_style="flat") for lane in lanes])
        return Floor(list(nodes), np.array([node.at for node in nodes.values()]), blocked, lanes, strips)

    def _add_rides(self, building: Building) -> None:
        for name, elevator in building.elevators.items():
            stops = [
                (floor, node.name)
                for floor in elevator.floors()
                for node in building.floors[floor].topological.nodes.values()
                if node.elevator == name
            ]
            for a, b in permutations(stops, 2):
                self.graph.add_edge(a, b, length=ride(building, elevator, a[0], b[0]).climb)

    def cheapest(self, start: Place, goal: Place, knows_elevators: bool) -> tuple[float, float]:
        """Length of the shortest path [m], infinite if there is none, and the search time of networkx [ms]."""
        graph = self.graph
        graph.add_nodes_from([START, GOAL])
        for node, length in self.connections(start, outbound=True):
            graph.add_edge(START, node, length=length)
        for node, length in self.connections(goal, outbound=False):
            graph.add_edge(node, GOAL, length=length)
        heuristic = self._estimate(goal) if knows_elevators else self._straight_line(goal)
        began = time.perf_counter()
        try:
            path = nx.astar_path(graph, START, GOAL, heuristic=heuristic, weight="length")
            took_ms = (time.perf_counter() - began) * 1e3
            return nx.path_weight(graph, path, "length"), took_ms
        except nx.NetworkXNoPath:
            return math.inf, (time.perf_counter() - began) * 1e3
        finally:
            graph.remove_nodes_from([START, GOAL])

    def _straight_line(self, goal: Place) -> Callable[[Node, Node], float]:
        """The straight line to the goal and the climb: admissible, because rides count their climb."""
        at, hypot, (goal_floor, gx, gy) = self.at, math.hypot, goal
        climbs = {floor: abs(height - self.heights[goal_floor]) for floor, height in self.heights.items()}

        def heuristic(node: Node, _: Node) -> float:
            if node is GOAL:
                return 0.0
            x, y = at[node]
            return hypot(x - gx, y - gy) + climbs.get(node[0], 0.0)

        return heuristic

    def _estimate(self, goal: Place) -> Callable[[Node, Node], float]:
        """The straight line on the goal's floor; elsewhere over the best cabin of this floor, and the climb.

        Admissible, because an elevator is at the same place on every floor."""
        at, hypot, (goal_floor, gx, gy) = self.at, math.hypot, goal
        climbs = {floor: abs(height - self.heights[goal_floor]) for floor, height in self.heights.items()}
        onward = {
            floor: [(x, y, climbs[floor] + hypot(x - gx, y - gy)) for x, y in cabins]
            for floor, cabins in self.cabins.items()
        }

        def heuristic(node: Node, _: Node) -> float:
            if node is GOAL:
                return 0.0
            x, y = at[node]
            if node[0] == goal_floor:
                return hypot(x - gx, y - gy)
            return min([hypot(x - cx, y - cy) + rest for cx, cy, rest in onward[node[0]]])

        return heuristic

    def connections(self, place: Place, outbound: bool) -> list[tuple[Node, float]]:
        """The nodes that a place is connected to, nearest first, and their distances [m]."""
        floor, here = self.floors[place.floor], place[1:]
        away = np.hypot(*(floor.xy - here).T)
        found: list[tuple[Node, float]] = []
        for i in np.argsort(away)[:MAX_CANDIDATES]:
            length = float(away[i])
            if len(found) == MAX_CONNECTIONS or (found and length > found[0][1] + CONNECTION_REACH_M):
                break
            line = LineString([here, floor.xy[i]] if outbound else [floor.xy[i], here])
            if len(floor.blocked.query(line, "dwithin", self.radius - 1e-9)) or self._is_wrong_way(floor, line):
                continue
            found.append(((place.floor, floor.names[i]), length))
            if length < ON_NODE_M:
                break
        return found

    def _is_wrong_way(self, floor: Floor, line: LineString) -> bool:
        """Whether a drive goes back beside a one-way edge for more than the robot's diameter."""
        for i in floor.strips.query(line, "intersects"):
            lane = floor.lanes[i]
            shared = shapely.get_coordinates(line.intersection(floor.strips.geometries[i]))
            along = [lane.project(shapely.Point(point)) for point in shared]
            ahead = np.dot(*(np.diff(shapely.get_coordinates(drive), axis=0)[0] for drive in (line, lane)))
            if ahead < 0 and max(along) - min(along) > 2 * self.radius:
                return True
        return False


def over_iiop(building: Building, trips: Sequence[Trip]) -> list[str]:
    """getPath of a real server, compared to a null call; start-up time and memory of the server.

    Returns the missed marks."""
    rows = []
    null: list[float] = []
    path: list[float] = []
    with tempfile.TemporaryDirectory(prefix="robocorba-bench-") as folder:
        file, state = Path(folder) / "grid.yaml", Path(folder) / "state"
        with PROGRESS.status("writing the map file"):
            native.save(building, file)
        for origin in ("map file", "store"):  # the second start restores the building from the state folder
            began = time.monotonic()
            with servers(state, "--building", str(file), "--start-limit", START_LIMIT_S) as naming, Orb(naming) as orb:
                start_s = time.monotonic() - began
                planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
                server = _map_editor(state)
                idle = server.memory_info().rss
                null, path, lengths = _ask(planner, trips, f"getPath, started from the {origin}")
                rows.append(
                    {
                        "started from": origin,
                        "s to ready": start_s,
                        "memory MB": idle / 1e6,
                        "MB after paths": server.memory_info().rss / 1e6,
                        "paths": len(path),
                        "points, mean": statistics.mean(lengths),
                        "null call, median ms": statistics.median(null),
                        "getPath, median ms": statistics.median(path),
                        "getPath, p99 ms": quantile(path, 0.99),
                    }
                )
    median = statistics.median(path)
    title = f"getPath over IIOP, 100,000 nodes, 10 floors: {median:.2f} ms at the median"
    summarize_samples(
        RESULTS / "large_building_server", title, rows, {"null call": null, "getPath": path}, "milliseconds"
    )
    return [f"getPath's median over IIOP is above {MAX_MEDIAN_MS:g} ms"] if median > MAX_MEDIAN_MS else []


def _ask(planner: Any, trips: Sequence[Trip], title: str) -> tuple[list[float], list[float], list[int]]:
    """The ms of a null call and of a getPath alternately, and the number of points of each path."""
    null, path, lengths = [], [], []
    for start, goal in track(trips, title, console=PROGRESS, transient=True):
        null.append(timed_ms(planner._non_existent)[1])
        with contextlib.suppress(RoboCorba.NoPath):
            points, took_ms = timed_ms(planner.getPath, RoboCorba.Point(*start), RoboCorba.Point(*goal))
            path.append(took_ms)
            lengths.append(len(points))
    return null, path, lengths


def _map_editor(state: Path) -> psutil.Process:
    """The server's process."""
    record = StateFolder(state).read_record()
    assert record is not None
    return psutil.Process(next(process.pid for process in record.processes if process.name == "map_editor"))


if __name__ == "__main__":
    main()
