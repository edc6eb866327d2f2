"""Whole links on wires that lose, repeat and reorder packets and fail calls: nothing is lost, nothing comes twice."""

from __future__ import annotations

import random
import threading
from dataclasses import replace

import pytest

from robocorba.backoff import Backoff
from robocorba.events.links import LinkSnapshot
from robocorba.events.policies import LinkPolicy
from robocorba.testing.processes import eventually
from tests.events.network import Consumer, Network, Weather
from tests.events.samples import is_balanced
from tests.waits import pause, stays

#: Shorter intervals than the defaults.
QUICK = LinkPolicy(
    renew_interval_s=0.02, retransmit_s=0.02, recheck_s=0.02, probe_interval_s=0.05, backoff=Backoff(0.05, 0.05)
)


def stormy(seed: int) -> Weather:
    return Weather(seed, lost=0.1, twice=0.1, late=0.1, fails=0.05)


def states(network: Network) -> list[LinkSnapshot]:
    return [state for node in network.nodes.values() for state in node.links.snapshots()]


def link(network: Network, *shape: str, consuming: str) -> dict[str, Consumer]:
    """Link nodes, and wait until all know all links and what the consumers want, one at each of these nodes."""
    network.link(*shape)
    consumers = {name: network[name].consume("t") for name in consuming}
    wanted = {frozenset(pair) for pair in shape}

    def is_known() -> bool:
        for node in network.nodes.values():
            with node.channel.lock:
                known = {entry.name: entry.peers for entry in node.channel.federation.advertisements}
            links = {frozenset((a, b)) for a, peers in known.items() for b in peers if a in known.get(b, ())}
            if links != wanted or any(node.knows(name) != ("t",) for name in consuming):
                return False
        return True

    eventually(is_known, what="all links and the interest everywhere")
    return consumers


def check(network: Network, consumers: dict[str, Consumer], supplied: dict[str, list[str]]) -> None:
    """Each consumer gets what each node has supplied, in order, and nothing else."""
    total = sum(map(len, supplied.values()))
    for consumer in consumers.values():
        eventually(lambda consumer=consumer: len(consumer.read()) >= total, what="all events")
    stays(lambda: all(len(consumer.read()) == total for consumer in consumers.values()))
    for consumer in consumers.values():
        for origin, payloads in supplied.items():
            assert [text for text in consumer.got if text.startswith(origin)] == payloads
    for state in states(network):
        assert is_balanced(state.feed.totals) and is_balanced(state.gateway.totals)


@pytest.mark.parametrize("seed", range(6))
def test_each_event_comes_once_and_in_order(seed: int) -> None:
    """Also while a consumer changes what else it wants."""
    weather, chance = stormy(seed), random.Random(seed)
    with Network("A", "B", "C", weather=weather, policy=QUICK) as network:
        consumers = link(network, "AB", "BC", consuming="BC")
        supplied = [f"A{number}" for number in range(300)]
        for number, payload in enumerate(supplied):
            network["A"].publish(payload)
            if number % 10 == 0:
                consumers["B"].change("t", f"x{number}")
                pause(chance.uniform(0, 0.02))
        weather.clear_up()
        check(network, consumers, {"A": supplied})
        eventually(lambda: network["A"].links.snapshots()[0].feed.totals.queued == 0, what="the last acknowledgement")
        assert network["A"].links.snapshots()[0].feed.totals.received == 300


@pytest.mark.parametrize("shape", [("AB", "BC", "CA"), ("AB", "AC", "BD", "CD"), ("AB", "AC", "AD", "BC", "BD", "CD")])
def test_with_several_paths_each_event_arrives_once(shape: tuple[str, ...]) -> None:
    weather, names = stormy(7), sorted(set("".join(shape)))
    supplied = {name: [f"{name}{number}" for number in range(100)] for name in names}
    with Network(*names, weather=weather, policy=QUICK) as network:
        consumers = link(network, *shape, consuming="".join(names))

        def talk(name: str) -> None:
            for payload in supplied[name]:
                network[name].publish(payload, source=name)
                pause(0.001)

        speakers = [threading.Thread(target=talk, args=(name,)) for name in names]
        for speaker in speakers:
            speaker.start()
        for speaker in speakers:
            speaker.join(30)
        weather.clear_up()
        check(network, consumers, supplied)


