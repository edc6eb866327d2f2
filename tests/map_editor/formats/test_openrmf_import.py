"""Open-RMF building files become buildings: scale, alignment, lanes, doors, lifts, and what is reported as lost."""

from __future__ import annotations

import copy
import math
import re
from typing import Any

import networkx as nx
import pytest

from robocorba.errors.maps import MapFileError
from robocorba.map_editor import validation
from robocorba.map_editor.checking import blocked
from robocorba.map_editor.formats import read_map
from robocorba.map_editor.model import CabinSide, ElevatorDoor, PathEdge
from tests.map_editor.formats.hostile import MISSING, changed
from tests.map_editor.formats.rmf_files import imported, real_file, small


def test_everything_of_a_file() -> None:
    """Pixels become metres with y up; the upper level is scaled, turned and moved onto the lower one; lanes of several
    graphs are one edge, one without a graph belongs to all."""
    result = imported(small())
    lower, upper = result.building.floors["L1"], result.building.floors["L2"]
    nodes, walls = lower.topological.nodes, lower.geometrical.walls
    assert nodes["start"].at == pytest.approx((2.5, -2.5))
    assert walls["w1"].b == pytest.approx((10.0, -5.0))
    assert (walls["w0"].height, walls["w1"].height) == (3.5, 2.5)
    assert [tuple(map(round, point)) for point in lower.floor.outline] == [(0, 0), (10, 0), (10, -5), (0, -5)]
    assert upper.topological.nodes["n0"].at == pytest.approx(nodes["n9"].at)
    assert upper.topological.nodes["n1"].at == pytest.approx(nodes["n10"].at)
    assert (upper.floor.level, upper.floor.elevation) == (1, 4.0)
    assert lower.topological.edges == {
        "start-n9": PathEdge(name="start-n9", a="start", b="n9", speed_limit=0.5, graphs=("tiny", "1")),
        "n9-n10": PathEdge(name="n9-n10", a="n9", b="n10", one_way=True, graphs=("tiny",)),
    }
    assert upper.topological.edges["n0-n1"].graphs == ()
    lift = result.building.elevators["lift"]
    assert (lift.at, lift.size) == (pytest.approx((9.0, -2.5)), (1.6, 1.4))
    assert lift.doors == tuple(
        ElevatorDoor(floor=floor, side=CabinSide.LEFT, width=1.0, offset=0.1) for floor in ("L1", "L2")
    )
    assert (nodes["n10"].elevator, upper.topological.nodes["n1"].elevator) == ("lift", "lift")
    assert len(result.losses) == len(set(result.losses))
    assert {
        "models: 3 left out, the file gives no sizes: Chair (x3)",
        "drawing: not kept: L1",
        "vertex property is_charger: not kept: L1 start",
    } <= set(result.losses)


#: Places in small(): a level, its vertices, the name of one of them.
ONE, VERTICES, LIFT = ("levels", "L1"), ("levels", "L1", "vertices"), ("lifts", "lift")


@pytest.mark.parametrize(
    ("place", "value", "lost"),
    [
        ((*LIFT, "level_doors"), {}, "lifts that open on no level: 1 left out: lift"),
        (("lifts",), {}, "vertices name a lift that the file does not contain: lift at L1 n10, lift at L2 n1"),
        (
            *((*ONE, "measurements", 1, 2, "distance", 1), 9.0),
            "scale of L1: levels.L1.measurements[1] gives 0.09000 m per pixel, the median is 0.07000",
        ),
        ((*VERTICES, 9, 3), "start", "names used twice, renamed: vertex of L1: start is now start_2"),
        (("levels", "L2", "elevation"), 0, "elevation: levels of equal elevation are placed 3 m apart: L2"),
        *(
            ((*LIFT, "level_doors"), doors, "")
            for doors in (
                {"L1": "west", "L2": "west"},
                [{"L1": ["west"]}, {"L2": "west"}],
                *([["L1", "west"], ["L2", "west"]], ["L1", "L2"]),
            )
        ),
    ],
)
def test_losses(place: tuple[Any, ...], value: Any, lost: str) -> None:
    found, plain = imported(changed(small(), place, value)), imported(small())
    assert lost in found.losses if lost else found == plain


