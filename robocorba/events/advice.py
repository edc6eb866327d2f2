"""Which layout of its channels would serve a federation best, predicted from what the channels have measured.

An event arrives after half the round trip of each call on its way; each channel on the way takes its service time,
more of it the busier it is. A channel calls a consumer again when it has answered, so the next event waits meanwhile:
long round trips cost more than their length. Layouts differ in where the channels of the sub-networks are (a central
channel serves all, across the links) and which of them are linked.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Any, NamedTuple

import networkx

from robocorba.errors.events import TooFewEvents
from robocorba.events.traffic import ChannelTraffic, OriginTraffic

#: Layouts whose latencies differ by less than this share are as good.
AS_GOOD = 0.15
#: Deliveries that a measurement needs: the mean of fewer depends on chance.
MIN_DELIVERIES = 200
#: With more channels only central ones are compared, since the number of other layouts increases with the square.
MAX_COMPARED = 16
#: Link delays beyond this are not looked at when the one is searched at which two layouts are as fast [s].
MAX_DELAY_S = 1.0

Pair = tuple[str, str]


@dataclass(frozen=True)
class Demand:
    """What a federation carries.

    links: with the names of each in order. events, deliveries: by the channel where they originate and the one that has
    the consumers [1/s]; events of (a, a): all that are published at a. consumers, calls_s (the mean duration of a call
    to one of them), services_s: by channel. base_s: the shortest call within a sub-network [s]. round_trips_s: the
    shortest over a link, with its names in order: what it is longer than base_s is the link's delay."""

    channels: Sequence[str]
    links: frozenset[Pair]
    events: Mapping[Pair, float]
    deliveries: Mapping[Pair, float]
    consumers: Mapping[str, int]
    calls_s: Mapping[str, float]
    services_s: Mapping[str, float]
    base_s: float
    round_trips_s: Mapping[Pair, float]


class Layout(NamedTuple):
    """home: the channel that serves the clients of each sub-network, which has the name of its channel now."""

    name: str
    home: Mapping[str, str]
    links: frozenset[Pair]


class Prediction(NamedTuple):
    """latency_s: mean of all deliveries [s], infinite if a channel would be overloaded or not be reached. messages:
    those over links, for each published event; more where the channels behind a link want different events. is_bound:
    the delay of a link that does not exist yet was taken as that of the way around."""

    layout: str
    latency_s: float
    messages: float
    is_bound: bool


class Advice(NamedTuple):
    """now: the federation as it is. centrals, shapes: with one central channel, and others, best first.
    break_even_s: the one-way link delay from which on the federation is faster than `central` [s]; None if it never is
    below MAX_DELAY_S, 0 if always."""

    now: Prediction
    centrals: Sequence[Prediction]
    shapes: Sequence[Prediction]
    break_even_s: float | None

    @property
    def central(self) -> Prediction:
        return self.centrals[0]

    @property
    def best(self) -> Prediction:
        """What the federation is compared with: the best central channel, or another shape that is faster than both."""
        good_s = (1.0 - AS_GOOD) * min(self.now.latency_s, self.central.latency_s)
        return next((shape for shape in self.shapes if shape.latency_s < good_s), self.central)

    @property
    def ratio(self) -> float:
        """The federation's latency to that of the best other layout; 0 if all others are overloaded."""
        return self.now.latency_s / self.best.latency_s if self.best.latency_s < math.inf else 0.0

    @property
    def verdict(self) -> str:
        """ "keep", "change" to the best other layout, or "as good"."""
        if self.ratio < 1.0 - AS_GOOD:
            return "keep"
        return "change" if self.ratio > 1.0 + AS_GOOD else "as good"

    def __str__(self) -> str:
        both = f"({_ms(self.now)} to {_ms(self.best)})"
        if self.verdict == "as good":
            return f"as good: the federation takes {self.ratio:.2f} of {self.best.layout} {both}, within {AS_GOOD:.0%}"
        even_ms = 1e3 * (self.break_even_s or 0.0)
        until = f"; {self.central.layout} would be faster below {even_ms:.2g} ms of link delay" if even_ms else ""
        if self.verdict == "keep":
            return f"keep the federation: {self.ratio:.2f} of {self.best.layout} {both}{until}"
        below = f" below {even_ms:.2g} ms of link delay" if even_ms else ", whatever the links' delay"
        below = below if self.best is self.central else ""
        return f"{self.best.layout} would be faster{below}: now the federation takes {self.ratio:.2f} of it {both}"


