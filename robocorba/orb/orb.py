"""The ORB of a process: settings, names it serves, names it calls, shutdown.

A server's composition root reads as a sentence:

    with Orb(naming=settings.naming, endpoint=settings.endpoint) as orb:
        orb.serve({"MapEditor": editor, "PathPlanner": planner})
        orb.run()

and a client's:

    with Orb(naming=settings.naming) as orb:
        planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)

A reference to a served object stays valid when its process is killed and restarted on the same endpoint, because
its object key is its name only. Names are bound in the naming context RoboCorba, and bound again when a restarted
naming service has lost them.
"""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import secrets
import sys
import threading
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import omniORB
import PortableServer
import PortableServer__POA
from omniORB import CORBA, BiDirPolicy

from robocorba.errors.services import NotReachable, PortInUse, ServiceError
from robocorba.orb import tls
from robocorba.orb.bounded_any import read_bounded
from robocorba.orb.calls import describe, set_call_timeout
from robocorba.orb.connections import ConnectionLimit, enlarge_queue
from robocorba.orb.guard import Guard, guarded, without_keys
from robocorba.orb.naming import PROBE_TIMEOUT_S, BoundNames, NamingService, resolve_corbaname
from robocorba.orb.references import object_at
from robocorba.orb.robot_objects import RobotObjects
from robocorba.orb.texts import refuse_unreadable_texts
from robocorba.orb.workarounds import (
    hold_connections,
    let_connections_wait,
    return_freed_memory,
    serve_connections,
    trim,
    wait_for_call_threads,
)
from robocorba.system.endpoints import is_free
from robocorba.system.repeating import Repeating
from robocorba.system.roles import Role
from robocorba.system.settings import Address, RoleNaming, omniorb_trace
from robocorba.system.stop_request import StopRequest

CONTEXT = "RoboCorba"
#: The versions of omniORB and of its Python binding.
OMNIORB = f"{omniORB.coreVersion()}, omniORBpy {omniORB.__version__}"

#: Options of omniORB 4.2 and 4.3 that differ from their defaults; `Orb(options=...)` changes single ones.
#: clientConnectTimeOutPeriod is omitted on purpose: on a new connection it would replace the timeout of the call.
OPTIONS: dict[str, str] = {
    # omniORB's default of 2 MiB is too small for a large map or a list of paths; both ends must allow more.
    "giopMaxMsgSize": str(64 * 1024 * 1024),
    # Names in maps may be any text; by default, strings beyond Latin-1 fail with DATA_CONVERSION.
    "nativeCharCodeSet": "UTF-8",
    # Connections are shared per server address. With the default of 5, five calls that wait for a slow object delay
    # a sixth call to another object.
    "maxGIOPConnectionPerServer": "64",
    # The client closes idle connections well before the server does, so that a call never races with a close by the
    # server.
    "outConScanPeriod": "60",
    "inConScanPeriod": "180",
    # A request of which only a part arrives, or a reply that the client doesn't read, ends its connection [ms]. The
    # first 8 KiB of a request are exempt: a stalled beginning holds its connection and its thread until
    # inConScanPeriod, so connections must have threads of their own (omniORB's default, threadPerConnectionPolicy 1).
    "serverCallTimeOutPeriod": "20000",
    # omniORB's default of 100 would let each connection start 100 threads. omniORB's own clients need one.
    "maxServerThreadPerConnection": "16",
    # Timeout of a call that arrives while a process starts [ms]; by default it waits without limit.
    "poaHoldRequestTimeout": "5000",
}

#: Options of a client that lets servers call its objects over the connections that it has opened (bidirectional GIOP),
#: for clients behind NAT; and those of a server that does so.
OFFER_CALLBACKS = {"offerBiDirectionalGIOP": "1", "clientTransportRule": "* bidir,tcp"}
ACCEPT_CALLBACKS = {
    "acceptBiDirectionalGIOP": "1",
    "serverTransportRule": "* tcp,bidir",
    "clientTransportRule": "* bidir,tcp",
}

#: A process that has not ended this long after `run` returned prints the stacks of its threads and exits [s].
SHUTDOWN_LIMIT_S = 30.0

_one_orb = threading.Lock()


def checking(servant: Any) -> Any:
    """The servant, whose operations refuse texts of callers that are not UTF-8, anys that are nested too deep, and
    references that would end the process."""
    kind: Any = type(servant)
    read_bounded(kind)
    refuse_unreadable_texts(kind)
    return servant


