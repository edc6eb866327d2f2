"""What a value breaks in a JSON schema, and hypothesis strategies of values that the schema of programs accepts."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st
from jsonschema import Draft202012Validator

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
    return [error.message for error in Draft202012Validator(schema).iter_errors(value)]


def resolved(schema: Node, node: Node) -> Node:
    """What a $ref leads to."""
    return schema["$defs"][node["$ref"].rpartition("/")[2]] if "$ref" in node else node


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
