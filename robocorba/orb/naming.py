"""Access to the naming service: resolving names, and keeping the names of a server bound."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any
from urllib.parse import quote, unquote

import CosNaming
from omniORB import CORBA, URI

from robocorba.errors.services import NotBound, NotReachable
from robocorba.orb.bounded_any import invoke
from robocorba.orb.calls import describe, set_call_timeout
from robocorba.orb.ior import address_of
from robocorba.orb.naming_contexts import NamingContexts, resolve
from robocorba.system.backoff import Backoff
from robocorba.system.repeating import Repeating
from robocorba.system.settings import Address, RoleNaming

#: For this time a name may be stolen [s].
STOLEN_S = 2.5
#: After this time an object that does not answer is gone [s]: a server that hangs is back before, a computer that was
#: switched off is not.
SILENT_S = 30.0
#: Interval between two log lines about the same stolen name, and about names that can't be bound [s]: over a bad link
#: that changes all the time.
LOG_INTERVAL_S = 60.0
#: Timeout of a single call to the naming service, and of a call that probes an object [s].
PROBE_TIMEOUT_S = 1.0
#: Pauses between attempts to resolve or bind names.
BACKOFF = Backoff(0.02, 0.25)

_log = logging.getLogger(__name__)


class NamingService:
    """The naming service at `address`. connect: converts a URI to a reference without a call; uri: the reverse.

    context: the naming context that names are relative to, parts separated by slashes, where a dot is part of a name,
    such as a robot's; empty for the root, where names may have kinds, as Mobility.Unit."""

    def __init__(
        self,
        connect: Callable[[str], Any],
        address: Address,
        context: str,
        uri: Callable[[Any], str] = lambda reference: "",
    ) -> None:
        self._connect, self.address, self._uri = connect, address, uri
        self._context = context
        self._contexts = NamingContexts(uri)
        key = address.key if isinstance(address, RoleNaming) else "NameService"
        self.root_uri = f"corbaloc:{address.scheme}:1.2@{address}/{key}"

    def path(self, name: str) -> str:
        """The path of a name from the root context."""
        return f"{self._context}/{name}" if self._context else name

    def resolve(self, name: str, interface: Any, timeout_s: float, call_timeout_s: float | None) -> Any:
        """The object bound to `name`, as `interface` (a class of the stubs), once it has answered a call.

        Retries for `timeout_s` while the name is not bound or the object does not answer, for at most STOLEN_S while
        something of another kind is bound, then raises NotReachable with the reason. call_timeout_s: timeout of later
        calls through the reference (default: the ORB's), after which they raise CORBA.TIMEOUT."""
        if not all(name.split("/")):
            raise NotReachable(f"{self.path(name)!r} can't be a name")
        began = time.monotonic()
        deadline = began + timeout_s

        def resolve() -> Any:
            try:
                return self._narrow(self._lookup(name, deadline), interface, name, deadline)
            except _OtherKind as error:
                if time.monotonic() > began + STOLEN_S:
                    raise NotReachable(str(error)) from None
                raise

        try:
            reference = BACKOFF.call(resolve, timeout_s, _Retryable)
        except _Retryable as reason:
            raise NotReachable(f"{self.path(name)} is not reachable: {reason}") from None
        set_call_timeout(reference, call_timeout_s)
        return reference

    def resolve_once(self, name: str, interface: Any, call_timeout_s: float) -> Any:
        """Resolve without retries. call_timeout_s: timeout of each call, also of later calls through the reference.

        Raises NotReachable."""
        try:
            found = resolve(self._root(call_timeout_s), self._components(name))
        except (CosNaming.NamingContext.NotFound, CosNaming.NamingContext.CannotProceed):
            raise NotBound(f"the naming service at {self.address} does not know {name}") from None
        except CORBA.SystemException as error:
            raise self._unanswered(error) from None
        if found is None:
            raise NotReachable(f"{name} is bound to nil at {self.address}")
        try:
            set_call_timeout(found, call_timeout_s)
            reference = found._narrow(interface)
        except CORBA.SystemException as error:
            raise NotReachable(f"{name} is {self._unanswered_by(found, error)}") from None
        if reference is None:
            raise NotReachable(f"what is bound to {name} at {self.address} is not a {interface._NP_RepositoryId}")
        set_call_timeout(reference, call_timeout_s)
        return reference

    def names(self, path: str, timeout_s: float = PROBE_TIMEOUT_S) -> list[str]:
        """The names bound in the naming context `path`, sorted; empty if there is no such context.

        Retries for `timeout_s` while the naming service does not answer, then raises NotReachable."""
        deadline = time.monotonic() + timeout_s
        try:
            bindings = BACKOFF.call(
                lambda: self._bindings(path, deadline), timeout_s, CORBA.SystemException, _Retryable
            )
        except CosNaming.NamingContext.NotFound:
            return []
        except _Retryable as away:
            raise NotReachable(f"the naming context {self.path(path)} is {away}") from None
        except CORBA.SystemException as error:
            raise self._unanswered(error) from None
        return sorted(binding.binding_name[0].id for binding in bindings)

    def check(self, timeout_s: float = PROBE_TIMEOUT_S) -> None:
        """Raise NotReachable unless the naming service answers a call within `timeout_s`, with its root context."""
        try:
            if self._root(timeout_s)._non_existent():  # it listens before its root context is there
                raise NotReachable(f"the naming service at {self.address} has no root context")
        except CORBA.SystemException as error:
            raise self._unanswered(error) from None

    def root(self) -> Any:
        """The root context, with a timeout of PROBE_TIMEOUT_S for each call."""
        return self._root()

    def bind(self, name: str, reference: Any) -> None:
        """Bind a name to an object, also if it is bound already. Raises CORBA.SystemException, NotFound."""
        context, own = self._place(name)
        context.rebind(own, reference)

    def bound(self, name: str) -> Any:
        """The reference that is bound to a name; None if it is unbound. Raises CORBA.SystemException."""
        context, own = self._place(name)
        try:
            return resolve(context, own)
        except (CosNaming.NamingContext.NotFound, CosNaming.NamingContext.CannotProceed):
            return None

    def take_back(self, name: str, reference: Any) -> None:
        """Bind a name again which is bound to something else, even to a naming context. Raises CORBA.SystemException,
        NotFound."""
        try:
            self.bind(name, reference)
        except CosNaming.NamingContext.NotFound:  # it is bound as a context
            context, own = self._place(name)
            context.unbind(own)
            context.rebind(own, reference)

    def is_gone(self, reference: Any) -> bool | None:
        """Whether an object does not exist any more, or its server does not run; None if nothing answers."""
        try:
            set_call_timeout(reference, PROBE_TIMEOUT_S)
            return bool(reference._non_existent())
        except CORBA.TIMEOUT:
            return None
        except CORBA.SystemException:
            return True

    def address_bound(self, reference: Any) -> str:
        """The address of a reference's server, for display."""
        return address_of(self._uri(reference)) or "an unknown address"

    def unbind(self, name: str, reference: Any) -> None:
        """Unbind a name, if it is bound to this object. Raises CORBA.SystemException."""
        try:
            found = resolve(self._root(), self._components(name))
            if found is not None and found._is_equivalent(reference):
                self._root().unbind(self._components(name))
        except (CosNaming.NamingContext.NotFound, CosNaming.NamingContext.CannotProceed):
            pass

    def _unanswered(self, error: CORBA.SystemException) -> NotReachable:
        return NotReachable(f"the naming service at {self.address} does not answer ({describe(error)})")

    def _unanswered_by(self, found: Any, error: CORBA.SystemException) -> str:
        """What is wrong with an object that the naming service itself has found."""
        server = f"its server at {self.address_bound(found)} does not answer"
        return f"bound at {self.address}, but {server} ({describe(error)})"

    def _bindings(self, path: str, deadline: float) -> list[Any]:
        found = resolve(self._root(_remaining_s(deadline)), self._components(path))
        if found is None:
            raise CORBA.INV_OBJREF
        try:
            return self._listed(found, deadline)
        except CORBA.SystemException as error:  # it may be another server's, or have a wrong address
            raise _Retryable(self._unanswered_by(found, error)) from None

    def _listed(self, found: Any, deadline: float) -> list[Any]:
        context = found._unchecked_narrow(CosNaming.NamingContext)
        set_call_timeout(context, PROBE_TIMEOUT_S)
        bindings, rest = invoke(context, CosNaming.NamingContext, "list", 500)
        if rest is not None:
            set_call_timeout(rest, PROBE_TIMEOUT_S)
            has_more = True
            while has_more:
                if time.monotonic() > deadline or len(bindings) > 20_000:  # a context of another client's
                    raise CORBA.TIMEOUT
                has_more, more = rest.next_n(500)
                bindings += more
            rest.destroy()
        return list(bindings)

    def _place(self, name: str) -> tuple[Any, list[Any]]:
        """The naming context of a name, taken back if others have bound something else there, and the name in it."""
        path = self._components(name)
        return self._contexts.context(self._root(), path[:-1]), path[-1:]

    def _components(self, name: str) -> list[Any]:
        parts = [(part, "", "") if self._context else part.partition(".") for part in self.path(name).split("/")]
        return [CosNaming.NameComponent(name, kind) for name, _, kind in parts]

    def _root(self, timeout_s: float = PROBE_TIMEOUT_S) -> Any:
        root = self._connect(self.root_uri)
        context = root._unchecked_narrow(CosNaming.NamingContext)
        set_call_timeout(context, timeout_s)
        return context

    def _lookup(self, name: str, deadline: float) -> Any:
        try:
            return resolve(self._root(_remaining_s(deadline)), self._components(name))
        except (CosNaming.NamingContext.NotFound, CosNaming.NamingContext.CannotProceed):
            raise _Retryable(f"the naming service at {self.address} does not know it") from None
        except CORBA.SystemException as error:
            raise _Retryable(str(self._unanswered(error))) from None

    def _narrow(self, found: Any, interface: Any, name: str, deadline: float) -> Any:
        try:
            if found is None:
                raise _Retryable("it is bound to nil")
            set_call_timeout(found, _remaining_s(deadline))
            reference = found._narrow(interface)
            if reference is None:
                kind = interface._NP_RepositoryId
                raise _OtherKind(f"what is bound to {self.path(name)} at {self.address} is not a {kind}")
            set_call_timeout(reference, _remaining_s(deadline))
            if reference._non_existent():
                raise _Retryable("its server answers that the object does not exist")
        except CORBA.SystemException as error:
            raise _Retryable(self._unanswered_by(found, error)) from None
        return reference


