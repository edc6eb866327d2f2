"""Nonsense of every kind over the wire: a typed exception each time, and a server that stays as it was."""

from __future__ import annotations

import contextlib
import copy
import math
from collections.abc import Iterator
from typing import Any

import psutil
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robocorba.corba.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.testing.processes import Running
from tests.system.elements import Example, examples, id_of, ring

pytestmark = [pytest.mark.system, pytest.mark.full]

#: What the server may grow by over all of this module, MiB. Single messages of it have up to 10 MB.
GROWTH_MIB = 100
#: The fixtures are of the module, so they are the same for all examples of a test.
MANY = settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))

LONG = "x" * 1_000_000
numbers = st.sampled_from([math.nan, math.inf, -math.inf, 1e308, -1e308, 1e7])
names = st.sampled_from(["", LONG, "ж" * 201, "two\nlines", "\x1b[2J", "\N{RIGHT-TO-LEFT OVERRIDE}", "\x7f"])
floors = st.sampled_from(["", "L9", LONG, "l1", "L1 ", "\n"])
polygons = st.one_of(
    st.sampled_from(
        [
            ring((0, 0), (1, 1)),
            ring((0, 0), (1, 1), (1, 0), (0, 1)),  # crosses itself
            ring((0, 0), (1, 0), (2, 0)),  # no area
            ring(*[(0, 0)] * 5),
            ring((0, 0), (1, 0), (1e308, 1e308)),
            ring(*[(math.cos(i), math.sin(i)) for i in range(20_000)]),
        ]
    ),
    st.lists(st.builds(RoboCorba.XY, numbers, numbers), min_size=3, max_size=5),
)
#: Members that must be sensible, by kind and path; all of them are numbers.
NUMBERS = {
    "FLOOR_ELEMENT": ["elevation", "height"],
    "WALL_ELEMENT": ["fromPoint.x", "toPoint.y", "height"],
    "OBJECT_ELEMENT": ["at.x", "at.y", "heading", "height"],
    "DOOR_ELEMENT": ["fromPoint.y", "toPoint.x"],
    "NODE_ELEMENT": ["at.x", "at.y"],
    "EDGE_ELEMENT": ["speedLimit", "clearance"],
    "ELEVATOR_ELEMENT": ["at.x", "heading", "size.x", "size.y", "speed", "doorTime"],
}
POLYGONS = {"FLOOR_ELEMENT": "outline", "AREA_ELEMENT": "polygon"}
#: Lists that hold too much, and shapes without a size.
OTHERS: dict[str, list[tuple[str, Any]]] = {
    "EDGE_ELEMENT": [("graphs", ["g"] * 100_000), ("graphs", [LONG]), ("fromNode", "nowhere"), ("toNode", LONG)],
    "NODE_ELEMENT": [("inElevator", "E9"), ("inElevator", LONG)],
    "AREA_ELEMENT": [("subnet", LONG), ("subnet", "a\nb")],
    "ELEVATOR_ELEMENT": [
        ("doors", []),
        ("doors", [RoboCorba.ElevatorDoor("L9", RoboCorba.FRONT, 1.0, 0.0)]),
        ("doors", [RoboCorba.ElevatorDoor("L1", RoboCorba.FRONT, 1.0, 0.0)] * 50_000),
        ("doors", [RoboCorba.ElevatorDoor(LONG, RoboCorba.BACK, math.nan, math.inf)]),
    ],
    "OBJECT_ELEMENT": [
        ("footprint", RoboCorba.Shape(length=math.nan)),
        ("footprint", RoboCorba.Shape(radius=0.0)),
        ("footprint", RoboCorba.Shape(radius=-1e308)),
        ("footprint", RoboCorba.Shape(size=RoboCorba.XY(1e308, math.inf))),
        ("footprint", RoboCorba.Shape(points=[])),
    ],
}


@pytest.fixture(scope="module", autouse=True)
def server_stays(system: Running, system_orb: Orb) -> Iterator[None]:
    """The same process answers at the end, with the same building, and has not grown much."""
    editor = system_orb.resolve("MapEditor", RoboCorba.MapEditor)
    process, before = psutil.Process(system.pid("map_editor")), editor.exportMap()
    began = process.memory_info().rss
    yield
    assert system.pid("map_editor") == process.pid
    assert (editor._get_currentVersion(), editor.exportMap()) == (1, before)
    grown_mib = (process.memory_info().rss - began) / 2**20
    print(f"\nthe server grew by {grown_mib:.0f} MiB")
    assert grown_mib < GROWTH_MIB


@pytest.fixture(scope="module")
def editor(system_orb: Orb) -> Any:
    return system_orb.resolve("MapEditor", RoboCorba.MapEditor)


