"""Servants of the four kinds of proxy, each named after the OMG interface that its client calls."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import CosEventChannelAdmin__POA
from omniORB import CORBA

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.events import EventTooLarge, InvalidEvent
from robocorba.events.corba import events
from robocorba.events.proxies import Proxies
from robocorba.events.proxy import ProxyKind
from robocorba.events.proxy_consumer import ProxyConsumer
from robocorba.events.proxy_push_supplier import ProxyPushSupplier
from robocorba.events.proxy_supplier import ProxyPullSupplier
from robocorba.orb.callers import present_caller
from robocorba.orb.exceptions import raise_idl, translating
from robocorba.stubs import RoboCorba__POA

#: Maximum duration of a pull [s]; then it raises TRANSIENT, because not every client that has gone is noticed.
PULL_TIMEOUT_S = 300.0


class ClientFactory(Protocol):
    """Makes the ports of clients from their references."""

    def of(self, kind: ProxyKind, reference: Any) -> Any:
        """The port of the client of a proxy of this kind; None for nil."""


def _refuse_nil(reference: Any) -> None:
    if reference is None:
        raise CORBA.BAD_PARAM(0, CORBA.COMPLETED_NO)


class PushConsumerServant(RoboCorba__POA.EventProxyPushConsumer):
    """RoboCorba::EventProxyPushConsumer: a supplier pushes to it."""

    #: Headers are checked once for many events.
    checks_texts_itself = frozenset({"pushEvent", "pushRuns"})

    def __init__(self, proxy: ProxyConsumer, proxies: Proxies, clients: ClientFactory) -> None:
        self._proxy, self._proxies, self._clients = proxy, proxies, clients

    @translating
    def connect_push_supplier(self, supplier: Any) -> None:
        self._proxies.connect(self._proxy, self._clients.of(ProxyKind.PUSH_CONSUMER, supplier))

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

    @translating
    def disconnect_push_consumer(self) -> None:
        self._proxies.disconnect(self._proxy)

    @translating
    def state(self) -> Any:
        return events.proxy_state(self._proxies.snapshot(self._proxy))


class PullConsumerServant(CosEventChannelAdmin__POA.ProxyPullConsumer):
    """CosEventChannelAdmin::ProxyPullConsumer: polls a supplier for events."""

    def __init__(self, proxy: ProxyConsumer, proxies: Proxies, clients: ClientFactory) -> None:
        self._proxy, self._proxies, self._clients = proxy, proxies, clients

    @translating
    def connect_pull_supplier(self, supplier: Any) -> None:
        _refuse_nil(supplier)
        self._proxies.connect(self._proxy, self._clients.of(ProxyKind.PULL_CONSUMER, supplier))

    @translating
    def disconnect_pull_consumer(self) -> None:
        self._proxies.disconnect(self._proxy)


class PushSupplierServant(RoboCorba__POA.EventProxyPushSupplier):
    """RoboCorba::EventProxyPushSupplier: calls a consumer."""

    def __init__(
        self,
        proxy: ProxyPushSupplier,
        proxies: Proxies,
        clients: ClientFactory,
        is_in_force: Callable[[ProxyPushSupplier, str], bool],
    ) -> None:
        self._proxy, self._proxies, self._clients, self._is_in_force = proxy, proxies, clients, is_in_force

    @translating
    def connect_push_consumer(self, consumer: Any) -> None:
        _refuse_nil(consumer)
        self._proxies.connect(self._proxy, self._clients.of(ProxyKind.PUSH_SUPPLIER, consumer))

    @translating
    def changeSubscription(self, wanted: Any) -> None:
        self._proxies.change(self._proxy, events.subscription_of(wanted))

    @translating
    def suspend(self) -> None:
        self._proxies.suspend(self._proxy, True)

    @translating
    def resume(self) -> None:
        self._proxies.suspend(self._proxy, False)

    @translating
    def isInForceAt(self, peer: str) -> bool:
        return self._is_in_force(self._proxy, peer)

    @translating
    def disconnect_push_supplier(self) -> None:
        self._proxies.disconnect(self._proxy)

    @translating
    def state(self) -> Any:
        return events.proxy_state(self._proxies.snapshot(self._proxy))


class PullSupplierServant(RoboCorba__POA.EventProxyPullSupplier):
    """RoboCorba::EventProxyPullSupplier: queues events for a consumer that pulls them."""

    def __init__(self, proxy: ProxyPullSupplier, proxies: Proxies, clients: ClientFactory) -> None:
        self._proxy, self._proxies, self._clients = proxy, proxies, clients

    @translating
    def connect_pull_consumer(self, consumer: Any) -> None:
        self._proxies.connect(self._proxy, self._clients.of(ProxyKind.PULL_SUPPLIER, consumer))

    @translating
    def changeSubscription(self, wanted: Any) -> None:
        self._proxies.change(self._proxy, events.subscription_of(wanted))

    @translating
    def pull(self) -> Any:
        batch = self._proxy.pull(0.0) or self._proxy.pull(PULL_TIMEOUT_S, present_caller())
        if batch is None:
            raise CORBA.TRANSIENT(0, CORBA.COMPLETED_NO)
        return events.plain_event(batch)

    @translating
    def try_pull(self) -> tuple[Any, bool]:
        batch = self._proxy.pull(0.0)
        return (CORBA.Any(CORBA.TC_null, None), False) if batch is None else (events.plain_event(batch), True)

    @translating
    def disconnect_pull_supplier(self) -> None:
        self._proxies.disconnect(self._proxy)

    @translating
    def state(self) -> Any:
        return events.proxy_state(self._proxies.snapshot(self._proxy))
