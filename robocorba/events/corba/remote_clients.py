"""Consumers and suppliers of a channel, called by their object references."""

from __future__ import annotations

import logging
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
from robocorba.orb.ior import parsed
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba

#: Maximum number of consumers that are called over their own connections; a further one replaces the oldest.
MAX_ROUTES = 1000
#: HOST:PORT and object key.
Identity = tuple[str, bytes]

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


class RemoteClient:
    """A client; this class alone calls it only to notify it of its disconnection, by `disconnect_operation`.

    routes: by their identity, references to clients that are called over the connections that they have opened."""

    def __init__(
        self,
        orb: Orb,
        uri: str,
        interface: Any,
        disconnect_operation: str,
        routes: Mapping[Identity, Any] | None = None,
    ) -> None:
        ior = parsed(uri)
        self.reference, self._interface, self._routes, self._route = uri, interface, routes, None
        self.address, self._identity = ior.address, (ior.address, ior.key)
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
            self._set_limit(1.0)
            getattr(self._remote, self._disconnect_operation)()
        except CORBA.Exception as error:
            _log.info("could not notify %s of its disconnection (%s)", self.address, describe(error))


class RemotePushConsumer(RemoteClient):
    """A plain consumer, which takes one `any` a call."""

    takes_batches = False
    is_idempotent = False

    def __init__(
        self,
        orb: Orb,
        uri: str,
        routes: Mapping[Identity, Any] | None = None,
        interface: Any = CosEventComm.PushConsumer,
    ) -> None:
        super().__init__(orb, uri, interface, "disconnect_push_consumer", routes)

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

    def __init__(self, orb: Orb, uri: str, routes: Mapping[Identity, Any]) -> None:
        super().__init__(orb, uri, routes, RoboCorba.EventConsumer)
        self.is_idempotent = parsed(uri).type == RoboCorba.IdempotentEventConsumer._NP_RepositoryId

    def deliver(self, items: Sequence[QueueItem], limit_s: float) -> None:
        self._set_limit(limit_s)
        try:
            if isinstance(items[0], CorrelatedEvents):
                self._remote.pushTogether(items[0].clause_number, events.correlated_events(items[0]))
            else:
                self._remote.pushRuns([events.event_run(batch) for batch in items if isinstance(batch, EventBatch)])
        except CORBA.Exception as error:
            raise delivery_failure(error) from None


class RemotePullSupplier(RemoteClient):
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
        return None if reference is None else self.find(kind, self._orb.uri(reference))

    def find(self, kind: ProxyKind, uri: str) -> Any:
        """The client of a proxy of this kind at an IOR."""
        if kind is ProxyKind.PUSH_SUPPLIER:
            ours = RoboCorba.EventConsumer, RoboCorba.IdempotentEventConsumer
            takes_batches = parsed(uri).type in [interface._NP_RepositoryId for interface in ours]
            return (RemoteEventConsumer if takes_batches else RemotePushConsumer)(self._orb, uri, self._routes)
        if kind is ProxyKind.PULL_CONSUMER:
            return RemotePullSupplier(self._orb, uri)
        if kind is ProxyKind.PUSH_CONSUMER:
            return RemoteClient(self._orb, uri, CosEventComm.PushSupplier, "disconnect_push_supplier")
        return RemoteClient(self._orb, uri, CosEventComm.PullConsumer, "disconnect_pull_consumer")

    def keep(self, reference: Any) -> None:
        """Call this consumer over the connection by which its reference came."""
        ior = parsed(self._orb.uri(reference))
        identity = ior.address, ior.key
        with self._lock:
            self._routes[identity] = reference
            self._routes.move_to_end(identity)  # never without it: calls look it up without the lock
            if len(self._routes) > MAX_ROUTES:
                self._routes.popitem(last=False)

    def event_consumer(self, reference: Any) -> RemoteEventConsumer:
        """A consumer that takes batches."""
        return RemoteEventConsumer(self._orb, self._orb.uri(reference), self._routes)
