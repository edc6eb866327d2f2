"""The native map file: versioned YAML, one element per line. docs/map-file.md is its manual."""

from __future__ import annotations

import json
import re
from collections.abc import Container, Iterable
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from robocorba.errors.maps import InvalidElement
from robocorba.map_editor import validation
from robocorba.map_editor.element_rules import violations
from robocorba.map_editor.model import (
    COLLECTION_OF,
    Area,
    Building,
    Door,
    Element,
    ElementKind,
    Elevator,
    Floor,
    FloorMap,
    MapObject,
    PathEdge,
    PathNode,
    Wall,
    by_level,
)
from robocorba.map_editor.yaml_file import YamlFile, parse_yaml, read_yaml
from robocorba.system.output_files import write_outputs

E_ = TypeVar("E_", bound=Element)


class _FloorEntry(Floor, frozen=True):
    height: float = 3.0  # not the object that Floor has as its default, which msgspec would omit
    walls: tuple[Wall, ...] = ()
    objects: tuple[MapObject, ...] = ()
    doors: tuple[Door, ...] = ()
    areas: tuple[Area, ...] = ()
    nodes: tuple[PathNode, ...] = ()
    edges: tuple[PathEdge, ...] = ()


class _Subnet(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    gateway: str


class _BuildingFile(msgspec.Struct, forbid_unknown_fields=True):
    robocorba: int
    name: str
    floors: tuple[_FloorEntry, ...]
    elevators: tuple[Elevator, ...] = ()
    subnets: tuple[_Subnet, ...] = ()


def load(path: str | Path) -> Building:
    """Read and check a native map file. Raises MapFileError with file, line and key."""
    return checked(read_yaml(path))


def loads(text: str | bytes, name: str = "map") -> Building:
    """Read and check a native map from text. Errors use `name` as the file name. Raises MapFileError."""
    return checked(parse_yaml(text.encode() if isinstance(text, str) else text, name))


def is_native(data: Any) -> bool:
    """Whether parsed YAML looks like a native map file."""
    return isinstance(data, dict) and "robocorba" in data


def checked(file: YamlFile) -> Building:
    """The building of a file. Raises MapFileError with line and key."""
    building = parse(file)
    check_rules(file, building)
    return building


def check_rules(file: YamlFile, building: Building) -> None:
    """Raise MapFileError with line and key if the building of a file breaks a rule. A list of floors by `name` and one
    of elevators say where."""
    for wrong in validation.problems(building, limit=1):
        raise file.error(_key_of(file, wrong), str(wrong))


def parse(file: YamlFile) -> Building:
    """The building of a file, before its rules are checked. Raises MapFileError."""
    if not is_native(file.data):
        raise file.error("$", "not a RoboCorba map: the key `robocorba: 1` is missing")
    version = file.data["robocorba"]
    if type(version) is not int or version != 1:
        raise file.error("$.robocorba", f"this release reads format version 1, not {version!r}")
    content = file.convert(_BuildingFile)
    gateways = _gateways(file, content)
    floors: dict[str, FloorMap] = {}
    for i, entry in enumerate(content.floors):
        at = f"$.floors[{i}]"
        if entry.name in floors:
            raise file.error(f"{at}.name", f"there is a floor {entry.name!r} already")
        areas = tuple(
            area if area.gateway else msgspec.structs.replace(area, gateway=gateways.get(area.subnet, ""))
            for area in entry.areas
        )
        entry = msgspec.structs.replace(entry, areas=areas)
        floors[entry.name] = FloorMap.of(
            Floor(entry.name, entry.level, entry.elevation, entry.height, entry.outline),
            {kind: _by_name(getattr(entry, key), f"{at}.{key}", file) for kind, (_layer, key) in COLLECTION_OF.items()},
        )
    return Building(content.name, by_level(floors), _by_name(content.elevators, "$.elevators", file))


def _gateways(file: YamlFile, content: _BuildingFile) -> dict[str, str]:
    """The gateways of sub-networks by name."""
    known = {area.subnet for floor in content.floors for area in floor.areas}
    found: dict[str, str] = {}
    for i, subnet in enumerate(content.subnets):
        at = f"$.subnets[{i}]"
        if subnet.name in found:
            raise file.error(at, f"the name {subnet.name!r} is used twice")
        if subnet.name not in known:
            raise file.error(f"{at}.name", f"no area has the subnet {subnet.name!r}")
        probe = Area("probe", ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)), subnet.name, subnet.gateway)
        for reason in violations(probe):
            raise file.error(f"{at}.gateway", reason)
        found[subnet.name] = subnet.gateway
    return found


