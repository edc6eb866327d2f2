"""Batches of events, small clients that note what they are given, and proxies for them."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from robocorba.errors.events import EventError
from robocorba.events.account import Account
from robocorba.events.channel import Channel
from robocorba.events.event import CorrelatedEvents, EventBatch, EventHeader
from robocorba.events.federation import Federation
from robocorba.events.policies import ChannelPolicy, DeliveryPolicy
from robocorba.events.proxy_push_supplier import ProxyPushSupplier
from robocorba.events.proxy_supplier import ProxyPullSupplier, ProxySupplier
from robocorba.events.queue import QueueItem, QueuePolicy
from robocorba.events.seen_events import SeenEvents
from robocorba.events.subscription import ALL, Clause, Pattern, Subscription
from robocorba.system.backoff import Backoff

NOW = 1_000_000.0
BOTH: Subscription = (Clause((Pattern("a"), Pattern("b"))),)
#: A consumer that does not answer is probed sooner, and disconnected after fewer failures, than by default.
IMPATIENT = DeliveryPolicy(backoff=Backoff(0.001, 0.002), settle_s=0.0, max_failures=4)
DEFAULTS = ChannelPolicy()
_references = itertools.count()


def events(first: int, count: int = 1, *, type: str = "t", priority: int = 0, expiry: float = 0.0) -> EventBatch:
    """Events made at NOW, each with its number as payload."""
    return EventBatch(
        EventHeader(type, "A", "lab", priority, expiry), [NOW] * count, list(range(first, first + count)), first
    )


def supplied(type: str, *payloads: bytes, source: str = "A", priority: int = 0, expiry: float = 0.0) -> EventBatch:
    """Events of a supplier: without origin, numbers and times, which the channel sets."""
    return EventBatch(EventHeader(type, source, "", priority, expiry), [0.0] * len(payloads), list(payloads))


def numbers(items: Sequence[QueueItem]) -> list[int]:
    """The numbers of all events, in order."""
    batches = [batch for item in items for batch in (item.batches if isinstance(item, CorrelatedEvents) else (item,))]
    return [batch.first + place for batch in batches for place in range(len(batch))]


def wanting(*types: str) -> Subscription:
    """A disjunction of types."""
    return tuple(Clause((Pattern(type),)) for type in types)


def is_balanced(totals: Account) -> bool:
    """Whether no event is missing or counted twice."""
    return totals.received == totals.delivered + totals.discarded + totals.expired + totals.queued


class Consumer:
    """A consumer; `answer` may raise instead of taking what it is given, and `is_alive` may raise or be False."""

    def __init__(self, takes_batches: bool = True, answer: Callable[[Sequence[QueueItem]], None] | None = None) -> None:
        self.takes_batches = takes_batches
        self.is_idempotent = False
        self.reference = self.address = f"consumer {next(_references)}"
        self.answer = answer or (lambda items: None)
        self.is_alive: Callable[[], bool] = lambda: True
        self.on_disconnect: Callable[[], None] = lambda: None
        self.items: list[QueueItem] = []
        self.disconnections = 0
        self.overlaps = 0
        self._busy = threading.Lock()

    def deliver(self, items: Sequence[QueueItem], limit_s: float) -> None:
        if not self._busy.acquire(blocking=False):
            self.overlaps += 1
            raise AssertionError("called by two threads at once")
        try:
            self.answer(items)
            self.items += items
        finally:
            self._busy.release()

    def answers(self, limit_s: float) -> bool:
        return self.is_alive()

    def disconnect(self) -> None:
        self.disconnections += 1
        self.on_disconnect()

    @property
    def payloads(self) -> list[object]:
        """Of all single events that it has got."""
        return [payload for item in self.items if isinstance(item, EventBatch) for payload in item.payloads]


class Supplier:
    """A polled supplier: gives `batches` in turn, then nothing; an error among them is raised."""

    def __init__(self, *batches: EventBatch | EventError) -> None:
        self.reference = self.address = f"supplier {next(_references)}"
        self.batches = list(batches)
        self.asked = 0
        self.on_disconnect: Callable[[], None] = lambda: None
        self.disconnections = 0

    def try_pull(self, limit_s: float) -> EventBatch | None:
        self.asked += 1
        batch = self.batches.pop(0) if self.batches else None
        if isinstance(batch, EventError):
            raise batch
        return batch

    def disconnect(self) -> None:
        self.disconnections += 1
        self.on_disconnect()


def failing(*errors: Exception) -> Callable[[Sequence[QueueItem]], None]:
    """Raises one error a call, then takes everything."""
    left = list(errors)

    def answer(items: Sequence[QueueItem]) -> None:
        if left:
            raise left.pop(0)

    return answer


@contextmanager
def open_channel(
    folder: Path, first_number: int = 1, name: str = "lab", policy: ChannelPolicy = DEFAULTS
) -> Iterator[Channel]:
    """A channel without peers."""
    with SeenEvents(folder / f"{name}.seen") as seen:
        yield Channel(Federation(name, []), seen, first_number, policy=policy)


def arrive(channel: Channel, *batches: EventBatch, before: int = 0) -> Account:
    """Events come from a peer, for this channel. before: number of the event before the first of each batch."""
    account = Account()
    for batch in batches:
        batch.targets = {channel.name: before}
    channel.deliver(channel.forward(list(batches), account))
    return account


def add(channel: Channel, proxy: ProxySupplier, client: object = None) -> None:
    """Connect a client by a proxy."""
    with channel.lock:
        channel.proxy_suppliers[proxy.id] = proxy
        proxy.connect(client)
        channel.update_routes()


class LostClients:
    """The reasons why clients were lost."""

    def __init__(self) -> None:
        self.reasons: list[str] = []

    def __call__(self, proxy: ProxyPushSupplier, reason: str) -> None:
        self.reasons.append(reason)
        with proxy._lock:
            proxy.end()


def push_supplier_of(
    channel: Channel,
    consumer: Consumer,
    policy: QueuePolicy | None = None,
    wanted: Subscription = ALL,
    name: str = "",
    on_client_lost: Callable[[ProxyPushSupplier, str], None] | None = None,
    delivery: DeliveryPolicy = IMPATIENT,
) -> ProxyPushSupplier:
    id, lost = f"{len(channel.proxy_suppliers) + 1}", on_client_lost or LostClients()
    proxy = ProxyPushSupplier(channel.lock, id, wanted, policy or QueuePolicy(), delivery, lost, name)
    add(channel, proxy, consumer)
    return proxy


def pull_supplier_of(channel: Channel, wanted: Subscription = ALL, size: int = 10_000) -> ProxyPullSupplier:
    proxy = ProxyPullSupplier(channel.lock, f"{len(channel.proxy_suppliers) + 1}", wanted, QueuePolicy(size))
    add(channel, proxy)
    return proxy


def pulled(proxy: ProxyPullSupplier) -> list[EventBatch]:
    """What waits there, one event each."""
    found = []
    while batch := proxy.pull(0.0):
        assert len(batch) == 1
        found.append(batch)
    return found


def publish(channel: Channel, *payloads: int, type: str = "t", priority: int = 0, expiry: float = 0.0) -> None:
    channel.publish(supplied(type, *(str(n).encode() for n in payloads), priority=priority, expiry=expiry), Account())


def received(consumer: Consumer) -> list[int]:
    return [int(str(payload, "ascii")) for payload in consumer.payloads if isinstance(payload, bytes)]


def totals(proxy: ProxySupplier) -> Account:
    with proxy._lock:
        return proxy.totals()


def is_settled(proxy: ProxySupplier) -> bool:
    return totals(proxy).queued == 0