class _Finder(PortableServer__POA.ServantActivator):
    """Finds the servants of objects that are not active."""

    def __init__(self, find: Callable[[str], Any]) -> None:
        self._find = find

    def incarnate(self, id: bytes, adapter: Any) -> Any:
        servant = self._find(id.decode(errors="replace"))
        if servant is None:
            raise CORBA.OBJECT_NOT_EXIST(0, CORBA.COMPLETED_NO)
        return checking(servant)

    def etherealize(self, id: bytes, adapter: Any, servant: Any, is_cleanup: bool, has_other_ids: bool) -> None:
        pass


class Orb:
    """The ORB of this process, alive inside a `with`; at most one at a time.

    naming: address of the naming service. As a role of a guarded system (RoleNaming) this ORB guards what it serves,
        see robocorba.orb.guard, unless `guards` is False, and uses TLS if that system does.
    endpoint: address of a server, fixed so that references survive restarts. Without one, an ORB that activates
        objects listens on a free port: on loopback if the naming service does, else on all interfaces.
    context: the naming context that names are relative to, parts separated by slashes; empty for the root, where names
        may have kinds, as Mobility.Unit; otherwise a dot is part of a name, such as a robot's.
    call_timeout_s: timeout of every call through this ORB, unless `resolve` sets another one.

    Raises PortInUse if another process listens on the endpoint, ServiceError if that is none of this machine, or if the
    process already has an ORB.
    """

    def __init__(
        self,
        naming: Address,
        endpoint: Address | None = None,
        *,
        context: str = CONTEXT,
        call_timeout_s: float = 10.0,
        options: Mapping[str, str] | None = None,
        guards: bool = True,
    ) -> None:
        self.naming, self.endpoint = naming, endpoint
        self._names = NamingService(self._connect, naming, context, self.uri)
        self._bound_names: Any = BoundNames(self._names)
        self._guard: Guard | None = None
        self._robot_objects: RobotObjects | None = None
        if isinstance(naming, RoleNaming) and guards:
            from robocorba.orb.role_names import HeldNames  # loads stubs, which other processes need not

            # Servers have one secret, so that their references stay valid.
            self._guard = Guard(naming.key.encode() if naming.role is Role.SERVER else b"")
            self._bound_names = HeldNames(self._names, self._guard)
        self._connections = ConnectionLimit()
        self._trimming: Repeating | None = None
        self._active_keys: set[str] = set()
        self._options = {
            **OPTIONS,
            **omniorb_trace(),
            # By default a call to a peer that hangs or was switched off never returns.
            "clientCallTimeOutPeriod": str(round(call_timeout_s * 1000)),
            "InitRef": f"NameService={self._names.root_uri}",
            "endPoint": f"giop:tcp:{endpoint}"
            if endpoint
            else f"giop:tcp:{naming.host if naming.is_loopback else ''}:",
            **(options or {}),
        }
        if naming.scheme == "ssliop":
            assert isinstance(naming, RoleNaming)
            self._options |= tls.options(naming.file.parent, self._options)
        self._stop = StopRequest()

    def __enter__(self) -> Orb:
        if not _one_orb.acquire(blocking=False):
            raise ServiceError("this process has an ORB already; omniORB allows one")
        arguments = ["robocorba"]
        for option, value in self._options.items():
            arguments += [f"-ORB{option}", value]
        try:
            let_connections_wait()
            self._orb = CORBA.ORB_init(arguments, CORBA.ORB_ID)
            if self.endpoint:
                if return_freed_memory():
                    self._trimming = Repeating("trim", trim, 30.0).start()
                hold_connections()
                _ = self._named_adapter  # listens from here on, so that a port in use is detected now; callers wait
                enlarge_queue()
            self._connections.start()
            if self.offers_callbacks:
                _ = self._object_adapter  # omniORB makes no call that offers callbacks before it is there
        except BaseException:
            self._shut_down()
            raise
        return self

    def __exit__(self, *raised: object) -> None:
        self._stop.close()
        if self._robot_objects:
            self._robot_objects.close()
        self._bound_names.close()
        self._connections.close()
        self._shut_down()

    def _shut_down(self) -> None:
        orb = self.__dict__.pop("_orb", None)
        self._active_keys.clear()
        for adapter in ("_root_adapter", "_object_adapter", "_named_adapter", "_secret_adapter"):
            self.__dict__.pop(adapter, None)
        if self._trimming:
            self._trimming.close()
        serve_connections()
        try:
            if orb:
                orb.shutdown(True)  # waits for calls in progress
                orb.destroy()
                wait_for_call_threads()
        finally:
            faulthandler.cancel_dump_traceback_later()
            _one_orb.release()

    # ---- serving ----

    def serve(self, servants: Mapping[str, Any], owns_names: Callable[[], bool] = lambda: True) -> None:
        """Activate servants under their names and keep these bound until the `with` ends.

        Returns immediately; binding continues in the background while the naming service is away. Calls are accepted
        when all servants are active: clients that kept a reference over a restart wait, and never get
        OBJECT_NOT_EXIST. Call it once. Names may have several parts, such as EventChannels/hall. While `owns_names`,
        which must not block, they are taken back from other processes that bind them."""
        self._catch_signals()
        served = {name: self._activate_named(servant, name) for name, servant in servants.items()}
        if self._guard and isinstance(self.naming, RoleNaming) and self.naming.role is Role.SERVER:
            self._robot_objects = self._objects_for_robots(self.naming.file.parent, self._guard, servants).start()
        self.accept_calls()
        self._bound_names.start(served, owns_names)

    def wait_until_bound(self, limit_s: float) -> bool:
        """Wait until all served names have been bound; whether they were within this time."""
        return bool(self._bound_names.are_bound.wait(limit_s))

    def activate(self, servant: Any, key: str = "") -> Any:
        """A reference to an object that lives until `deactivate`, or with a key `deactivate_key`, at most as long as
        this process.

        With a `key`, which must differ from all served names, the reference is valid again whenever a process has
        activated an object with the same key at the same endpoint. Objects whose references others may have kept must
        be activated before `serve`. Activating a servant under its key again has no effect. Texts of callers that are
        not UTF-8 and anys that are nested too deep are refused.

        In a guarded system the reference is for servers, and for those that they give it to: its key can't be guessed.
        """
        if key:
            return self._activate_with_key(servant, self._guard.key(key) if self._guard else key)
        if self.endpoint is None:
            self.accept_calls()
        checking(servant)
        if self._guard:
            id = secrets.token_bytes(16)
            self._object_adapter.activate_object_with_id(id, servant)
        else:
            id = self._object_adapter.activate_object(servant)
        return self._object_adapter.id_to_reference(id)

    def activate_for_all(self, servant: Any, key: str) -> Any:
        """The same with a key that everybody knows; in a guarded system with the rights of observers."""
        checking(servant)  # before its operations are taken
        return self._activate_with_key(guarded(servant, Role.OBSERVER) if self._guard else servant, key)

    def _activate_named(self, servant: Any, name: str) -> Any:
        """The reference of a served object; guarded, that for each role."""
        if self._guard is None:
            return self._activate_with_key(servant, name)
        checking(servant)  # before its operations are taken
        return {role: self._activate_with_key(guarded(servant, role), self._guard.key(name, role)) for role in Role}

    def _objects_for_robots(self, access: Path, guard: Guard, servants: Mapping[str, Any]) -> RobotObjects:
        return RobotObjects(access, guard, servants, self._activate_with_key, self._deactivate_with_key)

    def _activate_with_key(self, servant: Any, key: str) -> Any:
        # Not only by the exception: where a servant is being found, omniORBpy sometimes raises SystemError instead.
        if key not in self._active_keys:
            with contextlib.suppress(PortableServer.POA.ObjectAlreadyActive):  # at the same time
                self._named_adapter.activate_object_with_id(key.encode(), checking(servant))
            self._active_keys.add(key)
        return self._named_adapter.id_to_reference(key.encode())

    def deactivate(self, servant: Any) -> None:
        """Deactivate a servant without a key; calls in progress are finished, later ones get OBJECT_NOT_EXIST."""
        self._object_adapter.deactivate_object(self._object_adapter.servant_to_id(servant))

    def deactivate_key(self, key: str) -> None:
        """Deactivate the object with a key or a name, if there is one; the name stays bound."""
        for each in self._guard.keys(key) if self._guard else [key]:
            self._deactivate_with_key(each)

    def _deactivate_with_key(self, key: str) -> None:
        with contextlib.suppress(PortableServer.POA.ObjectNotActive):
            self._named_adapter.deactivate_object(key.encode())
        self._active_keys.discard(key)

    def serve_secrets(self, find: Callable[[str], Any]) -> None:
        """Serve objects whose keys this process need not know: a key is the right to call, and who stores only its
        digest gives nothing away. `find` gets the key of a call to an object that is not active, and returns its
        servant, None if there is none; it must not block. Call it before `serve`."""
        root = self._root_adapter
        policies = [
            root.create_lifespan_policy(PortableServer.PERSISTENT),
            root.create_id_assignment_policy(PortableServer.USER_ID),
            root.create_request_processing_policy(PortableServer.USE_SERVANT_MANAGER),
            root.create_servant_retention_policy(PortableServer.RETAIN),
        ]
        self._secret_adapter = root.create_POA("secrets", root._get_the_POAManager(), policies)
        # The finder is an object, too, which is called here, before the others accept calls. Its key can't be guessed:
        # omniORB would let clients call it as well.
        finders = root.create_POA("finders", None, [root.create_id_assignment_policy(PortableServer.USER_ID)])
        finders._get_the_POAManager().activate()
        id = secrets.token_bytes(16)
        finders.activate_object_with_id(id, _Finder(find))
        self._secret_adapter.set_servant_manager(finders.id_to_reference(id))

    def activate_secret(self, servant: Any, key: str) -> Any:
        """A reference to an object that `find` would find by its secret key, until `deactivate_secret`."""
        with contextlib.suppress(PortableServer.POA.ObjectAlreadyActive):
            self._secret_adapter.activate_object_with_id(key.encode(), checking(servant))
        return self._secret_adapter.id_to_reference(key.encode())

    def deactivate_secret(self, key: str) -> None:
        with contextlib.suppress(PortableServer.POA.ObjectNotActive):
            self._secret_adapter.deactivate_object(key.encode())

    def is_own(self, reference: Any) -> bool:
        """Whether this process serves the object of a reference under a name or a key."""
        try:
            self._named_adapter.reference_to_id(reference)
        except (PortableServer.POA.WrongAdapter, CORBA.SystemException):
            return False
        return True

    def uri(self, reference: Any) -> str:
        """The stringified form of a reference, which `reference` converts back in any process."""
        return str(self._orb.object_to_string(reference))

    def uri_at(self, address: Address | str, key: str) -> str:
        """The URI of an object at HOST:PORT of this system, by the key that observers know."""
        return f"corbaloc:{self.naming.scheme}:1.2@{address}/{key}"

    def uri_for_servers(self, address: Address | str, name: str) -> str:
        """The URI of a named object of another server at HOST:PORT of this system, with the rights of servers."""
        return self.uri_at(address, self._guard.key(name) if self._guard else name)

    def reference(self, uri: str, interface: Any, call_timeout_s: float | None = None) -> Any:
        """The object at an IOR, corbaloc or corbaname, cast to `interface` unchecked. Only a corbaname makes a call.

        call_timeout_s: as for `resolve`; each reference has its own. Raises NotReachable for any other URI."""
        try:
            found = self._connect(uri)
        except CORBA.Exception as error:
            raise NotReachable(f"{without_keys(uri)[:80]!r} leads to no object ({describe(error)})") from None
        if found is None:
            raise NotReachable(f"{without_keys(uri)[:80]!r} is a nil reference")
        reference = found._unchecked_narrow(interface)
        if call_timeout_s is not None:
            set_call_timeout(reference, call_timeout_s)
        return reference

    def withdraw(self, name: str) -> None:
        """Stop serving one name, and unbind it."""
        self.deactivate_key(name)
        self._bound_names.withdraw(name)

    def run(self) -> None:
        """Serve until SIGTERM, SIGINT or `stop`; then the `with` must end within SHUTDOWN_LIMIT_S. Main thread only."""
        gc.freeze()  # the objects loaded so far stay; traversing them in each collection would delay calls
        self.accept_calls()
        self._catch_signals()
        try:
            self._stop.wait()
        finally:
            faulthandler.dump_traceback_later(SHUTDOWN_LIMIT_S, exit=True, file=sys.__stderr__ or 2)
            self._stop.release_signals()

    def stop(self) -> None:
        """Let `run` return; from any thread, servant or signal handler."""
        self._stop.make()

    def _catch_signals(self) -> None:
        """A signal between `serve` and `run` makes `run` return immediately, instead of killing the process."""
        if threading.current_thread() is threading.main_thread():
            self._stop.catch_signals()

    def accept_calls(self) -> None:
        """Accept calls of active objects; for a process that has objects, but no names for `serve`."""
        for adapter in (self._named_adapter, self._root_adapter):
            adapter._get_the_POAManager().activate()
        serve_connections()

    @cached_property
    def _named_adapter(self) -> Any:
        """For objects with a name: PERSISTENT, USER_ID. The object key is the id only, so that
        corbaloc:iiop:HOST:PORT/NAME works without a naming service."""
        return self._resolve_adapter("omniINSPOA")

    @cached_property
    def _root_adapter(self) -> Any:
        """For objects without a name: TRANSIENT, unique ids."""
        return self._resolve_adapter("RootPOA")

    @cached_property
    def _object_adapter(self) -> Any:
        """The same; guarded, with ids that can't be guessed; for calls over the connections of clients where wanted."""
        root = self._root_adapter
        policies = [root.create_id_assignment_policy(PortableServer.USER_ID)] if self._guard else []
        if self._options.keys() & {"offerBiDirectionalGIOP", "acceptBiDirectionalGIOP"}:
            kind, both = BiDirPolicy.BIDIRECTIONAL_POLICY_TYPE, BiDirPolicy.BOTH
            policies.append(self._orb.create_policy(kind, both))
        if not policies:
            return root
        try:
            return root.create_POA("objects", root._get_the_POAManager(), policies)
        except PortableServer.POA.AdapterAlreadyExists:  # by another thread: from Python 3.12 on, nothing excludes it
            return root.find_POA("objects", False)

    @property
    def offers_callbacks(self) -> bool:
        """Whether servers may call objects of this process over its own connections (OFFER_CALLBACKS)."""
        return "offerBiDirectionalGIOP" in self._options

    def _resolve_adapter(self, which: str) -> Any:
        try:
            return self._orb.resolve_initial_references(which)
        except CORBA.INITIALIZE as error:
            if self.endpoint is None:
                raise ServiceError(f"cannot listen: {error}") from None
            is_free(self.endpoint.host, self.endpoint.port)  # raises, where there is another reason
            raise PortInUse(self.endpoint.host, self.endpoint.port, "this server") from None

    # ---- names ----

    def resolve(self, name: str, interface: Any, timeout_s: float = 10.0, call_timeout_s: float | None = None) -> Any:
        """The object bound to `name`, as `interface` (a class of the stubs), once it has answered a call.

        Retries for `timeout_s`, then raises NotReachable with the reason. call_timeout_s: timeout of later calls
        through the reference (default: the ORB's), after which they raise CORBA.TIMEOUT."""
        return self._names.resolve(name, interface, timeout_s, call_timeout_s)

    def resolve_in_other_naming_service(self, naming: Address, name: str, interface: Any, call_timeout_s: float) -> Any:
        """The object bound to `name`, which may have a kind, in the root of another naming service; without retries.

        call_timeout_s: timeout of each call, also of later calls through the reference. Raises NotReachable."""
        other = NamingService(self._connect, naming, "")
        return other.resolve_once(name, interface, call_timeout_s)

    def names_elsewhere(self, naming: Address) -> BoundNames:
        """Names, which may have kinds, that are kept bound in the root of another naming service, or in the root of
        the system's, until they are closed; none at first. Names that others have stay with them."""
        names = BoundNames(NamingService(self._connect, naming, "", self.uri), yields=True)
        names.start({})
        return names

    def names(self, path: str, timeout_s: float = PROBE_TIMEOUT_S) -> list[str]:
        """The names bound in the naming context `path`, sorted; empty if there is no such context.

        Retries for `timeout_s` while the naming service does not answer, then raises NotReachable."""
        return self._names.names(path, timeout_s)

    def check_naming(self, timeout_s: float = PROBE_TIMEOUT_S) -> None:
        """Raise NotReachable unless the naming service answers a call within `timeout_s`."""
        self._names.check(timeout_s)

    def _connect(self, uri: str) -> Any:
        if uri.lower().startswith("corbaname:"):
            return resolve_corbaname(self._connect, uri)
        return object_at(self._orb, uri)
