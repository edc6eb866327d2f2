"""The native file: what is written comes back, and whatever is wrong is named with file, line and key; the samples; and
elements as JSON objects."""

from __future__ import annotations

import json
import random
import re
from pathlib import Path

import msgspec
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from shapely import Point

from robocorba.errors.files import OutputError
from robocorba.errors.maps import InvalidElement, MapFileError
from robocorba.map_editor import geometry, native
from robocorba.map_editor.changes import elements_of
from robocorba.map_editor.element_json import as_json, form_members, from_json
from robocorba.map_editor.model import Area, Building, CircleShape, ElementKind, Floor, MapObject, PathEdge, Wall
from robocorba.map_editor.samples import load_sample, map_file, sample_path
from robocorba.map_editor.yaml_file import YamlLimits, parse_yaml, read_yaml
from testkit.buildings import buildings, grid, two_floors

MANUAL = Path(__file__).parents[2] / "docs" / "map-file.md"

SOUND = """\
robocorba: 1
name: house
floors:
- name: L1
  level: 1
  elevation: 0
  walls:
  - {name: w1, from: [0, 0], to: [4, 0]}
  - {name: w2, from: [4, 0], to: [4, 4]}
  nodes:
  - name: a
    at: [1, 1]
  - name: b
    at: [3, 1]
  edges:
  - {from: a, to: b}
- name: L2
  level: 2
  elevation: 4
elevators:
- name: E
  at: [2, 3]
  size: [1, 1]
  doors:
  - {floor: L1, width: 0.8}
"""


def wrong(text: str | bytes) -> MapFileError:
    with pytest.raises(MapFileError) as raised:
        native.loads(text, "house.yaml")
    assert len(str(raised.value)) < 1000
    return raised.value


def test_the_example_of_the_manual_uses_every_key() -> None:
    manual = MANUAL.read_text(encoding="utf-8")
    found = re.search(r"```yaml\n(.*?)```", manual, re.DOTALL)
    assert found
    building = native.loads(found[1])
    assert [len(building.elements(kind, "L1")) for kind in ElementKind] == [2, 1, 4, 1, 1, 3, 3, 1]
    assert native.loads(native.dumps(building)) == building
    given = set(re.findall(r"(\w+):", found[1]))
    documented = set(re.findall(r"`([a-z_]+)`", " ".join(re.findall(r"^\|[^\n]*", manual, re.MULTILINE))))
    assert {"offset", "locked"} == documented & _keys() - given
    assert _keys() <= documented | {"kind", "points", "length", "radius"}


def _keys() -> set[str]:
    """Every key that the format knows."""
    schema = native.msgspec.json.schema(native._BuildingFile)
    return {key for part in schema["$defs"].values() for key in part.get("properties", {})}


numbers = st.floats(allow_nan=False, allow_infinity=False)
words = st.text(min_size=1, max_size=20).filter(str.isprintable)


@settings(deadline=None, max_examples=100)
@given(words, words, st.tuples(numbers, numbers), numbers)
@example("no", "1e3", (1e6, 1e-3), 5e-324)
@example("12", ": #", (0.1, 123456.789), 1e-7)
@example("2020-01-01", "'\"\\{}[]&*!|>%@`", (1.0, 1.0), -0.0)
@example(" ", "\U0001f600 é 漢字", (1.0, 1.0), 1e5)
@example("~", "<<", (1.0, 1.0), 0.0)
@example("=", "1:30", (1.0, 1.0), 0.0)
def test_round_trip_of_any_name_and_number(name: str, other: str, at: tuple[float, float], heading: float) -> None:
    building = Building(name).with_element("", Floor(name=other, level=1, elevation=heading))
    building = building.with_element(other, MapObject(name=name, shape=CircleShape(radius=0.5), at=at, heading=heading))
    building = building.with_element(other, PathEdge(name=f"{name}-{other}", a=name, b=other))
    assert native.parse(parse_yaml(native.dumps(building).encode(), "map")) == building