@pytest.fixture(scope="module")
def planner(system_orb: Orb) -> Any:
    return system_orb.resolve("PathPlanner", RoboCorba.PathPlanner)


def with_member(value: Any, path: str, new: Any) -> Any:
    """A copy of an Element with another value at a member's path."""
    value = copy.deepcopy(value)
    owner = value._v
    *before, last = path.split(".")
    for step in before:
        owner = getattr(owner, step)
    assert hasattr(owner, last)
    setattr(owner, last, new)
    return value


@st.composite
def wrong_elements(draw: st.DrawFn) -> tuple[str, Any]:
    """An element with one member that can't be, and its floor."""
    kind, example = draw(st.sampled_from(list(examples("bad").items())))
    ways = [st.tuples(st.just("name"), names)]
    if kind in NUMBERS:
        ways.append(st.tuples(st.sampled_from(NUMBERS[kind]), numbers))
    if kind in POLYGONS:
        ways.append(st.tuples(st.just(POLYGONS[kind]), polygons))
    if kind == "OBJECT_ELEMENT":
        ways.append(st.tuples(st.just("footprint"), st.builds(lambda p: RoboCorba.Shape(points=p), polygons)))
    if kind in OTHERS:
        ways.append(st.sampled_from(OTHERS[kind]))
    path, new = draw(st.one_of(ways))
    return example.floor, with_member(example.value, path, new)


@given(wrong_elements())
@MANY
def test_a_wrong_element_is_refused(editor: Any, wrong: tuple[str, Any]) -> None:
    floor, value = wrong
    transaction = editor.begin()
    try:
        with pytest.raises(RoboCorba.InvalidElement) as refused:
            editor.create(floor, value)
        assert refused.value.id.kind == value._d
        assert refused.value.reason
        with pytest.raises(RoboCorba.InvalidElement):
            transaction.create(floor, value)
            transaction.commit()
    finally:
        end(transaction)


def end(transaction: Any) -> None:
    with contextlib.suppress(RoboCorba.TransactionClosed):
        transaction.rollBack()


@given(floors, st.sampled_from([example for example in examples("bad").values() if example.floor]))
@MANY
def test_what_is_not_there_is_unknown(editor: Any, floor: str, example: Example) -> None:
    with pytest.raises(RoboCorba.UnknownElement):
        editor.create(floor, example.value)
    with pytest.raises(RoboCorba.UnknownElement):
        editor.elements(example.value._d, floor)
    with pytest.raises(RoboCorba.UnknownElement):
        editor.buildTopologicalMap(floor, 0.4)
    for call in (editor.read, lambda id: editor.remove(id, 2**64 - 1)):
        with pytest.raises(RoboCorba.UnknownElement):
            call(id_of(floor, example.value))
    with pytest.raises(RoboCorba.UnknownElement):
        editor.change(floor, example.value, 0)


def test_versions_beyond_all_are_refused(editor: Any) -> None:
    for version in (0, 2**63, 2**64 - 1):
        with pytest.raises(RoboCorba.StaleVersion):
            editor.undo(version)
        with pytest.raises(RoboCorba.StaleVersion):
            editor.redo(version)
        with pytest.raises(RoboCorba.VersionUnavailable):
            editor.changesSince(version)


coordinates = st.one_of(numbers, st.floats())
points = st.builds(RoboCorba.Point, st.one_of(st.just("L1"), floors), coordinates, coordinates)
PLACE = RoboCorba.Point("L1", 3.0, 3.0)
REFUSALS = (
    RoboCorba.InvalidPoint,
    RoboCorba.InvalidRequest,
    RoboCorba.UnknownFloor,
    RoboCorba.NotFree,
    RoboCorba.NoPath,
)


@given(points, st.booleans())
@MANY
def test_a_path_from_or_to_anywhere(planner: Any, point: Any, backwards: bool) -> None:
    """Floats in range may be free places; everything else is refused with the member that is wrong."""
    start, goal = (PLACE, point) if backwards else (point, PLACE)
    try:
        path = planner.getPath(start, goal)
    except REFUSALS as refused:
        if isinstance(refused, RoboCorba.InvalidPoint):
            assert refused.which == ("goal" if backwards else "start")
            assert not abs(getattr(point, refused.field)) <= 1e6
        elif isinstance(refused, RoboCorba.UnknownFloor):
            assert (refused.floorName, refused.known) == (point.floor[:200], ["L1", "L2"])
        else:
            assert point.floor == "L1" and abs(point.x) <= 1e6 and abs(point.y) <= 1e6
    else:
        assert path and point.floor == "L1" and math.isfinite(point.x + point.y)


