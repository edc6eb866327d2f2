"""A back end of omniidl: IDL files as entries for the interface repository of Combat, an ORB for Tcl.

    omniidl -p FOLDER -b tcl FILE.idl ... > FILE.tcl

A Tcl program that sources the output can call and serve the interfaces. What several of the files include is printed
once, before its first use.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Any

from omniidl import idlast, idltype

#: A Tcl list: words, and lists.
Item = str | tuple["Item", ...]

#: Tcl's name of each basic type, by its number.
_BASIC: dict[int, Item] = {
    getattr(idltype, name): name.removeprefix("tk_") for name in dir(idltype) if name.startswith("tk_")
} | {
    idltype.tk_ushort: ("unsigned", "short"),
    idltype.tk_ulong: ("unsigned", "long"),
    idltype.tk_longlong: ("long", "long"),
    idltype.tk_ulonglong: ("unsigned", "long", "long"),
    idltype.tk_longdouble: ("long", "double"),
}
_DIRECTIONS = ("in", "out", "inout")
#: Declarations that have been printed, of all files of this run.
_printed: set[Item] = set()


def run(tree: Any, arguments: list[str]) -> None:
    """Called by omniidl with the syntax tree of a file."""
    print(f"# {tree.file()}\npackage require combat\ncombat::ir add {{")
    for item in _new(tree.declarations()):
        if item[0] == "module":
            print(f"{{module {_text(item[1])} {{", *map(_text, item[2]), "}}", sep="\n")
        else:
            print(_text(item))
    print("}")


def _new(declarations: Iterable[Any]) -> Iterator[tuple[Item, ...]]:
    """The entries that have not been printed yet."""
    for each in declarations:
        if isinstance(each, idlast.Module):
            if contents := tuple(_new(each.definitions())):
                yield "module", _name(each), contents
        else:
            for item in _items(each):
                if item not in _printed:
                    _printed.add(item)
                    yield item


def _items(each: Any) -> Iterator[tuple[Item, ...]]:
    """The entries of a declaration outside of modules."""
    if isinstance(each, idlast.Interface):
        bases = tuple(base.repoId() for base in each.inherits())
        yield "interface", _name(each), bases, tuple(item for inner in each.contents() for item in _items(inner))
    elif isinstance(each, idlast.Forward):
        yield "interface", _name(each)
    elif isinstance(each, idlast.Operation):
        parameters = tuple(
            (_DIRECTIONS[one.direction()], one.identifier(), _type(one.paramType())) for one in each.parameters()
        )
        raises = tuple(one.repoId() for one in each.raises())
        way = ("oneway",) if each.oneway() else ()
        yield "operation", _name(each), _type(each.returnType()), parameters, raises, *way
    elif isinstance(each, idlast.Attribute):
        way = ("readonly",) if each.readonly() else ()
        for declarator in each.declarators():
            yield "attribute", _name(declarator), _type(each.attrType()), *way
    elif isinstance(each, idlast.Struct | idlast.Exception):
        kind = "struct" if isinstance(each, idlast.Struct) else "exception"
        members = tuple(
            (declarator.identifier(), _declared(member.memberType(), declarator))
            for member in each.members()
            for declarator in member.declarators()
        )
        yield kind, _name(each), members, _within((one, one.memberType()) for one in each.members())
    elif isinstance(each, idlast.Union):
        cases = tuple(
            (_label(label), case.declarator().identifier(), _declared(case.caseType(), case.declarator()))
            for case in each.cases()
            for label in case.labels()
        )
        within = _within((case, case.caseType()) for case in each.cases())
        yield "union", _name(each), _type(each.switchType()), cases, within
    elif isinstance(each, idlast.Enum):
        yield "enum", _name(each), tuple(one.identifier() for one in each.enumerators())
    elif isinstance(each, idlast.Typedef):
        yield from _within([(each, each.aliasType())])
        for declarator in each.declarators():
            yield "typedef", _name(declarator), _declared(each.aliasType(), declarator)
    elif isinstance(each, idlast.Const):
        yield "const", _name(each), _type(each.constType()), _value(each.value())
    else:
        raise SystemExit(f"{each.file()}:{each.line()}: {type(each).__name__} is not supported for Tcl")


def _name(declaration: Any) -> Item:
    """Repository id, name and version."""
    identity = declaration.repoId()
    return identity, declaration.identifier(), identity.rpartition(":")[2]


def _within(declared: Iterable[tuple[Any, Any]]) -> tuple[Item, ...]:
    """The types that are declared inside a declaration: pairs of a member and its type."""
    return tuple(item for member, kind in declared if member.constrType() for item in _items(kind.decl()))


def _label(label: Any) -> str:
    return "(default)" if label.default() else _value(label.value())


def _value(value: Any) -> str:
    return str(int(value)) if isinstance(value, bool) else str(getattr(value, "identifier", lambda: value)())


def _declared(kind: Any, declarator: Any) -> Item:
    """A type with the sizes of an array."""
    item = _type(kind)
    for size in reversed(declarator.sizes()):
        item = "array", item, str(size)
    return item


def _type(kind: Any) -> Item:
    if isinstance(kind, idltype.Sequence):
        bound = (str(kind.bound()),) if kind.bound() else ()
        return "sequence", _type(kind.seqType()), *bound
    if isinstance(kind, idltype.String | idltype.WString):
        name = "string" if isinstance(kind, idltype.String) else "wstring"
        return (name, str(kind.bound())) if kind.bound() else name
    if isinstance(kind, idltype.Declared):
        return "Object" if kind.scopedName() == ["CORBA", "Object"] else kind.decl().repoId()
    return _BASIC[kind.kind()]


def _text(item: Item) -> str:
    """A list as an element of another one."""
    if isinstance(item, tuple):
        return f"{{{' '.join(map(_text, item))}}}"
    return re.sub(r'([\s{}\[\]"\\$;#])', r"\\\1", item) or "{}"
