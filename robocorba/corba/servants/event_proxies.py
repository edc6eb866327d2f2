"""Servants of the four kinds of proxy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import CosEventChannelAdmin__POA
from omniORB import CORBA

from robocorba.corba.conversion import events
from robocorba.corba.conversion.errors import raise_idl, translating
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.events import Disconnected, InvalidEvent, ProxyGone
from robocorba.events.inlet import Inlet
from robocorba.events.outlet import PullOutlet
from robocorba.events.proxies import Kind, Proxies
from robocorba.events.push_outlet import PushOutlet
from robocorba.stubs import RoboCorba__POA

#: A pull that found nothing for so long ends with TRANSIENT: perhaps nobody waits for the answer any more.
PULL_LIMIT_S = 300.0


class Clients(Protocol):
    """Makes the clients of proxies of references."""

    def of(self, kind: Kind, reference: Any) -> Any:
        """None for nil."""


def _refuse_nil(reference: Any) -> None:
    if reference is None:
        raise CORBA.BAD_PARAM(0, CORBA.COMPLETED_NO)


class PushConsumerServant(RoboCorba__POA.EventProxyPushConsumer):
    """RoboCorba::EventProxyPushConsumer: where a supplier pushes."""

    def __init__(self, inlet: Inlet, proxies: Proxies, clients: Clients) -> None:
        self._inlet, self._proxies, self._clients = inlet, proxies, clients

    @translating
    def connect_push_supplier(self, supplier: Any) -> None:
        self._proxies.connect(self._inlet, self._clients.of(Kind.PUSH_CONSUMER, supplier))

    # These two run for every event: without a wrapper around them.

    def push(self, value: Any) -> None:
        try:
            self._inlet.push(events.run_of_any(value))
        except InvalidEvent:  # the standard has no exception for it
            raise CORBA.BAD_PARAM(0, CORBA.COMPLETED_NO) from None
        except RoboCorbaError as error:
            raise_idl(error)

    def pushEvent(self, one: Any) -> None:
        try:
            self._inlet.push(events.run_of_event(one))
        except RoboCorbaError as error:
            raise_idl(error)

    @translating
    def pushRuns(self, runs: Any) -> None:
        for run in [events.run_of(struct) for struct in runs]:  # all are checked before any goes in
            if run.payloads:
                self._inlet.push(run)

    @translating
    def disconnect_push_consumer(self) -> None:
        self._proxies.disconnect(self._inlet)

    def state(self) -> Any:
        return events.proxy_state(self._proxies.state(self._inlet))


class PullConsumerServant(CosEventChannelAdmin__POA.ProxyPullConsumer):
    """CosEventChannelAdmin::ProxyPullConsumer: asks a supplier for events."""

    def __init__(self, inlet: Inlet, proxies: Proxies, clients: Clients) -> None:
        self._inlet, self._proxies, self._clients = inlet, proxies, clients

    @translating
    def connect_pull_supplier(self, supplier: Any) -> None:
        _refuse_nil(supplier)
        self._proxies.connect(self._inlet, self._clients.of(Kind.PULL_CONSUMER, supplier))

    @translating
    def disconnect_pull_consumer(self) -> None:
        self._proxies.disconnect(self._inlet)


class PushSupplierServant(RoboCorba__POA.EventProxyPushSupplier):
    """RoboCorba::EventProxyPushSupplier: calls a consumer."""

    def __init__(
        self, outlet: PushOutlet, proxies: Proxies, clients: Clients, is_in_force: Callable[[PushOutlet, str], bool]
    ) -> None:
        self._outlet, self._proxies, self._clients, self._is_in_force = outlet, proxies, clients, is_in_force

    @translating
    def connect_push_consumer(self, consumer: Any) -> None:
        _refuse_nil(consumer)
        self._proxies.connect(self._outlet, self._clients.of(Kind.PUSH_SUPPLIER, consumer))

    @translating
    def changeSubscription(self, wanted: Any) -> None:
        self._proxies.change(self._outlet, events.subscription_of(wanted))

    @translating
    def suspend(self) -> None:
        self._proxies.suspend(self._outlet, True)

    @translating
    def resume(self) -> None:
        self._proxies.suspend(self._outlet, False)

    @translating
    def isInForceAt(self, peer: str) -> bool:
        return self._is_in_force(self._outlet, peer)

    @translating
    def disconnect_push_supplier(self) -> None:
        self._proxies.disconnect(self._outlet)

    def state(self) -> Any:
        return events.proxy_state(self._proxies.state(self._outlet))


class PullSupplierServant(RoboCorba__POA.EventProxyPullSupplier):
    """RoboCorba::EventProxyPullSupplier: keeps events for a consumer that fetches them."""

    def __init__(self, outlet: PullOutlet, proxies: Proxies, clients: Clients) -> None:
        self._outlet, self._proxies, self._clients = outlet, proxies, clients

    @translating
    def connect_pull_consumer(self, consumer: Any) -> None:
        self._proxies.connect(self._outlet, self._clients.of(Kind.PULL_SUPPLIER, consumer))

    @translating
    def changeSubscription(self, wanted: Any) -> None:
        self._proxies.change(self._outlet, events.subscription_of(wanted))

    @translating
    def pull(self) -> Any:
        run = self._pulled(PULL_LIMIT_S)
        if run is None:
            raise CORBA.TRANSIENT(0, CORBA.COMPLETED_NO)
        return events.any_of(run)

    @translating
    def try_pull(self) -> tuple[Any, bool]:
        run = self._pulled(0.0)
        return (CORBA.Any(CORBA.TC_null, None), False) if run is None else (events.any_of(run), True)

    def _pulled(self, limit_s: float) -> Any:
        try:
            return self._outlet.pull(limit_s)
        except ProxyGone:  # to one who waited, or came at the same moment, the standard says it in its own words
            raise Disconnected("the proxy was disconnected") from None

    @translating
    def disconnect_pull_supplier(self) -> None:
        self._proxies.disconnect(self._outlet)

    def state(self) -> Any:
        return events.proxy_state(self._proxies.state(self._outlet))
