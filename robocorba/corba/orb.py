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
import signal
import sys
import threading
from collections.abc import Mapping
from functools import cached_property
from queue import SimpleQueue
from types import TracebackType
from typing import Any

import PortableServer
from omniORB import CORBA, interceptors

from robocorba.corba.calls import describe
from robocorba.corba.naming import PROBE_TIMEOUT_S, KeptNames, NamingService
from robocorba.errors.services import NotReachable, PortInUse, ServiceError
from robocorba.settings import Address

CONTEXT = "RoboCorba"
DEFAULT_CALL_TIMEOUT_S = 10.0

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
        self.naming, self.endpoint = naming, endpoint
        self._names = NamingService(self._connect, naming, context, with_kinds)
        self._kept = KeptNames(self._names)
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
        self._kept.close()
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
        served = {name: self.activate(servant, name) for name, servant in servants.items()}
        self._let_calls_in()
        self._kept.start(served)

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
        self.deactivate_key(name)
        self._kept.withdraw(name)

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

        Tries again for `timeout_s`; then raises NotReachable with the reason. The reference's own calls take at most
        `call_timeout_s` (default: the ORB's), then raise CORBA.TIMEOUT."""
        return self._names.resolve(name, interface, timeout_s, call_timeout_s)

    def resolve_elsewhere(self, naming: Address, name: str, interface: Any, call_timeout_s: float) -> Any:
        """The object bound to `name`, which may have a kind, in the root of another naming service: asked once.

        No call takes longer than `call_timeout_s`, then and later. Raises NotReachable."""
        there = NamingService(self._connect, naming, "", with_kinds=True)
        return there.resolve_once(name, interface, call_timeout_s)

    def names(self, path: str, timeout_s: float = PROBE_TIMEOUT_S) -> list[str]:
        """What is bound in the naming context `path`, sorted; nothing where there is no such context.

        Tries again for `timeout_s` while the naming service does not answer; then raises NotReachable."""
        return self._names.names(path, timeout_s)

    def check_naming(self, timeout_s: float = PROBE_TIMEOUT_S) -> None:
        """Raise NotReachable unless the naming service answers a call within `timeout_s`."""
        self._names.check(timeout_s)

    def _connect(self, uri: str) -> Any:
        return self._orb.string_to_object(uri)
