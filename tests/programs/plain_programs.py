"""Programs as plain data, for hypothesis: valid ones, and those with one thing wrong that is known."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from hypothesis import strategies as st

from robocorba.programs.program import MAX_NESTING, schema
from tests.programs import json_schema

SCHEMA = schema()
#: What the icon of a tag has: its schema.
ICON_NODES = {
    node["properties"]["icon"]["enum"][0]: node
    for node in SCHEMA["$defs"].values()
    if "icon" in node.get("properties", {})
}
PROGRAMS: st.SearchStrategy[dict[str, Any]] = json_schema.values(SCHEMA, SCHEMA)


class Malformed(NamedTuple):
    """A program as JSON, and which parameter of which icon is wrong in it."""

    text: str
    icon: str
    parameter: str
    is_against_schema: bool = True


def plain_icons(program: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every icon with its path."""
    return _inside("icons", program["icons"])


def _inside(at: str, icons: list[dict[str, Any]]) -> Iterator[tuple[str, dict[str, Any]]]:
    for number, icon in enumerate(icons):
        path = f"{at}[{number}]"
        yield path, icon
        for name in ("icons", "then", "otherwise"):
            if name in icon:
                yield from _inside(f"{path}.{name}", icon[name])


@st.composite
def malformed(draw: st.DrawFn) -> Malformed:
    """A valid program with one thing made wrong."""
    program = copy.deepcopy(draw(PROGRAMS))
    path, icon = draw(st.sampled_from(list(plain_icons(program))))
    node = ICON_NODES[icon["icon"]]
    faults = [("unknown", "icon"), ("untold", "icon"), ("surplus", "wings"), ("twice", "icon")]
    for name, part in node["properties"].items():
        if name == "icon":
            continue
        faults += [("missing", name)] if name in node["required"] else []
        part = _one(part)
        kind = "joints" if name == "joints" else part.get("type", "enum" if "enum" in part else "")
        if kind or "anyOf" in part:
            faults += [("type", name)]
        faults += [(fault, name) for fault in _FAULTS.get(kind, ())]
        faults += [("empty", name)] if part.get("minItems") else []
    fault, name = draw(st.sampled_from(faults))
    part = _one(node["properties"].get(name, {}))
    if fault in ("missing", "untold"):
        icon.pop(name, None)
    elif fault == "twice":
        marked = json.dumps(program | {"icons": _marked(program["icons"], icon)})
        return Malformed(marked.replace('"MARK": 0', '"icon": "wait"'), path, name, False)
    elif fault == "deep":
        icon[name] = _nested(MAX_NESTING)
        levels = MAX_NESTING - path.count("[")
        return Malformed(json.dumps(program), f"{path}.{name}[0]" + ".icons[0]" * (levels - 1), "icons", False)
    else:
        icon[name] = _wrong(draw, fault, part)
    return Malformed(json.dumps(program), path, name, fault not in ("nan", "infinite"))


_FAULTS = {
    "number": ("low", "high", "nan", "infinite"),
    "integer": ("low", "high"),
    "string": ("empty", "long", "control"),
    "joints": ("empty", "short", "beyond"),
    "array": ("deep",),
    "enum": ("unknown",),
}


def _one(node: dict[str, Any]) -> dict[str, Any]:
    """Of a parameter that may be left out: what it is if not."""
    ways = [way for way in node.get("anyOf", ()) if way.get("type") != "null"]
    return json_schema.resolved(SCHEMA, ways[0] if len(ways) == 1 else node)


def _wrong(draw: st.DrawFn, fault: str, part: dict[str, Any]) -> Any:
    number = part.get("type") in ("number", "integer")
    if fault == "unknown":
        return draw(st.sampled_from(["fly", "Mbase", "mbase_path ", ""]))
    if fault == "surplus":
        return 2
    if fault == "type":
        return draw(st.sampled_from([True, "x" if number else 1.5, *([[[]], {"icon": 3}] if number else [])]))
    if fault == "low":
        return part.get("minimum", part.get("exclusiveMinimum", 0) + 1) - draw(st.integers(1, 10**9))
    if fault == "high":
        return part["maximum"] + draw(st.integers(1, 10**9))
    if fault in ("nan", "infinite"):
        return math.nan if fault == "nan" else draw(st.sampled_from([math.inf, -math.inf]))
    if fault in ("long", "control"):
        return "x" * 201 if fault == "long" else "a\nb"
    if fault == "empty":
        return "" if part["type"] == "string" else []
    return [0.0] * 6 if fault == "short" else [*[0.0] * 6, draw(st.floats(1.1, 10))]


def _marked(icons: list[dict[str, Any]], wanted: dict[str, Any]) -> list[dict[str, Any]]:
    marked = []
    for icon in icons:
        found = {
            name: _marked(value, wanted) if name in ("icons", "then", "otherwise") else value
            for name, value in icon.items()
        }
        marked.append(found | {"MARK": 0} if icon is wanted else found)
    return marked


def _nested(depth: int) -> list[dict[str, Any]]:
    icons: list[dict[str, Any]] = [{"icon": "wait", "seconds": 1.0}]
    for _ in range(depth):
        icons = [{"icon": "repeat", "times": 2, "icons": icons}]
    return icons