def test_save_and_load(tmp_path: Path, building: Building) -> None:
    file = tmp_path / "house.yaml"
    for each in (building, grid(3, 2)):
        native.save(each, file)
        assert native.load(file) == each
    assert [path.name for path in tmp_path.iterdir()] == ["house.yaml"]
    with pytest.raises(OutputError, match="No such file or directory"):
        native.save(building, tmp_path / "no" / "house.yaml")
    with pytest.raises(MapFileError, match="No such file or directory"):
        native.load(tmp_path / "none.yaml")
    with pytest.raises(MapFileError, match="Is a directory"):
        native.load(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "reason"),
    [
        ("robocorba: 1", "robocorba: 2", 1, "robocorba", "this release reads format version 1, not 2"),
        ("robocorba: 1\n", "", 1, "", "the key `robocorba: 1` is missing"),
        ("name: house", "name: ''", 2, "name", "the name is empty"),
        ("name: house", "name: 12", 2, "name", "Expected `str`, got `int`"),
        ("name: house\n", "", 1, "", "missing required field `name`"),
        ("name: house", "name: house\nroof: red", 3, "roof", "there is no such key"),
        ("name: house", "name: house\n? [a]\n: b", 3, "", "a key must be a plain word"),
        ("name: house", "name: house\n1: b", 1, "", "a key is wrong: Expected `str`"),
        ("name: L2", "name: L1", 17, "floors[1].name", "there is a floor 'L1' already"),
        ("level: 2", "level: 1", 17, "floors[1]", "level 1 is that of floor 'L1'"),
        ("elevation: 4", "elevation: 1.0e+308", 17, "floors[1]", "elevation must be"),
        ("name: w2", "name: w1", 9, "floors[0].walls[1]", "the name 'w1' is used twice"),
        ("to: [4, 4]", "to: [4, 4, 4]", 9, "floors[0].walls[1].to", "Expected `array` of length 2, got 3"),
        (
            "to: [4, 4]",
            "to: [4, -nan]",
            9,
            "floors[0].walls[1].to[1]",
            "'-nan' is a text in YAML and no number; write a",
        ),
        ("at: [3, 1]", "at: [1.5, 3]", 13, "floors[0].nodes[1]", "it stands on the shaft of elevator 'E'"),
        ("{from: a, to: b}", "{from: a, to: c}", 16, "floors[0].edges[0]", "edge 'a-c' on L1: node 'c' does not exist"),
        ("width: 0.8", "side: up", 25, "elevators[0].doors[0].side", "Invalid enum value 'up'"),
        ("name: w2", "name: &n w2, height: *n", 9, "floors[0].walls[1].height", "aliases are not accepted"),
        ("name: w2", "name: !!python/object:os.system w2", 9, "floors[0].walls[1].name", "'w2' is not a value"),
        ("name: w2", "name: [w2", 9, "", "did not find expected"),
        ("elevators:", "---\nelevators:", 21, "", "only one document"),
    ],
)
def test_errors_name_line_and_key(old: str, new: str, line: int, key: str, reason: str) -> None:
    assert old in SOUND
    found = wrong(SOUND.replace(old, new, 1))
    assert (found.file, found.line, found.key) == ("house.yaml", line, key), found
    assert reason in found.reason


@pytest.mark.parametrize(
    ("raw", "line", "reason"),
    [
        (b"", 1, "empty file"),
        (b"\x89PNG\r\n\x1a\n\x00\x00", 1, "not UTF-8 text"),
        (b"a: 1\nb: \xff", 2, "not UTF-8 text"),
        (b"a: 1\nb: \0", 2, "control characters are not allowed"),
        (b"[" * 1_000_000, 1, "nested deeper than 40"),
        (b"{" * 1_000_000, 1, ""),  # either this reason or the depth: libyaml 0.2.6 scans ahead and counts levels
        (b"? " * 1_000_000, 1, "a key must be a plain word"),
        (b"robocorba: 1\nname: h\nfloors: []\n" + b"k" * 1_000_000 + b": 1", 4, ""),
        (b"robocorba: " + b"1" * 1_000_000, 1, "this release reads format version 1, not"),
        (b"robocorba: 1\nname: " + b"x" * 1_000_000 + b"\nfloors: []", 2, "the name has 1000000 characters"),
        (b"robocorba: 1\nname: x\nfloors:", 3, "Expected `array`, got `null`"),
        (b'robocorba: 1\nname: "\\ud800"\nfloors: []', 2, ""),
        (b"robocorba: 1\nname: x\nfloors: []\n.nan: 1", 1, "Expected `str`"),
    ],
)
def test_hostile_text(raw: bytes, line: int, reason: str) -> None:
    found = wrong(raw)
    assert found.line == line, found
    assert reason in found.reason


def test_size_and_number_of_values_are_bounded() -> None:
    with pytest.raises(MapFileError, match="more than 1000 values"):
        parse_yaml(b"[" + b"a," * 2000 + b"]", "long", YamlLimits(values=1000))
    with pytest.raises(MapFileError, match="larger than 9 KiB"):
        parse_yaml(b"#" * 10_001, "large", YamlLimits(size_bytes=10_000))
    with pytest.raises(MapFileError, match="larger than 64 KiB"):
        read_yaml("/dev/zero", YamlLimits(size_bytes=64 * 1024))


def test_keys_with_points_and_brackets_are_found() -> None:
    file = parse_yaml(b"levels:\n  L:\n    x: 1\n  L.1:\n    x:\n    - 2\n    - {y: 3}\n  'a[0]': 4\n", "f")
    lines = {"L.x": 3, "L.1.x": 6, "L.1.x[1].y": 7, "a[0]": 8, "none": 2, "L.1.x[7]": 6}
    assert {key: file.line(f"$.levels.{key}") for key in lines} == lines
    assert file.line("$") == file.line("$[...].x") == 1


@settings(deadline=None, max_examples=80)
@given(st.one_of(st.binary(max_size=200), st.text(alphabet="[]{}:,-&*!|>'\"%@ \n\tab01.", max_size=60).map(str.encode)))
def test_any_bytes_end_in_a_typed_error(raw: bytes) -> None:
    with pytest.raises(MapFileError):
        native.loads(raw)