def resolve_corbaname(connect: Callable[[str], Any], uri: str) -> Any:
    """The object at a corbaname. connect: as for NamingService. Raises CORBA.Exception, or CosNaming.InvalidName."""
    location, _, name = uri.partition("#")
    place, slash, key = location.partition(":")[2].partition("/")
    context = connect(f"corbaloc:{place}/{key if slash and key else 'NameService'}")
    context = context._unchecked_narrow(CosNaming.NamingContext)
    return resolve(context, URI.stringToName(unquote(name))) if name else context


class BoundNames:
    """Binds the names of a process in the background until `close`, again after a naming service has lost them or
    another process has bound them.

    check_interval_s: interval between checks [s]. With the calls of a check, a stolen name is taken back within 2 s.
    yields: whether a name stays with another process as long as what that has bound is there."""

    def __init__(self, names: NamingService, check_interval_s: float = 1.0, yields: bool = False) -> None:
        self._names, self._yields = names, yields
        self._served: dict[str, Any] = {}
        self._owns_names: Callable[[], bool] = lambda: True
        self._bound: set[str] = set()
        #: Time since which the object that another process has bound to a name does not answer [s].
        self._silent_since: dict[str, float] = {}
        #: Number of thefts of a path since its last log line, and the time of that line [s].
        self._thefts: dict[str, tuple[int, float]] = {}
        self._is_started = False
        self._failures, self._outages = 0, BindingOutages(names.address)
        self._binding = Repeating("bindings", self._bind, lambda: BACKOFF.pause_s(self._failures) or check_interval_s)
        #: Set as soon as all names have been bound.
        self.are_bound = threading.Event()

    def start(self, served: dict[str, Any], owns_names: Callable[[], bool] = lambda: True) -> None:
        """Begin to bind names to these objects; returns immediately.

        owns_names: whether the names belong to this process now, and are taken back from others; must not block."""
        self._served, self._owns_names = served, owns_names
        self._binding.start()
        self._is_started = True

    def add(self, name: str, reference: Any) -> None:
        """Bind another name, with the next check if it can be bound. It must not be bound by this yet."""
        self._served[name] = reference

    def withdraw(self, name: str) -> None:
        """Unbind one of them."""
        self._unbind({name: self._served.pop(name)})

    def close(self) -> None:
        """Unbind all names, except those that another server has bound since."""
        self._binding.close()
        if self._is_started:
            self._unbind(self._served)

    def _bind(self) -> None:
        """Bind all names at start; later those that were lost or stolen."""
        errors = _failures_of(self._check, self._served.items())
        self._outages.note(errors)
        self._failures = self._failures + 1 if errors else 0
        if self._bound.issuperset(list(self._served)):
            self.are_bound.set()

    def _note_bound(self, name: str) -> None:
        self._bound.add(name)
        _log.info("bound %s at %s", self._names.path(name), self._names.address)

    def _check(self, name: str, reference: Any) -> None:
        if self._served.get(name) is not reference:
            return  # withdrawn
        try:
            found = self._names.bound(name) if self._yields or name in self._bound else None
            if self._yields and found is not None and self._is_gone(name, found):
                found = None
        except CORBA.MARSHAL:  # a reference that can't be read
            if self._owns_names():
                self._names.take_back(name, reference)
                self._note_theft(self._names.path(name), "an unknown address")
            return
        if found is None:
            self._names.take_back(name, reference)
            if self._served.get(name) is not reference:  # withdrawn meanwhile
                self._names.unbind(name, reference)
                return
            self._note_bound(name)
        elif found._is_equivalent(reference):
            self._bound.add(name)
        elif self._yields:
            self._note_theft(self._names.path(name), self._names.address_bound(found), "left the name %s to another")
        elif self._owns_names():
            self._names.take_back(name, reference)
            self._note_theft(self._names.path(name), self._names.address_bound(found))

    def _is_gone(self, name: str, found: Any) -> bool:
        is_gone, now = self._names.is_gone(found), time.monotonic()
        if is_gone is None:
            return now - self._silent_since.setdefault(name, now) > SILENT_S
        self._silent_since.pop(name, None)
        return is_gone

    def _note_theft(self, path: str, other: str, what: str = "took back the name %s") -> None:
        """Log who has or had bound a name, at most once in LOG_INTERVAL_S."""
        count, logged_at = self._thefts.get(path, (0, -math.inf))
        now = time.monotonic()
        if now - logged_at >= LOG_INTERVAL_S:
            more = f"; {count} times more in the last minute" if count else ""
            _log.warning(f"{what}: an object at %s was bound to it%s", path, other, more)
            count, logged_at = -1, now
        self._thefts[path] = count + 1, logged_at

    def _release(self, name: str, reference: Any) -> None:
        self._names.unbind(name, reference)

    def _unbind(self, served: dict[str, Any]) -> None:
        if errors := _failures_of(self._release, served.items()):
            _log.warning("cannot unbind names at %s (%s)", self._names.address, describe(errors[0]))


