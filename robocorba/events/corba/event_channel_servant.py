"""Servants of an event channel, its ConsumerAdmin and its SupplierAdmin."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

import CosEventChannelAdmin__POA
from omniORB import CORBA

from robocorba.errors.events import TooManyProxies
from robocorba.events.channel import Channel
from robocorba.events.corba import events
from robocorba.events.links import Links
from robocorba.events.proxies import Proxies
from robocorba.events.proxy import Proxy, ProxyKind
from robocorba.events.proxy_consumer import own_supplier
from robocorba.orb.exceptions import translating
from robocorba.orb.server_release import ServerServant
from robocorba.stubs import RoboCorba, RoboCorba__POA


class ChannelObjects(Protocol):
    """Gives access to the CORBA objects of a channel."""

    #: The admins, the feed that gateways join, and the gateway that feeds supply.
    consumer_admin: Any
    supplier_admin: Any
    feed: Any
    #: The route by which consumers behind NAT are called, None if there is none.
    callback_route: Any

    def of(self, proxy: Proxy) -> Any:
        """The reference of a proxy's object, which is activated on the first call."""

    def event_consumer(self, reference: Any) -> Any:
        """The port of the consumer with this reference."""

    def gateway(self, reference: Any) -> Any:
        """The port of a peer's gateway."""

    def uri(self, reference: Any) -> str:
        """The stringified reference."""


class EventChannelServant(ServerServant, RoboCorba__POA.EventChannel):
    """RoboCorba::EventChannel. on_destroyed: called when the channel was destroyed and all clients are disconnected."""

    def __init__(
        self,
        channel: Channel,
        proxies: Proxies,
        links: Links,
        objects: ChannelObjects,
        on_destroyed: Callable[[], None],
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

    @translating
    def unsubscribe(self, subscriptionName: str) -> None:
        self._proxies.unsubscribe(subscriptionName)

    @translating
    def state(self) -> Any:
        return events.channel_state(self._channel, self._proxies, self._links)

    # ---- peers ----

    @translating
    def addPeer(self, peer: Any) -> None:
        self._links.add(events.peer_of(peer))

    @translating
    def removePeer(self, peer: str) -> None:
        self._links.remove(peer)

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


class _Admin:
    """Base of ConsumerAdmin and SupplierAdmin, which hand out proxies to clients."""

    def __init__(self, proxies: Proxies, objects: ChannelObjects) -> None:
        self._proxies, self._objects = proxies, objects

    @translating
    def _obtain(self, kind: ProxyKind) -> Any:
        try:
            return self._objects.of(self._proxies.obtain(kind))
        except TooManyProxies:  # the OMG interface has no exception for this
            raise CORBA.IMP_LIMIT(0, CORBA.COMPLETED_NO) from None


class SupplierAdminServant(_Admin, CosEventChannelAdmin__POA.SupplierAdmin):
    """Hands out proxies to suppliers."""

    def obtain_push_consumer(self) -> Any:
        return self._obtain(ProxyKind.PUSH_CONSUMER)

    def obtain_pull_consumer(self) -> Any:
        return self._obtain(ProxyKind.PULL_CONSUMER)


class ConsumerAdminServant(_Admin, CosEventChannelAdmin__POA.ConsumerAdmin):
    """Hands out proxies to consumers."""

    def obtain_push_supplier(self) -> Any:
        return self._obtain(ProxyKind.PUSH_SUPPLIER)

    def obtain_pull_supplier(self) -> Any:
        return self._obtain(ProxyKind.PULL_SUPPLIER)
