"""The event channel of one sub-network, with a gateway for each of its peers."""

from __future__ import annotations

import contextlib
import functools
import threading
from collections.abc import Sequence
from typing import Any

from robocorba.events.channel import Channel
from robocorba.events.channel_store import ChannelStore, Peer
from robocorba.events.corba.event_channel_servant import (
    CallbackRouteServant,
    ConsumerAdminServant,
    EventChannelServant,
    SupplierAdminServant,
)
from robocorba.events.corba.event_gateway_servant import PeerFeedServant, PeerGatewayServant
from robocorba.events.corba.event_proxy_servants import (
    PullConsumerServant,
    PullSupplierServant,
    PushConsumerServant,
    PushSupplierServant,
)
from robocorba.events.corba.foreign_channel import ForeignChannel
from robocorba.events.corba.remote_clients import RemoteClients
from robocorba.events.corba.remote_gateway import PeerJoiner, forwarding_to
from robocorba.events.event_numbers import life_of
from robocorba.events.federation import Federation, check_name
from robocorba.events.feed import Forward
from robocorba.events.links import Links
from robocorba.events.policies import LinkPolicy, ProxyPolicy
from robocorba.events.proxies import Proxies
from robocorba.events.proxy import Proxy
from robocorba.events.proxy_consumer import ProxyConsumer, ProxyPullConsumer
from robocorba.events.proxy_push_supplier import ProxyPushSupplier
from robocorba.events.proxy_supplier import ProxyPullSupplier
from robocorba.events.queue import QueuePolicy
from robocorba.events.seen_events import SeenEvents
from robocorba.orb.orb import ACCEPT_CALLBACKS, Orb
from robocorba.system import logs
from robocorba.system.names import CHANNELS
from robocorba.system.private_files import claim_state
from robocorba.system.record_file import KEEP_INTERVAL_S
from robocorba.system.repeating import Repeating
from robocorba.system.settings import ChannelSettings


class ChannelServer:
    """A channel and its CORBA objects. Their object keys begin with the name that the channel is bound to and do not
    change, so references to them stay valid after a restart."""

    def __init__(self, name: str, orb: Orb, store: ChannelStore, seen: SeenEvents, policy: ProxyPolicy) -> None:
        self.path = f"{CHANNELS}/{check_name(name)}"
        self._orb, self._store = orb, store
        self._lock = threading.Lock()
        self._active: dict[str, Any] = {}
        self.clients = RemoteClients(orb)
        first_number = store.first_number()
        federation = Federation(name, store.advertisements(), life_of(first_number))
        channel = Channel(federation, seen, first_number)
        self.proxies = Proxies(channel, store, QueuePolicy(), self._send_advertisements, self._deactivate, policy)
        self.links = Links(channel, store, self._join, self._attach, LinkPolicy())
        self.servant = EventChannelServant(channel, self.proxies, self.links, self, self._destroyed)
        reference = orb.activate(self.servant, self.path)
        self.consumer_admin = self._activate(ConsumerAdminServant(self.proxies, self.of), "consumers")
        self.supplier_admin = self._activate(SupplierAdminServant(self.proxies, self.of), "suppliers")
        self.feed = self._activate(PeerFeedServant(self.links), "feed")
        gateway = self._activate(PeerGatewayServant(self.links), "gateway")
        self.callback_route: Any = None
        self._joiner = PeerJoiner(orb, name, reference, gateway)

    def start(self, peers: Sequence[Peer]) -> None:
        """Restore proxies and links from the store, link with `peers`, and accept calls."""
        for proxy in self.proxies.restore(self.clients.find):
            self.of(proxy)
        self.links.restore()
        for peer in peers:
            self.links.add(peer)
        self._orb.serve({self.path: self.servant})

    def accept_callbacks(self) -> None:
        """Call consumers that want it over their own connections; the ORB needs ACCEPT_CALLBACKS."""
        self.callback_route = self._orb.activate(CallbackRouteServant(self.clients.keep))

    # ---- for the servants ----

    def of(self, proxy: Proxy) -> Any:
        """The reference of a proxy's object, which is activated on the first call."""
        with self._lock:
            if proxy.id not in self._active:
                self._active[proxy.id] = self._activate(self._servant(proxy), f"proxies/{proxy.id}")
            return self._active[proxy.id]

    def event_consumer(self, reference: Any) -> Any:
        return self.clients.event_consumer(reference)

    def gateway(self, reference: Any) -> Forward:
        return forwarding_to(self._orb, reference)

    def uri(self, reference: Any) -> str:
        return self._orb.uri(reference)

    # ---- inside ----

    def _servant(self, proxy: Proxy) -> Any:
        if isinstance(proxy, ProxyPushSupplier):
            return PushSupplierServant(proxy, self.proxies, self.clients.of, self.links.is_in_force)
        if isinstance(proxy, ProxyPullSupplier):
            return PullSupplierServant(proxy, self.proxies, self.clients.of)
        assert isinstance(proxy, ProxyConsumer)
        servant = PullConsumerServant if isinstance(proxy, ProxyPullConsumer) else PushConsumerServant
        return servant(proxy, self.proxies, self.clients.of)

    def _activate(self, servant: Any, key: str) -> Any:
        return self._orb.activate(servant, f"{self.path}/{key}")

    def _deactivate(self, id: str) -> None:
        with self._lock:
            self._active.pop(id, None)
        self._orb.deactivate_key(f"{self.path}/proxies/{id}")

    def _join(self, record: Peer) -> Any:
        return self._joiner.join(record)

    def _attach(self, record: Peer) -> Any:
        return functools.partial(ForeignChannel, self._orb, record.address)

    def _send_advertisements(self) -> None:
        self.links.send_advertisements()

    def _destroyed(self) -> None:
        """Peers keep their links, and find an empty channel when this process is started again."""
        self.links.close()
        self._store.clear()
        for key in ("consumers", "suppliers", "feed", "gateway"):
            self._orb.deactivate_key(f"{self.path}/{key}")
        self._orb.withdraw(self.path)


def main(arguments: Sequence[str] | None = None, policy: ProxyPolicy | None = None) -> None:
    settings = ChannelSettings.read(arguments, __doc__ or "")
    process, folder = f"events_{check_name(settings.name)}", settings.server.state / "channels"
    claim_state(settings.server.state)
    logs.setup(process, settings.server.state / "logs")
    peers = [Peer(name, address) for name, address in settings.peers]
    peers += [Peer(name, uri, foreign=True) for name, uri in settings.foreign]
    with (
        ChannelStore(folder / f"{settings.name}.sqlite") as store,
        SeenEvents(folder / f"{settings.name}.seen") as seen,
        Orb(
            *(settings.server.naming, settings.server.endpoint),
            options=ACCEPT_CALLBACKS if settings.accepts_callbacks else None,
        ) as orb,
    ):
        server = ChannelServer(settings.name, orb, store, seen, policy or ProxyPolicy())
        if settings.accepts_callbacks:
            server.accept_callbacks()
        keeping = Repeating("keep", store.keep, KEEP_INTERVAL_S).start()
        with contextlib.closing(server.links), contextlib.closing(server.proxies), contextlib.closing(keeping):
            server.start(peers)
            orb.run()


if __name__ == "__main__":
    main()