def _by_name(elements: Iterable[E_], at: str, file: YamlFile) -> dict[str, E_]:
    found: dict[str, E_] = {}
    for i, element in enumerate(elements):
        if isinstance(element, PathEdge) and not element.name:
            element = msgspec.structs.replace(element, name=_default_name(element))
        if element.name in found:
            raise file.error(f"{at}[{i}]", f"the name {element.name!r} is used twice")
        found[element.name] = element
    return found


def _key_of(file: YamlFile, wrong: InvalidElement) -> str:
    """The key path of the element that an error names."""
    if wrong.kind == "building":
        return "$.name"
    if wrong.kind == "elevator":
        return _index("$.elevators", file.data.get("elevators") or [], wrong.name)
    floor = wrong.name if wrong.kind == "floor" else wrong.floor
    at = _index("$.floors", file.data["floors"], floor)
    if wrong.kind == "floor" or "]" not in at:
        return at
    _layer, key = COLLECTION_OF[ElementKind(wrong.kind)]
    entries = file.data["floors"][int(at[len("$.floors[") : -1])].get(key)
    return _index(f"{at}.{key}", entries, wrong.name) if entries else at


def _index(at: str, entries: list[dict[str, Any]], name: str) -> str:
    for i, entry in enumerate(entries):
        if entry.get("name") == name or ("name" not in entry and f"{entry.get('from')}-{entry.get('to')}" == name):
            return f"{at}[{i}]"
    return at


def dumps(building: Building) -> str:
    """A building as the text of a native map file. Loading the text gives an equal building."""
    out = ["robocorba: 1", f"name: {_flow(building.name)}", "floors:" if building.floors else "floors: []"]
    gateways = _common_gateways(building)
    for name, entry in building.floors.items():
        floor = msgspec.to_builtins(entry.floor)
        out += [f"{'- ' if i == 0 else '  '}{key}: {_flow(value)}" for i, (key, value) in enumerate(floor.items())]
        for kind, (_layer, key) in COLLECTION_OF.items():
            out += _listed(f"  {key}:", "  ", building.elements(kind, name).values(), gateways)
    out += _listed("elevators:", "", building.elevators.values())
    if gateways:
        rows = ({"name": name, "gateway": gateway} for name, gateway in gateways.items())
        out += ["subnets:", *(f"- {_flow(row)}" for row in rows)]
    return "\n".join(out) + "\n"


def _common_gateways(building: Building) -> dict[str, str]:
    """The gateways of those sub-networks whose areas have the same one, by name; the others stay in the areas."""
    found: dict[str, set[str]] = {}
    for floor in building.floors.values():
        for area in floor.geometrical.areas.values():
            found.setdefault(area.subnet, set()).add(area.gateway)
    return {name: min(each) for name, each in found.items() if name and len(each) == 1 and "" not in each}


def _listed(head: str, indent: str, elements: Iterable[Element], gateways: Container[str] = ()) -> list[str]:
    lines = [f"{indent}- {_flow(_entry(element, gateways))}" for element in elements]
    return [head, *lines] if lines else []


def _entry(element: Element, gateways: Container[str]) -> dict[str, Any]:
    entry: dict[str, Any] = msgspec.to_builtins(element)
    if isinstance(element, Area) and element.subnet in gateways:
        del entry["gateway"]
    if isinstance(element, PathEdge) and element.name == _default_name(element):
        del entry["name"]
    return entry


def _default_name(edge: PathEdge) -> str:
    return f"{edge.a}-{edge.b}"


#: Words that YAML reads as text without quotes.
_PLAIN = re.compile(r"(?!(?:y|n|yes|no|on|off|true|false|null)$)[A-Za-z_][A-Za-z0-9_.-]*", re.IGNORECASE | re.ASCII)


def _flow(value: Any) -> str:
    """A value as YAML on one line, about 50 times faster than a general YAML writer."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        # YAML requires a point in the mantissa.
        text = repr(value)
        return text.replace("e", ".0e") if "e" in text and "." not in text else text
    if isinstance(value, str) and not _PLAIN.fullmatch(value):
        return json.dumps(value, ensure_ascii=not value.isprintable())
    return str(value)


def save(building: Building, path: str | Path) -> None:
    """Write a native map file atomically. Raises OutputError if that fails."""
    write_outputs({Path(path): dumps(building).encode()})
