"""Conversion between elements of a building, their changes and findings, and IDL types."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

import msgspec
from omniORB import CORBA

from robocorba.errors import maps as errors
from robocorba.map_editor import model
from robocorba.map_editor.changes import Change, ChangeKind, ElementKey
from robocorba.map_editor.edits import EditRecord, Finding, MapChange
from robocorba.map_editor.model import KIND_OF, CabinSide, DoorKind, Element, ElementKind, Shape
from robocorba.map_editor.pages import ChangePage, ChangePosition, ElementPage, Selection
from robocorba.map_editor.proposals import Proposal
from robocorba.map_editor.spatial.pose import XY
from robocorba.map_editor.underlays import Underlay
from robocorba.orb.exceptions import register, register_system, register_with
from robocorba.orb.structs import BOOLEAN, SAME, STRINGS, Converter, enumeration, sequence, struct_converter
from robocorba.stubs import RoboCorba

#: Returns an element by kind, floor and name, None if there is none.
Find: TypeAlias = Callable[[ElementKind, str, str], Element | None]

_KIND: Converter[ElementKind] = enumeration(ElementKind, suffix="_ELEMENT")
#: The ElementKind enumerator of a kind, and the kind of one.
enumerator_of, kind_of = _KIND.both
_POINT: Converter[XY] = Converter(lambda point: RoboCorba.XY(*point), lambda found: (found.x, found.y))
#: An XY struct, and the point of one.
xy, xy_of = _POINT.both
_POINTS = sequence(_POINT)
_ENDS = {"fromPoint": "a", "toPoint": "b"}

#: The discriminator of each kind of shape, and the member of its struct.
_SHAPES = {
    model.SegmentShape: (RoboCorba.SEGMENT_SHAPE, "length", SAME),
    model.BoxShape: (RoboCorba.BOX_SHAPE, "size", _POINT),
    model.CircleShape: (RoboCorba.CIRCLE_SHAPE, "radius", SAME),
    model.PolygonShape: (RoboCorba.POLYGON_SHAPE, "points", _POINTS),
}


def _shape(value: Shape) -> Any:
    discriminator, member, converter = _SHAPES[type(value)]
    return RoboCorba.Shape(discriminator, converter.to_idl(getattr(value, member)))


def _shape_of(union: Any) -> Shape:
    for shape, (discriminator, member, converter) in _SHAPES.items():
        if union._d == discriminator:
            return shape(**{member: converter.from_idl(union._v)})
    raise CORBA.BAD_PARAM(0, CORBA.COMPLETED_NO)


_ELEVATOR_DOOR = struct_converter(
    model.ElevatorDoor, RoboCorba.ElevatorDoor, {"onFloor": "floor"}, side=enumeration(CabinSide)
)
_ELEMENTS: dict[ElementKind, Converter[Any]] = {
    ElementKind.FLOOR: struct_converter(model.Floor, RoboCorba.Floor, outline=_POINTS),
    ElementKind.WALL: struct_converter(model.Wall, RoboCorba.Wall, _ENDS, a=_POINT, b=_POINT),
    ElementKind.OBJECT: struct_converter(
        *(model.MapObject, RoboCorba.MapObject, {"footprint": "shape"}),
        shape=Converter(_shape, _shape_of),
        at=_POINT,
        movable=BOOLEAN,
    ),
    ElementKind.DOOR: struct_converter(
        model.Door, RoboCorba.Door, _ENDS, a=_POINT, b=_POINT, kind=enumeration(DoorKind), locked=BOOLEAN
    ),
    ElementKind.AREA: struct_converter(model.Area, RoboCorba.Area, polygon=_POINTS),
    ElementKind.NODE: struct_converter(model.PathNode, RoboCorba.PathNode, {"inElevator": "elevator"}, at=_POINT),
    ElementKind.EDGE: struct_converter(
        *(model.PathEdge, RoboCorba.PathEdge, {"fromNode": "a", "toNode": "b", "directed": "one_way"}),
        one_way=BOOLEAN,
        graphs=STRINGS,
    ),
    ElementKind.ELEVATOR: struct_converter(
        model.Elevator, RoboCorba.Elevator, at=_POINT, size=_POINT, doors=sequence(_ELEVATOR_DOOR)
    ),
}


def element(value: Element) -> Any:
    """An Element union."""
    kind = KIND_OF[type(value)]
    return RoboCorba.Element(_KIND.to_idl(kind), _ELEMENTS[kind].to_idl(value))


def element_of(union: Any) -> Element:
    """The element in an Element union. Raises CORBA.BAD_PARAM for an empty union."""
    try:
        kind = kind_of(union._d)
    except KeyError:
        raise CORBA.BAD_PARAM(0, CORBA.COMPLETED_NO) from None
    found: Element = _ELEMENTS[kind].from_idl(union._v)
    return found


def fact_keys(kind: ElementKind) -> tuple[str, ...]:
    """The members of a kind that are ElementFacts, since its struct of 0.1.0 lacks them."""
    return {ElementKind.OBJECT: ("mass",), ElementKind.AREA: ("gateway",)}.get(kind, ())


def facts(floor: str, value: Element) -> list[Any]:
    """The ElementFacts of an element, also those that are 0 or empty."""
    kind = KIND_OF[type(value)]
    where = element_id(kind.value, floor, value.name)
    return [RoboCorba.ElementFact(where, each, str(getattr(value, each))) for each in fact_keys(kind)]


def facts_of(building: model.Building, part: Selection) -> list[Any]:
    """The ElementFactSeq of a part of a building."""
    return [
        fact
        for floor in building.floors
        if part.floor in ("", floor)
        for kind in part.kinds or ElementKind
        for value in building.elements(kind, floor).values()
        if any(getattr(value, each) for each in fact_keys(kind))
        for fact in facts(floor, value)
    ]


def with_fact(value: Element, fact: Any) -> Element:
    """An element with a fact. Raises InvalidElement."""
    key = key_of(fact.id)
    known = fact_keys(key.kind)
    if fact.key not in known:
        reason = f"it has no fact {fact.key[:80]!r}; there are {', '.join(known) or 'none'}"
        raise errors.InvalidElement(*key.words, reason)
    try:
        fresh = type(getattr(value, fact.key))(fact.value)
    except ValueError:
        raise errors.InvalidElement(*key.words, f"{fact.key} is not a number: {fact.value[:80]!r}") from None
    return msgspec.structs.replace(value, **{fact.key: fresh})


def with_facts(building: model.Building, found: Iterable[Any]) -> model.Building:
    """A building with the facts of an ElementFactSeq; those of elements that it lacks, and of later releases, are left
    out."""
    changes: dict[ElementKey, Element] = {}
    for fact in found:
        key = key_of(fact.id)
        before = changes.get(key) or building.find(*key)
        if before is not None and fact.key in fact_keys(key.kind):
            changes[key] = with_fact(before, fact)
    fresh = [(*key, value) for key, value in changes.items() if value != building.find(*key)]
    return building.with_changes(fresh) if fresh else building


def edited(fact: Any, find: Find) -> tuple[str, Element]:
    """The floor and the element of a fact, with the fact. Raises UnknownElement, InvalidElement."""
    key = key_of(fact.id)
    before = find(*key)
    if before is None:
        raise errors.UnknownElement(*key.words)
    return key.floor, with_fact(before, fact)


def replacement_of(union: Any, floor: str, find: Find) -> Element:
    """The element in an Element union, with the facts of the one that it replaces, which `find` returns."""
    value = element_of(union)
    kind = KIND_OF[type(value)]
    if (kept := fact_keys(kind)) and (before := find(kind, floor, value.name)) is not None:
        value = msgspec.structs.replace(value, **{each: getattr(before, each) for each in kept})
    return value


def key_of(struct: Any) -> ElementKey:
    """The key of an ElementId."""
    return ElementKey(kind_of(struct.kind), struct.onFloor, struct.name)


def element_id(kind: str, floor: str, name: str) -> Any:
    """An ElementId."""
    return RoboCorba.ElementId(_KIND.to_idl(ElementKind(kind)), floor, name)


def record(floor: str, value: Element, changed_in: int) -> Any:
    """An ElementRecord. changed_in: the version of the building that last changed the element."""
    return RoboCorba.ElementRecord(floor, element(value), changed_in)


def findings(values: Iterable[Finding]) -> list[Any]:
    """A FindingSeq."""
    return [
        RoboCorba.Finding(element_id(one.kind.value, one.floor, one.name), RoboCorba.Point(*one.where), one.reason)
        for one in values
    ]


def findings_of(found: Iterable[Any]) -> list[Finding]:
    """The findings of a FindingSeq."""
    return [Finding(*key_of(one.id), (one.position.floor, one.position.x, one.position.y), one.reason) for one in found]


def changes(values: Iterable[Change]) -> list[Any]:
    """A ChangeSeq."""
    return [
        RoboCorba.Change(change.version, getattr(RoboCorba, change.kind.name), change.floor, element(change.element))
        for change in values
    ]


def changes_of(found: Iterable[Any]) -> list[MapChange]:
    """The changes of a ChangeSeq."""
    return [MapChange(one.changedTo, ChangeKind[str(one.kind)], one.onFloor, element_of(one.value)) for one in found]


def selection(part: Selection) -> Any:
    """A MapSelection."""
    return RoboCorba.MapSelection([_KIND.to_idl(kind) for kind in part.kinds], part.floor)


def selection_of(struct: Any) -> Selection:
    """The part of the building that a MapSelection names."""
    return Selection(tuple(dict.fromkeys(map(kind_of, struct.kinds))), struct.onFloor)


#: A ChangePosition struct, and the position of one.
position, position_of = struct_converter(ChangePosition, RoboCorba.ChangePosition).both


def change_page(page: ChangePage) -> Any:
    """A ChangePage."""
    return RoboCorba.ChangePage(changes(page.changes), position(page.next), page.is_last, page.left)


def element_page(page: ElementPage) -> Any:
    """An ElementPage."""
    records = [record(*each) for each in page.elements]
    return RoboCorba.ElementPage(page.read_at, records, page.next, page.is_last)


#: An EditRecord struct, and the edit of one.
edit, edit_of = struct_converter(EditRecord, RoboCorba.EditRecord, {"changedTo": "version", "time": "time_s"}).both
#: A Proposal struct, and the proposal of one.
proposal, proposal_of = struct_converter(
    *(Proposal, RoboCorba.Proposal, {"onFloor": "floor", "age": "age_s", "unseen": "unseen_s"}),
    outline=_POINTS,
    seen_by=STRINGS,
).both


def underlay(value: Underlay | None) -> Any:
    """An Underlay struct; without a picture for None."""
    shown = value or Underlay(b"", (0.0, 0.0), 0.0)
    return RoboCorba.Underlay(shown.picture, RoboCorba.XY(*shown.origin), shown.resolution)


def underlay_of(struct: Any) -> Underlay | None:
    """The underlay of an Underlay struct, None if it has no picture."""
    return Underlay(bytes(struct.picture), xy_of(struct.origin), struct.resolution) if struct.picture else None


def _register_element_error(error: type[errors.MapError], exception: Any, *fields: str) -> None:
    """Register an error with the fields kind, floor and name, and `fields` of the same names as the members."""
    register_with(
        error,
        exception,
        lambda e: exception(element_id(e.kind, e.floor, e.name), *(getattr(e, field) for field in fields)),
        lambda e: error(*key_of(e.id).words, *(getattr(e, field) for field in fields)),
    )


_register_element_error(errors.InvalidElement, RoboCorba.InvalidElement, "reason")
_register_element_error(errors.UnknownElement, RoboCorba.UnknownElement)
_register_element_error(errors.DuplicateElement, RoboCorba.DuplicateElement)
_register_element_error(errors.StaleEdit, RoboCorba.StaleEdit, "expected", "current")
_register_element_error(errors.EditedByOthers, RoboCorba.EditedByOthers, "author")
register_with(
    errors.MapFileError,
    RoboCorba.InvalidMap,
    # From an operation on the served map, of which only few raise InvalidMap: its store failed, such as on a full disk.
    lambda e: CORBA.PERSIST_STORE(0, CORBA.COMPLETED_NO),
    lambda e: errors.MapFileError("map", e.line, e.key, e.reason),
)
register(errors.StaleVersion, RoboCorba.StaleVersion, "expected", "current")
register(errors.NothingToUndo, RoboCorba.NothingToUndo)
register(errors.NothingToRedo, RoboCorba.NothingToRedo)
register(errors.VersionUnavailable, RoboCorba.VersionUnavailable, "version", "oldest", "current")
register_system(errors.SessionEnded, CORBA.OBJECT_NOT_EXIST)
register(errors.TransactionClosed, RoboCorba.TransactionClosed)
register(errors.TooManyTransactions, RoboCorba.TooManyTransactions, "limit")
register_system(errors.ServerBusy, CORBA.TRANSIENT)
register_system(errors.TooSlow, CORBA.TIMEOUT)
register_system(errors.ReplyTooLarge, CORBA.IMP_LIMIT)
