"""Servants of the four kinds of proxy, each named after the OMG interface that its client calls."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import CosEventChannelAdmin__POA
from omniORB import CORBA

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.events import EventTooLarge, InvalidEvent
from robocorba.events.corba import events
from robocorba.events.proxies import Proxies
from robocorba.events.proxy import ProxyKind
from robocorba.events.proxy_push_supplier import ProxyPushSupplier
from robocorba.orb.callers import present_caller
from robocorba.orb.exceptions import raise_idl, translating
from robocorba.stubs import RoboCorba__POA

#: Makes the port of the client of a kind of proxy from its reference; None for nil.
ClientOf = Callable[[ProxyKind, Any], Any]


class _ProxyServant:
    """What all of them do."""

    def __init__(self, proxy: Any, proxies: Proxies, client_of: ClientOf) -> None:
        self._proxy, self._proxies, self._client_of = proxy, proxies, client_of

    @translating
    def _connect(self, client: Any) -> None:
        kind = self._proxy.kind
        if client is None and kind in (ProxyKind.PULL_CONSUMER, ProxyKind.PUSH_SUPPLIER):  # which are called
            raise CORBA.BAD_PARAM(0, CORBA.COMPLETED_NO)
        self._proxies.connect(self._proxy, self._client_of(kind, client))

    @translating
    def _disconnect(self) -> None:
        self._proxies.disconnect(self._proxy)

    @translating
    def state(self) -> Any:
        return events.proxy_state(self._proxies.snapshot(self._proxy))

    @translating
    def changeSubscription(self, wanted: Any) -> None:
        self._proxies.change(self._proxy, events.subscription_of(wanted))


class PushConsumerServant(_ProxyServant, RoboCorba__POA.EventProxyPushConsumer):
    """RoboCorba::EventProxyPushConsumer: a supplier pushes to it."""

    #: Headers are checked once for many events.
    checks_texts_itself = frozenset({"pushEvent", "pushRuns"})
    connect_push_supplier, disconnect_push_consumer = _ProxyServant._connect, _ProxyServant._disconnect

    # Without decorator, because these two methods run for every event.

    def push(self, value: Any) -> None:
        try:
            self._proxy.push(events.batch_of_any(value))
        except InvalidEvent as error:  # the OMG interface has no exception for this
            reason = CORBA.IMP_LIMIT if isinstance(error, EventTooLarge) else CORBA.BAD_PARAM
            raise reason(0, CORBA.COMPLETED_NO) from None
        except RoboCorbaError as error:
            raise_idl(error)

    def pushEvent(self, one: Any) -> None:
        try:
            self._proxy.push(events.batch_of_event(one))
        except RoboCorbaError as error:
            raise_idl(error)

    @translating
    def pushRuns(self, runs: Any) -> None:
        for batch in [events.batch_of(struct) for struct in runs]:  # check all before publishing any
            if batch.payloads:
                self._proxy.push(batch)


class PullConsumerServant(_ProxyServant, CosEventChannelAdmin__POA.ProxyPullConsumer):
    """CosEventChannelAdmin::ProxyPullConsumer: polls a supplier for events."""

    connect_pull_supplier, disconnect_pull_consumer = _ProxyServant._connect, _ProxyServant._disconnect


class PushSupplierServant(_ProxyServant, RoboCorba__POA.EventProxyPushSupplier):
    """RoboCorba::EventProxyPushSupplier: calls a consumer."""

    connect_push_consumer, disconnect_push_supplier = _ProxyServant._connect, _ProxyServant._disconnect

    def __init__(
        self,
        proxy: ProxyPushSupplier,
        proxies: Proxies,
        client_of: ClientOf,
        is_in_force: Callable[[ProxyPushSupplier, str], bool],
    ) -> None:
        super().__init__(proxy, proxies, client_of)
        self._is_in_force = is_in_force

    @translating
    def suspend(self) -> None:
        self._proxies.suspend(self._proxy, True)

    @translating
    def resume(self) -> None:
        self._proxies.suspend(self._proxy, False)

    @translating
    def isInForceAt(self, peer: str) -> bool:
        return self._is_in_force(self._proxy, peer)


class PullSupplierServant(_ProxyServant, RoboCorba__POA.EventProxyPullSupplier):
    """RoboCorba::EventProxyPullSupplier: queues events for a consumer that pulls them."""

    connect_pull_consumer, disconnect_pull_supplier = _ProxyServant._connect, _ProxyServant._disconnect

    @translating
    def pull(self) -> Any:
        # Not without end: not every client that has gone is noticed.
        batch = self._proxy.pull(0.0) or self._proxy.pull(300.0, present_caller())
        if batch is None:
            raise CORBA.TRANSIENT(0, CORBA.COMPLETED_NO)
        return events.plain_event(batch)

    @translating
    def try_pull(self) -> tuple[Any, bool]:
        batch = self._proxy.pull(0.0)
        return (CORBA.Any(CORBA.TC_null, None), False) if batch is None else (events.plain_event(batch), True)
