"""Paths in a building of 100,000 nodes over 10 floors: the planner compared to networkx's A*, and getPath over IIOP.

networkx gets the same graph and the same connections of start and goal; only its search is timed, but the planner's
whole query. Both must find the same cost, or the bench fails.
"""

from __future__ import annotations

import contextlib
import gc
import math
import statistics
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from itertools import permutations
from typing import Any, NamedTuple

import networkx as nx
import numpy as np
import psutil
import shapely
from shapely import LineString, STRtree

from bench.common.harness import folder_of_bench, progress, run
from robocorba.clients.robot_processes import servers
from robocorba.errors.paths import NoPath
from robocorba.map_editor import native
from robocorba.map_editor.geometry import obstacles
from robocorba.map_editor.model import Building
from robocorba.orb.orb import Orb
from robocorba.planning.elevators import ride
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import SMARTPAL_RADIUS_M, PathRequest, Place, RouteMode
from robocorba.stubs import RoboCorba
from testkit.generated_buildings import grid_building, random_trips
from testkit.json_process import pids_of
from testkit.report import PROGRESS, at_least, at_most, distribution, summarize, summary, timed_ms

#: networkx is slow: it gets one in this many trips.
PEER_EVERY = 3
#: Minimum ratio of the medians, and maximum median [ms].
MIN_RATIO, MAX_MEDIAN_MS = 10.0, 5.0
#: Time limit for the start of the server [s]: a map of 16 MB takes long on a slow machine.
START_LIMIT_S = "600"

#: The planner's rule for connections to the roadmap; see robocorba.planning.search.
MAX_CONNECTIONS, CONNECTION_REACH_M, MAX_CANDIDATES, ON_NODE_M = 8, 6.0, 256, 0.01

Trip = tuple[Place, Place]
Node = tuple[str, str]
START, GOAL = ("", "start"), ("", "goal")
OURS, PEER = "RoboCorba", "networkx A*"


def main(rounds: int = 5, trips: int = 300) -> bool:
    with PROGRESS.status("making the building, its planner and the graph for networkx"):
        building = grid_building()
        all_trips = random_trips(building, SMARTPAL_RADIUS_M, rounds * trips, seed=3)
        planner = PathPlanner(building)
        planner.warm_up()
        peer = Peer(building, SMARTPAL_RADIUS_M)
        # Otherwise the garbage collector visits millions of objects during a query.
        gc.collect()
        gc.freeze()
    is_reached = in_process(planner, peer, [all_trips[i * trips : (i + 1) * trips] for i in range(rounds)])
    del planner, peer
    return over_iiop(building, all_trips) and is_reached


