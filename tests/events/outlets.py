"""Outlets of a channel for tests."""

from __future__ import annotations

from collections.abc import Callable

from robocorba.backoff import Backoff
from robocorba.events.account import Account, Totals
from robocorba.events.channel import Channel
from robocorba.events.policies import DeliveryPolicy
from robocorba.events.proxy_push_supplier import ProxyPushSupplier
from robocorba.events.proxy_supplier import ProxySupplier
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import ALL, Clause, Pattern, Subscription
from tests.events.samples import Consumer, add, supplied

BOTH: Subscription = (Clause((Pattern("a"), Pattern("b"))),)

#: A consumer that does not answer is probed sooner, and disconnected after fewer failures, than by default.
IMPATIENT = DeliveryPolicy(backoff=Backoff(0.001, 0.002), settle_s=0.0, max_failures=4)


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


def publish(channel: Channel, *payloads: int, type: str = "t", priority: int = 0, expiry: float = 0.0) -> None:
    channel.publish(supplied(type, *(str(n).encode() for n in payloads), priority=priority, expiry=expiry), Account())


def received(consumer: Consumer) -> list[int]:
    return [int(str(payload, "ascii")) for payload in consumer.payloads if isinstance(payload, bytes)]


def totals(proxy: ProxySupplier) -> Totals:
    with proxy._lock:
        return proxy.totals()


def is_settled(proxy: ProxySupplier) -> bool:
    return totals(proxy).queued == 0
