"""Servants of an event channel, its ConsumerAdmin and its SupplierAdmin."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import CosEventChannelAdmin__POA
from omniORB import CORBA

from robocorba.errors.events import TooManyProxies
from robocorba.events.channel import Channel
from robocorba.events.corba import events
from robocorba.events.links import Links
from robocorba.events.proxies import Proxies
from robocorba.events.proxy import Proxy, ProxyKind
from robocorba.events.proxy_consumer import own_supplier
from robocorba.orb.exceptions import forwarded, translating
from robocorba.orb.server_release import ServerServant
from robocorba.stubs import RoboCorba, RoboCorba__POA


class EventChannelServant(ServerServant, RoboCorba__POA.EventChannel):
    """RoboCorba::EventChannel. on_destroyed: called when the channel was destroyed and all clients are disconnected.

    objects: what the server's process has. References: `consumer_admin`, `supplier_admin`, `feed` (that gateways join),
    `callback_route` (by which consumers behind NAT are called, None if there is none). Functions: `of` (the reference
    of a proxy), `event_consumer` and `gateway` (the port for the reference of a consumer or of a peer's gateway), `uri`
    (of a reference)."""

    def __init__(
        self, channel: Channel, proxies: Proxies, links: Links, objects: Any, on_destroyed: Callable[[], None]
    ) -> None:
        self._channel, self._proxies, self._links, self._objects = channel, proxies, links, objects
        self._on_destroyed = on_destroyed

    # ---- CosEventChannelAdmin::EventChannel ----

    @translating
    def for_consumers(self) -> Any:
        self._proxies.check_not_destroyed()
        return self._objects.consumer_admin

    @translating
    def for_suppliers(self) -> Any:
        self._proxies.check_not_destroyed()
        return self._objects.supplier_admin

    @translating
    def destroy(self) -> None:
        self._proxies.destroy()
        self._on_destroyed()

    # ---- events with a header ----

    def _get_name(self) -> str:
        return self._channel.name

    @translating
    def supply(self, supplierName: str) -> Any:
        return self._objects.of(self._proxies.supply(supplierName))

    def bound_to(self, robot: str) -> dict[str, Callable[..., Any]]:
        """What a robot with a file of its own calls instead: it publishes in its own name only."""

        def supply(name: str) -> Any:
            if name != robot:
                raise CORBA.NO_PERMISSION(0, CORBA.COMPLETED_NO)
            return self.supply(own_supplier(robot))

        def for_suppliers() -> Any:
            raise CORBA.NO_PERMISSION(0, CORBA.COMPLETED_NO)

        return {"supply": supply, "for_suppliers": for_suppliers}

    @translating
    def subscribe(self, subscriptionName: str, consumer: Any, wanted: Any, queue: Any) -> Any:
        if consumer is None:
            raise CORBA.BAD_PARAM(0, CORBA.COMPLETED_NO)
        subscription, policy = events.subscription_of(wanted), events.policy_of(queue)
        client = self._objects.event_consumer(consumer)
        return self._objects.of(self._proxies.subscribe(subscriptionName, client, subscription, policy))

    unsubscribe = forwarded("_proxies", Proxies.unsubscribe)

    @translating
    def state(self) -> Any:
        return events.channel_state(self._channel, self._proxies, self._links)

    @translating
    def traffic(self) -> Any:
        return events.channel_traffic(self._links.traffic())

    # ---- peers ----

    @translating
    def addPeer(self, peer: Any) -> None:
        self._links.add(events.peer_of(peer))

    removePeer = forwarded("_links", Links.remove)

    def peers(self) -> list[Any]:
        return [events.peer(record) for record in self._links.peers]

    def joinGateway(self, consuming: str, itself: Any, gateway: Any) -> Any:
        reason = f"{consuming} runs release 0.1.0, which takes event numbers for times; it needs a later one"
        raise RoboCorba.InvalidPeer("consuming", reason)

    @translating
    def joinPeer(self, consuming: str, itself: Any, gateway: Any) -> tuple[Any, float]:
        if itself is None or gateway is None:
            raise CORBA.BAD_PARAM(0, CORBA.COMPLETED_NO)
        session, position = self._links.join(consuming, self._objects.uri(itself), self._objects.gateway(gateway))
        return events.feed_terms(self._objects.feed, session, position), time.monotonic()

    def routeBack(self) -> Any:
        return self._objects.callback_route


class CallbackRouteServant(RoboCorba__POA.CallbackRoute):
    """RoboCorba::CallbackRoute. keep: called with each consumer."""

    takes_connections = ("keep",)

    def __init__(self, keep: Callable[[Any], None]) -> None:
        self._keep = keep

    def keep(self, consumer: Any) -> None:
        if consumer is None:
            raise CORBA.BAD_PARAM(0, CORBA.COMPLETED_NO)
        self._keep(consumer)


@translating
def _obtained(proxies: Proxies, of: Callable[[Proxy], Any], kind: ProxyKind) -> Any:
    try:
        return of(proxies.obtain(kind))
    except TooManyProxies:  # the OMG interface has no exception for this
        raise CORBA.IMP_LIMIT(0, CORBA.COMPLETED_NO) from None


class SupplierAdminServant(CosEventChannelAdmin__POA.SupplierAdmin):
    """Hands out proxies to suppliers. of: the reference of a proxy."""

    def __init__(self, proxies: Proxies, of: Callable[[Proxy], Any]) -> None:
        self._proxies, self._of = proxies, of

    def obtain_push_consumer(self) -> Any:
        return _obtained(self._proxies, self._of, ProxyKind.PUSH_CONSUMER)

    def obtain_pull_consumer(self) -> Any:
        return _obtained(self._proxies, self._of, ProxyKind.PULL_CONSUMER)


class ConsumerAdminServant(CosEventChannelAdmin__POA.ConsumerAdmin):
    """Hands out proxies to consumers. of: the reference of a proxy."""

    def __init__(self, proxies: Proxies, of: Callable[[Proxy], Any]) -> None:
        self._proxies, self._of = proxies, of

    def obtain_push_supplier(self) -> Any:
        return _obtained(self._proxies, self._of, ProxyKind.PUSH_SUPPLIER)

    def obtain_pull_supplier(self) -> Any:
        return _obtained(self._proxies, self._of, ProxyKind.PULL_SUPPLIER)