def test_a_restart_at_any_moment_repeats_nothing_and_the_rest_arrives() -> None:
    weather = stormy(11)
    with Network("A", "B", weather=weather, policy=QUICK) as network:
        consumer = link(network, "AB", consuming="B")["B"]
        got: list[str] = []
        for number in range(200):
            network["A"].publish(f"{number:03}")
            if number % 40 == 39:
                got += consumer.read()
                consumer = network.restart("B", "t").consumers[0]
        weather.clear_up()
        network["A"].publish("last")
        eventually(lambda: consumer.read()[-1:] == ["last"], what="the last event")
        got += consumer.read()
        assert got == sorted(set(got))


def test_the_supplying_end_restarts_and_its_events_are_new() -> None:
    with Network("A", "B", policy=QUICK) as network:
        consumer = link(network, "AB", consuming="B")["B"]
        eventually(lambda: network["B"].links.is_in_force(consumer.proxy, "A"), what="the interest at A, on its disk")
        network["A"].publish("before")
        eventually(lambda: consumer.read() == ["before"], what="the first event")
        network.restart("A").publish("after")  # no peer has sent the interest of B yet: it is in the store
        eventually(lambda: consumer.read() == ["before", "after"], what="the second event")


def test_both_ends_agree_that_a_link_is_down_where_one_of_them_cannot_be_called() -> None:
    """As behind a firewall: B can call A, and A can't call B."""
    with Network("A", "B", policy=replace(QUICK, lease_s=0.2, silence_s=0.2)) as network:
        consumer = link(network, "AB", consuming="B")["B"]

        def conditions() -> list[bool]:
            return [end.is_up for state in states(network) for end in (state.feed, state.gateway)]

        eventually(lambda: conditions() == [True] * 4, what="the link")
        network.refused.add(("A", "B"))
        network["A"].publish("1")
        eventually(lambda: conditions() == [False] * 4, what="the link to be down at both ends")
        stays(lambda: not any(conditions()), 0.4)  # while B renews its session with A again and again
        at_a, at_b = states(network)
        assert (at_a.feed.problem, at_a.gateway.problem) == ("B is away", "B is away")
        assert "nothing that it sends has arrived" in at_b.gateway.problem
        assert "has not called" in at_b.feed.problem
        assert not network["B"].links.is_in_force(consumer.proxy, "A")
        network.refused.clear()
        eventually(lambda: conditions() == [True] * 4, what="the link again")
        eventually(lambda: consumer.read() == ["1"], what="what waited")


def test_what_waits_for_a_link_that_is_down_goes_by_the_other_way() -> None:
    """And by the shorter way again when it is up."""
    with Network("A", "B", "C", policy=replace(QUICK, lease_s=0.2, silence_s=0.5)) as network:
        consumers = link(network, "AB", "BC", "CA", consuming="ABC")
        eventually(lambda: all(state.feed.is_up for state in states(network)), what="all links")
        published: dict[str, list[str]] = {name: [] for name in "ABC"}

        def publish(count: int) -> None:
            for _ in range(count):
                for name in "ABC":
                    published[name].append(f"{name}{len(published[name])}")
                    network[name].publish(published[name][-1])
                pause(0.001)

        def all_came() -> bool:
            return all(len(consumer.read()) == sum(map(len, published.values())) for consumer in consumers.values())

        for _ in range(2):
            publish(100)
            network.cut.add(frozenset("AB"))
            publish(100)
            eventually(all_came, what="all events by way of C")
            network.cut.clear()
        eventually(lambda: all(state.feed.is_up for state in states(network)), what="all links again")
        publish(1)
        check(network, consumers, published)
        assert network["C"].channel.feeds["B"].account.delivered >= 400 + 200, "those of C, and those of A meanwhile"
        eventually(lambda: all(not state.feed.totals.queued for state in states(network)), what="all acknowledged")


def test_interest_follows_consumers() -> None:
    with Network("A", "B", "C", policy=QUICK) as network:
        network.link("AB", "BC")
        first = network["C"].consume("a")
        eventually(lambda: network["A"].knows("C") == ("a",), what="a")
        second = network["C"].consume("b", "a.*")
        eventually(lambda: network["A"].knows("C") == ("a", "a.*", "b"), what="a and b")
        first.leave()
        eventually(lambda: network["A"].knows("C") == ("a.*", "b"), what="without the first")
        second.change("b")
        eventually(lambda: network["A"].knows("C") == ("b",), what="the change")
        assert network["A"].knows("B") == ()  # a gateway never counts
        second.leave()
        eventually(lambda: network["A"].knows("C") == (), what="nothing")
        network["A"].publish("x", type="b")
        stays(lambda: [state.feed.totals.received for state in network["A"].links.snapshots()] == [0])
        assert [state.gateway.packets for state in network["B"].links.snapshots()] == [0, 0]
