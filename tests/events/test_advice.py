"""Which layout of channels is predicted to be the fastest, against a simulation of every call."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Sequence
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocorba.errors.events import TooFewEvents
from robocorba.events.advice import Demand, Model, advise, demand_between, layouts, replace_delays, waiting_s
from robocorba.events.traffic import ChannelTraffic, OriginTraffic

CALL_S, SERVICE_S = 0.0004, 0.0001
durations = st.floats(0.0, 0.02)


def demand(rates: Sequence[Sequence[float]], delays_s: Sequence[float], **changed: object) -> Demand:
    """rates: deliveries by origin and channel [1/s], one consumer each; delays_s: one-way delay of each link of a full
    mesh [s], by its names in order."""
    names = "abcdefgh"[: len(rates)]
    deliveries = {(a, b): rates[i][j] for i, a in enumerate(names) for j, b in enumerate(names)}
    events = {pair: rate if pair[0] != pair[1] else 0.0 for pair, rate in deliveries.items()}
    events |= {(a, a): sum(rates[i]) for i, a in enumerate(names)}
    round_trips_s = {link: CALL_S + 2 * s for link, s in zip(itertools.combinations(names, 2), delays_s, strict=False)}
    usual = {"consumers": dict.fromkeys(names, 1), "calls_s": dict.fromkeys(names, CALL_S)}
    usual |= {"services_s": dict.fromkeys(names, SERVICE_S), "base_s": CALL_S, "round_trips_s": round_trips_s}
    return replace(
        Demand(list(names), frozenset(round_trips_s), events, deliveries, {}, {}, {}, 0.0, {}), **{**usual, **changed}
    )  # type: ignore[arg-type]


@st.composite
def demands(draw: st.DrawFn) -> Demand:
    count = draw(st.integers(2, 4))
    rates = draw(
        st.lists(st.lists(st.floats(0.0, 50.0), min_size=count, max_size=count), min_size=count, max_size=count)
    )
    return demand(rates, draw(st.lists(durations, min_size=6, max_size=6)))


def latencies_s(one: Demand) -> dict[str, float]:
    now, centrals, others = layouts(one)
    return {layout.name: Model(one).predict(layout).latency_s for layout in (now, *centrals, *others)}


@given(demands(), st.data())
def test_a_longer_delay_makes_nothing_faster(one: Demand, data: st.DataObject) -> None:
    link = data.draw(st.sampled_from(sorted(one.round_trips_s)))
    longer = {**one.round_trips_s, link: one.round_trips_s[link] + data.draw(durations)}
    before, after = latencies_s(one), latencies_s(replace(one, round_trips_s=longer))
    for name, latency_s in before.items():
        if name in after:
            assert after[name] >= latency_s - 1e-12


@given(st.lists(st.floats(1.0, 50.0), min_size=2, max_size=4), st.lists(st.floats(1e-6, 0.02), min_size=6, max_size=6))
def test_where_all_events_are_local_a_central_channel_is_never_faster(
    local: list[float], delays_s: list[float]
) -> None:
    rates = [[rate if i == j else 0.0 for j in range(len(local))] for i, rate in enumerate(local)]
    advice = advise(demand(rates, delays_s))
    assert advice.now.latency_s < advice.central.latency_s
    assert (advice.verdict, advice.now.messages) in {("keep", 0.0), ("as good", 0.0)}
    assert advice.break_even_s == 0.0


@given(demands())
def test_the_break_even_is_where_both_are_as_fast(one: Demand) -> None:
    advice = advise(one)
    if advice.break_even_s:
        for factor, is_federation_faster in ((0.9, False), (1.1, True)):
            there = latencies_s(replace_delays(one, factor * advice.break_even_s))
            assert (there[advice.now.layout] <= there[advice.central.layout]) is is_federation_faster


RATES = [[40.0, 5.0, 3.0], [6.0, 30.0, 2.0], [4.0, 8.0, 20.0]]
DELAYS_S = {("a", "b"): 0.001, ("a", "c"): 0.004, ("b", "c"): 0.006}


@pytest.mark.parametrize("central", ["", "a", "c"])
def test_it_is_the_mean_of_all_calls_of_a_simulated_network(central: str) -> None:
    """Events at random times, each followed from call to call; a consumer takes one call at a time, with all events
    that wait."""
    chance, arrivals = random.Random(4), {name: list[tuple[float, float]]() for name in "abc"}

    def way_s(here: str, there: str) -> float:
        return CALL_S / 2 + (DELAYS_S[min(here, there), max(here, there)] if here != there else 0.0)

    for (i, a), (j, b) in itertools.product(enumerate("abc"), repeat=2):
        at = 0.0
        while (at := at + chance.expovariate(RATES[i][j])) < 2000.0:
            served = at + way_s(a, central or a) + SERVICE_S
            if not central and a != b:
                served += CALL_S / 2 + way_s(a, b) + SERVICE_S
            arrivals[b].append((served, at))
    total, count = 0.0, 0
    for consumer, events in arrivals.items():
        one_way_s, free_at, waiting = way_s(central or consumer, consumer), 0.0, sorted(events)
        while waiting:
            call_at = max(free_at, waiting[0][0])
            taken = [made for served, made in waiting[:100] if served <= call_at]
            del waiting[: len(taken)]
            total, count = total + sum(call_at + one_way_s - made for made in taken), count + len(taken)
            free_at = call_at + 2 * one_way_s
    predicted = latencies_s(demand(RATES, list(DELAYS_S.values())))
    name = f"one central channel in {central}" if central else "the federation as it is"
    assert predicted[name] == pytest.approx(total / count, rel=0.03)


def test_messages_are_counted_by_link_and_a_missing_link_is_bounded_by_the_way_around() -> None:
    one = demand(RATES, list(DELAYS_S.values()))
    published = sum(map(sum, RATES))
    chain = replace(one, links=frozenset({("a", "b"), ("b", "c")}))
    chain = replace(chain, round_trips_s={link: one.round_trips_s[link] for link in chain.links})
    advice = advise(chain)
    found = {each.layout: each for each in (advice.now, *advice.centrals, *advice.shapes)}
    # From a 5 to b, and the same copies for the 3 of c; from b 6 and 2; from c 8 to b, and 4 of them for a.
    assert advice.now.messages == pytest.approx((5 + 3 + 6 + 2 + 8 + 4) / published)
    assert found["a full mesh"].messages == pytest.approx((5 + 3 + 6 + 2 + 8 + 4) / published)
    at_a = (38 + 32) + (5 + 30 + 8) + (3 + 2 + 20)  # published elsewhere; delivered in b, in c
    assert found["one central channel in a"].messages == pytest.approx(at_a / published)
    assert {name for name, each in found.items() if each.is_bound} == {
        *("a full mesh", "a star around a", "a star around c", "b merged into a", "b merged into c"),
        *("one central channel in a", "one central channel in c"),
    }


def test_an_overloaded_central_channel_is_never_advised() -> None:
    busy = demand([[3000.0, 1.0], [1.0, 3000.0]], [0.0])
    advice = advise(busy)
    assert math.isinf(advice.central.latency_s) and advice.now.latency_s < 0.01
    assert advice.verdict == "keep"


@pytest.mark.parametrize(
    ("rates", "delay_s", "words"),
    [
        (
            [[80.0, 20.0], [20.0, 80.0]],
            0.005,
            "keep the federation: 0.22 of one central channel in a (1.61 ms to 7.45 ms)",
        ),
        ([[0.0, 1e-4], [0.0, 0.0]], 0.0, "one central channel in a would be faster, whatever the links' delay: now"),
        ([[10.0, 90.0], [90.0, 10.0]], 0.0, "one central channel in a would be faster below 1"),
        ([[90.0, 10.0], [10.0, 90.0]], 0.0, "as good: the federation takes 1."),
    ],
)
def test_the_sentence(rates: list[list[float]], delay_s: float, words: str) -> None:
    assert str(advise(demand(rates, [delay_s]))).startswith(words)


def traffic(clock_s: float, deliveries: dict[str, int], **changed: object) -> ChannelTraffic:
    origins = {name: OriginTraffic(count, count) for name, count in deliveries.items()}
    return ChannelTraffic(clock_s, origins, 2, CALL_S, CALL_S, SERVICE_S, 0.1, {})._replace(**changed)  # type: ignore[arg-type]


def test_the_demand_is_the_difference_of_two_measurements() -> None:
    before = {"lab": traffic(10.0, {"lab": 5}), "hall": traffic(99.0, {})}
    after = {
        "lab": traffic(20.0, {"lab": 205, "hall": 100, "foreign": 7}, round_trips_s={"hall": 0.002, "away": 1.0}),
        "hall": traffic(109.0, {}, call_s=0.0, round_trips_s={"lab": 0.004}),
    }
    found = demand_between(before, after)
    assert {pair: rate for pair, rate in found.deliveries.items() if rate} == {
        ("lab", "lab"): 20.0,
        ("hall", "lab"): 10.0,
    }
    assert found.round_trips_s == {("hall", "lab"): pytest.approx(0.003)}
    assert found.calls_s == {"lab": CALL_S, "hall": CALL_S}  # no consumer at hall was called
    restarted = {**before, "lab": traffic(10.0, {"lab": 900})}
    assert demand_between(restarted, after).deliveries["lab", "lab"] == 20.5
    with pytest.raises(TooFewEvents, match="4 were delivered in 10 s, 200 are needed") as refused:
        demand_between(before, {"lab": traffic(20.0, {"lab": 9}), "hall": traffic(109.0, {})})
    assert (refused.value.count, refused.value.needed) == (4, 200)


@given(st.floats(0.0, 1000.0), st.floats(0.0, 1.0))
def test_a_wait_is_at_most_half_a_call(rate: float, call_s: float) -> None:
    assert 0.0 <= waiting_s(rate, call_s) <= call_s / 2
