"""Which events fit: beside fnmatch, and by trying texts; and what all consumers of a channel want."""

from __future__ import annotations

import math
from fnmatch import fnmatchcase

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from robocorba.errors.events import InvalidSubscription
from robocorba.events.subscription import (
    EVERYTHING,
    MAX_UNION,
    Clause,
    Interest,
    Pattern,
    Subscription,
    SubscriptionMatch,
    checked,
    is_covered,
    match_subscription,
    patterns_of,
    union,
)

#: Without brackets, which only fnmatch knows.
GLOBS = st.text("ab.*?", max_size=8)
TEXTS = st.text("ab.", max_size=8)
PATTERNS = st.builds(Pattern, GLOBS, st.just("*"))


@given(GLOBS, TEXTS)
def test_wildcards_are_those_of_fnmatch(glob: str, text: str) -> None:
    assert Pattern(glob).matches(text, "A") == fnmatchcase(text, glob)
    assert Pattern("*", glob).matches("t", text) == fnmatchcase(text, glob)


@given(PATTERNS, PATTERNS, TEXTS)
def test_a_covering_pattern_matches_all_events_of_the_other(wider: Pattern, pattern: Pattern, text: str) -> None:
    if wider.covers(pattern) and pattern.matches(text, ""):
        assert wider.matches(text, "")
    assert pattern.covers(pattern)
    assert EVERYTHING.covers(pattern)


@given(st.lists(PATTERNS, max_size=8), TEXTS)
def test_a_union_matches_exactly_what_any_of_its_patterns_matches(patterns: list[Pattern], text: str) -> None:
    one = union(patterns)
    assert set(one) <= {*patterns, EVERYTHING}
    assert any(p.matches(text, "") for p in one) == any(p.matches(text, "") for p in patterns)
    # It has nothing that another of its patterns covers.
    assert not any(a.covers(b) for a in one for b in one if a is not b)
    assert all(is_covered(pattern, one) for pattern in patterns if "*" not in pattern.type)


def test_of_patterns_that_cover_each_other_one_stays_and_of_very_many_everything() -> None:
    (one,) = union([Pattern("a*"), Pattern("a**")])
    assert one.matches("abc", "")
    assert union(Pattern(f"t{number}") for number in range(MAX_UNION + 1)) == (EVERYTHING,)
    assert len(union(Pattern(f"t{number}") for number in range(MAX_UNION))) == MAX_UNION


def test_a_pattern_with_many_wildcards_is_matched_quickly() -> None:
    assert not Pattern("*a" * 60 + "b").matches("a" * 200, "")


def test_matches_of_disjunctions_and_conjunctions() -> None:
    subscription = (Clause((Pattern("x*"),)), Clause((Pattern("a"), Pattern("?")), 2.0))
    for type, match in (
        ("x1", SubscriptionMatch(True, ())),
        ("a", SubscriptionMatch(False, ((1, (0, 1)),))),
        ("x", SubscriptionMatch(True, ((1, (1,)),))),
        ("yy", None),
    ):
        assert match_subscription(subscription, type, "A") == match
    assert match_subscription((), "x", "A") is None
    assert checked([([("", "B")], 0.0)]) == (Clause((Pattern("*", "B"),)),)  # an empty text is a star


@pytest.mark.parametrize(
    ("where", "clauses"),
    [
        ("[1].patterns", [([("a", "")], 0.0), ([], 0.0)]),
        ("[0].patterns", [([("a", "")] * 17, 0.0)]),
        ("[0].window", [([("a", "")], -1.0)]),
        ("[0].window", [([("a", "")], math.nan)]),
        ("[0].patterns[1].source", [([("a", ""), ("b", "x" * 201)], 0.0)]),
        ("[0].patterns[0].type", [([("x" * 201, "")], 0.0)]),
        ("", [([("a", "")], 0.0)] * 201),
    ],
)
def test_an_invalid_subscription_is_named(where: str, clauses: list[tuple[list[tuple[str, str]], float]]) -> None:
    with pytest.raises(InvalidSubscription) as refused:
        checked(clauses)
    assert refused.value.where == where


WANTED = st.sampled_from([("a", "*"), ("a*", "*"), ("b", "s"), ("b", "*"), ("c", ""), ("*", "*")])
SUBSCRIPTIONS = st.lists(st.tuples(st.lists(WANTED, min_size=1, max_size=3), st.just(0.0)), max_size=3)


class Subscribing(RuleBasedStateMachine):
    """The interest of a channel is the union of all subscriptions."""

    def __init__(self) -> None:
        super().__init__()
        self.interest = Interest()
        self.subscriptions: dict[str, Subscription] = {}

    @rule(consumer=st.sampled_from("123"), clauses=SUBSCRIPTIONS)
    def set(self, consumer: str, clauses: list[tuple[list[tuple[str, str]], float]]) -> None:
        self.subscriptions[consumer] = checked(clauses) if clauses else ()
        self.interest.set(consumer, self.subscriptions[consumer])

    @invariant()
    def is_the_union(self) -> None:
        everything = [pattern for each in self.subscriptions.values() for pattern in patterns_of(each)]
        assert self.interest.patterns() == union(everything)


TestSubscribing = Subscribing.TestCase
TestSubscribing.settings = settings(max_examples=30, stateful_step_count=12, deadline=None)