def demand_between(before: Mapping[str, ChannelTraffic], after: Mapping[str, ChannelTraffic]) -> Demand:
    """The traffic of a federation between two measurements of its channels, by name. Raises TooFewEvents."""
    channels = sorted(before.keys() & after.keys())
    events, deliveries, total, seconds, none = {}, {}, 0, 0.0, OriginTraffic()
    for here in channels:
        seconds = after[here].clock_s - before[here].clock_s
        for origin in channels:
            earlier, later = (traffic[here].origins.get(origin, none) for traffic in (before, after))
            if later.events < earlier.events:
                earlier = none  # the channel was restarted meanwhile
            events[origin, here] = (later.events - earlier.events) / seconds
            deliveries[origin, here] = (later.deliveries - earlier.deliveries) / seconds
            total += later.deliveries - earlier.deliveries
    if total < MIN_DELIVERIES:
        raise TooFewEvents(max(0, total), seconds, MIN_DELIVERIES)

    def measured(what: str) -> dict[str, float]:
        """A duration by channel; where no event has come yet, that of the others."""
        found = {here: getattr(after[here], what) for here in channels}
        known = [one for one in found.values() if one]
        return {here: one or sum(known) / (len(known) or 1) for here, one in found.items()}

    ends: dict[Pair, list[float]] = {}
    for here in channels:
        for peer in after[here].round_trips_s.keys() & set(channels):
            ends.setdefault(_pair(here, peer), []).append(after[here].round_trips_s[peer])
    return Demand(
        channels,
        frozenset(ends),
        events,
        deliveries,
        {here: after[here].consumers for here in channels},
        measured("call_s"),
        measured("service_s"),
        min((after[here].fastest_s for here in channels if after[here].fastest_s), default=0.0),
        {link: sum(both) / len(both) for link, both in ends.items()},
    )


def advise(demand: Demand) -> Advice:
    """Compare the federation as it is with other layouts. There are at least two channels."""
    model, (now, centrals, shapes) = Model(demand), layouts(demand)
    predicted = {layout.name: model.predict(layout) for layout in (*centrals, *shapes)}

    for several in (centrals, shapes):
        several.sort(key=lambda layout: predicted[layout.name].latency_s)
    central, shaped = ([predicted[layout.name] for layout in several] for several in (centrals, shapes))
    return Advice(model.predict(now), central, shaped, _break_even_s(demand, now, centrals[0]))


def layouts(demand: Demand) -> tuple[Layout, list[Layout], list[Layout]]:
    """The federation as it is, those with one central channel, and others."""
    channels, itself = demand.channels, {name: name for name in demand.channels}
    now = Layout("the federation as it is", itself, demand.links)
    centrals = [
        Layout(f"one central channel in {place}", dict.fromkeys(channels, place), frozenset()) for place in channels
    ]
    shapes: list[Layout] = []
    if 2 < len(channels) <= MAX_COMPARED:
        mesh = frozenset(combinations(channels, 2))
        stars = ((f"a star around {hub}", frozenset(_pair(hub, a) for a in channels if a != hub)) for hub in channels)
        ring = frozenset(map(_pair, channels, [*channels[1:], channels[0]]))
        for name, links in (("a full mesh", mesh), *stars, ("a ring by name", ring)):
            if links not in (demand.links, *(shape.links for shape in shapes)):
                shapes.append(Layout(name, itself, links))
        for a, b in sorted(demand.links):
            for kept, gone in ((a, b), (b, a)):
                home = {**itself, gone: kept}
                links = frozenset(_pair(home[x], home[y]) for x, y in demand.links if home[x] != home[y])
                shapes.append(Layout(f"{gone} merged into {kept}", home, links))
    return now, centrals, shapes


