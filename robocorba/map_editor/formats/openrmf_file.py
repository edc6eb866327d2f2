"""The content of an Open-RMF building.yaml, checked value by value. Every error names file, line and key."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

from robocorba.errors.maps import MapFileError
from robocorba.map_editor.formats.yaml_item import Item
from robocorba.map_editor.losses import Losses
from robocorba.map_editor.spatial.pose import XY


@dataclass(frozen=True)
class Vertex:
    """A point of a level: in the coordinates of the file, or of the building [m] after `Level.placed`."""

    at: XY
    name: str
    params: dict[str, Item]


@dataclass(frozen=True)
class Link:
    """A wall, lane, door or measurement: two vertices by index, and parameters."""

    item: Item
    a: int
    b: int
    params: dict[str, Item]

    def text(self, name: str) -> str:
        """A parameter as text, empty if it is missing."""
        return self.params[name].text() if name in self.params else ""


@dataclass(frozen=True)
class Level:
    """One level of the file."""

    item: Item
    name: str
    elevation: float
    vertices: list[Vertex]
    links: dict[str, list[Link]]
    fiducials: dict[str, XY] = field(default_factory=dict)
    polygons: list[list[int]] = field(default_factory=list)
    holes: list[list[int]] = field(default_factory=list)

    def placed(self, to_building: Callable[[XY], XY]) -> Level:
        """The level with its vertices in the coordinates of the building."""
        vertices = [replace(vertex, at=to_building(vertex.at)) for vertex in self.vertices]
        return replace(self, vertices=vertices)

    def points(self, indices: Iterable[int]) -> list[XY]:
        """The positions of vertices."""
        return [self.vertices[index].at for index in indices]

    def node_vertices(self) -> list[int]:
        """Indices of the vertices that become nodes: those of lanes, and those with a name or parameters."""
        ends = {index for lane in self.links["lanes"] for index in (lane.a, lane.b)}
        return [i for i, vertex in enumerate(self.vertices) if i in ends or vertex.name or vertex.params]


def read_level(name: str, item: Item, losses: Losses) -> Level:
    """One level, with checked vertex indices and lanes. A lane that can't be read is left out: a road can be drawn
    again, while a building without one of its walls would be another one. Raises MapFileError."""
    vertices = [_vertex(vertex) for vertex in item.get("vertices").items()]
    fiducials: dict[str, XY] = {}
    for entry in item.get("fiducials").items():
        x, y, label = _row(entry, 3)[:3]
        if label.text():
            fiducials.setdefault(label.text(), (x.number(), y.number()))
    return Level(
        item=item,
        name=name,
        elevation=item.get("elevation").number(0.0),
        vertices=vertices,
        links={
            **{
                kind: [_link(link, len(vertices)) for link in item.get(kind).items()]
                for kind in ("walls", "doors", "measurements")
            },
            "lanes": _lanes(name, item.get("lanes"), len(vertices), losses),
        },
        fiducials=fiducials,
        polygons=[_polygon(entry, len(vertices)) for entry in item.get("floors").items()],
        holes=[_polygon(entry, len(vertices)) for entry in item.get("holes").items()],
    )


def _row(item: Item, least: int) -> list[Item]:
    row = item.items()
    if len(row) < least:
        raise item.error(f"expected at least {least} values")
    return row


def _vertex(item: Item) -> Vertex:
    """A vertex from [x, y, z, name, {parameters}]; old files omit values at the end."""
    row = _row(item, 2)
    if len(row) > 2:
        row[2].number()
    return Vertex(
        at=(row[0].number(), row[1].number()),
        name=row[3].text() if len(row) > 3 else "",
        params=params(row[4]) if len(row) > 4 else {},
    )


def _link(item: Item, vertices: int) -> Link:
    row = _row(item, 2)
    a, b = _index(row[0], vertices), _index(row[1], vertices)
    return Link(item, a, b, params(row[2]) if len(row) > 2 else {})


def _lanes(level: str, item: Item, vertices: int, losses: Losses) -> list[Link]:
    found: list[Link] = []
    for lane in item.items():
        try:
            link = _link(lane, vertices)
            _check_lane(link)
        except MapFileError as error:
            losses.add("lanes that can't be read, left out: {names}", f"{level} {error.key} ({error.reason})")
        else:
            found.append(link)
    return found


def _check_lane(lane: Link) -> None:
    """Raises MapFileError for a parameter that a building keeps and that has another type or range."""
    lane.text("name")
    for name in ("speed_limit", "clearance"):
        if name in lane.params and lane.params[name].number() < 0:
            raise lane.params[name].error("must not be below zero")
    if "graph_idx" in lane.params:
        lane.params["graph_idx"].integer()
    for name in ("bidirectional", "is_bidirectional"):
        flag(lane.params, name)


def _polygon(item: Item, vertices: int) -> list[int]:
    return [_index(index, vertices) for index in item.need("vertices").items()]


def _index(item: Item, vertices: int) -> int:
    index = item.integer()
    if not 0 <= index < vertices:
        raise item.error(f"there is no vertex {index}; the level has {vertices}")
    return index


def params(item: Item) -> dict[str, Item]:
    """Parameters by name. Each is [type, value]; in the oldest files it is a bare value."""
    found = {}
    for name, entry in item.members():
        if isinstance(entry.value, list):
            if len(entry.value) != 2:
                raise entry.error("expected [type, value]")
            entry = entry.items()[1]
        found[name] = entry
    return found


def flag(params: dict[str, Item], name: str) -> bool:
    """A boolean parameter, False if it is missing."""
    if name not in params:
        return False
    value = params[name].value
    if not isinstance(value, (bool, int)):
        raise params[name].error("expected true or false")
    return bool(value)
