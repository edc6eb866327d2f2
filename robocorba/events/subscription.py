"""Subscriptions: which events a consumer wants, by type and source, singly or as conjunctions."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import chain
from typing import NamedTuple

from robocorba.errors.events import InvalidSubscription
from robocorba.events.event import MAX_NAME

#: Maximum number of clauses of a subscription.
MAX_CLAUSES = 200
#: Maximum number of patterns of a clause.
MAX_PATTERNS = 16
#: A union of more patterns than this is replaced by the pattern that matches everything.
MAX_UNION = 2000
#: Each pattern of a union is compared with this many general patterns of its type, and as many of any type.
MAX_COMPARED = 16


class Pattern(NamedTuple):
    """Type and source with wildcards: * matches any text, also empty text; ? matches one character."""

    type: str = "*"
    source: str = "*"

    def matches(self, type: str, source: str) -> bool:
        """Whether an event of this type and source matches."""
        return _matches(self.type, type) and _matches(self.source, source)

    def covers(self, other: Pattern) -> bool:
        """Whether every event that matches `other` matches this. Never wrongly true; wrongly false in rare cases."""
        return _matches(self.type, other.type, True) and _matches(self.source, other.source, True)


EVERYTHING = Pattern()


class Clause(NamedTuple):
    """One pattern: each matching event. Several: a conjunction of events at most `window` s apart (0: no limit)."""

    patterns: tuple[Pattern, ...]
    window: float = 0.0

    @property
    def is_conjunction(self) -> bool:
        return len(self.patterns) > 1


#: The disjunction of its clauses.
Subscription = tuple[Clause, ...]

#: The subscription of a plain consumer, one that supports OMG's interfaces only.
ALL: Subscription = (Clause((EVERYTHING,)),)


class SubscriptionMatch(NamedTuple):
    """How events of a type and source match a subscription. single: a clause with one pattern."""

    single: bool
    #: Index of each conjunction that matches, and indices of its matching patterns.
    conjunctions: tuple[tuple[int, tuple[int, ...]], ...]


def checked(clauses: Iterable[tuple[Sequence[tuple[str, str]], float]]) -> Subscription:
    """The subscription with these clauses: pairs of ((type, source), ...) and window. Raises InvalidSubscription."""
    result: list[Clause] = []
    for number, (patterns, window) in enumerate(clauses):
        where = f"[{number}]"
        if number >= MAX_CLAUSES:
            raise InvalidSubscription("", f"more than {MAX_CLAUSES} clauses")
        if not 1 <= len(patterns) <= MAX_PATTERNS:
            raise InvalidSubscription(f"{where}.patterns", f"{len(patterns)} patterns; 1 to {MAX_PATTERNS} are allowed")
        if not (math.isfinite(window) and window >= 0):
            raise InvalidSubscription(f"{where}.window", f"{window} is not a number of seconds from 0 on")
        for index, pattern in enumerate(patterns):
            for field, text in zip(("type", "source"), pattern, strict=True):
                if len(text) > MAX_NAME:
                    raise InvalidSubscription(
                        f"{where}.patterns[{index}].{field}", f"{len(text)} characters; at most {MAX_NAME} are allowed"
                    )
        result.append(Clause(tuple(Pattern(type or "*", source or "*") for type, source in patterns), window))
    return tuple(result)


def match_subscription(subscription: Subscription, type: str, source: str) -> SubscriptionMatch | None:
    """How events of this type and source match; None if they do not."""
    single = False
    conjunctions: list[tuple[int, tuple[int, ...]]] = []
    for number, clause in enumerate(subscription):
        indices = tuple(index for index, pattern in enumerate(clause.patterns) if pattern.matches(type, source))
        if indices and clause.is_conjunction:
            conjunctions.append((number, indices))
        elif indices:
            single = True
    return SubscriptionMatch(single, tuple(conjunctions)) if single or conjunctions else None


def union(patterns: Iterable[Pattern]) -> tuple[Pattern, ...]:
    """A sorted subset of the patterns that covers all of them. More than MAX_UNION patterns become EVERYTHING."""
    unique = sorted(set(patterns))
    if EVERYTHING in unique or len(unique) > MAX_UNION:
        return (EVERYTHING,)
    # Patterns that may cover others, by type, or by "" if the type has wildcards. Short patterns cover the most.
    general: dict[str, list[Pattern]] = {}
    for pattern in sorted(unique, key=lambda pattern: len(pattern.type) + len(pattern.source)):
        if _has_wildcards(pattern.type) or _has_wildcards(pattern.source):
            group = general.setdefault("" if _has_wildcards(pattern.type) else pattern.type, [])
            if len(group) < MAX_COMPARED:
                group.append(pattern)
    remaining = dict.fromkeys(unique)
    for pattern in unique:
        wider = chain(general.get("", ()), general.get(pattern.type, ()))
        # Of two patterns that cover each other, such as a* and a**, one must stay: a removed pattern covers nothing.
        if any(other is not pattern and other in remaining and other.covers(pattern) for other in wider):
            del remaining[pattern]
    return tuple(remaining)


def patterns_of(subscription: Subscription) -> Iterable[Pattern]:
    """All patterns of all clauses: a conjunction needs all of its events."""
    return (pattern for clause in subscription for pattern in clause.patterns)


class Interest:
    """The interest of a channel: the union of the subscriptions of its own consumers. The channel locks.

    It is counted consumer by consumer: with thousands of them, each that subscribes would otherwise hold up the channel
    for as long as it takes to go through all others."""

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


def is_covered(pattern: Pattern, interest: Iterable[Pattern]) -> bool:
    """Whether one pattern of `interest` covers `pattern`."""
    return any(wider.covers(pattern) for wider in interest)


def _has_wildcards(text: str) -> bool:
    return "*" in text or "?" in text


@lru_cache(8192)
def _matches(pattern: str, text: str, text_is_pattern: bool = False) -> bool:
    """Match in time proportional to both lengths; a regular expression would need exponential time for some patterns.

    text_is_pattern: only * matches a * in `text`."""
    if pattern == "*":
        return True
    at = index = 0  # positions in the pattern and in the text
    star, retry = -1, 0  # the last * in the pattern, and where the text after it begins
    while index < len(text):
        if at < len(pattern) and pattern[at] == "*":
            star, retry = at, index
            at += 1
        elif at < len(pattern) and (
            pattern[at] == text[index] or (pattern[at] == "?" and not (text_is_pattern and text[index] == "*"))
        ):
            at += 1
            index += 1
        elif star >= 0:
            retry += 1
            at, index = star + 1, retry
        else:
            return False
    return all(rest == "*" for rest in pattern[at:])