def test_names_and_levels() -> None:
    for index, name, names in (
        (9, "start", ["start", "start_2", "n10"]),
        (8, "n9", ["n9", "n9_2", "n10"]),
        (8, " cafe\u0301 ", ["caf\u00e9", "n9", "n10"]),
    ):
        found = imported(changed(small(), (*VERTICES, index, 3), name)).building
        assert list(found.floors["L1"].topological.nodes) == names
    for level, elevation, expected in (("L2", 0, [(0, 0.0), (1, 3.0)]), ("L1", -3.5, [(-1, -3.5), (0, 4.0)])):
        found = imported(changed(small(), ("levels", level, "elevation"), elevation)).building
        assert [(entry.floor.level, entry.floor.elevation) for entry in found.floors.values()] == expected


def test_keys_that_may_be_missing_or_have_other_names() -> None:
    data = small()
    del data["coordinate_system"], data["graphs"], data["name"], data["levels"]["L1"]["measurements"]
    data["building_name"] = "old"
    data["levels"]["L2"]["measurements"] = [[0, 1, {"distance": [3, 1.5]}]]
    building = imported(data).building
    assert building.name == "old"
    assert building.floors["L1"].topological.edges["start-n9"].graphs == ("0", "1")
    assert building.floors["L1"].topological.nodes["start"].at == pytest.approx((2.5, -2.5))  # by the scale of L2
    assert list(imported({"levels": {"B1/L:1": {"vertices": [[0, 0, 0, "a"]]}}}).building.floors) == ["B1_L_1"]
    metres = {
        **{"name": "plain", "coordinate_system": "cartesian_meters", "parameters": {"offset_x": [3, 100.0]}},
        "levels": {"G": {"vertices": [[101, 2], [103, 2, 0], [103, 5, 0, "end"]], "lanes": [[0, 1], [1, 2, {}]]}},
    }
    nodes = imported(metres).building.floors["G"].topological.nodes.values()
    assert {node.name: node.at for node in nodes} == {"n0": (1.0, 2.0), "n1": (3.0, 2.0), "end": (3.0, 5.0)}


@pytest.mark.parametrize(
    ("x", "y", "motion", "side", "offset"),
    [
        (0.2, -0.9, 0.0, CabinSide.FRONT, 0.2),
        (0.2, 0.9, 0.0, CabinSide.BACK, 0.2),
        (0.9, -0.1, math.pi / 2, CabinSide.RIGHT, -0.1),
        (-0.7, 0.7, 0.0, CabinSide.BACK, -0.3),
    ],
)
def test_the_side_of_a_lift_door(x: float, y: float, motion: float, side: CabinSide, offset: float) -> None:
    data = small()
    data["levels"] = {"L1": data["levels"]["L1"]}
    lift = data["lifts"]["lift"]
    lift.update(highest_floor="", level_doors={"L1": ["d"]})
    lift["doors"] = {"d": {"x": x, "y": y, "width": 1.0, "motion_axis_orientation": motion}}
    door = imported(data).building.elevators["lift"].doors[0]
    assert door.side is side
    assert door.offset == pytest.approx(offset)


def test_nothing_is_lost_to_a_lift_that_was_left_out() -> None:
    """Of two lifts that overlap one is left out: no outline is extended for it, no edge through its shaft is lost."""
    data = small()
    data["levels"]["L1"]["vertices"][1][0] = data["levels"]["L1"]["vertices"][2][0] = 190
    data["levels"]["L1"]["vertices"] += [[150, 80, 0, "west"], [170, 80, 0, "east"]]
    data["levels"]["L1"]["lanes"] += [[11, 12, {"graph_idx": [2, 0]}]]
    deep = {**copy.deepcopy(data["lifts"]["lift"]), "depth": 4.0}
    data["lifts"] = {"deep": deep, **data["lifts"]}
    result = imported(data)
    assert [loss for loss in result.losses if loss.startswith("left out")] == [
        "left out: elevators (1): its shaft overlaps that of elevator 'lift': deep"
    ]
    assert "outline: extended by the shafts of lifts: L1 lift" in result.losses
    assert "west-east" in result.building.floors["L1"].topological.edges


