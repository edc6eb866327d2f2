"""A process's ORB: its settings, the names it serves, the names it calls, its end.

A server's composition root reads as a sentence:

    with Orb(naming=settings.naming, endpoint=settings.endpoint) as orb:
        orb.serve({"MapEditor": editor, "PathPlanner": planner})
        orb.run()

and a client's:

    with Orb(naming=settings.naming) as orb:
        planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)

A reference to a served object stays valid when its process is killed and started again on the
same endpoint: its object key is its name, and nothing else. Names are bound in the
naming context RoboCorba, and bound again when the naming service comes back without them.
"""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import logging
import signal
import sys
import threading
import time
from collections.abc import Mapping
from functools import cached_property
from queue import SimpleQueue
from types import TracebackType
from typing import Any
from urllib.parse import quote

import CosNaming
import omniORB
import PortableServer
from omniORB import CORBA, interceptors

from robocorba.errors import NotReachable, PortInUse, ServiceError
from robocorba.settings import Address

CONTEXT = "RoboCorba"
DEFAULT_CALL_TIMEOUT_S = 10.0
#: How often a server looks whether its names are still bound.
BINDING_CHECK_S = 2.0
#: Longest single call to the naming service, and to an object that is asked whether it is there.
PROBE_TIMEOUT_S = 1.0
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.02, 0.25
_LISTED_AT_ONCE = 500

#: Each known to omniORB 4.2 and 4.3. What is not listed stays at omniORB's default;
#: `Orb(options=...)` changes single ones. clientConnectTimeOutPeriod is left out on purpose:
#: on a new connection it takes the place of the call's own limit, shorter or longer.
OPTIONS: dict[str, str] = {
    # omniORB's default is 2 MiB; both ends must allow what a large map or a path list needs.
    "giopMaxMsgSize": str(64 * 1024 * 1024),
    # Names in maps are any text; without this, strings beyond Latin-1 fail with DATA_CONVERSION.
    "nativeCharCodeSet": "UTF-8",
    # Connections are shared per server address. With the default of 5, five calls that wait
    # for a slow peer delay the sixth, though it goes to another object.
    "maxGIOPConnectionPerServer": "64",
    # Idle connections are closed by the side that calls, well before the side that serves:
    # a call never races with a close from the other end.
    "outConScanPeriod": "60",
    "inConScanPeriod": "300",
    # A call that arrives while a process starts waits this long (ms) rather than for good.
    "poaHoldRequestTimeout": "5000",
}

#: A process that was told to end and has not done so within this time tells where its threads are, and ends, s.
END_LIMIT_S = 30.0

_log = logging.getLogger(__name__)
_one_orb = threading.Lock()

#: Open when all servants are there. omniORB takes calls from the moment that its first adapter is made, and
#: answers OBJECT_NOT_EXIST, which means "gone for good", for what is not yet active. The interceptor runs once
#: for each thread that begins to serve a connection, and makes it wait; a call costs nothing more.
_gate = threading.Event()


def _wait_at_gate() -> None:
    _gate.wait()  # an interceptor must return None, or the process is aborted


interceptors.addAssignUpcallThread(_wait_at_gate)


