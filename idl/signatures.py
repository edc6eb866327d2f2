"""A back end of omniidl: what clients compile in of an IDL file, a line for each declaration.

    omniidl -p FOLDER -b signatures FILE.idl ...

A line is a repository id, a tab and the signature: types, names of members and enumerators, directions of parameters,
exceptions. Comments, names of parameters and the order of declarations don't matter to clients.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from omniidl import idlast, idltype

#: The IDL's name of each basic type, by its number.
_BASIC = {getattr(idltype, name): name.removeprefix("tk_") for name in dir(idltype) if name.startswith("tk_")}


def run(tree: Any, arguments: list[str]) -> None:
    """Called by omniidl with the syntax tree of a file."""
    for declaration, signature in _lines(tree.declarations()):
        print(declaration, signature, sep="\t")


def _lines(declarations: Iterable[Any]) -> Iterator[tuple[str, str]]:
    for each in declarations:
        if not each.mainFile():
            continue
        if isinstance(each, idlast.Module):
            yield from _lines(each.definitions())
        elif isinstance(each, idlast.Interface):
            bases = ", ".join("::".join(base.scopedName()) for base in each.inherits())
            yield each.repoId(), f"interface : {bases}".strip()
            yield from _lines(each.contents())
        elif isinstance(each, idlast.Operation):
            yield each.repoId(), _operation(each)
        elif isinstance(each, idlast.Attribute):
            kind = "readonly attribute" if each.readonly() else "attribute"
            for declarator in each.declarators():
                yield declarator.repoId(), f"{kind} {_type(each.attrType())}"
        elif isinstance(each, idlast.Struct | idlast.Exception):
            kind = "struct" if isinstance(each, idlast.Struct) else "exception"
            yield each.repoId(), f"{kind} {{ {_members(each)} }}"
        elif isinstance(each, idlast.Union):
            cases = "; ".join(
                f"{', '.join(_label(label) for label in case.labels())}: "
                f"{_declared(case.caseType(), case.declarator())}"
                for case in each.cases()
            )
            yield each.repoId(), f"union switch ({_type(each.switchType())}) {{ {cases} }}"
        elif isinstance(each, idlast.Enum):
            yield each.repoId(), f"enum {{ {', '.join(one.identifier() for one in each.enumerators())} }}"
        elif isinstance(each, idlast.Typedef):
            for declarator in each.declarators():
                yield declarator.repoId(), f"typedef {_declared(each.aliasType(), declarator)}"
        elif isinstance(each, idlast.Const):
            yield each.repoId(), f"const {_type(each.constType())} {each.value()!r}"
        elif not isinstance(each, idlast.Forward):
            raise SystemExit(f"{each.file()}:{each.line()}: {type(each).__name__} has no signature")


def _operation(operation: Any) -> str:
    directions = ("in", "out", "inout")
    parameters = ", ".join(
        f"{directions[each.direction()]} {_type(each.paramType())}" for each in operation.parameters()
    )
    raises = ", ".join(sorted("::".join(each.scopedName()) for each in operation.raises()))
    way = "oneway " if operation.oneway() else ""
    return f"{way}{_type(operation.returnType())} ({parameters}) raises ({raises})"


def _members(structure: Any) -> str:
    return "; ".join(
        _declared(member.memberType(), declarator)
        for member in structure.members()
        for declarator in member.declarators()
    )


def _label(label: Any) -> str:
    value = label.value()
    return "default" if label.default() else getattr(value, "identifier", lambda: repr(value))()


def _declared(kind: Any, declarator: Any) -> str:
    return f"{_type(kind)} {declarator.identifier()}{''.join(f'[{size}]' for size in declarator.sizes())}"


def _type(kind: Any) -> str:
    if isinstance(kind, idltype.Sequence):
        bound = f", {kind.bound()}" if kind.bound() else ""
        return f"sequence<{_type(kind.seqType())}{bound}>"
    if isinstance(kind, idltype.String | idltype.WString):
        name = "string" if isinstance(kind, idltype.String) else "wstring"
        return f"{name}<{kind.bound()}>" if kind.bound() else name
    if isinstance(kind, idltype.Declared):
        return "::".join(kind.scopedName())
    return _BASIC[kind.kind()]
