"""The proxies of a channel: obtained, connected, restored after a restart, disconnected."""

from __future__ import annotations

import contextlib
import logging
import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.events import AlreadyConnected, ProxyGone, TooManyProxies, UnknownSubscription
from robocorba.errors.services import ServiceError
from robocorba.events.account import Account
from robocorba.events.channel import Channel
from robocorba.events.channel_store import ChannelStore, StoredProxy
from robocorba.events.clients import ClientPort, ConsumerPort
from robocorba.events.policies import ProxyPolicy
from robocorba.events.proxy import Proxy, ProxyCondition, ProxyKind
from robocorba.events.proxy_consumer import ProxyConsumer, ProxyPullConsumer
from robocorba.events.proxy_push_supplier import ProxyPushSupplier
from robocorba.events.proxy_supplier import ProxyPullSupplier, ProxySupplier
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import ALL, Subscription

_log = logging.getLogger(__name__)


class ProxySnapshot(NamedTuple):
    """A proxy at one moment. policy: of its queue."""

    id: str
    kind: ProxyKind
    condition: ProxyCondition
    name: str
    client: str
    subscription: Subscription
    policy: QueuePolicy
    failures: int
    totals: Account


class Proxies:
    """All proxies of `channel`, kept in `store`.

    queue: queue policy of proxies that are obtained through OMG's ConsumerAdmin and SupplierAdmin.
    on_advertisement_changed: called when this channel's own advertisement (its peers and subscriptions) has changed.
    on_removed: called with the id of a proxy that has ended, before its client is notified. Both are called without
    the channel's lock."""

    def __init__(
        self,
        channel: Channel,
        store: ChannelStore,
        queue: QueuePolicy,
        on_advertisement_changed: Callable[[], None],
        on_removed: Callable[[str], None],
        policy: ProxyPolicy,
    ) -> None:
        #: Number of clients that were disconnected after failed calls.
        self.lost_clients = 0
        self._channel, self._store, self._queue, self._policy = channel, store, queue, policy
        self._on_advertisement_changed, self._on_removed = on_advertisement_changed, on_removed
        self._all: dict[str, Proxy] = {}
        self._lock = threading.RLock()  # guards the set of proxies; never held while clients are called
        self._is_destroyed = False

    # ---- called for clients ----

    def obtain(self, kind: ProxyKind) -> Proxy:
        """Create a proxy without a client. Raises TooManyProxies, ProxyGone."""
        with self._lock:
            proxy = self._make(kind, self._new_id())
            self._add(proxy)
            self._save(proxy)
        return proxy

    def connect(self, proxy: Proxy, client: Any) -> None:
        """Connect a client of the kind that the proxy serves; None for a nil reference.

        Raises AlreadyConnected, ProxyGone."""
        with self._lock:
            self._check_not_ended(proxy)
            if proxy.condition is not ProxyCondition.WAITING:
                raise AlreadyConnected(f"proxy {proxy.id} is connected already")
            with self._channel.lock:
                proxy.connect(client)
            self._save(proxy)
        self._update_routes(proxy)

    def supply(self, name: str) -> ProxyConsumer:
        """A connected proxy to push to; the same name returns the same proxy. Raises TooManyProxies, ProxyGone."""
        with self._lock:
            for known in self._all.values():
                if name and isinstance(known, ProxyConsumer) and known.name == name:
                    return known
            proxy = self._make(ProxyKind.PUSH_CONSUMER, self._new_id(), name=name)
            assert isinstance(proxy, ProxyConsumer)
            proxy.connect(None)
            self._add(proxy)
            self._save(proxy)
        return proxy

    def subscribe(
        self, name: str, client: ConsumerPort, subscription: Subscription, queue: QueuePolicy
    ) -> ProxyPushSupplier:
        """Connect a consumer. A name makes the subscription durable, or replaces the consumer of that name, which is
        disconnected. Raises InvalidQueue, TooManyProxies, ProxyGone."""
        queue = queue.checked()
        before: ClientPort | None = None
        with self._lock:
            proxy = self._durable(name) if name else None
            if proxy is None:
                new = self._make(ProxyKind.PUSH_SUPPLIER, self._new_id(), subscription, queue, name)
                assert isinstance(new, ProxyPushSupplier)
                proxy = new
                self._add(proxy)
            if proxy.client and proxy.client.reference != client.reference:
                before = proxy.client
            with self._channel.lock:
                proxy.resize(queue)
                proxy.select(subscription)
                proxy.connect(client)
                self._channel.forget_routes()
            self._save(proxy)
        self._update_routes(proxy)
        if before:
            before.disconnect()
        return proxy

    def unsubscribe(self, name: str) -> None:
        """End a durable subscription. Raises UnknownSubscription."""
        with self._lock:
            proxy = self._durable(name)
        if proxy is None:
            raise UnknownSubscription(name)
        self._remove(proxy)

    def change(self, proxy: ProxySupplier, subscription: Subscription) -> None:
        """Change the subscription of a proxy. Raises ProxyGone."""
        with self._lock:
            self._check_not_ended(proxy)
            with self._channel.lock:
                proxy.select(subscription)
                self._channel.forget_routes()
            self._save(proxy)
        self._update_routes(proxy)

    def suspend(self, proxy: ProxyPushSupplier, suspended: bool) -> None:
        """Suspend or resume delivery; events wait meanwhile. Raises ProxyGone."""
        with self._lock:
            self._check_not_ended(proxy)
            with self._channel.lock:
                proxy.suspend() if suspended else proxy.resume()
            self._save(proxy)

    def disconnect(self, proxy: Proxy) -> None:
        """Disconnect the client and notify it once. A durable subscription stays. Raises ProxyGone."""
        if isinstance(proxy, ProxyPushSupplier) and proxy.name:
            with self._lock:
                client = proxy.client
                if client is None:
                    raise ProxyGone(f"proxy {proxy.id} has no client")
                self._leave(proxy)
                self._on_removed(proxy.id)  # before the next client of this name can take over the subscription
            client.disconnect()
        else:
            self._remove(proxy)

    def destroy(self) -> None:
        """Disconnect all clients permanently. Raises ProxyGone if the channel was destroyed before."""
        with self._lock:
            self.check_not_destroyed()
            self._is_destroyed = True
            everything = list(self._all.values())
            with self._channel.lock:
                self._channel.is_destroyed = True
        with ThreadPoolExecutor(16) as callers:  # a client that hangs takes a second
            list(callers.map(self._remove_if_present, everything))
        self._update_routes()

    def check_not_destroyed(self) -> None:
        """Raise ProxyGone if the channel was destroyed: a call may arrive while its object is being deactivated."""
        if self._is_destroyed:
            raise ProxyGone(f"channel {self._channel.name} was destroyed")

    # ---- called by the server process ----

    def restore(self, find: Callable[[ProxyKind, str], ClientPort]) -> list[Proxy]:
        """Restore the proxies of the store, connected as before. find: the client of a proxy by its reference."""
        # Proxies that poll last: their events arrive immediately, when all consumers must be connected.
        for stored in sorted(self._store.proxies(), key=lambda stored: stored.kind == ProxyKind.PULL_CONSUMER.value):
            kind = ProxyKind(stored.kind)
            proxy = self._make(kind, stored.id, stored.subscription, stored.policy, stored.name)
            self._add(proxy)
            with self._channel.lock:
                if stored.is_connected:
                    proxy.connect(find(kind, stored.client) if stored.client else None)
                if stored.is_suspended and isinstance(proxy, ProxyPushSupplier):
                    proxy.suspend()
        self._update_routes()
        return list(self._all.values())

    def close(self) -> None:
        """Let all waiting pull calls return, because the process ends."""
        with self._lock, self._channel.lock:
            for proxy in self._all.values():
                if isinstance(proxy, ProxyPullSupplier):
                    proxy.release()

    def snapshots(self) -> list[ProxySnapshot]:
        """Snapshots of all proxies, taken one after another."""
        with self._lock:
            everything = list(self._all.values())
        snapshots = []
        for proxy in everything:
            with contextlib.suppress(ProxyGone):  # meanwhile
                snapshots.append(self.snapshot(proxy))
        return snapshots

    def snapshot(self, proxy: Proxy) -> ProxySnapshot:
        """Raises ProxyGone."""
        with self._channel.lock:
            self._check_not_ended(proxy)
            supplier = proxy if isinstance(proxy, ProxySupplier) else None
            return ProxySnapshot(
                proxy.id,
                proxy.kind,
                proxy.condition,
                proxy.name,
                proxy.client.address if proxy.client else "",
                supplier.subscription if supplier else (),
                supplier.policy if supplier else self._queue,
                proxy.failures,
                proxy.totals(),
            )

    # ---- private ----

    def _make(
        self,
        kind: ProxyKind,
        id: str,
        subscription: Subscription = ALL,
        queue: QueuePolicy | None = None,
        name: str = "",
    ) -> Proxy:
        lock, publish, has_had = self._channel.lock, self._channel.publish, self._channel.has_had
        queue, policy = queue or self._queue, self._policy
        if kind is ProxyKind.PUSH_CONSUMER:
            return ProxyConsumer(lock, id, publish, has_had, name)
        if kind is ProxyKind.PULL_CONSUMER:
            return ProxyPullConsumer(lock, id, publish, has_had, policy.delivery, self._client_lost)
        if kind is ProxyKind.PULL_SUPPLIER:
            return ProxyPullSupplier(lock, id, subscription, queue)
        return ProxyPushSupplier(lock, id, subscription, queue, policy.delivery, self._client_lost, name)

    def _add(self, proxy: Proxy) -> None:
        self._all[proxy.id] = proxy
        if isinstance(proxy, ProxySupplier):
            with self._channel.lock:
                self._channel.proxy_suppliers[proxy.id] = proxy

    def _new_id(self) -> str:
        self.check_not_destroyed()
        if len(self._all) >= self._policy.max_proxies:
            now = time.monotonic()
            unused = [proxy for proxy in self._all.values() if now - proxy.used_at > self._unused_limit_s(proxy)]
            if not unused:
                raise TooManyProxies(self._policy.max_proxies)
            oldest = min(unused, key=lambda proxy: proxy.used_at)
            oldest.client = None  # finds out by its next pull; a client may hang, and is not called under the lock
            self._remove(oldest)
        return str(self._store.next_id())

    def _unused_limit_s(self, proxy: Proxy) -> float:
        """Time without use after which a proxy makes room for others [s]."""
        if isinstance(proxy, ProxyPullSupplier):
            return math.inf if proxy.pulls else self._policy.forgotten_s
        if proxy.condition is ProxyCondition.WAITING and not proxy.name:
            return self._policy.forgotten_s
        return self._policy.unused_s if isinstance(proxy, ProxyConsumer) and not proxy.client else math.inf

    def _durable(self, name: str) -> ProxyPushSupplier | None:
        found = (proxy for proxy in self._all.values() if isinstance(proxy, ProxyPushSupplier) and proxy.name == name)
        return next(found, None)

    def _check_not_ended(self, proxy: Proxy) -> None:
        if proxy.is_ended:
            raise ProxyGone(f"proxy {proxy.id} was disconnected")

    def _remove(self, proxy: Proxy) -> None:
        """End a proxy. Its object is deactivated before the client is called, so that a mutual disconnect ends here."""
        with self._lock:
            self._check_not_ended(proxy)
            with self._channel.lock:
                proxy.end()
                self._channel.proxy_suppliers.pop(proxy.id, None)
                self._channel.forget_routes()
            self._all.pop(proxy.id, None)
            try:
                self._store.forget_proxy(proxy.id)
            except ServiceError as error:  # a restart restores the proxy, and finds its client dead
                _log.error("%s", error)
        self._on_removed(proxy.id)
        if not self._is_destroyed:  # else `destroy` updates the routes once at its end
            self._update_routes(proxy)
        if proxy.client:
            proxy.client.disconnect()

    def _remove_if_present(self, proxy: Proxy) -> None:
        with contextlib.suppress(ProxyGone):  # it was removed meanwhile
            self._remove(proxy)

    def _client_lost(self, proxy: Proxy, reason: str) -> None:
        """A client is lost. A durable subscription waits for its next consumer; any other proxy ends."""
        _log.warning("disconnected the client of proxy %s %s: %s", proxy.kind.value, proxy.id, reason)
        try:
            if isinstance(proxy, ProxyPushSupplier) and proxy.name:
                with self._lock:
                    self._leave(proxy)
            else:
                self._remove(proxy)
            self.lost_clients += 1
        except ProxyGone:
            return
        except RoboCorbaError as error:
            _log.error("%s", error)

    def _leave(self, proxy: ProxyPushSupplier) -> None:
        """The consumer of a durable subscription has left, or is lost."""
        self._check_not_ended(proxy)
        with self._channel.lock:
            proxy.leave()
        self._save(proxy)

    def _save(self, proxy: Proxy) -> None:
        stored = StoredProxy(
            proxy.id,
            proxy.kind.value,
            proxy.name,
            proxy.condition is not ProxyCondition.WAITING,
            proxy.condition is ProxyCondition.SUSPENDED,
            proxy.client.reference if proxy.client else "",
        )
        if isinstance(proxy, ProxySupplier):
            stored.subscription, stored.policy = proxy.subscription, proxy.policy
        self._store.save_proxy(stored)

    def _update_routes(self, of: Proxy | None = None) -> None:
        """of: the only proxy that has come, changed or gone; all by default."""
        if of is not None and not isinstance(of, ProxySupplier):
            return  # suppliers have no part in routes
        with self._channel.lock:
            changed = self._channel.update_routes(of)
        if changed:
            self._on_advertisement_changed()
