"""Subscriptions: which events a consumer wants, by type and source, singly or as conjunctions."""

from __future__ import annotations

import math
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

#: The subscription of a plain consumer.
ALL: Subscription = (Clause((EVERYTHING,)),)


class SubscriptionMatch(NamedTuple):
    """How events of a type and source match a subscription: singly, and in which slots of its conjunctions."""

    single: bool
    slots: tuple[tuple[int, tuple[int, ...]], ...]  # index of the clause, indices of its patterns


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
        for place, pattern in enumerate(patterns):
            for field, text in zip(("type", "source"), pattern, strict=True):
                if len(text) > MAX_NAME:
                    raise InvalidSubscription(
                        f"{where}.patterns[{place}].{field}", f"{len(text)} characters; at most {MAX_NAME} are allowed"
                    )
        result.append(Clause(tuple(Pattern(type or "*", source or "*") for type, source in patterns), window))
    return tuple(result)


def match_subscription(subscription: Subscription, type: str, source: str) -> SubscriptionMatch | None:
    """How events of this type and source match; None if they do not."""
    single = False
    slots: list[tuple[int, tuple[int, ...]]] = []
    for number, clause in enumerate(subscription):
        fitting = tuple(place for place, pattern in enumerate(clause.patterns) if pattern.matches(type, source))
        if fitting and clause.is_conjunction:
            slots.append((number, fitting))
        elif fitting:
            single = True
    return SubscriptionMatch(single, tuple(slots)) if single or slots else None


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
    left = dict.fromkeys(unique)
    for pattern in unique:
        wider = chain(general.get("", ()), general.get(pattern.type, ()))
        # Of two patterns that cover each other, such as a* and a**, one must stay: a removed pattern covers nothing.
        if any(other is not pattern and other in left and other.covers(pattern) for other in wider):
            del left[pattern]
    return tuple(left)


def patterns_of(subscription: Subscription) -> Iterable[Pattern]:
    """All patterns of all clauses: a conjunction needs all of its events."""
    return (pattern for clause in subscription for pattern in clause.patterns)


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
    at = place = 0
    star, retry = -1, 0
    while place < len(text):
        if at < len(pattern) and pattern[at] == "*":
            star, retry = at, place
            at += 1
        elif at < len(pattern) and (
            pattern[at] == text[place] or (pattern[at] == "?" and not (text_is_pattern and text[place] == "*"))
        ):
            at += 1
            place += 1
        elif star >= 0:
            retry += 1
            at, place = star + 1, retry
        else:
            return False
    return all(rest == "*" for rest in pattern[at:])