def in_process(planner: PathPlanner, peer: Peer, rounds: Sequence[Sequence[Trip]]) -> bool:
    """The planner and networkx alternately, on the shortest path along the topological map."""
    rows: list[dict[str, Any]] = []
    samples: dict[str, list[float]] = {OURS: [], PEER: []}
    for round_, trips in enumerate(rounds, 1):
        took: dict[str, list[float]] = {name: [] for name in samples}
        both: list[float] = []
        for i, trip in enumerate(progress(trips, f"round {round_} of {len(rounds)}")):
            cost, took_ms = timed_ms(_cost, planner, *trip)
            took[OURS].append(took_ms)
            if i % PEER_EVERY == 0:
                both.append(took_ms)
                expected, peer_ms = peer.cheapest(*trip)
                if not math.isclose(cost, expected, rel_tol=1e-9):
                    sys.exit(f"large_building: {trip} costs {cost} m, by networkx {expected} m")
                took[PEER].append(peer_ms)
        rows.append(
            {
                "round": round_,
                "trips": len(took[OURS]),
                **summary(took[OURS], "planner median ms", "planner p99 ms"),
                "networkx's trips": len(both),
                **summary(took[PEER], "networkx median ms", "networkx p99 ms"),
                "ratio of medians": statistics.median(took[PEER]) / statistics.median(both),
                "of totals": sum(took[PEER]) / sum(both),
            }
        )
        for name, times in took.items():
            samples[name] += times
    median, ratio = statistics.median(samples[OURS]), statistics.median(row["ratio of medians"] for row in rows)
    title = f"100,000 nodes, 10 floors: {median:.2f} ms at the median, networkx {ratio:.1f} x as long"
    marks = [
        at_most("planner, median ms", median, MAX_MEDIAN_MS),
        at_least("networkx's median to the planner's, median of rounds", ratio, MIN_RATIO),
    ]
    return summarize("large_building", title, rows, marks, distribution(samples, "milliseconds"))


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
        self.floors = {name: self._add_floor(building, name) for name in building.floors}
        self._add_rides(building)

    def _add_floor(self, building: Building, floor: str) -> Floor:
        topological = building.floors[floor].topological
        blocked = STRtree([item.geometry for item in obstacles(building, floor)])
        nodes, edges = topological.nodes, list(topological.edges.values())
        for node in nodes.values():
            self.at[floor, node.name] = node.at
            self.graph.add_node((floor, node.name))
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

    def cheapest(self, start: Place, goal: Place) -> tuple[float, float]:
        """Length of the shortest path [m], infinite if there is none, and the search time of networkx [ms]."""
        graph = self.graph
        graph.add_nodes_from([START, GOAL])
        for node, length in self.connections(start, outbound=True):
            graph.add_edge(START, node, length=length)
        for node, length in self.connections(goal, outbound=False):
            graph.add_edge(node, GOAL, length=length)
        heuristic = self._heuristic(goal)
        began = time.perf_counter()
        try:
            path = nx.astar_path(graph, START, GOAL, heuristic=heuristic, weight="length")
            took_ms = (time.perf_counter() - began) * 1e3
            return nx.path_weight(graph, path, "length"), took_ms
        except nx.NetworkXNoPath:
            return math.inf, (time.perf_counter() - began) * 1e3
        finally:
            graph.remove_nodes_from([START, GOAL])

    def _heuristic(self, goal: Place) -> Callable[[Node, Node], float]:
        """The straight line to the goal and the climb: admissible, because rides count their climb."""
        at, hypot, (goal_floor, gx, gy) = self.at, math.hypot, goal
        climbs = {floor: abs(height - self.heights[goal_floor]) for floor, height in self.heights.items()}

        def straight(node: Node, _: Node) -> float:
            if node is GOAL:
                return 0.0
            x, y = at[node]
            return hypot(x - gx, y - gy) + climbs.get(node[0], 0.0)

        return straight

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


def over_iiop(building: Building, trips: Sequence[Trip]) -> bool:
    """getPath of a real server, compared to a null call; start-up time and memory of the server."""
    rows = []
    samples: dict[str, list[float]] = {}
    with folder_of_bench() as folder:
        file, state = folder / "grid.yaml", folder / "state"
        with PROGRESS.status("writing the map file"):
            native.save(building, file)
        for origin in ("map file", "store"):  # the second start restores the building from the state folder
            began = time.monotonic()
            with servers(state, "--building", str(file), "--start-limit", START_LIMIT_S) as naming, Orb(naming) as orb:
                start_s = time.monotonic() - began
                planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
                (pid,) = pids_of(state, "map_editor")
                server = psutil.Process(pid)
                idle = server.memory_info().rss
                samples, lengths = _ask(planner, progress(trips, f"getPath, started from the {origin}"))
                rows.append(
                    {
                        "started from": origin,
                        "s to ready": start_s,
                        "memory MB": idle / 1e6,
                        "MB after paths": server.memory_info().rss / 1e6,
                        "paths": len(lengths),
                        "points, mean": statistics.mean(lengths),
                        **summary(samples["null call"], "null call, median ms"),
                        **summary(samples["getPath"], "getPath, median ms", "getPath, p99 ms"),
                    }
                )
    median = statistics.median(samples["getPath"])
    title = f"getPath over IIOP, 100,000 nodes, 10 floors: {median:.2f} ms at the median"
    marks = [at_most("getPath over IIOP, median ms", median, MAX_MEDIAN_MS)]
    return summarize("large_building_server", title, rows, marks, distribution(samples, "milliseconds"))


def _ask(planner: Any, trips: Iterable[Trip]) -> tuple[dict[str, list[float]], list[int]]:
    """The ms of a null call and of a getPath alternately, and the number of points of each path."""
    samples: dict[str, list[float]] = {"null call": [], "getPath": []}
    lengths = []
    for start, goal in trips:
        samples["null call"].append(timed_ms(planner._non_existent)[1])
        with contextlib.suppress(RoboCorba.NoPath):
            points, took_ms = timed_ms(planner.getPath, RoboCorba.Point(*start), RoboCorba.Point(*goal))
            samples["getPath"].append(took_ms)
            lengths.append(len(points))
    return samples, lengths


if __name__ == "__main__":
    run(main, trips="of a round")
