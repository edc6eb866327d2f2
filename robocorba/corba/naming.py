"""The naming service: objects found by their names, and names kept bound."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any
from urllib.parse import quote

import CosNaming
from omniORB import CORBA

from robocorba.corba.calls import describe, limit_calls
from robocorba.errors.services import NotReachable
from robocorba.settings import Address

#: How often a server looks whether its names are still bound.
BINDING_CHECK_S = 2.0
#: Longest single call to the naming service, and to an object that is asked whether it is there.
PROBE_TIMEOUT_S = 1.0
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.02, 0.25
_LISTED_AT_ONCE = 500

_log = logging.getLogger(__name__)


class NamingService:
    """The one at an address. connect: makes a reference of a URI; asks nobody.

    context: that names are relative to, parts separated by slashes; empty for the root. with_kinds: names may have
    kinds, as Mobility.Unit; without, a dot is part of a name, such as a robot's."""

    def __init__(self, connect: Callable[[str], Any], address: Address, context: str, with_kinds: bool = False) -> None:
        self._connect, self.address = connect, address
        self._context, self._with_kinds = context, with_kinds

    def path(self, name: str) -> str:
        """Of a name, from the root."""
        return f"{self._context}/{name}" if self._context else name

    def resolve(self, name: str, interface: Any, timeout_s: float, call_timeout_s: float | None) -> Any:
        """The object bound to `name`, as `interface` (a class of the stubs), once it has answered a call.

        Tries again for `timeout_s` while the name is not bound or nobody answers; then raises
        NotReachable with the reason. The reference's own calls take at most `call_timeout_s`
        (default: the ORB's), then raise CORBA.TIMEOUT."""
        if not all(name.split("/")):
            raise NotReachable(f"{self.path(name)!r} can't be a name")
        deadline, pause = time.monotonic() + timeout_s, FIRST_PAUSE_S
        while True:
            try:
                found = self._lookup(name, deadline)
                reference = self._ask(found, interface, name, deadline)
                break
            except _NotYet as reason:
                if time.monotonic() + pause > deadline:
                    raise NotReachable(f"{self.path(name)} is not reachable: {reason}") from None
            time.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE_S)
        limit_calls(reference, call_timeout_s)
        return reference

    def resolve_once(self, name: str, interface: Any, call_timeout_s: float) -> Any:
        """The same, asked once. No call takes longer than `call_timeout_s`, then and later. Raises NotReachable."""
        try:
            found = self._root(call_timeout_s).resolve(self._components(name))
            if found is None:
                raise NotReachable(f"nil is bound to {name} at {self.address}")
            limit_calls(found, call_timeout_s)
            reference = found._narrow(interface)
        except (CosNaming.NamingContext.NotFound, CosNaming.NamingContext.CannotProceed):
            raise NotReachable(f"the naming service at {self.address} does not know {name}") from None
        except CORBA.SystemException as wrong:
            raise NotReachable(f"{name} at {self.address} does not answer ({describe(wrong)})") from None
        if reference is None:
            raise NotReachable(f"what is bound to {name} at {self.address} is not a {interface._NP_RepositoryId}")
        limit_calls(reference, call_timeout_s)
        return reference

    def names(self, path: str, timeout_s: float = PROBE_TIMEOUT_S) -> list[str]:
        """What is bound in the naming context `path`, sorted; nothing where there is no such context.

        Tries again for `timeout_s` while the naming service does not answer; then raises NotReachable."""
        deadline = time.monotonic() + timeout_s
        while True:
            try:
                return sorted(binding.binding_name[0].id for binding in self._bindings(path, deadline))
            except CosNaming.NamingContext.NotFound:
                return []
            except CORBA.SystemException as wrong:
                if time.monotonic() + FIRST_PAUSE_S > deadline:
                    reason = f"the naming service at {self.address} does not answer ({describe(wrong)})"
                    raise NotReachable(reason) from None
            time.sleep(FIRST_PAUSE_S)

    def check(self, timeout_s: float = PROBE_TIMEOUT_S) -> None:
        """Raise NotReachable unless the naming service answers a call within `timeout_s`."""
        try:
            self._root(timeout_s)._non_existent()
        except CORBA.SystemException as wrong:
            raise NotReachable(f"the naming service at {self.address} does not answer ({describe(wrong)})") from None

    def bind(self, name: str, reference: Any) -> None:
        """Let a name stand for an object, whatever it stood for. Raises CORBA.SystemException, NotFound."""
        root, path = self._root(), self._components(name)
        try:
            root.rebind(path, reference)
        except CosNaming.NamingContext.NotFound:
            for length in range(1, len(path)):
                try:
                    root.bind_new_context(path[:length])
                except CosNaming.NamingContext.AlreadyBound:
                    continue
            root.rebind(path, reference)

    def is_unbound(self, name: str) -> bool:
        """Whether a name stands for nothing. Raises CORBA.SystemException."""
        try:
            self._root().resolve(self._components(name))
        except CosNaming.NamingContext.NotFound:
            return True
        return False

    def unbind(self, name: str, reference: Any) -> None:
        """Let a name that stands for this object stand for nothing. Raises CORBA.SystemException."""
        try:
            if self._root().resolve(self._components(name))._is_equivalent(reference):
                self._root().unbind(self._components(name))
        except CosNaming.NamingContext.NotFound:
            pass

    def _bindings(self, path: str, deadline: float) -> list[Any]:
        found = self._root(_share(deadline)).resolve(self._components(path))
        context = found._unchecked_narrow(CosNaming.NamingContext)
        limit_calls(context, PROBE_TIMEOUT_S)
        bindings, rest = context.list(_LISTED_AT_ONCE)
        has_more = rest is not None
        while has_more:
            has_more, more = rest.next_n(_LISTED_AT_ONCE)
            bindings += more
        if rest is not None:
            rest.destroy()
        return list(bindings)

    def _components(self, name: str) -> list[Any]:
        return [_component(part, self._with_kinds) for part in self.path(name).split("/")]

    def _root(self, timeout_s: float = PROBE_TIMEOUT_S) -> Any:
        root = self._connect(f"corbaloc:iiop:1.2@{self.address}/NameService")
        context = root._unchecked_narrow(CosNaming.NamingContext)
        limit_calls(context, timeout_s)
        return context

    def _lookup(self, name: str, deadline: float) -> Any:
        try:
            return self._root(_share(deadline)).resolve(self._components(name))
        except (CosNaming.NamingContext.NotFound, CosNaming.NamingContext.CannotProceed):
            raise _NotYet(f"the naming service at {self.address} does not know it") from None
        except CORBA.SystemException as wrong:
            raise _NotYet(f"the naming service at {self.address} does not answer ({describe(wrong)})") from None

    def _ask(self, found: Any, interface: Any, name: str, deadline: float) -> Any:
        try:
            if found is None:
                raise _NotYet("nil is bound to it")
            limit_calls(found, _share(deadline))
            reference = found._narrow(interface)
            if reference is None:
                kind = interface._NP_RepositoryId
                raise NotReachable(f"what is bound to {self.path(name)} at {self.address} is not a {kind}")
            limit_calls(reference, _share(deadline))
            if reference._non_existent():
                raise _NotYet("its server says that the object does not exist")
        except CORBA.SystemException as wrong:
            raise _NotYet(f"bound at {self.address}, but its server does not answer ({describe(wrong)})") from None
        return reference