def test_what_breaks_a_rule_is_left_out_and_counted() -> None:
    data = small()
    level = data["levels"]["L1"]
    first = len(level["vertices"])
    level["vertices"] += [[50 + i, 150, 0, f"outside{i}"] for i in range(20)]
    level["lanes"] += [[8, first + i, {"graph_idx": [2, 0]}] for i in range(20)]
    level["vertices"] += [[20 + i, 20, 0, f"inside{i}"] for i in range(40)]  # most nodes: the outline stands
    level["vertices"] += [[60, 50, 0, "a"], [60, 50, 0, "b"]]
    level["lanes"] += [[first + 60, first + 61, {"graph_idx": [2, 0]}], [8, first + 60, {"graph_idx": [2, 0]}]]
    result = imported(data)
    assert validation.problems(result.building) == []
    assert {"start-n9", "start-a"} <= result.building.floors["L1"].topological.edges.keys()
    shown = ", ".join(f"outside{i}" for i in range(12))
    left_out = [loss for loss in result.losses if loss.startswith("left out")]
    assert sum("a-b" in loss for loss in left_out) == 1  # without length
    assert [loss for loss in left_out if "a-b" not in loss] == [
        f"left out: nodes of L1 (20): it stands outside the outline of the floor: {shown} and 8 more",
        "left out: edges of L1 (20): a node at its end is left out: "
        + ", ".join(f"start-outside{i}" for i in range(12))
        + " and 8 more",
    ]


@pytest.mark.parametrize(
    ("vertices", "more", "losses"),
    [
        (
            [[300, 0], [310, 0], [310, 10]],
            {"floors": [{"vertices": [0, 1, 2, 3]}, {"vertices": [11, 12, 13]}], "walls": [[11, 12], [2, 12]]},
            [
                "outline: 1 parts of the floor except the largest are left out, no lane leads there: "
                "L1 0.12 m2 at (15.38, -0.25)",
                "walls and doors in parts of the floor that are left out: 1: L1 w0",  # the other one stands on both
            ],
        ),
        (
            [[20, -10], [40, -10], [40, 110], [20, 110]],
            {"holes": [{"vertices": [11, 12, 13, 14]}]},
            [
                "outline: 1 parts of the floor except the largest are left out, holes cut them off: "
                "L1 5.00 m2 at (0.50, -2.50)",
                "walls and doors in parts of the floor that are left out: 1: L1 w3",
            ],
        ),
    ],
)
def test_parts_of_a_floor_that_are_left_out(vertices: list[Any], more: dict[str, Any], losses: list[str]) -> None:
    data = small()
    data["levels"]["L1"]["vertices"] += vertices
    data["levels"]["L1"].update(more)
    result = imported(data)
    assert [loss for loss in result.losses if "parts of the floor" in loss] == losses
    assert max(x for x, _ in result.building.floors["L1"].floor.outline) == pytest.approx(10.0)


def test_floor_polygons_unite_holes_become_voids_and_one_of_a_rack_is_no_outline() -> None:
    """It would throw out nearly all nodes, in one line each."""
    data = small()
    level = data["levels"]["L1"]
    level["vertices"] += [[10, 10], [20, 10], [20, 20], [10, 20]]
    level["floors"] = [{"vertices": [0, 4, 7, 3]}, {"vertices": [4, 1, 2, 7]}]
    level["holes"] = [{"vertices": [11, 12, 13, 14]}]
    floor = imported(data).building.floors["L1"]
    assert {tuple(map(round, point)) for point in floor.floor.outline} >= {(0, 0), (10, 0), (10, -5), (0, -5)}
    assert floor.geometrical.objects["void1"].at == pytest.approx((0.75, -0.75))
    del level["holes"]
    level["floors"] = [{"vertices": [11, 12, 13, 14]}]
    result = imported(data)
    floor = result.building.floors["L1"]
    assert validation.problems(result.building) == []
    assert list(floor.topological.nodes) == ["start", "n9", "n10"]
    assert not [loss for loss in result.losses if loss.startswith("left out")]
    assert [loss for loss in result.losses if loss.startswith("outline")] == [
        "outline of L1: the floor polygons cover 0.2 m2 and leave out 2 of 3 nodes and 6 of 6 walls; "
        "the convex hull of all, 50.0 m2, is used instead"
    ]
    x, y = zip(*floor.floor.outline, strict=True)
    assert (min(x), max(x), min(y), max(y)) == pytest.approx((0.0, 10.0, -5.0, 0.0))


