"""Compiles or loads the planner's kernels, in steps that several processes share."""

from __future__ import annotations

import math

from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.pose import SMARTPAL_RADIUS_M
from robocorba.planning.planner import WARM_UP_GOAL, WARM_UP_START, PathPlanner, warm_up_room
from robocorba.planning.request import PathRequest
from robocorba.planning.snapshot import BuildingSnapshot
from robocorba.planning.space import FloorSpace
from robocorba.planning.tangent_graph import TangentGraph
from robocorba.planning.topological import connect_in_sight


def drives() -> None:
    """Drives through free space."""
    TangentGraph(_space(), SMARTPAL_RADIUS_M).legs(WARM_UP_START[1:], [WARM_UP_GOAL[1:]])


def mesh() -> None:
    """The triangulation of a floor."""
    _space().mesh([WARM_UP_START[1:], WARM_UP_GOAL[1:]])


def shortest_path() -> None:
    """The shortest path on the roadmap, the other way round: start and goal are connected with it."""
    PathPlanner(warm_up_room(), time_limit_s=math.inf).shortest(WARM_UP_GOAL, WARM_UP_GOAL._replace(y=5.0))


def connections() -> None:
    """Connections of a place with the roadmap."""
    snapshot = BuildingSnapshot(warm_up_room(), 0)
    connect_in_sight(snapshot, PathRequest(WARM_UP_START, WARM_UP_GOAL), WARM_UP_GOAL, outbound=True)


def all_queries() -> None:
    """All that queries use."""
    PathPlanner(Building("none")).warm_up()


def _space() -> FloorSpace:
    return FloorSpace(warm_up_room(), WARM_UP_START.floor)
