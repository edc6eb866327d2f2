"""Paths in a building of 100,000 nodes over 10 floors: the planner compared to networkx's A*, and getPath over IIOP.

Trips between random nodes are planned by both on the same graph; only the search of networkx is timed, but the
planner's whole query. Both must find the same cost, or the bench fails. Over IIOP trips are between random places."""

from __future__ import annotations

import gc
import math
import statistics
import sys
from functools import partial
from itertools import permutations
from random import Random
from typing import Any

import networkx as nx
import shapely
from shapely import STRtree

from bench.common.harness import alternately, progress, run, system
from bench.planning.get_path import NULL, PATH, calls_of
from robocorba.map_editor.geometry import obstacles
from robocorba.map_editor.model import Building
from robocorba.planning.elevators import ride
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import SMARTPAL_RADIUS_M, PathRequest, Place, RouteMode
from testkit.generated_buildings import grid_building, random_trips
from testkit.report import PROGRESS, at_least, at_most, summarize, summary, timed_ms

#: networkx is slow: it gets one in this many trips.
PEER_EVERY = 3
#: Minimum ratio of the medians, and maximum median [ms].
MIN_RATIO, MAX_MEDIAN_MS = 10.0, 5.0
#: Time limit for the start of the server [s]: a map of 16 MB takes long on a slow machine.
START_LIMIT_S = "600"

Node = tuple[str, str]
OURS, PEER = "RoboCorba", "networkx A*"


def main(rounds: int = 3, trips: int = 300) -> bool:
    with PROGRESS.status("making the building, its planner and the graph for networkx"):
        building = grid_building()
        planner, graph = PathPlanner(building), graph_of(building, SMARTPAL_RADIUS_M)
        planner.warm_up()
        # Otherwise the garbage collector visits millions of objects during a query.
        gc.collect()
        gc.freeze()
    is_reached = in_process(planner, building, graph, rounds, trips)
    del planner, graph
    return over_iiop(building, rounds * trips) and is_reached


def graph_of(building: Building, radius: float) -> nx.DiGraph[Node]:
    """The topological maps of a building as far as a robot of this radius [m] can drive them, and the elevators."""
    graph: nx.DiGraph[Node] = nx.DiGraph()
    stops: dict[str, list[Node]] = {name: [] for name in building.elevators}
    for floor, entry in building.floors.items():
        nodes, edges = entry.topological.nodes, list(entry.topological.edges.values())
        for node in nodes.values():
            graph.add_node((floor, node.name), at=node.at)
            if node.elevator:
                stops[node.elevator].append((floor, node.name))
        blocked = STRtree([item.geometry for item in obstacles(building, floor)])
        lines = shapely.linestrings([[nodes[edge.a].at, nodes[edge.b].at] for edge in edges])
        narrow = set(blocked.query(lines, "dwithin", radius - 1e-9)[0].tolist())
        for number, (edge, line) in enumerate(zip(edges, lines, strict=True)):
            if number not in narrow and not 0.0 < edge.clearance < radius:
                a, b = (floor, edge.a), (floor, edge.b)
                graph.add_edge(a, b, length=line.length)
                if not edge.one_way:
                    graph.add_edge(b, a, length=line.length)
    for name, elevator in building.elevators.items():
        for a, b in permutations(stops[name], 2):
            graph.add_edge(a, b, length=ride(building, elevator, a[0], b[0]).climb)
    return graph


def in_process(planner: PathPlanner, building: Building, graph: nx.DiGraph[Node], rounds: int, trips: int) -> bool:
    """The planner and networkx alternately, on the shortest path along the topological map."""
    nodes, chance, at = sorted(graph), Random(3), dict(graph.nodes(data="at"))
    heights = {name: entry.floor.elevation for name, entry in building.floors.items()}

    def straight(node: Node, goal: Node) -> float:
        """The straight line and the climb: admissible, because rides count their climb."""
        return math.dist(at[node], at[goal]) + abs(heights[node[0]] - heights[goal[0]])

    rows: list[dict[str, Any]] = []
    samples: dict[str, list[float]] = {OURS: [], PEER: []}
    for number in range(1, rounds + 1):
        took: dict[str, list[float]] = {OURS: [], PEER: []}
        both: list[float] = []
        for i in progress(range(trips), f"round {number} of {rounds}"):
            a, b = chance.sample(nodes, 2)
            if not nx.has_path(graph, a, b):
                continue
            start, goal = (Place(floor, *at[floor, name]) for floor, name in (a, b))
            request = PathRequest(start, goal, mode=RouteMode.TOPOLOGICAL)
            found, took_ms = timed_ms(planner.paths, request)
            took[OURS].append(took_ms)
            if i % PEER_EVERY == 0:
                both.append(took_ms)
                path, peer_ms = timed_ms(partial(nx.astar_path, graph, a, b, straight, "length"))
                took[PEER].append(peer_ms)
                expected = nx.path_weight(graph, path, "length")
                if not math.isclose(found[0].distance, expected, rel_tol=1e-9):
                    sys.exit(f"large_building: {a} to {b} costs {found[0].distance} m, by networkx {expected} m")
        row = {"round": number, "trips": len(took[OURS]), **summary(took[OURS], "planner median ms", "planner p99 ms")}
        row |= summary(took[PEER], "networkx median ms", "networkx p99 ms")
        rows.append({**row, "ratio of medians": statistics.median(took[PEER]) / statistics.median(both)})
        for name, times in took.items():
            samples[name] += times
    median, ratio = statistics.median(samples[OURS]), statistics.median(row["ratio of medians"] for row in rows)
    title = f"100,000 nodes, 10 floors: {median:.2f} ms at the median, networkx {ratio:.1f} x as long"
    marks = [
        at_most("planner, median ms", median, MAX_MEDIAN_MS),
        at_least("networkx's median to the planner's, median of rounds", ratio, MIN_RATIO),
    ]
    return summarize("large_building", title, rows, marks, samples, "ms")


def over_iiop(building: Building, trips: int) -> bool:
    """getPath of a real server, compared to a null call."""
    with system("--start-limit", START_LIMIT_S, building=building) as found:
        turns, points = calls_of(found.resolve("PathPlanner"), random_trips(building, SMARTPAL_RADIUS_M, trips, seed=3))
        ms = alternately(progress(turns, "getPath"))
    row = {"paths": len(turns), "points, mean": statistics.mean(points), **summary(ms[NULL], "null call, median ms")}
    row |= summary(ms[PATH], "getPath, median ms", "getPath, p99 ms")
    median = statistics.median(ms[PATH])
    title = f"getPath over IIOP, 100,000 nodes, 10 floors: {median:.2f} ms at the median"
    marks = [at_most("getPath over IIOP, median ms", median, MAX_MEDIAN_MS)]
    return summarize("large_building_server", title, [row], marks, ms, "ms")


if __name__ == "__main__":
    run(main, trips="of a round")
