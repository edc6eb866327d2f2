"""Subscriptions: which events a consumer wants, by type and source, one by one or several together."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import chain
from typing import NamedTuple

from robocorba.errors.events import InvalidSubscription
from robocorba.events.event import MAX_NAME

MAX_CLAUSES = 200
MAX_PATTERNS = 16
#: A union of more patterns than this becomes "everything".
MAX_UNION = 2000
#: With how many others each pattern of a union is compared.
MAX_GENERAL = 16


class Pattern(NamedTuple):
    """Type and source with wildcards: * for any text, also none; ? for one character."""

    type: str = "*"
    source: str = "*"

    def matches(self, type: str, source: str) -> bool:
        """Whether an event of this type and source fits."""
        return _fits(self.type, type) and _fits(self.source, source)

    def covers(self, other: Pattern) -> bool:
        """Whether every event that fits `other` fits this one. Never wrongly true; false in odd cases only."""
        return _fits(self.type, other.type, True) and _fits(self.source, other.source, True)


EVERYTHING = Pattern()


class Clause(NamedTuple):
    """One pattern: each event that fits. Several: a conjunction, whose events are at most `window` s apart (0: any)."""

    patterns: tuple[Pattern, ...]
    window: float = 0.0

    @property
    def is_conjunction(self) -> bool:
        return len(self.patterns) > 1


#: A disjunction of its clauses.
Subscription = tuple[Clause, ...]

#: What a plain consumer gets.
ALL: Subscription = (Clause((EVERYTHING,)),)


class Fit(NamedTuple):
    """How events of a type and source fit a subscription: whether as such, and where in its conjunctions."""

    single: bool
    slots: tuple[tuple[int, tuple[int, ...]], ...]  # number of the clause, numbers of its patterns


def checked(clauses: Iterable[tuple[Sequence[tuple[str, str]], float]]) -> Subscription:
    """The subscription of ((type, source), ...), window pairs. Raises InvalidSubscription."""
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


def fit(subscription: Subscription, type: str, source: str) -> Fit | None:
    """How events of this type and source fit; None where they don't."""
    single = False
    slots: list[tuple[int, tuple[int, ...]]] = []
    for number, clause in enumerate(subscription):
        fitting = tuple(place for place, pattern in enumerate(clause.patterns) if pattern.matches(type, source))
        if fitting and clause.is_conjunction:
            slots.append((number, fitting))
        elif fitting:
            single = True
    return Fit(single, tuple(slots)) if single or slots else None


def union(patterns: Iterable[Pattern]) -> tuple[Pattern, ...]:
    """A few of the patterns that cover all of them, sorted. More than MAX_UNION become one that covers all."""
    unique = sorted(set(patterns))
    if EVERYTHING in unique or len(unique) > MAX_UNION:
        return (EVERYTHING,)
    # By type, or by "" where that has wildcards, those that may cover others. The shortest ones cover the most.
    general: dict[str, list[Pattern]] = {}
    for pattern in sorted(unique, key=lambda pattern: len(pattern.type) + len(pattern.source)):
        if _has_wildcards(pattern.type) or _has_wildcards(pattern.source):
            group = general.setdefault("" if _has_wildcards(pattern.type) else pattern.type, [])
            if len(group) < MAX_GENERAL:
                group.append(pattern)
    left = dict.fromkeys(unique)
    for pattern in unique:
        wider = chain(general.get("", ()), general.get(pattern.type, ()))
        # Of two that cover each other, such as a* and a**, one must stay: what goes no longer covers anything.
        if any(other is not pattern and other in left and other.covers(pattern) for other in wider):
            del left[pattern]
    return tuple(left)


def patterns_of(subscription: Subscription) -> Iterable[Pattern]:
    """Every pattern that it has anywhere: a conjunction needs all of its events, wherever they come from."""
    return (pattern for clause in subscription for pattern in clause.patterns)


def is_covered(pattern: Pattern, interest: Iterable[Pattern]) -> bool:
    """Whether one of `interest` lets everything through that `pattern` does."""
    return any(wider.covers(pattern) for wider in interest)


def _has_wildcards(text: str) -> bool:
    return "*" in text or "?" in text


@lru_cache(8192)
def _fits(pattern: str, text: str, text_is_pattern: bool = False) -> bool:
    """Match in time proportional to both lengths; a regular expression would need exponential time for some.

    Where `text` is itself a pattern, its * is matched by * alone."""
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