class BindingOutages:
    """Logs that names can't be bound, once for each outage and at most once in LOG_INTERVAL_S, and that they are
    bound again. address: of the naming service. clock: the time [s]."""

    def __init__(self, address: Address, clock: Callable[[], float] = time.monotonic) -> None:
        self._address, self._clock = address, clock
        self._is_out = self._is_logged = False
        self._logged_at, self._unlogged = -math.inf, 0

    def note(self, errors: Sequence[CORBA.Exception]) -> None:
        """Note the errors of an attempt."""
        if not errors:
            if self._is_out and self._is_logged:
                _log.info("names are bound at %s again", self._address)
            self._is_out = False
        elif not self._is_out:
            self._is_out = True
            self._is_logged = self._clock() - self._logged_at >= LOG_INTERVAL_S
            if not self._is_logged:
                self._unlogged += 1
                return
            more = f"; {self._unlogged} times more since the last line" if self._unlogged else ""
            _log.warning("cannot bind names at %s (%s); retrying%s", self._address, describe(errors[0]), more)
            self._logged_at, self._unlogged = self._clock(), 0


def _failures_of(do: Callable[..., None], arguments: Iterable[tuple[Any, ...]]) -> list[CORBA.Exception]:
    """Call `do` with each of these arguments; the errors. One that fails does not stop the others, unless the naming
    service does not answer."""
    errors = []
    for each in list(arguments):
        try:
            do(*each)
        except CORBA.Exception as error:
            errors.append(error)
            if isinstance(error, (CORBA.TRANSIENT, CORBA.COMM_FAILURE, CORBA.TIMEOUT)):
                break
    return errors


class _Retryable(Exception):
    """An attempt to resolve or to list failed for a reason that may be temporary."""


class _OtherKind(_Retryable):
    """An object of another kind is bound: the name may be stolen."""


def corbaname(naming: Address, name: str = "") -> str:
    """The URI by which any CORBA client finds `name`, such as RoboCorba/PathPlanner (parts without kinds)."""
    if not name:
        return f"corbaname::{naming}"
    stringified = name.replace("\\", "\\\\").replace(".", "\\.")
    return f"corbaname::{naming}#{quote(stringified, safe=';/:?@&=+$,-_.!~*()')}"


def _remaining_s(deadline: float) -> float:
    """Timeout of one call: the time left, at most PROBE_TIMEOUT_S, so that a stalled server leaves time for a retry; at
    least 0.2 s, so that the last one gives the reason and is not cut short."""
    return min(PROBE_TIMEOUT_S, max(0.2, deadline - time.monotonic()))
