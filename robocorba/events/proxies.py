"""The proxies of a channel: obtained, connected, restored after a restart, disconnected."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from enum import Enum
from typing import Any, NamedTuple

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.events import AlreadyConnected, ProxyGone, TooManyProxies, UnknownSubscription
from robocorba.errors.services import ServiceError
from robocorba.events.account import Totals
from robocorba.events.channel import Channel
from robocorba.events.clients import ClientFinder, ClientPort, ConsumerPort
from robocorba.events.inlet import Inlet, PolledInlet
from robocorba.events.outlet import Outlet, ProxyCondition, PullOutlet
from robocorba.events.push_outlet import PushOutlet
from robocorba.events.queue import QueuePolicy
from robocorba.events.store import ChannelStore, ProxyRecord
from robocorba.events.subscription import ALL, Subscription

#: Maximum number of proxies of a channel.
MAX_PROXIES = 10_000
#: When the channel is full, an inlet without a known client is removed if it was unused for this time [s].
UNUSED_S = 3600.0
#: Threads that disconnect clients when the channel is destroyed; a client that hangs takes a second.
DISCONNECT_THREADS = 16

_log = logging.getLogger(__name__)


class ProxyKind(Enum):
    """Named as by OMG: a push supplier proxy serves a push consumer."""

    PUSH_CONSUMER = "push consumer"
    PULL_CONSUMER = "pull consumer"
    PUSH_SUPPLIER = "push supplier"
    PULL_SUPPLIER = "pull supplier"


class ProxyState(NamedTuple):
    """Snapshot of a proxy."""

    id: str
    kind: ProxyKind
    condition: ProxyCondition
    name: str
    client: str
    subscription: Subscription
    policy: QueuePolicy
    failures: int
    totals: Totals


Proxy = Inlet | Outlet


class Proxies:
    """All proxies of `channel`, kept in `store`. policy: queue policy of proxies that are obtained from an admin.

    on_interest: called when this channel's own advertisement has changed. on_removed: called with the id of a proxy
    that has ended, before its client is notified. Both are called without the channel's lock."""

    def __init__(
        self,
        channel: Channel,
        store: ChannelStore,
        policy: QueuePolicy,
        on_interest: Callable[[], None],
        on_removed: Callable[[str], None],
    ) -> None:
        self.evicted = 0
        self._channel, self._store, self._policy = channel, store, policy
        self._on_interest, self._on_removed = on_interest, on_removed
        self._all: dict[str, Proxy] = {}
        self._lock = threading.RLock()  # guards the set of proxies; never held while clients are called
        self._is_destroyed = False

    # ---- from a client ----

    def obtain(self, kind: ProxyKind) -> Proxy:
        """Create a proxy without a client. Raises TooManyProxies, ProxyGone."""
        with self._lock:
            proxy = self._make(kind, self._new_id(), ALL, self._policy)
            self._add(proxy)
            self._save(proxy)
        return proxy

    def connect(self, proxy: Proxy, client: Any) -> None:
        """Connect a client of the kind that the proxy serves; None for a nil reference.

        Raises AlreadyConnected, ProxyGone."""
        with self._lock:
            self._check(proxy)
            if proxy.condition is not ProxyCondition.WAITING:
                raise AlreadyConnected(f"proxy {proxy.id} is connected already")
            with self._channel.lock:
                proxy.connect(client)
            self._save(proxy)
        self._interest_changed()

    def supply(self, name: str) -> Inlet:
        """A connected proxy to push to; the same name returns the same proxy. Raises TooManyProxies, ProxyGone."""
        with self._lock:
            for proxy in self._all.values():
                if name and isinstance(proxy, Inlet) and proxy.name == name:
                    return proxy
            inlet = self._make(ProxyKind.PUSH_CONSUMER, self._new_id(), ALL, self._policy, name)
            assert isinstance(inlet, Inlet)
            with self._channel.lock:
                inlet.connect(None)
            self._add(inlet)
            self._save(inlet)
        return inlet

    def subscribe(self, name: str, client: ConsumerPort, subscription: Subscription, policy: QueuePolicy) -> PushOutlet:
        """Connect a consumer. A name makes the subscription durable, or takes over the subscription of that name.

        Raises InvalidQueue, TooManyProxies, ProxyGone."""
        policy = policy.checked()
        before: ClientPort | None = None
        with self._lock:
            outlet = self._durable(name) if name else None
            if outlet is None:
                made = self._make(ProxyKind.PUSH_SUPPLIER, self._new_id(), subscription, policy, name)
                assert isinstance(made, PushOutlet)
                outlet = made
                self._add(outlet)
            if outlet.client and outlet.client.reference != client.reference:
                before = outlet.client
            with self._channel.lock:
                outlet.resize(policy)
                outlet.select(subscription)
                outlet.connect(client)
            self._save(outlet)
        self._interest_changed()
        if before:
            before.disconnect()
        return outlet

    def unsubscribe(self, name: str) -> None:
        """End a durable subscription. Raises UnknownSubscription."""
        with self._lock:
            outlet = self._durable(name)
        if outlet is None:
            raise UnknownSubscription(name)
        self._remove(outlet)

    def change(self, outlet: Outlet, subscription: Subscription) -> None:
        """Change an outlet's subscription. Raises ProxyGone."""
        with self._lock:
            self._check(outlet)
            with self._channel.lock:
                outlet.select(subscription)
            self._save(outlet)
        self._interest_changed()

    def suspend(self, outlet: PushOutlet, suspended: bool) -> None:
        """Suspend or resume delivery; events wait meanwhile. Raises ProxyGone."""
        with self._lock:
            self._check(outlet)
            with self._channel.lock:
                outlet.suspend() if suspended else outlet.resume()
            self._save(outlet)

    def disconnect(self, proxy: Proxy) -> None:
        """Disconnect the client and notify it once. A durable subscription stays. Raises ProxyGone."""
        if isinstance(proxy, PushOutlet) and proxy.name:
            with self._lock:
                self._check(proxy)
                client = proxy.client
                if client is None:
                    raise ProxyGone(f"proxy {proxy.id} has no client")
                with self._channel.lock:
                    proxy.leave()
                self._save(proxy)
                self._on_removed(proxy.id)  # before the next client of this name can take over the subscription
            client.disconnect()
        else:
            self._remove(proxy)

    def destroy(self) -> None:
        """Disconnect all clients permanently. Raises ProxyGone if the channel was destroyed before."""
        with self._lock:
            self.check()
            self._is_destroyed = True
            everything = list(self._all.values())
            with self._channel.lock:
                self._channel.is_destroyed = True
        with ThreadPoolExecutor(DISCONNECT_THREADS) as callers:
            list(callers.map(self._remove_if_there, everything))
        self._interest_changed()

    def check(self) -> None:
        """Raise ProxyGone if the channel was destroyed: a call may arrive while its object is being deactivated."""
        if self._is_destroyed:
            raise ProxyGone(f"channel {self._channel.name} was destroyed")

    # ---- from the server ----

    def restore(self, clients: ClientFinder) -> list[Proxy]:
        """Restore the proxies of the store, connected as before."""
        # Polled suppliers last: their events arrive as soon as they are connected, and all consumers must be there.
        for record in sorted(self._store.proxies(), key=lambda record: record.kind == ProxyKind.PULL_CONSUMER.value):
            kind = ProxyKind(record.kind)
            proxy = self._make(kind, record.id, record.subscription, record.policy or self._policy, record.name)
            self._all[record.id] = proxy
            with self._channel.lock:
                if isinstance(proxy, Outlet):
                    self._channel.outlets[record.id] = proxy
                if record.is_connected:
                    client: Any = clients.find(record.kind, record.client) if record.client else None
                    proxy.connect(client)
                if record.is_suspended and isinstance(proxy, PushOutlet):
                    proxy.suspend()
        self._interest_changed()
        return list(self._all.values())

    def close(self) -> None:
        """Let all waiting pull calls return, because the process ends."""
        with self._lock, self._channel.lock:
            for proxy in self._all.values():
                if isinstance(proxy, PullOutlet):
                    proxy.release()

    def states(self) -> list[ProxyState]:
        """Snapshots of all proxies, taken one after another."""
        with self._lock:
            everything = list(self._all.values())
        return [self.state(proxy) for proxy in everything]

    def state(self, proxy: Proxy) -> ProxyState:
        with self._channel.lock:
            outlet = proxy if isinstance(proxy, Outlet) else None
            return ProxyState(
                proxy.id,
                _kind(proxy),
                proxy.condition,
                proxy.name,
                proxy.client.address if proxy.client else "",
                outlet.subscription if outlet else (),
                outlet.policy if outlet else self._policy,
                proxy.failures,
                proxy.totals(),
            )

    # ---- inside ----

    def _make(self, kind: ProxyKind, id: str, subscription: Subscription, policy: QueuePolicy, name: str = "") -> Proxy:
        lock, publish = self._channel.lock, self._channel.publish
        if kind is ProxyKind.PUSH_CONSUMER:
            return Inlet(lock, id, publish, name)
        if kind is ProxyKind.PULL_CONSUMER:
            return PolledInlet(lock, id, publish, self._client_lost)
        if kind is ProxyKind.PULL_SUPPLIER:
            return PullOutlet(lock, id, subscription, policy)
        return PushOutlet(lock, id, subscription, policy, self._client_lost, name)

    def _add(self, proxy: Proxy) -> None:
        self._all[proxy.id] = proxy
        if isinstance(proxy, Outlet):
            with self._channel.lock:
                self._channel.outlets[proxy.id] = proxy

    def _new_id(self) -> str:
        self.check()
        if len(self._all) >= MAX_PROXIES:
            unused = [
                proxy
                for proxy in self._all.values()
                if isinstance(proxy, Inlet) and not proxy.client and proxy.used_at < time.monotonic() - UNUSED_S
            ]
            if not unused:
                raise TooManyProxies(MAX_PROXIES)
            self._remove(min(unused, key=lambda proxy: proxy.used_at))
        return str(self._store.next_id())

    def _durable(self, name: str) -> PushOutlet | None:
        found = (proxy for proxy in self._all.values() if isinstance(proxy, PushOutlet) and proxy.name == name)
        return next(found, None)

    def _check(self, proxy: Proxy) -> None:
        if proxy.is_ended:
            raise ProxyGone(f"proxy {proxy.id} was disconnected")

    def _remove(self, proxy: Proxy) -> None:
        """End a proxy. Its object is deactivated before the client is called, so that a mutual disconnect ends here."""
        with self._lock:
            self._check(proxy)
            with self._channel.lock:
                proxy.end()
                self._channel.outlets.pop(proxy.id, None)
            self._all.pop(proxy.id, None)
            try:
                self._store.forget_proxy(proxy.id)
            except ServiceError as error:  # it ends all the same; after a restart its client is found dead
                _log.error("%s", error)
        self._on_removed(proxy.id)
        if not self._is_destroyed:  # else `destroy` updates the interest once at its end
            self._interest_changed()
        if proxy.client:
            proxy.client.disconnect()

    def _remove_if_there(self, proxy: Proxy) -> None:
        with contextlib.suppress(ProxyGone):  # it was removed meanwhile
            self._remove(proxy)

    def _client_lost(self, proxy: Proxy, reason: str) -> None:
        """A client is gone. A durable subscription waits for its next consumer; any other proxy ends."""
        _log.warning("disconnected the client of %s %s: %s", _kind(proxy).value, proxy.id, reason)
        try:
            if isinstance(proxy, PushOutlet) and proxy.name:
                with self._lock:
                    self._check(proxy)
                    with self._channel.lock:
                        proxy.leave()
                    self._save(proxy)
            else:
                self._remove(proxy)
            self.evicted += 1
        except ProxyGone:
            return
        except RoboCorbaError as error:
            _log.error("%s", error)

    def _save(self, proxy: Proxy) -> None:
        record = ProxyRecord(
            proxy.id,
            _kind(proxy).value,
            proxy.name,
            proxy.condition is not ProxyCondition.WAITING,
            proxy.condition is ProxyCondition.SUSPENDED,
            proxy.client.reference if proxy.client else "",
        )
        if isinstance(proxy, Outlet):
            record.subscription, record.policy = proxy.subscription, proxy.policy
        self._store.save_proxy(record)

    def _interest_changed(self) -> None:
        with self._channel.lock:
            changed = self._channel.changed()
        if changed:
            self._on_interest()


def _kind(proxy: Proxy) -> ProxyKind:
    if isinstance(proxy, PolledInlet):
        return ProxyKind.PULL_CONSUMER
    if isinstance(proxy, Inlet):
        return ProxyKind.PUSH_CONSUMER
    return ProxyKind.PULL_SUPPLIER if isinstance(proxy, PullOutlet) else ProxyKind.PUSH_SUPPLIER
