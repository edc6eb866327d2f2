"""The naming service of a guarded system: names for everybody to read, and a naming context for each role."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Sequence
from typing import Any

from robocorba import logs
from robocorba.corba.orb import CONTEXT, Orb
from robocorba.corba.servants.naming import BindingIteratorServant, NameRegistryServant, NamingContextServant
from robocorba.name_table import NameTable, Path
from robocorba.names import ROBOTS
from robocorba.roles import Role
from robocorba.settings import ServerSettings
from robocorba.supervision.access import Access

#: Maximum number of iterators over names; a further one replaces the oldest.
MAX_ITERATORS = 100


class NamesServer:
    """The names, and the objects by which they are read and bound. Names are in memory: servers and robots bind those
    that are missing within two seconds."""

    def __init__(self, orb: Orb, access: Access) -> None:
        self._orb, self._access = orb, access
        self._table = NameTable((CONTEXT, ROBOTS))
        self._lock = threading.Lock()
        self._contexts: dict[tuple[Role, Path], Any] = {}
        #: The keys of iterators, which can't be guessed: nobody else takes bindings from a list, or ends it.
        self._iterators: dict[BindingIteratorServant, str] = {}
        self._registries = {
            role: orb.activate(NameRegistryServant(self._table, role), f"{access.key(role)}/registry")
            for role in (Role.ROBOT, Role.SERVER)
        }
        for role in Role:
            self.context(role, ())

    # ---- for the servants ----

    def context(self, role: Role, path: Path) -> Any:
        with self._lock:
            if (role, path) not in self._contexts:
                servant = NamingContextServant(self._table, role, path, self)
                key = "/".join((self._access.key(role), *path))
                self._contexts[role, path] = self._orb.activate(servant, key)
            return self._contexts[role, path]

    def registry(self, role: Role) -> Any:
        return self._registries.get(role)

    def iterator(self, bindings: list[Any]) -> Any:
        servant, key = BindingIteratorServant(bindings, self), f"iterators/{secrets.token_urlsafe(24)}"
        reference = self._orb.activate(servant, key)
        with self._lock:
            self._iterators[servant] = key
            oldest = next(iter(self._iterators)) if len(self._iterators) > MAX_ITERATORS else None
        if oldest:
            self.forget(oldest)
        return reference

    def forget(self, iterator: BindingIteratorServant) -> None:
        with self._lock:
            key = self._iterators.pop(iterator, "")
        if key:
            self._orb.deactivate_key(key)


def main(arguments: Sequence[str] | None = None) -> None:
    settings = ServerSettings.read(arguments, __doc__ or "")
    logs.setup("names", settings.state / "logs")
    with Orb(settings.naming, settings.endpoint, guards=False) as orb:
        NamesServer(orb, Access.read(settings.state))
        orb.accept_calls()
        orb.run()


if __name__ == "__main__":
    main()
