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


def check_accounts(network: Network) -> None:
    for node in network.nodes.values():
        for state in node.links.snapshots():
            assert is_balanced(state.feed.totals) and is_balanced(state.gateway.totals)


def all_know(network: Network, name: str, *types: str) -> bool:
    return all(node.knows(name) == types for node in network.nodes.values())


@pytest.mark.parametrize("seed", range(6))
def test_each_event_comes_once_and_in_order(seed: int) -> None:
    weather = stormy(seed)
    with Network("A", "B", "C", weather=weather, policy=QUICK) as network:
        network.link("AB", "BC")
        far = network["C"].consume("t")
        near = network["B"].consume("t")
        eventually(lambda: all_know(network, "C", "t") and all_know(network, "B", "t"), what="the interest everywhere")
        chance = random.Random(seed)
        for number in range(300):
            network["A"].publish(f"{number}")
            if number % 10 == 0:
                pause(chance.uniform(0, 0.02))
        weather.clear_up()
        expected = [str(number) for number in range(300)]
        eventually(lambda: len(far.read()) >= 300 and len(near.read()) >= 300, what="all events")
        stays(lambda: far.read() == near.read() == expected)

        feed_of_b = network["A"].links.snapshots()[0].feed
        eventually(lambda: network["A"].links.snapshots()[0].feed.totals.queued == 0, what="the last acknowledgement")
        assert feed_of_b.totals.received == 300
        check_accounts(network)


@pytest.mark.parametrize("shape", [("AB", "BC", "CA"), ("AB", "AC", "BD", "CD"), ("AB", "AC", "AD", "BC", "BD", "CD")])
def test_with_several_paths_each_event_arrives_once(shape: tuple[str, ...]) -> None:
    weather = stormy(7)
    names = sorted(set("".join(shape)))
    with Network(*names, weather=weather, policy=QUICK) as network:
        network.link(*shape)
        consumers = {name: network[name].consume("t") for name in names}
        eventually(lambda: all(all_know(network, name, "t") for name in names), what="the interest everywhere")
        _wait_links_known(network, shape)

        def talk(name: str) -> None:
            for number in range(100):
                network[name].publish(f"{name}{number}", source=name)
                pause(0.001)

        speakers = [threading.Thread(target=talk, args=(name,)) for name in names]
        for speaker in speakers:
            speaker.start()
        for speaker in speakers:
            speaker.join(30)
        weather.clear_up()
        _check_all(consumers, {name: [f"{name}{number}" for number in range(100)] for name in names})
        check_accounts(network)


def test_a_restart_at_any_moment_repeats_nothing_and_the_rest_arrives() -> None:
    weather = stormy(11)
    with Network("A", "B", weather=weather, policy=QUICK) as network:
        network.link("AB")
        consumer = network["B"].consume("t")
        eventually(lambda: all_know(network, "B", "t"), what="the interest at A")
        got: list[str] = []
        for round_ in range(5):
            for number in range(40):
                network["A"].publish(f"{round_}.{number}")
            got += consumer.read()
            consumer = network.restart("B", "t").consumers[0]
        weather.clear_up()
        network["A"].publish("last")
        eventually(lambda: consumer.read()[-1:] == ["last"], what="the last event")
        got += consumer.read()
        assert len(got) == len(set(got))
        assert got == sorted(got, key=lambda text: [int(part) for part in text.split(".")] if text != "last" else [99])


def test_the_supplying_end_restarts_and_its_events_are_new() -> None:
    with Network("A", "B", policy=QUICK) as network:
        network.link("AB")
        consumer = network["B"].consume("t")
        eventually(lambda: network["B"].links.is_in_force(consumer.proxy, "A"), what="the interest at A, on its disk")
        network["A"].publish("before")
        eventually(lambda: consumer.read() == ["before"], what="the first event")
        network.restart("A").publish("after")  # no peer has sent the interest of B yet: it is in the store
        eventually(lambda: consumer.read() == ["before", "after"], what="the second event")


def test_a_link_that_was_cut_delivers_its_queue() -> None:
    with Network("A", "B", policy=QUICK) as network:
        network.link("AB")
        consumer = network["B"].consume("t")
        eventually(lambda: all_know(network, "B", "t"), what="the interest at A")
        network.cut.add(frozenset("AB"))
        for number in range(50):
            network["A"].publish(str(number))
        eventually(lambda: network["A"].links.snapshots()[0].gateway.problem == "B is away", what="a reported problem")
        assert consumer.read() == []
        network.cut.clear()
        eventually(lambda: len(consumer.read()) >= 50, what="what waited")
        assert consumer.read() == [str(number) for number in range(50)]


