"""As much of JSON schema as the schema of programs uses: what a value breaks, and hypothesis strategies of values.

Both refuse a schema that uses a word which they don't know."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from hypothesis import strategies as st

_TYPES: dict[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "number": (int, float),
    "integer": (int,),
    "null": (type(None),),
}
_KNOWN = {"$ref", "$defs", "$schema", "anyOf", "discriminator", "enum", "type", "title", "description", "default"}
_KNOWN |= {"minimum", "maximum", "exclusiveMinimum", "minLength", "maxLength", "pattern"}
_KNOWN |= {"properties", "required", "additionalProperties", "items", "prefixItems", "minItems", "maxItems"}

Node = dict[str, Any]

JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False, allow_infinity=False)
    # no half surrogates
    | st.text(st.characters(exclude_categories=["Cs"]), max_size=10),
    lambda inside: (
        st.lists(inside, max_size=3)
        | st.dictionaries(st.text(st.characters(exclude_categories=["Cs"]), max_size=5), inside, max_size=3)
    ),
    max_leaves=5,
)


def problems(schema: Node, value: Any) -> list[str]:
    """What a value breaks; empty: the schema accepts it."""
    return list(_problems(schema, schema, value, "$"))


def resolved(schema: Node, node: Node) -> Node:
    """What a $ref leads to."""
    assert node.keys() <= _KNOWN, node.keys() - _KNOWN
    return schema["$defs"][node["$ref"].rpartition("/")[2]] if "$ref" in node else node


def _problems(schema: Node, node: Node, value: Any, at: str) -> Iterator[str]:
    node = resolved(schema, node)
    if "anyOf" in node:
        if all(list(_problems(schema, way, value, at)) for way in node["anyOf"]):
            yield f"{at}: none of {len(node['anyOf'])} ways"
    elif "enum" in node:
        if value not in node["enum"] or isinstance(value, bool):
            yield f"{at}: not one of {node['enum']}"
    elif "type" in node:
        if not isinstance(value, _TYPES[node["type"]]) or isinstance(value, bool):
            yield f"{at}: no {node['type']}"
        else:
            yield from _of_type(schema, node, value, at)


def _of_type(schema: Node, node: Node, value: Any, at: str) -> Iterator[str]:
    if isinstance(value, int | float):
        if not node.get("minimum", value) <= value <= node.get("maximum", value):
            yield f"{at}: out of range"
        if "exclusiveMinimum" in node and not value > node["exclusiveMinimum"]:
            yield f"{at}: out of range"
    elif isinstance(value, str):
        if not node.get("minLength", 0) <= len(value) <= node.get("maxLength", len(value)):
            yield f"{at}: length"
        if "pattern" in node and not re.search(node["pattern"], value):
            yield f"{at}: pattern"
    elif isinstance(value, list):
        if not node.get("minItems", 0) <= len(value) <= node.get("maxItems", len(value)):
            yield f"{at}: number of items"
        nodes = node.get("prefixItems") or [node["items"]] * len(value)
        for number, (inside, part) in enumerate(zip(nodes, value, strict=False)):
            yield from _problems(schema, inside, part, f"{at}[{number}]")
    elif isinstance(value, dict):
        yield from (f"{at}: {name} is missing" for name in node["required"] if name not in value)
        for name, part in value.items():
            if name in node["properties"]:
                yield from _problems(schema, node["properties"][name], part, f"{at}.{name}")
            elif node.get("additionalProperties") is False:
                yield f"{at}: {name} is too much"


def values(schema: Node, node: Node, depth: int = 2) -> st.SearchStrategy[Any]:
    """What the schema accepts; of ways that lead to themselves again at most `depth` inside each other."""
    node = resolved(schema, node)
    if "anyOf" in node:
        ways = [way for way in node["anyOf"] if depth > 0 or not _holds_icons(resolved(schema, way))]
        return st.one_of([values(schema, way, depth) for way in ways])
    if "enum" in node:
        return st.sampled_from(node["enum"])
    kind = node.get("type")
    if kind == "object":
        required = {name: _later(schema, node["properties"][name], depth) for name in node["required"]}
        others = {name: part for name, part in node["properties"].items() if name not in required}
        return st.fixed_dictionaries(
            required, optional={name: _later(schema, part, depth) for name, part in others.items()}
        )
    if kind == "array":
        if "prefixItems" in node:
            return st.tuples(*(values(schema, part, depth) for part in node["prefixItems"])).map(list)
        return st.lists(values(schema, node["items"], depth), min_size=node.get("minItems", 0), max_size=3)
    if kind == "string":
        letters = st.characters(exclude_categories=["Cs", "Cc"])
        return st.text(letters, min_size=node.get("minLength", 0), max_size=8)
    if kind == "number":
        low = node.get("minimum", node.get("exclusiveMinimum"))
        return st.floats(low, node["maximum"], exclude_min="exclusiveMinimum" in node, allow_subnormal=False)
    if kind == "integer":
        return st.integers(node["minimum"], node["maximum"])
    return st.none() if kind == "null" else JSON


def _later(schema: Node, node: Node, depth: int) -> st.SearchStrategy[Any]:
    return st.deferred(lambda: values(schema, node, depth - 1 if node.get("type") == "array" else depth))


def _holds_icons(node: Node) -> bool:
    return any("anyOf" in (part.get("items") or {}) for part in node.get("properties", {}).values())
