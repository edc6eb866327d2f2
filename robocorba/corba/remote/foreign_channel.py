"""Channels of others, called by their references."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Any

import CosEventChannelAdmin
from omniORB import CORBA

from robocorba.corba.calls import describe, limit_calls
from robocorba.corba.conversion import events
from robocorba.corba.conversion.contents import content_of
from robocorba.corba.orb import Orb
from robocorba.corba.remote.event_clients import PushConsumer, failure_of
from robocorba.corba.servants.foreign_consumer import ForeignConsumerServant
from robocorba.errors.events import NotDelivered, Refused
from robocorba.errors.services import NotReachable
from robocorba.events.event import Encoding, Run
from robocorba.events.foreign import Echoes
from robocorba.events.queue import Item

CALL_LIMIT_S = 2.0
CHECK_LIMIT_S = 1.0


class _Proxy(PushConsumer):
    """The proxy of a foreign channel that takes events; what is pushed is expected back."""

    def __init__(self, orb: Orb, uri: str, echoes: Echoes) -> None:
        super().__init__(orb, uri, CosEventChannelAdmin.ProxyPushConsumer)
        self._orb, self._echoes = orb, echoes

    def deliver(self, items: Sequence[Item], limit_s: float) -> None:
        run = items[0]
        assert isinstance(run, Run)
        value = events.any_of(run)
        self._set_limit(limit_s)
        # What is not plain goes as an Event, with origin and number.
        is_plain = run.header.encoding is not Encoding.MSGPACK
        content = content_of(value, self._orb.uri) if is_plain else None
        if is_plain:
            self._echoes.expect(content)
        try:
            self._remote.push(value)
        except CORBA.Exception as wrong:
            failure = failure_of(wrong)
            if is_plain and isinstance(failure, NotDelivered | Refused):
                self._echoes.recognise(content)
            raise failure from None


class ForeignChannel:
    """Both connections with the channel at `uri`. Raises NotReachable."""

    def __init__(self, orb: Orb, uri: str, echoes: Echoes, receive: Callable[[Run, Hashable], None]) -> None:
        self._orb = orb
        # Not a reference that lasts: where the channel remembers an earlier connection, it must find nobody.
        self._servant = ForeignConsumerServant(receive, orb.uri)
        itself = orb.activate(self._servant)
        try:
            channel = self._limited(orb.reference(uri, CosEventChannelAdmin.EventChannel))
            taking = self._limited(self._limited(channel.for_suppliers()).obtain_push_consumer())
            taking.connect_push_supplier(None)
            self._giving = self._limited(self._limited(channel.for_consumers()).obtain_push_supplier())
            self._giving.connect_push_consumer(itself)
        except (CORBA.Exception, NotReachable) as wrong:
            orb.deactivate(self._servant)
            raise NotReachable(str(wrong) if isinstance(wrong, NotReachable) else describe(wrong)) from None
        self.consumer = _Proxy(orb, orb.uri(taking), echoes)
        self._taking = taking

    def is_there(self) -> bool:
        try:
            for proxy in (self._taking, self._giving):
                limit_calls(proxy, CHECK_LIMIT_S)
                if proxy._non_existent():
                    return False
        except CORBA.SystemException:
            return False
        return True

    def leave(self) -> None:
        for disconnect in (self._taking.disconnect_push_consumer, self._giving.disconnect_push_supplier):
            try:
                disconnect()
            except CORBA.Exception:
                continue  # it is gone already
        self._orb.deactivate(self._servant)

    @staticmethod
    def _limited(reference: Any) -> Any:
        limit_calls(reference, CALL_LIMIT_S)
        return reference
