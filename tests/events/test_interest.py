"""The interest of a channel, against the union of all subscriptions."""

from __future__ import annotations

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from robocorba.events.interest import Interest
from robocorba.events.subscription import Subscription, checked, patterns_of, union

PATTERNS = st.sampled_from([("a", "*"), ("a*", "*"), ("b", "s"), ("b", "*"), ("c", ""), ("*", "*")])
SUBSCRIPTIONS = st.lists(st.tuples(st.lists(PATTERNS, min_size=1, max_size=3), st.just(0.0)), max_size=3)


class Subscribing(RuleBasedStateMachine):
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