areas = st.builds(RoboCorba.ForbiddenArea, st.just("L1"), polygons)
wrong_members = st.one_of(
    st.tuples(st.just("start"), st.builds(RoboCorba.Point, floors, numbers, numbers)),
    st.tuples(st.just("goal"), st.builds(RoboCorba.Point, st.just("L1"), numbers, st.just(0.0))),
    st.tuples(st.sampled_from(["robotRadius", "robotSpeed"]), st.one_of(numbers, st.just(-1.0))),
    st.tuples(st.just("robotSpeed"), st.sampled_from([0.0, 5e-324])),
    st.tuples(st.just("avoidElevators"), st.sampled_from([[LONG], [""], ["E9"] * 100_000])),
    st.tuples(st.just("avoidAreas"), st.sampled_from([["room"], ["L9/room"], ["L1/" + LONG], ["/"], ["a/b"] * 50_000])),
    st.tuples(st.just("forbiddenAreas"), st.lists(areas, min_size=1, max_size=3)),
    st.tuples(
        st.just("forbiddenAreas"),
        st.sampled_from(
            [
                [RoboCorba.ForbiddenArea("L9", ring((0, 0), (1, 0), (0, 1)))],
                [RoboCorba.ForbiddenArea("L1", ring((0, 0), (0.1, 0), (0, 0.1)))] * 10_000,
            ]
        ),
    ),
    st.tuples(st.just("withoutMovables"), st.sampled_from([["L9"], [LONG], ["L1", ""]])),
    st.tuples(st.just("navigationGraph"), st.sampled_from([LONG, "nothing", "\n"])),
    st.tuples(st.just("alternatives"), st.sampled_from([10, 2**32 - 1])),
)


@given(wrong_members, st.sampled_from(RoboCorba.RouteMode._items))
@MANY
def test_a_wrong_request_is_refused(planner: Any, wrong: tuple[str, Any], mode: Any) -> None:
    request = planner.defaultRequest(PLACE, RoboCorba.Point("L1", 15.0, 3.0))
    request.mode = mode
    assert hasattr(request, wrong[0])
    setattr(request, *wrong)
    with pytest.raises((RoboCorba.InvalidRequest, RoboCorba.InvalidPoint, RoboCorba.UnknownFloor)) as refused:
        planner.findPaths(request)
    if isinstance(refused.value, RoboCorba.InvalidRequest):
        assert refused.value.field.startswith(wrong[0]) and refused.value.reason


PNG = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + bytes(range(256)) * 1000
BOMB = "a: &a [x, x]\n" + "".join(
    f"{b}: &{b} [*{a}, *{a}, *{a}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
HEAD = "robocorba: 1\nname: x\nfloors:\n- {name: L1, level: 1, elevation: 0, "
DOCUMENTS = {
    "nothing": ("", "empty file"),
    "a picture": (PNG.decode("latin-1").replace("\0", "\1"), ""),
    "a YAML bomb": (BOMB, "aliases are not accepted"),
    "deep nesting": ("[" * 100_000 + "]" * 100_000, "nested deeper than 40"),
    "deep mapping": ("".join(" " * i + "a:\n" for i in range(500)), "nested deeper than 40"),
    "many documents": ("a: 1\n---\n" * 10_000, "only one document is accepted"),
    "a huge number": (f"{HEAD}height: {'9' * 1_000_000}}}", ""),
    "a huge name": (f"robocorba: 1\nname: {LONG}\nfloors: []", "at most 200 are allowed"),
    "a Python object": ("!!python/object/apply:os.system [id]", ""),
    "no numbers": (f"{HEAD}outline: [[.nan, .inf], [1, 2], [1e308, 3]]}}", ""),
    "many points": (f"{HEAD}outline: [{'[0, 0], ' * 20_000}]}}", "at most 10000 are allowed"),
    "another format": ("levels: {L1: {}}", "not a RoboCorba map"),
    "a later version": ("robocorba: 2\nname: x\nfloors: []", "format version 1"),
}


@pytest.mark.parametrize("what", DOCUMENTS)
def test_a_wrong_document_is_refused(editor: Any, what: str) -> None:
    document, reason = DOCUMENTS[what]
    with pytest.raises(RoboCorba.InvalidMap) as refused:
        editor.importMap(document, 1)
    assert reason in refused.value.reason
    assert refused.value.reason and len(refused.value.reason) < 1000


@given(st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"])))
@MANY
def test_any_text_is_refused_as_a_map(editor: Any, text: str) -> None:
    for document in (text, f"robocorba: 1\n{text}"):
        with pytest.raises(RoboCorba.InvalidMap):
            editor.importMap(document, 1)
