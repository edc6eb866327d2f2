"""Servants of the naming service of a guarded system: a read-only context for each role, and the registry."""

from __future__ import annotations

from typing import Any, NoReturn

import CosNaming
import CosNaming__POA
from omniORB import CORBA, URI

from robocorba.errors.services import InvalidBinding
from robocorba.orb.exceptions import translating
from robocorba.orb.guarded_names import role_references_of
from robocorba.stubs import RoboCorba__POA
from robocorba.system.name_table import NameTable, Path
from robocorba.system.roles import Role

Context = CosNaming.NamingContext
#: Names in the first part of an answer of `list`, whatever the caller wants.
MAX_LISTED = 500


class NamingContextServant(CosNaming__POA.NamingContextExt):
    """CosNaming::NamingContextExt: the names below `path`, as `role` sees them, or only `robot`.

    objects: gives references, each object being activated when it is first needed: `context(role, path, robot)` of a
    role's context; `registry(role, robot)`, None for a role that binds no names; `found(reference, path, robot)`, what
    the role gets for a bound one; `iterator(bindings)`."""

    def __init__(self, table: NameTable, role: Role, path: Path, objects: Any, robot: str = "") -> None:
        self._table, self._role, self._path, self._objects, self._robot = table, role, path, objects, robot

    def resolve(self, n: Any) -> Any:
        return self._find(n)

    def _find(self, n: Any) -> Any:
        if not n:
            raise Context.InvalidName()
        path = self._path + tuple(component.id for component in n)
        if not any(component.kind for component in n):
            if path == ("NameRegistry",) and (registry := self._objects.registry(self._role, self._robot)):
                return registry
            if (found := self._table.find(self._role, path)) is not None:
                return self._objects.found(found, path, self._robot)
            if self._table.is_context(path):
                return self._objects.context(self._role, path, self._robot)
        raise Context.NotFound(Context.missing_node, n)

    def list(self, how_many: int) -> Any:
        kinds = {False: CosNaming.nobject, True: CosNaming.ncontext}
        bindings = [
            CosNaming.Binding([CosNaming.NameComponent(name, "")], kinds[is_context])
            for name, is_context in self._table.children(self._path)
        ]
        count = min(how_many, MAX_LISTED)
        return bindings[:count], self._objects.iterator(bindings[count:]) if bindings[count:] else None

    def resolve_str(self, n: str) -> Any:
        return self._find(self.to_name(n))

    def to_string(self, n: Any) -> str:
        return _checked(URI.nameToString, n)

    def to_name(self, sn: str) -> Any:
        return _checked(URI.stringToName, sn)

    def to_url(self, addr: str, sn: str) -> str:
        return _checked(URI.addrAndNameToURI, addr, sn)

    def _refuse(self, *arguments: Any) -> NoReturn:
        raise CORBA.NO_PERMISSION(0, CORBA.COMPLETED_NO)

    bind = rebind = bind_context = rebind_context = unbind = new_context = bind_new_context = destroy = _refuse


class BindingIteratorServant(CosNaming__POA.BindingIterator):
    """CosNaming::BindingIterator: the rest of a list. objects: its `forget` deactivates this servant."""

    def __init__(self, bindings: list[Any], objects: Any) -> None:
        self._bindings, self._objects = bindings, objects

    def next_one(self) -> Any:
        has_more, found = self.next_n(1)
        return has_more, found[0] if found else CosNaming.Binding([], CosNaming.nobject)

    def next_n(self, how_many: int) -> Any:
        if how_many < 1:
            raise CORBA.BAD_PARAM(0, CORBA.COMPLETED_NO)
        count = min(how_many, MAX_LISTED)
        found, self._bindings = self._bindings[:count], self._bindings[count:]
        return bool(found), found

    def destroy(self) -> None:
        self._objects.forget(self)


class NameRegistryServant(RoboCorba__POA.NameRegistry):
    """RoboCorba::NameRegistry for the robots or for the servers. only: the only name that may be announced, empty for
    any that the role may."""

    def __init__(self, table: NameTable, role: Role, only: Path = ()) -> None:
        self._table, self._role, self._only = table, role, only

    @translating
    def announce(self, name: str, references: Any, secret: str) -> None:
        if self._only and tuple(name.split("/")) != self._only:
            raise InvalidBinding(name, f"this robot binds {'/'.join(self._only)} only")
        self._table.announce(self._role, tuple(name.split("/")), role_references_of(references), secret)

    @translating
    def withdraw(self, name: str, secret: str) -> None:
        self._table.withdraw(self._role, tuple(name.split("/")), secret)


def _checked(convert: Any, *arguments: Any) -> Any:
    try:
        return convert(*arguments)
    except Context.InvalidName:
        raise
    except Exception:  # of the parser, for what is no name
        raise Context.InvalidName() from None
