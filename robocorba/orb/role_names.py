"""The names that a process of a guarded system holds: announced to the registry of its role."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping
from typing import Any

import CosNaming

from robocorba.orb.calls import describe, set_call_timeout
from robocorba.orb.guard import Guard
from robocorba.orb.guarded_names import role_references
from robocorba.orb.naming import PROBE_TIMEOUT_S, BindingOutages, NamingService, failures_of
from robocorba.stubs import RoboCorba
from robocorba.system.backoff import Backoff
from robocorba.system.repeating import Repeating
from robocorba.system.roles import Role

#: Interval between announcements of a name [s]: three within the time that a robot holds its name.
ANNOUNCEMENT_INTERVAL_S = 2.0
#: Pauses between attempts to announce names.
BACKOFF = Backoff(0.02, 0.25)

_log = logging.getLogger(__name__)


class HeldNames:
    """Announces names in the background until `close`. guard: has the secrets by which this process holds its names."""

    def __init__(self, names: NamingService, guard: Guard) -> None:
        self._names, self._guard = names, guard
        self._served: dict[str, Mapping[Role, Any]] = {}
        self._owns_names: Callable[[], bool] = lambda: True
        self._bound: set[str] = set()
        self._failures, self._outages = 0, BindingOutages(names.address)
        self._is_started = False
        self._announcing = Repeating(
            "bindings", self._announce_all, lambda: BACKOFF.pause_s(self._failures) or ANNOUNCEMENT_INTERVAL_S
        )
        #: Set as soon as all names have been bound.
        self.are_bound = threading.Event()

    def start(self, served: dict[str, Mapping[Role, Any]], owns_names: Callable[[], bool]) -> None:
        """Begin to announce names with the references of each role, while `owns_names`; returns immediately."""
        self._served, self._owns_names = served, owns_names
        self._announcing.start()
        self._is_started = True

    def withdraw(self, name: str) -> None:
        """Unbind one of them."""
        del self._served[name]
        self._unbind([name])

    def close(self) -> None:
        """Unbind all names, except those that somebody else has bound since."""
        self._announcing.close()
        if self._is_started:
            self._unbind(list(self._served))

    def _announce_all(self) -> None:
        errors = failures_of(self._announce, self._served.items() if self._owns_names() else ())
        self._outages.note(errors)
        self._failures = self._failures + 1 if errors else 0
        if self._bound.issuperset(list(self._served)):
            self.are_bound.set()

    def _announce(self, name: str, references: Mapping[Role, Any]) -> None:
        path = self._names.path(name)
        self._registry().announce(path, role_references(references), self._guard.proof(path))
        if name not in self._bound:
            self._bound.add(name)
            _log.info("bound %s at %s", path, self._names.address)

    def _unbind(self, names: list[str]) -> None:
        def withdraw(path: str) -> None:
            self._registry().withdraw(path, self._guard.proof(path))

        if errors := failures_of(withdraw, [(self._names.path(name),) for name in names]):
            _log.warning("cannot unbind names at %s (%s)", self._names.address, describe(errors[0]))

    def _registry(self) -> Any:
        found = self._names.root().resolve([CosNaming.NameComponent("NameRegistry", "")])
        registry = found._unchecked_narrow(RoboCorba.NameRegistry)
        set_call_timeout(registry, PROBE_TIMEOUT_S)
        return registry
