"""The names that a process of a guarded system holds: announced to the registry of its role."""

from __future__ import annotations

from typing import Any

import CosNaming

from robocorba.orb.calls import set_call_timeout
from robocorba.orb.guard import Guard
from robocorba.orb.guarded_names import role_references
from robocorba.orb.naming import PROBE_TIMEOUT_S, BoundNames, NamingService
from robocorba.stubs import RoboCorba


class HeldNames(BoundNames):
    """Announces names in the background until `close`, with the references of each role. guard: has the secrets by
    which this process holds its names."""

    def __init__(self, names: NamingService, guard: Guard) -> None:
        super().__init__(names, check_interval_s=2.0)  # three times within the time that a robot holds its name
        self._guard = guard

    def _check(self, name: str, references: Any) -> None:
        if self._owns_names():
            path = self._names.path(name)
            self._registry().announce(path, role_references(references), self._guard.proof(path))
            if name not in self._bound:
                self._note_bound(name)

    def _release(self, name: str, references: Any) -> None:
        path = self._names.path(name)
        self._registry().withdraw(path, self._guard.proof(path))

    def _registry(self) -> Any:
        found = self._names.root().resolve([CosNaming.NameComponent("NameRegistry", "")])
        registry = found._unchecked_narrow(RoboCorba.NameRegistry)
        set_call_timeout(registry, PROBE_TIMEOUT_S)
        return registry