class KeptNames:
    """Names of a server that are bound in the background, and bound again when they vanish, until `close`."""

    def __init__(self, names: NamingService) -> None:
        self._names = names
        self._served: dict[str, Any] = {}
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()

    def start(self, served: dict[str, Any]) -> None:
        """Bind names to these objects; returns at once."""
        self._served = served
        self._thread = threading.Thread(target=self._keep, name="bindings", daemon=True)
        self._thread.start()

    def withdraw(self, name: str) -> None:
        """Unbind one of them."""
        self._unbind({name: self._served.pop(name)})

    def close(self) -> None:
        """Unbind them all. A server that was stopped leaves no names behind; one that now belongs to another stays."""
        self._closing.set()
        if self._thread:
            self._thread.join()
            self._unbind(self._served)

    def _keep(self) -> None:
        """Bind at start whatever the names stood for; later only what vanished, so as not to fight another server."""
        bound: set[str] = set()
        told, pause = False, FIRST_PAUSE_S
        while True:
            try:
                for name, reference in list(self._served.items()):
                    if name not in bound or self._names.is_unbound(name):
                        self._names.bind(name, reference)
                        bound.add(name)
                        _log.info("bound %s at %s", self._names.path(name), self._names.address)
                told, pause = False, BINDING_CHECK_S
            except (CORBA.Exception, CosNaming.NamingContext.NotFound) as wrong:
                if not told:
                    _log.warning("can't bind names at %s (%s); trying on", self._names.address, describe(wrong))
                told, pause = True, min(2 * pause, LONGEST_PAUSE_S)
            if self._closing.wait(pause):
                return

    def _unbind(self, served: dict[str, Any]) -> None:
        try:
            for name, reference in served.items():
                self._names.unbind(name, reference)
        except CORBA.Exception as wrong:
            _log.warning("can't unbind names at %s (%s)", self._names.address, describe(wrong))


class _NotYet(Exception):
    """Why an attempt failed that is worth another one."""


def _component(part: str, with_kinds: bool) -> Any:
    name, _, kind = part.partition(".") if with_kinds else (part, "", "")
    return CosNaming.NameComponent(name, kind)


def corbaname(naming: Address, name: str = "") -> str:
    """The URI under which any CORBA client finds `name`, such as RoboCorba/PathPlanner (parts without kinds)."""
    if not name:
        return f"corbaname::{naming}"
    stringified = name.replace("\\", "\\\\").replace(".", "\\.")
    return f"corbaname::{naming}#{quote(stringified, safe=';/:?@&=+$,-_.!~*()')}"


def _share(deadline: float) -> float:
    """Time for one call: what is left, but at most PROBE_TIMEOUT_S, so that a stalled peer leaves time for a retry."""
    return min(PROBE_TIMEOUT_S, max(0.01, deadline - time.monotonic()))