@pytest.mark.parametrize(
    ("place", "value", "key", "reason"),
    [
        ((*VERTICES, 2, 0), math.nan, "levels.L1.vertices[2][0]", "finite"),
        ((*ONE, "walls", 0, 1), 999, "levels.L1.walls[0][1]", "no vertex 999"),
        (
            *((*ONE, "measurements", 0, 2, "distance"), [3, -1.0]),
            *("levels.L1.measurements[0][2].distance[1]", "above zero"),
        ),
        ((*LIFT, "x"), MISSING, "lifts.lift", "'x' is missing"),
        ((*LIFT, "reference_floor_name"), "L9", "lifts.lift.reference_floor_name", "no level 'L9'"),
        (("coordinate_system",), "wgs84", "coordinate_system", "not supported"),
        (("levels",), {}, "levels", "no level"),
    ],
)
def test_errors_name_line_and_key(place: tuple[Any, ...], value: Any, key: str, reason: str) -> None:
    with pytest.raises(MapFileError, match=reason) as caught:
        imported(changed(small(), place, value))
    assert (caught.value.key, caught.value.line > 0) == (key, True)
    with pytest.raises(MapFileError, match="no level 'X'"):
        imported({**small(), "reference_level_name": "X"})


@pytest.mark.parametrize(
    ("lane", "reason"),
    [
        ([8, 99, {}], r"L1 levels.L1.lanes\[0\]\[1\] \(there is no vertex 99; the level has 11\)"),
        ([8], r"lanes\[0\] \(expected at least 2 values"),
        ("8-9", r"lanes\[0\] \(expected a list"),
        ([8, 9, {"speed_limit": [3, -1.0]}], r"speed_limit\[1\] \(must not be below zero"),
        ([8, 9, {"speed_limit": [3, "-nan"]}], r"\('-nan' is a text in YAML and no number; write a finite number"),
        ([8, 9, {"bidirectional": [4, "maybe"]}], r"bidirectional\[1\] \(expected true or false"),
        ([8, 9, {"name": [1, ["x"]]}], r"name\[1\] \(expected a text"),
        ([8, 8, {}], "from a vertex to itself: 1 left out: L1 start"),
    ],
)
def test_an_odd_lane_is_left_out_and_named(lane: Any, reason: str) -> None:
    data, plain = small(), imported(small())
    data["levels"]["L1"]["lanes"].insert(0, lane)
    found = imported(data)
    assert found.building == plain.building
    (loss,) = set(found.losses) - set(plain.losses)
    assert re.search(reason, loss)


def test_the_hotel() -> None:
    result = read_map(real_file("hotel"))
    building = result.building
    assert validation.problems(building) == list(blocked(building)) == []
    assert not [loss for loss in result.losses if loss.startswith("left out")]
    assert {name: entry.floor.elevation for name, entry in building.floors.items()} == {"L1": 0, "L2": 8, "L3": 16}
    assert [len(entry.geometrical.doors) for entry in building.floors.values()] == [5, 7, 7]
    assert len(building.floors["L1"].topological.nodes) == 41
    # 3.4 m between (403.349, 408.257) and (403.379, 469.32) on L1's drawing; the lobby lies at (349.99, 530.733).
    scale = 3.4 / math.hypot(403.349 - 403.379, 408.257 - 469.32)
    lobby = building.floors["L1"].topological.nodes["lobby"]
    assert lobby.at == pytest.approx((349.99 * scale, -530.733 * scale), abs=1e-6)
    graph: nx.Graph = nx.Graph()
    for floor, entry in building.floors.items():
        graph.add_edges_from(((floor, edge.a), (floor, edge.b)) for edge in entry.topological.edges.values())
        cabins = [node for node in entry.topological.nodes.values() if node.elevator]
        assert {node.elevator for node in cabins} == {"Lift1", "Lift2"}
        assert all(math.dist(node.at, building.elevators[node.elevator].at) < 0.1 for node in cabins)
        graph.add_edges_from(((floor, node.name), node.elevator) for node in cabins)
    assert nx.is_connected(graph)
