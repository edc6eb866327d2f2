"""The interest of a channel: the union of the subscriptions of its own consumers.

It is counted consumer by consumer: with thousands of them, each that subscribes would otherwise hold up the channel for
as long as it takes to go through all others."""

from __future__ import annotations

from collections import Counter

from robocorba.events.subscription import Pattern, Subscription, patterns_of, union


class Interest:
    """Not thread-safe: the channel locks."""

    def __init__(self) -> None:
        #: The subscription that is counted, by consumer, and how often a pattern occurs in them.
        self._subscriptions: dict[str, Subscription] = {}
        self._counts: Counter[Pattern] = Counter()
        #: None when a pattern has come or gone.
        self._union: tuple[Pattern, ...] | None = ()

    def set(self, consumer: str, subscription: Subscription) -> None:
        """The subscription of a consumer, () for one that has gone."""
        before = self._subscriptions.pop(consumer, ())
        if subscription:
            self._subscriptions[consumer] = subscription
        for pattern in patterns_of(subscription):
            self._counts[pattern] += 1
            if self._counts[pattern] == 1:
                self._union = None
        for pattern in patterns_of(before):
            self._counts[pattern] -= 1
            if not self._counts[pattern]:
                del self._counts[pattern]
                self._union = None

    def patterns(self) -> tuple[Pattern, ...]:
        """A sorted subset of all patterns that covers them."""
        if self._union is None:
            self._union = union(self._counts)
        return self._union
