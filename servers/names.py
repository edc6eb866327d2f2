"""The naming service of a guarded system: names for everybody to read, and a naming context for each role."""

from __future__ import annotations

import contextlib
import secrets
import threading
from collections.abc import Sequence
from typing import Any

from omniORB import CORBA

from robocorba.orb.guard import Guard
from robocorba.orb.naming_servant import BindingIteratorServant, NameRegistryServant, NamingContextServant
from robocorba.orb.orb import CONTEXT, Orb
from robocorba.orb.robot_objects import CHECK_INTERVAL_S
from robocorba.system import logs
from robocorba.system.name_table import NameTable, Path
from robocorba.system.names import ROBOTS
from robocorba.system.repeating import Repeating
from robocorba.system.roles import Role
from robocorba.system.settings import ServerSettings, robot_keys
from robocorba.system.supervision.access import Access

#: Maximum number of iterators over names; a further one replaces the oldest.
MAX_ITERATORS = 100


class NamesServer:
    """The names, and the objects by which they are read and bound. Names are in memory: servers and robots bind those
    that are missing within two seconds."""

    def __init__(self, orb: Orb, access: Access) -> None:
        self._orb, self._access = orb, access
        self._table = NameTable((CONTEXT, ROBOTS))
        #: The keys of the servers' objects, as the servers derive them.
        self._guard = Guard(access.key(Role.SERVER).encode())
        self._lock = threading.Lock()
        self._contexts: dict[tuple[Role, Path, str], Any] = {}
        #: The keys of iterators, which can't be guessed: nobody else takes bindings from a list, or ends it.
        self._iterators: dict[BindingIteratorServant, str] = {}
        self._registries = {
            (role, ""): orb.activate(NameRegistryServant(self._table, role), f"{access.key(role)}/registry")
            for role in (Role.ROBOT, Role.SERVER)
        }
        #: The keys of the contexts of robots that have a file of their own.
        self._robots: dict[str, str] = {}
        for role in Role:
            self.context(role, (), "")
        self._follow_robots()
        self._check = Repeating("robots' files", self._follow_robots, CHECK_INTERVAL_S).start()

    def close(self) -> None:
        self._check.close()

    # ---- for the servants ----

    def context(self, role: Role, path: Path, robot: str) -> Any:
        with self._lock:
            if robot and robot not in self._robots:  # its file was removed meanwhile
                raise CORBA.NO_PERMISSION
            if (role, path, robot) not in self._contexts:
                servant = NamingContextServant(self._table, role, path, self, robot)
                key = "/".join((self._robots[robot] if robot else self._access.key(role), *path))
                self._contexts[role, path, robot] = self._orb.activate(servant, key)
            return self._contexts[role, path, robot]

    def registry(self, role: Role, robot: str) -> Any:
        return self._registries.get((role, robot))

    def found(self, reference: Any, path: Path, robot: str) -> Any:
        """For a robot with a file of its own, a server's object with the key for that robot, which is as long."""
        name, own = "/".join(path[1:]), self._robots.get(robot)
        if own is None:
            return reference
        before, after = self._guard.key(name, Role.ROBOT).encode(), self._guard.robot_key(name, own).encode()
        return self._orb.reference(self._orb.uri(reference).replace(before.hex(), after.hex()), CORBA.Object)

    def _follow_robots(self) -> None:
        """Activate contexts and registries of robots with files of their own, and deactivate those without."""
        robots = robot_keys(self._access.folder)
        with self._lock:
            before, self._robots = self._robots, robots
        for robot, key in before.items() - robots.items():
            with self._lock:
                ended = [each for each in self._contexts if each[2] == robot]
                for each in ended:
                    del self._contexts[each]
                self._registries.pop((Role.ROBOT, robot), None)
            for _, path, _ in ended:
                self._orb.deactivate_key("/".join((key, *path)))
            self._orb.deactivate_key(f"{key}/registry")
        for robot, key in robots.items() - before.items():
            only = NameRegistryServant(self._table, Role.ROBOT, (CONTEXT, ROBOTS, robot))
            self._registries[Role.ROBOT, robot] = self._orb.activate(only, f"{key}/registry")
            self.context(Role.ROBOT, (), robot)

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
    with (
        Orb(settings.naming, settings.endpoint, guards=False) as orb,
        contextlib.closing(NamesServer(orb, Access.read(settings.state))),
    ):
        orb.accept_calls()
        orb.run()


if __name__ == "__main__":
    main()
