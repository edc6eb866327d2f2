"""Connection with a foreign channel: an event channel of another implementation, which supports CosEventChannelAdmin
only."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import CosEventChannelAdmin
import CosEventComm__POA
from omniORB import CORBA

from robocorba.errors.events import InvalidEvent, NotDelivered, Refused
from robocorba.errors.services import NotReachable
from robocorba.events.corba import events
from robocorba.events.corba.remote_clients import RemotePushConsumer, delivery_failure
from robocorba.events.event import Encoding, EventBatch
from robocorba.events.foreign import Echoes
from robocorba.events.queue import QueueItem
from robocorba.orb.calls import describe, set_call_timeout
from robocorba.orb.contents import content_of
from robocorba.orb.ior import address_of
from robocorba.orb.orb import Orb

_log = logging.getLogger(__name__)


class _ConsumerServant(CosEventComm__POA.PushConsumer):
    """The consumer that the foreign channel pushes to.

    receive: called with each event and the key that identifies its echo, None for an event with an origin, which is
    recognised by origin and number. on_disconnected: called when the foreign channel pushes no more, as omniEvents does
    after an event that was refused. uri: stringifies object references."""

    def __init__(
        self,
        receive: Callable[[EventBatch, Hashable], None],
        on_disconnected: Callable[[], None],
        uri: Callable[[Any], str],
    ) -> None:
        self._receive, self._on_disconnected, self._uri = receive, on_disconnected, uri

    def push(self, value: Any) -> None:
        try:
            batch = events.batch_of_foreign_any(value)
        except InvalidEvent as error:
            _log.warning("a foreign channel pushed an invalid event (%s)", error)
            return
        self._receive(batch, None if batch.header.origin else content_of(value, self._uri))

    def disconnect_push_consumer(self) -> None:
        self._on_disconnected()


class _ForeignProxyConsumer(RemotePushConsumer):
    """The proxy of a foreign channel to push to; the echo of each plain event is expected."""

    def __init__(self, orb: Orb, uri: str, echoes: Echoes) -> None:
        super().__init__(orb, uri, interface=CosEventChannelAdmin.ProxyPushConsumer)
        self._orb, self._echoes = orb, echoes

    def deliver(self, items: Sequence[QueueItem], limit_s: float) -> None:
        batch = items[0]
        assert isinstance(batch, EventBatch)
        value = events.plain_event(batch)
        self._set_limit(limit_s)
        # An event with a header is pushed as an Event, and recognised by its origin and number.
        is_plain = batch.header.encoding is not Encoding.MSGPACK
        content = content_of(value, self._orb.uri) if is_plain else None
        if is_plain:
            self._echoes.expect(content)
        began = time.monotonic()
        try:
            self._remote.push(value)
            self._echoes.note_push(began)
        except CORBA.Exception as error:
            failure = delivery_failure(error)
            if is_plain and isinstance(failure, NotDelivered | Refused):
                self._echoes.recognise(content)
            raise failure from None


class ForeignChannel:
    """Both connections with the channel at `uri`. receive, on_disconnected: as of _ConsumerServant.

    Raises NotReachable."""

    def __init__(
        self,
        orb: Orb,
        uri: str,
        echoes: Echoes,
        receive: Callable[[EventBatch, Hashable], None],
        on_disconnected: Callable[[], None],
    ) -> None:
        self._orb = orb
        # A transient reference: a channel that remembers an earlier connection must not find a consumer there.
        self._servant = _ConsumerServant(receive, on_disconnected, orb.uri)
        reference = orb.activate(self._servant)
        self.address = address_of(orb.uri(reference))
        try:
            channel = self._limited(orb.reference(uri, CosEventChannelAdmin.EventChannel))
            proxy_consumer = self._limited(self._limited(channel.for_suppliers()).obtain_push_consumer())
            proxy_consumer.connect_push_supplier(None)
            self._proxy_supplier = self._limited(self._limited(channel.for_consumers()).obtain_push_supplier())
            self._proxy_supplier.connect_push_consumer(reference)
        except (CORBA.Exception, NotReachable) as error:
            orb.deactivate(self._servant)
            raise NotReachable(str(error) if isinstance(error, NotReachable) else describe(error)) from None
        self.consumer = _ForeignProxyConsumer(orb, orb.uri(proxy_consumer), echoes)
        self._proxy_consumer = proxy_consumer
        #: Taken by the first call of `disconnect`: the thread of the link and whoever removes it both make one.
        self._ending = threading.Lock()

    def is_alive(self) -> bool:
        try:
            for proxy in (self._proxy_consumer, self._proxy_supplier):
                set_call_timeout(proxy, 1.0)
                if proxy._non_existent():
                    return False
        except CORBA.SystemException:
            return False
        return True

    def disconnect(self) -> None:
        if not self._ending.acquire(blocking=False):
            return
        for disconnect_proxy in (
            self._proxy_consumer.disconnect_push_consumer,
            self._proxy_supplier.disconnect_push_supplier,
        ):
            try:
                disconnect_proxy()
            except CORBA.Exception:
                continue  # the proxy is gone already
        self._orb.deactivate(self._servant)

    @staticmethod
    def _limited(reference: Any) -> Any:
        set_call_timeout(reference, 2.0)
        return reference
