"""Consumers and suppliers of a channel, called by their object references."""

from __future__ import annotations

import logging
import struct
import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import Any

import CosEventComm
from omniORB import CORBA

from robocorba.errors.events import ClientGone, EventError, NotDelivered, OwnProxy, Refused, Unconfirmed
from robocorba.events.corba import events
from robocorba.events.event import CorrelatedEvents, EventBatch
from robocorba.events.proxy import ProxyKind
from robocorba.events.queue import QueueItem
from robocorba.orb.bounded_any import invoke
from robocorba.orb.calls import describe, set_call_timeout
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba

#: Timeout of the call that notifies a client of its disconnection [s].
DISCONNECT_TIMEOUT_S = 1.0
#: Maximum number of consumers that are called over their own connections; a further one replaces the oldest.
MAX_ROUTES = 1000
#: HOST:PORT and object key.
Identity = tuple[str, bytes]
_NO_ROUTES: Mapping[Identity, Any] = {}
_EVENT_CONSUMER = RoboCorba.EventConsumer._NP_RepositoryId
_IDEMPOTENT_CONSUMER = RoboCorba.IdempotentEventConsumer._NP_RepositoryId

_log = logging.getLogger(__name__)
#: Errors of an object that does not exist, or has another type.
_GONE = (CORBA.OBJECT_NOT_EXIST, CORBA.INV_OBJREF, CORBA.BAD_OPERATION, CORBA.NO_IMPLEMENT, CORBA.OBJ_ADAPTER)
#: Errors of the transport, independent of the content of the call.
_TRANSPORT_FAILURES = (CORBA.COMM_FAILURE, CORBA.TRANSIENT, CORBA.TIMEOUT, CORBA.NO_RESOURCES, CORBA.NO_MEMORY)


def delivery_failure(error: CORBA.Exception) -> EventError:
    """The domain error for an exception of a call to a client: NotDelivered, Unconfirmed, Refused or ClientGone."""
    if isinstance(error, CosEventComm.Disconnected):
        return ClientGone("it answers that it is disconnected")
    if isinstance(error, _GONE):
        return ClientGone(describe(error))
    if isinstance(error, _TRANSPORT_FAILURES):
        return (NotDelivered if error.completed == CORBA.COMPLETED_NO else Unconfirmed)(describe(error))
    return Refused(describe(error))


class _RemoteClient:
    """Base of all clients. disconnect_operation: the operation that notifies the client of its disconnection.

    routes: by `identity_of`, references to clients that are called over the connections that they have opened."""

    def __init__(
        self,
        orb: Orb,
        uri: str,
        interface: Any,
        disconnect_operation: str,
        *,
        routes: Mapping[Identity, Any] = _NO_ROUTES,
    ) -> None:
        self.reference, self._interface, self._routes, self._route = uri, interface, routes, None
        self.address, self._identity = address_of(uri), identity_of(uri)
        self._remote = orb.reference(uri, interface)
        self._limit_s = 0.0
        self._disconnect_operation = disconnect_operation

    def _set_limit(self, limit_s: float) -> None:
        """Set the timeout of calls. Each instance has its own reference, and one thread at a time calls it."""
        route = self._routes.get(self._identity) if self._routes else None
        if route is not None and route is not self._route:
            self._route, self._remote, self._limit_s = route, route._unchecked_narrow(self._interface), 0.0
        if limit_s != self._limit_s:
            set_call_timeout(self._remote, limit_s)
            self._limit_s = limit_s

    def disconnect(self) -> None:
        try:
            self._set_limit(DISCONNECT_TIMEOUT_S)
            getattr(self._remote, self._disconnect_operation)()
        except CORBA.Exception as error:
            _log.info("could not notify %s of its disconnection (%s)", self.address, describe(error))


class RemotePushConsumer(_RemoteClient):
    """A plain consumer, which takes one `any` a call."""

    takes_batches = False
    is_idempotent = False

    def __init__(
        self,
        orb: Orb,
        uri: str,
        *,
        routes: Mapping[Identity, Any] = _NO_ROUTES,
        interface: Any = CosEventComm.PushConsumer,
    ) -> None:
        super().__init__(orb, uri, interface, "disconnect_push_consumer", routes=routes)

    def deliver(self, items: Sequence[QueueItem], limit_s: float) -> None:
        self._set_limit(limit_s)
        batch = items[0]
        assert isinstance(batch, EventBatch)
        value = events.plain_event(batch)
        try:
            self._remote.push(value)
        except CORBA.Exception as error:
            raise delivery_failure(error) from None

    def answers(self, limit_s: float) -> bool:
        self._set_limit(limit_s)
        try:
            if self._remote._non_existent():
                raise ClientGone("it does not exist")
        except _GONE as error:
            raise ClientGone(describe(error)) from None
        except CORBA.SystemException:
            return False
        return True


class RemoteEventConsumer(RemotePushConsumer):
    """A consumer that takes batches."""

    takes_batches = True

    def __init__(self, orb: Orb, uri: str, *, routes: Mapping[Identity, Any] = _NO_ROUTES) -> None:
        super().__init__(orb, uri, routes=routes, interface=RoboCorba.EventConsumer)
        self.is_idempotent = _type_id(uri) == _IDEMPOTENT_CONSUMER

    def deliver(self, items: Sequence[QueueItem], limit_s: float) -> None:
        self._set_limit(limit_s)
        try:
            if isinstance(items[0], CorrelatedEvents):
                self._remote.pushTogether(items[0].clause_number, events.correlated_events(items[0]))
            else:
                self._remote.pushRuns([events.event_run(batch) for batch in items if isinstance(batch, EventBatch)])
        except CORBA.Exception as error:
            raise delivery_failure(error) from None