def test_any_damage_to_a_sound_file_ends_in_a_building_or_a_typed_error() -> None:
    dice = random.Random(4)
    text = native.dumps(two_floors())
    outcomes: set[type] = set()
    for _ in range(150):
        at, length = dice.randrange(len(text)), dice.randrange(20)
        damaged = text[:at] + dice.choice(["", "x", "-1", "{", "]", "\n", ": ", "1.0e+99", "~"]) + text[at + length :]
        try:
            outcomes.add(type(native.loads(damaged)))
        except MapFileError as refused:
            outcomes.add(MapFileError)
            assert refused.line >= 1
    assert outcomes == {Building, MapFileError}


def test_five_floors_is_what_it_says() -> None:
    building = load_sample("five-floors")
    assert list(building.floors) == ["L1", "L2", "L3", "L4", "L5"]
    stops = {name: elevator.floors() for name, elevator in building.elevators.items()}
    assert stops == {"E1": ("L1", "L2", "L3", "L4", "L5"), "E2": ("L1", "L2", "L3"), "E3": ("L3", "L4", "L5")}
    for floor, entry in building.floors.items():
        assert 20 <= len(entry.topological.nodes) <= 40
        cabins = {node.elevator: Point(node.at) for node in entry.topological.nodes.values() if node.elevator}
        assert set(cabins) == {name for name, served in stops.items() if floor in served}
        for name, place in cabins.items():
            assert geometry.shaft_polygon(building.elevators[name]).contains(place)
    edges = [edge for entry in building.floors.values() for edge in entry.topological.edges.values()]
    assert any(edge.one_way for edge in edges) and any(edge.speed_limit for edge in edges)
    for unknown in ("", "../five-floors", "five-floors.yaml"):
        with pytest.raises(MapFileError, match="five-floors, paper-scene"):
            sample_path(unknown)
        assert map_file(unknown) == Path(unknown)
    assert map_file("five-floors") == sample_path("five-floors")


@settings(deadline=None, max_examples=30)
@given(buildings())
def test_a_building_comes_back_and_every_element_through_json(building: Building) -> None:
    assert native.loads(native.dumps(building)) == building
    for key, element in elements_of(building):
        members = json.loads(json.dumps(as_json(element)))
        assert from_json(key.kind, key.floor, members) == element
        assert [member["name"] for member in form_members(key.kind)] == list(members)


def test_members_are_described_by_type_unit_and_default() -> None:
    assert as_json(Wall("w", (0.0, 0.0), (1.0, 0.0))) == {"name": "w", "from": [0, 0], "to": [1, 0], "height": 2.5}
    members = {member["name"]: member for member in form_members(ElementKind.OBJECT)}
    assert members["at"] == {"name": "at", "default": None, "unit": "m", "type": "point"}
    assert members["heading"] == {"name": "heading", "default": 0, "unit": "rad", "type": "number"}
    assert members["movable"]["type"] == "boolean"
    assert set(members["shape"]["variants"]) == {"segment", "box", "circle", "polygon"}
    assert members["shape"]["variants"]["polygon"][0]["type"] == "points"
    doors = next(member for member in form_members(ElementKind.ELEVATOR) if member["name"] == "doors")
    assert doors["type"] == "rows"
    assert [(member["name"], member["type"]) for member in doors["members"][:2]] == [
        ("floor", "reference"),
        ("side", "choice"),
    ]
    edge = {member["name"]: member for member in form_members(ElementKind.EDGE)}
    assert edge["from"]["of"] == "node"
    assert (edge["graphs"]["type"], edge["speed_limit"]["unit"]) == ("names", "m/s")
    wall = {"name": "w", "from": [0, 0], "to": [1, 0]}
    for wrong in (None, [], {"name": "w"}, {**wall, "to": [1, "a"]}, {**wall, "colour": "red"}, {**wall, "name": 7}):
        with pytest.raises(InvalidElement):
            from_json(ElementKind.WALL, "L1", wrong)


def test_gateways_are_written_once_for_their_sub_network() -> None:
    room = Area("room", ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0)), "a", "10.0.0.1")
    alike = two_floors().with_element("L1", room).with_element("L2", msgspec.structs.replace(room, name="other"))
    text = native.dumps(alike)
    assert text.endswith('subnets:\n- {name: a, gateway: "10.0.0.1"}\n') and text.count("gateway") == 1
    assert native.loads(text) == alike
    different = alike.with_element("L2", msgspec.structs.replace(room, name="other", gateway="::1"))
    assert native.loads(native.dumps(different)) == different
    twice = 'subnets:\n- {name: a, gateway: "10.0.0.2"}\n'
    for before, after, key in (
        ('gateway: "10.0.0.1"', "gateway: lab", "subnets[0].gateway"),
        ("name: a, gateway", "name: b, gateway", "subnets[0].name"),
        ("subnets:\n", twice, "subnets[1]"),
    ):
        with pytest.raises(MapFileError) as refused:
            native.loads(text.replace(before, after))
        assert refused.value.key.removeprefix("$.") == key
        assert refused.value.line > 0
