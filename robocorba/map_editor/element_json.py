"""Elements of a building as JSON objects with all their members, and what a form needs to edit these."""

from __future__ import annotations

from enum import Enum
from typing import Any

import msgspec
from msgspec import inspect

from robocorba.errors.maps import InvalidElement
from robocorba.map_editor.model import TYPE_OF, Element, ElementKind
from robocorba.system.decoding import convert

#: Units of the members with a dimension; m is that of points and of all other numbers.
_UNITS = {"heading": "rad", "speed": "m/s", "speed_limit": "m/s", "door_time": "s", "level": "", "mass": "kg"}
#: Members that name other elements: of which kind.
_REFERENCES = {
    (ElementKind.NODE, "elevator"): ElementKind.ELEVATOR,
    (ElementKind.EDGE, "from"): ElementKind.NODE,
    (ElementKind.EDGE, "to"): ElementKind.NODE,
    (ElementKind.ELEVATOR, "floor"): ElementKind.FLOOR,
}


def as_json(element: Element) -> dict[str, Any]:
    """All members of an element, also those with default values, with the keys of the native map file."""
    return _struct_json(element)


def from_json(kind: ElementKind, floor: str, members: Any) -> Element:
    """The element of such an object. Raises InvalidElement, also for keys that the kind does not have."""
    try:
        element: Element = convert(members, TYPE_OF[kind])
    except msgspec.ValidationError as error:
        name = members.get("name", "") if isinstance(members, dict) else ""
        raise InvalidElement(kind.value, floor, str(name), str(error)) from None
    return element


def form_members(kind: ElementKind) -> list[dict[str, Any]]:
    """The members of a kind in their order, each with `name`, `type`, `unit`, `default` (None: required) and, by type,

    - number, integer, boolean, text, names (a list of texts), point, points
    - choice: `choices`
    - reference: `of`, the kind of the element that it names
    - variants: `variants`, the members by the value of their key `kind`
    - rows: `members` of each row."""
    return [_member(kind, field) for field in inspect.type_info(TYPE_OF[kind]).fields]  # type: ignore[attr-defined]


def _struct_json(value: Any) -> Any:
    if isinstance(value, msgspec.Struct):
        fields = msgspec.structs.fields(value)
        members = {field.encode_name: _struct_json(getattr(value, field.name)) for field in fields}
        tag = value.__struct_config__.tag
        return {"kind": tag, **members} if tag else members
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, tuple):
        return [_struct_json(item) for item in value]
    return value


def _member(kind: ElementKind, field: inspect.Field) -> dict[str, Any]:
    name = field.encode_name
    default = None if field.default is msgspec.NODEFAULT else _struct_json(field.default)
    described = _type(kind, name, field.type)
    unit = _UNITS.get(name, "m") if described["type"] in ("number", "point", "points") else ""
    return {"name": name, "default": default, "unit": unit, **described}


def _type(kind: ElementKind, name: str, found: inspect.Type) -> dict[str, Any]:
    if (kind, name) in _REFERENCES:
        return {"type": "reference", "of": _REFERENCES[kind, name].value}
    if isinstance(found, inspect.EnumType):
        return {"type": "choice", "choices": [choice.value for choice in found.cls]}
    if isinstance(found, inspect.UnionType):
        shapes = [shape for shape in found.types if isinstance(shape, inspect.StructType)]
        return {
            "type": "variants",
            "variants": {str(one.tag): [_member(kind, f) for f in one.fields] for one in shapes},
        }
    if isinstance(found, inspect.TupleType):
        return {"type": "point"}
    if isinstance(found, inspect.VarTupleType):
        item = found.item_type
        if isinstance(item, inspect.StructType):
            return {"type": "rows", "members": [_member(kind, field) for field in item.fields]}
        return {"type": "points" if isinstance(item, inspect.TupleType) else "names"}
    simple = {inspect.FloatType: "number", inspect.IntType: "integer", inspect.BoolType: "boolean"}
    return {"type": simple.get(type(found), "text")}