class Orb:
    """The ORB of this process, alive inside a `with`; at most one at a time.

    naming: where the naming service listens.
    endpoint: where a server listens, fixed so that references survive restarts. Without one, an ORB that
        activates objects listens on a free port: on loopback where the naming service does, else on all interfaces.
    context: the naming context that names are relative to, parts separated by slashes; empty for the root.
    with_kinds: names may have kinds, as Mobility.Unit; without, a dot is part of a name, such as a robot's.
    call_timeout_s: limit of every call made through this ORB, except where `resolve` sets another one.

    Raises PortInUse for an endpoint that is taken, ServiceError where the process has an ORB already.
    """

    def __init__(
        self,
        naming: Address,
        endpoint: Address | None = None,
        *,
        context: str = CONTEXT,
        with_kinds: bool = False,
        call_timeout_s: float = DEFAULT_CALL_TIMEOUT_S,
        options: Mapping[str, str] | None = None,
    ) -> None:
        self.naming, self.endpoint, self.context = naming, endpoint, context
        self._with_kinds = with_kinds
        self._options = {
            **OPTIONS,
            # By default a call to a peer that hangs or was switched off never returns.
            "clientCallTimeOutPeriod": str(round(call_timeout_s * 1000)),
            "InitRef": f"NameService=corbaloc:iiop:1.2@{naming}/NameService",
            "endPoint": f"giop:tcp:{endpoint}"
            if endpoint
            else f"giop:tcp:{naming.host if naming.is_loopback else ''}:",
            **(options or {}),
        }
        self._served: dict[str, Any] = {}
        self._binder: threading.Thread | None = None
        self._closing = threading.Event()
        # Unlike an Event, its put() is safe in a signal handler that interrupts its get().
        self._stop: SimpleQueue[None] = SimpleQueue()
        #: Of signals, as they were before ours.
        self._handlers: dict[int, Any] = {}

    def __enter__(self) -> Orb:
        if not _one_orb.acquire(blocking=False):
            raise ServiceError("this process has an ORB already; omniORB allows one")
        _gate.clear()
        arguments = ["robocorba"]
        for option, value in self._options.items():
            arguments += [f"-ORB{option}", value]
        try:
            self._orb = CORBA.ORB_init(arguments, CORBA.ORB_ID)
            if self.endpoint:
                _ = self._named_adapter  # listens from here on, so that a port in use is told now; callers wait
        except BaseException:
            self._end_orb()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._give_signals_back()
        self._closing.set()
        if self._binder:
            self._binder.join()
            self._unbind(self._served)
        self._end_orb()

    def _end_orb(self) -> None:
        orb = self.__dict__.pop("_orb", None)
        for adapter in ("_root_adapter", "_named_adapter"):
            self.__dict__.pop(adapter, None)
        _gate.set()
        try:
            if orb:
                orb.shutdown(True)  # waits for calls in progress
                orb.destroy()
        finally:
            faulthandler.cancel_dump_traceback_later()
            _one_orb.release()

    # ---- serving ----

    def serve(self, servants: Mapping[str, Any]) -> None:
        """Activate servants under their names and keep these bound until the `with` ends.

        Returns at once; binding goes on in the background while the naming service is away.
        Calls are let in when all servants are there: whoever kept a reference over a restart waits, and is
        never told OBJECT_NOT_EXIST. Call it once. Names may have several parts, such as EventChannels/hall."""
        self._take_signals()
        for name, servant in servants.items():
            self._served[name] = self.activate(servant, name)
        self._let_calls_in()
        self._binder = threading.Thread(target=self._keep_bound, name="bindings", daemon=True)
        self._binder.start()

    def activate(self, servant: Any, key: str = "") -> Any:
        """A reference to an object that lives until `deactivate`, at most as long as this process.

        With a `key`, other than any name that is served, it is valid again whenever the process has activated an
        object under the same key at the same endpoint. What others may have kept has to be activated before `serve`.
        To activate a servant under its key once more changes nothing."""
        if key:
            with contextlib.suppress(PortableServer.POA.ObjectAlreadyActive):
                self._named_adapter.activate_object_with_id(key.encode(), servant)
            return self._named_adapter.id_to_reference(key.encode())
        if self.endpoint is None:
            self._let_calls_in()
        return self._root_adapter.id_to_reference(self._root_adapter.activate_object(servant))

    def deactivate(self, servant: Any) -> None:
        """End what `activate` began; calls in progress are finished, later ones get OBJECT_NOT_EXIST."""
        self._root_adapter.deactivate_object(self._root_adapter.servant_to_id(servant))

    def deactivate_key(self, key: str) -> None:
        """The same for an object with a key or a name; the name stays bound. Nothing happens where there is none."""
        with contextlib.suppress(PortableServer.POA.ObjectNotActive):
            self._named_adapter.deactivate_object(key.encode())

    def uri(self, reference: Any) -> str:
        """What `reference` makes the reference of again, in any process."""
        return str(self._orb.object_to_string(reference))

    def reference(self, uri: str, interface: Any) -> Any:
        """The object at an IOR, corbaloc or corbaname, taken for an `interface`; only the last one asks anybody.

        Raises NotReachable for what is no such URI."""
        try:
            found = self._orb.string_to_object(uri)
        except CORBA.SystemException as wrong:
            raise NotReachable(f"{uri[:80]!r} leads to no object ({describe(wrong)})") from None
        if found is None:
            raise NotReachable(f"{uri[:80]!r} is a nil reference")
        return found._unchecked_narrow(interface)

    def withdraw(self, name: str) -> None:
        """Stop serving one name, and unbind it."""
        reference = self._served.pop(name)
        self.deactivate_key(name)
        self._unbind({name: reference})

    def run(self) -> None:
        """Serve until SIGTERM, SIGINT or `stop`; the `with` has to end within END_LIMIT_S after that. Only in the main
        thread."""
        gc.freeze()  # what a server has loaded by now stays: collecting it again and again would delay calls
        self._let_calls_in()
        self._take_signals()
        try:
            self._stop.get()
        finally:
            faulthandler.dump_traceback_later(END_LIMIT_S, exit=True, file=sys.__stderr__ or 2)
            self._give_signals_back()

    def stop(self) -> None:
        """Let `run` return; from any thread, servant or signal handler."""
        self._stop.put(None)

    def _take_signals(self) -> None:
        """What comes between `serve` and `run` ends `run` at once, rather than the process without its end."""
        if not self._handlers and threading.current_thread() is threading.main_thread():
            for number in (signal.SIGTERM, signal.SIGINT):
                self._handlers[number] = signal.signal(number, lambda *_: self.stop())

    def _give_signals_back(self) -> None:
        while self._handlers:
            signal.signal(*self._handlers.popitem())

    def _let_calls_in(self) -> None:
        for adapter in (self._named_adapter, self._root_adapter):
            adapter._get_the_POAManager().activate()
        _gate.set()

    @cached_property
    def _named_adapter(self) -> Any:
        """For objects with a name: PERSISTENT, USER_ID. The object key is the id alone, so that
        corbaloc:iiop:HOST:PORT/NAME works without a naming service."""
        return self._adapter("omniINSPOA")

    @cached_property
    def _root_adapter(self) -> Any:
        """For objects without a name: TRANSIENT, unique ids."""
        return self._adapter("RootPOA")

    def _adapter(self, which: str) -> Any:
        try:
            return self._orb.resolve_initial_references(which)
        except CORBA.INITIALIZE as wrong:
            if self.endpoint is None:
                raise ServiceError(f"can't listen: {wrong}") from None
            raise PortInUse(self.endpoint.host, self.endpoint.port, "this server") from None

    # ---- names ----

    def resolve(self, name: str, interface: Any, timeout_s: float = 10.0, call_timeout_s: float | None = None) -> Any:
        """The object bound to `name`, as `interface` (a class of the stubs), once it has answered a call.

        Tries again for `timeout_s` while the name is not bound or nobody answers; then raises
        NotReachable with the reason. The reference's own calls take at most `call_timeout_s`
        (default: the ORB's), then raise CORBA.TIMEOUT."""
        if not all(name.split("/")):
            raise NotReachable(f"{self._path(name)!r} can't be a name")
        deadline, pause = time.monotonic() + timeout_s, FIRST_PAUSE_S
        while True:
            try:
                found = self._lookup(name, deadline)
                reference = self._ask(found, interface, name, deadline)
                break
            except _NotYet as reason:
                if time.monotonic() + pause > deadline:
                    raise NotReachable(f"{self._path(name)} is not reachable: {reason}") from None
            time.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE_S)
        limit_calls(reference, call_timeout_s)
        return reference

    def resolve_elsewhere(self, naming: Address, name: str, interface: Any, call_timeout_s: float) -> Any:
        """The object bound to `name`, which may have a kind, in the root of another naming service: asked once.

        No call takes longer than `call_timeout_s`, then and later. Raises NotReachable."""
        root = self.reference(f"corbaloc:iiop:1.2@{naming}/NameService", CosNaming.NamingContext)
        limit_calls(root, call_timeout_s)
        try:
            found = root.resolve([_component(name, True)])
            if found is None:
                raise NotReachable(f"nil is bound to {name} at {naming}")
            limit_calls(found, call_timeout_s)
            reference = found._narrow(interface)
        except (CosNaming.NamingContext.NotFound, CosNaming.NamingContext.CannotProceed):
            raise NotReachable(f"the naming service at {naming} does not know {name}") from None
        except CORBA.SystemException as wrong:
            raise NotReachable(f"{name} at {naming} does not answer ({describe(wrong)})") from None
        if reference is None:
            raise NotReachable(f"what is bound to {name} at {naming} is not a {interface._NP_RepositoryId}")
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
                    reason = f"the naming service at {self.naming} does not answer ({describe(wrong)})"
                    raise NotReachable(reason) from None
            time.sleep(FIRST_PAUSE_S)

    def _bindings(self, path: str, deadline: float) -> list[Any]:
        found = self._naming(_share(deadline)).resolve(self._components(path))
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

    def check_naming(self, timeout_s: float = PROBE_TIMEOUT_S) -> None:
        """Raise NotReachable unless the naming service answers a call within `timeout_s`."""
        try:
            self._naming(timeout_s)._non_existent()
        except CORBA.SystemException as wrong:
            raise NotReachable(f"the naming service at {self.naming} does not answer ({describe(wrong)})") from None

    def _path(self, name: str) -> str:
        return f"{self.context}/{name}" if self.context else name

    def _components(self, name: str) -> list[Any]:
        return [_component(part, self._with_kinds) for part in self._path(name).split("/")]

    def _naming(self, timeout_s: float = PROBE_TIMEOUT_S) -> Any:
        root = self._orb.string_to_object(f"corbaloc:iiop:1.2@{self.naming}/NameService")
        context = root._unchecked_narrow(CosNaming.NamingContext)
        limit_calls(context, timeout_s)
        return context

    def _lookup(self, name: str, deadline: float) -> Any:
        try:
            return self._naming(_share(deadline)).resolve(self._components(name))
        except (CosNaming.NamingContext.NotFound, CosNaming.NamingContext.CannotProceed):
            raise _NotYet(f"the naming service at {self.naming} does not know it") from None
        except CORBA.SystemException as wrong:
            raise _NotYet(f"the naming service at {self.naming} does not answer ({describe(wrong)})") from None

    def _ask(self, found: Any, interface: Any, name: str, deadline: float) -> Any:
        try:
            if found is None:
                raise _NotYet("nil is bound to it")
            limit_calls(found, _share(deadline))
            reference = found._narrow(interface)
            if reference is None:
                kind = interface._NP_RepositoryId
                raise NotReachable(f"what is bound to {self._path(name)} at {self.naming} is not a {kind}")
            limit_calls(reference, _share(deadline))
            if reference._non_existent():
                raise _NotYet("its server says that the object does not exist")
        except CORBA.SystemException as wrong:
            raise _NotYet(f"bound at {self.naming}, but its server does not answer ({describe(wrong)})") from None
        return reference

    def _keep_bound(self) -> None:
        """Bind at start whatever the names stood for; later only what vanished, so as not to fight another server."""
        bound: set[str] = set()
        told, pause = False, FIRST_PAUSE_S
        while True:
            try:
                for name, reference in list(self._served.items()):
                    if name not in bound or self._is_unbound(name):
                        self._bind(name, reference)
                        bound.add(name)
                        _log.info("bound %s at %s", self._path(name), self.naming)
                told, pause = False, BINDING_CHECK_S
            except (CORBA.Exception, CosNaming.NamingContext.NotFound) as wrong:
                if not told:
                    _log.warning("can't bind names at %s (%s); trying on", self.naming, describe(wrong))
                told, pause = True, min(2 * pause, LONGEST_PAUSE_S)
            if self._closing.wait(pause):
                return

    def _is_unbound(self, name: str) -> bool:
        try:
            self._naming().resolve(self._components(name))
        except CosNaming.NamingContext.NotFound:
            return True
        return False

    def _bind(self, name: str, reference: Any) -> None:
        root, path = self._naming(), self._components(name)
        try:
            root.rebind(path, reference)
        except CosNaming.NamingContext.NotFound:
            for length in range(1, len(path)):
                try:
                    root.bind_new_context(path[:length])
                except CosNaming.NamingContext.AlreadyBound:
                    continue
            root.rebind(path, reference)

    def _unbind(self, served: Mapping[str, Any]) -> None:
        """A server that was stopped leaves no names behind; one that now belongs to another server stays."""
        try:
            for name, reference in served.items():
                try:
                    if self._naming().resolve(self._components(name))._is_equivalent(reference):
                        self._naming().unbind(self._components(name))
                except CosNaming.NamingContext.NotFound:
                    continue
        except CORBA.Exception as wrong:
            _log.warning("can't unbind names at %s (%s)", self.naming, describe(wrong))


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


def limit_calls(reference: Any, timeout_s: float | None) -> None:
    """How long each call by this very reference may take; None: as long as its ORB says."""
    omniORB.setClientCallTimeout(reference, 0 if timeout_s is None else max(1, round(timeout_s * 1000)))


def describe(error: BaseException) -> str:
    """'TRANSIENT_ConnectFailed' for omniORB's system exceptions, which say little as text."""
    if isinstance(error, CORBA.SystemException):
        minor = omniORB.minorCodeToString(error)
        return str(minor) if isinstance(minor, str) else type(error).__name__
    return type(error).__name__


def _share(deadline: float) -> float:
    """Time for one call: what is left, but at most PROBE_TIMEOUT_S, so that a stalled peer leaves time for a retry."""
    return min(PROBE_TIMEOUT_S, max(0.01, deadline - time.monotonic()))
