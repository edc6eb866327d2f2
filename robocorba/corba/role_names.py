"""The naming service of a guarded system, as a role sees it: names are read as everywhere, and bound by a registry."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import CosNaming

from robocorba.corba.calls import set_call_timeout
from robocorba.corba.conversion.names import role_references
from robocorba.corba.guard import Guard
from robocorba.corba.naming import PROBE_TIMEOUT_S, NamingService
from robocorba.roles import Role
from robocorba.settings import RoleNaming
from robocorba.stubs import RoboCorba


class RoleNames(NamingService):
    """guard: has the secrets by which this process holds its names. The references of a name are those of each role."""

    def __init__(
        self, connect: Callable[[str], Any], naming: RoleNaming, context: str, with_kinds: bool, guard: Guard
    ) -> None:
        super().__init__(connect, naming, context, with_kinds)
        self._guard, self._role = guard, naming.role

    def bind(self, name: str, reference: Mapping[Role, Any]) -> None:
        path = self.path(name)
        self._registry().announce(path, role_references(reference), self._guard.proof(path))

    def is_lapsing(self, name: str) -> bool:
        return self._role is not Role.SERVER or super().is_lapsing(name)

    def unbind(self, name: str, reference: Mapping[Role, Any]) -> None:
        try:
            if self._root().resolve(self._components(name))._is_equivalent(reference[self._role]):
                self._registry().withdraw(self.path(name), self._guard.proof(self.path(name)))
        except (CosNaming.NamingContext.NotFound, RoboCorba.NameHeld):
            pass

    def _registry(self) -> Any:
        found = self._root().resolve([CosNaming.NameComponent("NameRegistry", "")])
        registry = found._unchecked_narrow(RoboCorba.NameRegistry)
        set_call_timeout(registry, PROBE_TIMEOUT_S)
        return registry