class Model:
    """Predicts what a layout would do with a demand."""

    def __init__(self, demand: Demand) -> None:
        self._demand = demand
        #: What a hop between channels takes without a delay [s]: a call's time, as bench.events.advice measured.
        self._hop_s = min(demand.calls_s.values(), default=0.0)
        measured: Any = networkx.Graph()
        measured.add_weighted_edges_from((*link, round_trip_s) for link, round_trip_s in demand.round_trips_s.items())
        measured.add_nodes_from(demand.channels)
        #: By channel: the shortest round trip to each other one by links that have been measured [s].
        self._around_s = dict(networkx.all_pairs_dijkstra_path_length(measured))
        self._rate_of_one = {
            there: sum(demand.deliveries[origin, there] for origin in demand.channels) / max(1, demand.consumers[there])
            for there in demand.channels
        }

    def predict(self, layout: Layout) -> Prediction:
        demand, home = self._demand, layout.home
        graph = networkx.Graph(sorted(layout.links))  # sorted, it chooses among paths as federation.py does
        graph.add_nodes_from(home.values())
        paths = dict(networkx.all_pairs_shortest_path(graph))
        crossing, load = self._messages(home, paths)
        latency, total = 0.0, 0.0
        for (origin, there), rate in demand.deliveries.items():
            start, end = home[origin], home[there]
            if not rate:
                continue
            if end not in paths[start]:
                return Prediction(layout.name, math.inf, math.inf, False)
            call_s = demand.calls_s[there] + self._delay_s(there, end)
            event_s = (demand.calls_s[origin] + self._delay_s(origin, start) + call_s) / 2 + self._service_s(
                start, load
            )
            for here, peer in pairwise(paths[start][end]):
                event_s += self._hop_s + self._delay_s(here, peer) / 2 + self._service_s(peer, load)
            latency += rate * (event_s + waiting_s(self._rate_of_one[there], call_s))
            total += rate
        used = {*layout.links, *(_pair(name, place) for name, place in home.items() if name != place)}
        published = sum(demand.events[name, name] for name in home)
        is_bound = not used <= demand.round_trips_s.keys()
        return Prediction(layout.name, latency / (total or 1.0), crossing / (published or 1.0), is_bound)

    def _messages(
        self, home: Mapping[str, str], paths: Mapping[str, Mapping[str, Sequence[str]]]
    ) -> tuple[float, dict[str, float]]:
        """Messages that cross links [1/s], and those that each channel handles: events that come, and deliveries."""
        demand, crossing, load = self._demand, 0.0, defaultdict[str, float](float)
        for origin in demand.channels:
            published = demand.events[origin, origin]
            load[home[origin]] += published
            crossing += published * (home[origin] != origin)
            over = defaultdict[Pair, float](float)
            for there in demand.channels:
                delivered, wanted = demand.deliveries[origin, there], demand.events[origin, there]
                load[home[there]] += delivered
                crossing += delivered * (home[there] != there)
                # One copy crosses a link, for all channels behind it that want it.
                for link in pairwise(paths[home[origin]].get(home[there], ())):
                    over[link] = max(over[link], wanted)
            for (_, peer), rate in over.items():
                load[peer] += rate
                crossing += rate
        return crossing, load

    def _service_s(self, channel: str, load: Mapping[str, float]) -> float:
        """The time that an event spends in a channel with this load [1/s], as in a queue with one server."""
        service_s = self._demand.services_s[channel]
        busy = service_s * load[channel]
        return service_s / (1.0 - busy) if busy < 1.0 else math.inf

    def _delay_s(self, here: str, there: str) -> float:
        """What a round trip between two sub-networks takes more than one within."""
        if here == there:
            return 0.0
        around_s = self._around_s[here].get(there, math.inf)
        return max(0.0, self._demand.round_trips_s.get(_pair(here, there), around_s) - self._demand.base_s)


def waiting_s(rate: float, call_s: float) -> float:
    """The mean time [s] that an event waits for the call before it, if events for a consumer come at random at a rate
    [1/s], a call takes call_s and delivers all that wait: half a call if one is under way. Calls follow each other
    until one has left no event waiting, which has the chance exp(-rate * call_s)."""
    if rate * call_s > 50.0:
        return call_s / 2
    busy_s = call_s * math.exp(rate * call_s)
    return call_s / 2 * rate * busy_s / (1.0 + rate * busy_s)


def _break_even_s(demand: Demand, now: Layout, central: Layout) -> float | None:
    """The link delay from which on the federation is as fast as one central channel, were it the same on all links."""

    def is_federation_faster(delay_s: float) -> bool:
        model = Model(replace_delays(demand, delay_s))
        return model.predict(now).latency_s <= model.predict(central).latency_s

    if is_federation_faster(0.0):
        return 0.0
    low, high = 0.0, MAX_DELAY_S
    if not is_federation_faster(high):
        return None
    for _ in range(24):
        middle = (low + high) / 2
        low, high = (low, middle) if is_federation_faster(middle) else (middle, high)
    return high


def replace_delays(demand: Demand, delay_s: float) -> Demand:
    """The same demand on links with this one-way delay, between all channels [s]."""
    round_trip_s = demand.base_s + 2 * delay_s
    return replace(demand, round_trips_s=dict.fromkeys(combinations(demand.channels, 2), round_trip_s))


def _pair(a: str, b: str) -> Pair:
    return (a, b) if a < b else (b, a)


def _ms(prediction: Prediction) -> str:
    return f"{'at most ' if prediction.is_bound else ''}{1e3 * prediction.latency_s:.2f} ms"