def test_both_ends_agree_that_a_link_is_down_where_one_of_them_cannot_be_called() -> None:
    """As behind a firewall: B can call A, and A can't call B."""
    with Network("A", "B", policy=replace(QUICK, lease_s=0.2, silence_s=0.2)) as network:
        network.link("AB")
        consumer = network["B"].consume("t")
        eventually(lambda: all_know(network, "B", "t"), what="the interest at A")

        def conditions() -> list[bool]:
            states = [state for node in network.nodes.values() for state in node.links.snapshots()]
            return [end.is_up for state in states for end in (state.feed, state.gateway)]

        eventually(lambda: conditions() == [True] * 4, what="the link")
        network.refused.add(("A", "B"))
        network["A"].publish("1")
        eventually(lambda: conditions() == [False] * 4, what="the link to be down at both ends")
        stays(lambda: not any(conditions()), 0.4)  # while B renews its session with A again and again
        at_a, at_b = (network[name].links.snapshots()[0] for name in "AB")
        assert (at_a.feed.problem, at_a.gateway.problem) == ("B is away", "B is away")
        assert "nothing that it sends has arrived" in at_b.gateway.problem
        assert "has not called" in at_b.feed.problem
        assert not network["B"].links.is_in_force(consumer.proxy, "A")
        network.refused.clear()
        eventually(lambda: conditions() == [True] * 4, what="the link again")
        eventually(lambda: consumer.read() == ["1"], what="what waited")


@pytest.mark.parametrize("slow", ["OP", "PT"])
def test_a_direct_link_that_is_added_loses_nothing_of_what_waits_on_the_way(slow: str) -> None:
    with Network("O", "P", "T", policy=QUICK) as network:
        network.link("OP", "PT")
        consumer = network["T"].consume("t")
        eventually(lambda: all_know(network, "T", "t"), what="the interest everywhere")
        _wait_links_known(network, ("OP", "PT"))
        network["O"].publish("first")
        eventually(lambda: consumer.read() == ["first"], what="the first event")
        network.cut.add(frozenset(slow))
        for number in range(1000):
            network["O"].publish(str(number))
        if slow == "PT":
            eventually(lambda: network["O"].channel.feeds["P"].account.delivered == 1001, what="all events at P")
        network.link("OT")
        eventually(lambda: "T" in network["O"].channel.feeds and network["O"].channel.feeds["T"].is_up, what="the link")
        network["O"].publish("new")
        eventually(lambda: "new" in consumer.read(), what="an event by the new link")
        network.cut.clear()
        eventually(lambda: len(consumer.read()) >= 1002, what="all events")
        stays(lambda: len(consumer.read()) == 1002)
        assert consumer.got == ["first", *map(str, range(1000)), "new"]
        check_accounts(network)


def test_what_waits_for_a_link_that_is_down_goes_by_the_other_way() -> None:
    """And by the shorter way again when it is up."""
    with Network("A", "B", "C", policy=replace(QUICK, lease_s=0.2, silence_s=0.5)) as network:
        network.link("AB", "BC", "CA")
        consumers = {name: network[name].consume("t") for name in "ABC"}
        eventually(lambda: all(all_know(network, name, "t") for name in "ABC"), what="the interest everywhere")
        _wait_links_known(network, ("AB", "BC", "CA"))
        eventually(lambda: all(state.feed.is_up for state in _states(network)), what="all links")
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
        eventually(lambda: all(state.feed.is_up for state in _states(network)), what="all links again")
        publish(1)
        _check_all(consumers, published)
        check_accounts(network)
        assert network["C"].channel.feeds["B"].account.delivered >= 400 + 200, "those of C, and those of A meanwhile"
        eventually(lambda: all(not state.feed.totals.queued for state in _states(network)), what="all acknowledged")


def _states(network: Network) -> list[LinkSnapshot]:
    return [state for node in network.nodes.values() for state in node.links.snapshots()]


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


def test_a_change_of_subscription_loses_no_event_that_both_match() -> None:
    with Network("A", "B", policy=QUICK) as network:
        network.link("AB")
        consumer = network["B"].consume("kept", "x0")
        eventually(lambda: network["A"].knows("B") == ("kept", "x0"), what="the interest at A")
        stop = threading.Event()
        supplied: list[str] = []

        def talk() -> None:
            while not stop.is_set():
                supplied.append(str(len(supplied)))
                network["A"].publish(supplied[-1], type="kept")
                pause(0.0005)

        speaker = threading.Thread(target=talk)
        speaker.start()
        for number in range(100):
            consumer.change("kept", f"x{number}")
        stop.set()
        speaker.join(60.0)
        eventually(lambda: len(consumer.read()) >= len(supplied), what="all events")
        assert consumer.read() == supplied


def _wait_links_known(network: Network, shape: tuple[str, ...]) -> None:
    def known() -> bool:
        wanted = sorted("".join(sorted(pair)) for pair in shape)
        for node in network.nodes.values():
            with node.channel.lock:
                advertised = {n.name: n.peers for n in node.channel.federation.advertisements}
            links = sorted(
                a + b for a, peers in advertised.items() for b in peers if a < b and a in advertised.get(b, ())
            )
            if links != wanted:
                return False
        return True

    eventually(known, what="all links known everywhere")


def _check_all(consumers: dict[str, Consumer], supplied: dict[str, list[str]]) -> None:
    total = sum(map(len, supplied.values()))
    for consumer in consumers.values():
        eventually(lambda consumer=consumer: len(consumer.read()) >= total, what="all events")
    stays(lambda: all(len(consumer.read()) == total for consumer in consumers.values()))
    for consumer in consumers.values():
        for origin, payloads in supplied.items():
            assert [text for text in consumer.got if text.startswith(origin)] == payloads