class RemotePullSupplier(_RemoteClient):
    """A plain supplier that the channel polls."""

    def __init__(self, orb: Orb, uri: str) -> None:
        super().__init__(orb, uri, CosEventComm.PullSupplier, "disconnect_pull_supplier")

    def try_pull(self, limit_s: float) -> EventBatch | None:
        self._set_limit(limit_s)
        try:
            value, has_event = invoke(self._remote, CosEventComm.PullSupplier, "try_pull")
        except CORBA.Exception as error:
            raise delivery_failure(error) from None
        return events.batch_of_any(value) if has_event else None


class RemotePushSupplier(_RemoteClient):
    """A supplier that pushes; it is called only to disconnect it."""

    def __init__(self, orb: Orb, uri: str) -> None:
        super().__init__(orb, uri, CosEventComm.PushSupplier, "disconnect_push_supplier")


class RemotePullConsumer(_RemoteClient):
    """A consumer that pulls; it is called only to disconnect it."""

    def __init__(self, orb: Orb, uri: str) -> None:
        super().__init__(orb, uri, CosEventComm.PullConsumer, "disconnect_pull_consumer")


class RemoteClients:
    """Makes clients of proxies from their references."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
        self._lock = threading.Lock()
        #: By their identity. A reference leads over the connection by which it came; one made from its URI does not.
        self._routes: OrderedDict[Identity, Any] = OrderedDict()

    def of(self, kind: ProxyKind, reference: Any) -> Any:
        """The client of a proxy of this kind; None for nil. Raises OwnProxy."""
        is_source_or_sink = kind in (ProxyKind.PUSH_SUPPLIER, ProxyKind.PULL_CONSUMER)
        if is_source_or_sink and reference is not None and self._orb.is_own(reference):
            raise OwnProxy("a proxy of this channel can't be the client of another one: its events would circulate")
        return None if reference is None else self.find(kind.value, self._orb.uri(reference))

    def find(self, kind: str, reference: str) -> Any:
        if kind == ProxyKind.PUSH_SUPPLIER.value:
            takes_batches = _type_id(reference) in (_EVENT_CONSUMER, _IDEMPOTENT_CONSUMER)
            return (RemoteEventConsumer if takes_batches else RemotePushConsumer)(
                self._orb, reference, routes=self._routes
            )
        makers = {
            ProxyKind.PUSH_CONSUMER.value: RemotePushSupplier,
            ProxyKind.PULL_CONSUMER.value: RemotePullSupplier,
            ProxyKind.PULL_SUPPLIER.value: RemotePullConsumer,
        }
        return makers[kind](self._orb, reference)

    def keep(self, reference: Any) -> None:
        """Call this consumer over the connection by which its reference came."""
        identity = identity_of(self._orb.uri(reference))
        with self._lock:
            self._routes[identity] = reference
            self._routes.move_to_end(identity)  # never without it: calls look it up without the lock
            for oldest in list(self._routes)[: max(0, len(self._routes) - MAX_ROUTES)]:
                del self._routes[oldest]

    def event_consumer(self, reference: Any) -> RemoteEventConsumer:
        """A consumer that takes batches."""
        return RemoteEventConsumer(self._orb, self._orb.uri(reference), routes=self._routes)


def _type_id(ior: str) -> str:
    """The repository id in an IOR, read without a call to the object."""
    try:
        return _cdr_string(bytes.fromhex(ior.removeprefix("IOR:")), 4)[0]
    except (ValueError, struct.error):
        return ""


def address_of(ior: str) -> str:
    """HOST:PORT in the first IIOP profile of an IOR; empty if there is none."""
    return identity_of(ior)[0]


def identity_of(ior: str) -> tuple[str, bytes]:
    """HOST:PORT and object key in the first IIOP profile of an IOR; empty if there is none.

    omniORB marks the IORs of objects that are called over their own connections, so the same object has several."""
    try:
        data = bytes.fromhex(ior.removeprefix("IOR:"))
        order = "<" if data[0] else ">"
        _, at = _cdr_string(data, 4)
        at = (at + 3) & ~3
        count, tag, length = struct.unpack_from(f"{order}III", data, at)
        if not count or tag != 0:  # not TAG_INTERNET_IOP
            return "", b""
        profile = data[at + 12 : at + 12 + length]
        order = "<" if profile[0] else ">"
        host, end = _cdr_string(profile, 4)
        at = (end + 1) & ~1
        (port,) = struct.unpack_from(f"{order}H", profile, at)
        at = (at + 5) & ~3
        (length,) = struct.unpack_from(f"{order}I", profile, at)
        key = profile[at + 4 : at + 4 + length]
    except (ValueError, struct.error, IndexError):
        return "", b""
    return f"{host}:{port}", key


def _cdr_string(data: bytes, at: int) -> tuple[str, int]:
    """The string at an offset of a CDR encapsulation, and the offset after it."""
    (length,) = struct.unpack_from(("<" if data[0] else ">") + "I", data, at)
    return data[at + 4 : at + 3 + length].decode(errors="replace"), at + 4 + length
