"""Channels of one process, linked without an ORB: the same feeds, gateways and links, over wires that can fail."""

from __future__ import annotations

import contextlib
import random
import tempfile
import threading
import time
from pathlib import Path

from robocorba.errors.events import NotDelivered, SessionOver
from robocorba.errors.services import NotReachable
from robocorba.events.account import Account
from robocorba.events.channel import Channel
from robocorba.events.channel_store import ChannelStore, Peer
from robocorba.events.event import EventBatch
from robocorba.events.event_numbers import life_of
from robocorba.events.federation import Advertisement, Federation
from robocorba.events.foreign import Attach
from robocorba.events.links import Links
from robocorba.events.peer_clock import Exchange
from robocorba.events.policies import LinkPolicy
from robocorba.events.proxy_supplier import ProxyPullSupplier
from robocorba.events.seen_events import SeenEvents
from tests.events.samples import is_balanced, pull_supplier_of, pulled, supplied, wanting

DEFAULTS = LinkPolicy()


class Weather:
    """How bad the wires are: chances that a message is lost or comes twice, that a call fails before or after it was
    carried out."""

    def __init__(self, seed: int = 0, lost: float = 0.0, twice: float = 0.0, late: float = 0.0, fails: float = 0.0):
        self.lost, self.twice, self.late, self.fails = lost, twice, late, fails
        self._random = random.Random(seed)
        self._lock = threading.Lock()

    def clear_up(self) -> None:
        self.lost = self.twice = self.late = self.fails = 0.0

    def strikes(self, chance: float) -> bool:
        with self._lock:
            return self._random.random() < chance


class Node:
    """A channel with its links, on a machine of its own. booted_s: its monotonic clock is ahead of that of the test, as
    machines do not boot at the same time."""

    def __init__(self, network: Network, name: str, folder: Path) -> None:
        self.name, self.network = name, network
        self.booted_s = 1000.0 * len(network.nodes)
        self.store, self.seen = ChannelStore(folder / f"{name}.sqlite"), SeenEvents(folder / f"{name}.seen")
        first_number = self.store.first_number()
        federation = Federation(name, self.store.advertisements(), life_of(first_number))
        self.channel = Channel(federation, self.seen, first_number)
        self.links = Links(self.channel, self.store, self._join, self._no_foreign, network.policy)
        self.account = Account()
        self.consumers: list[Consumer] = []

    def publish(self, *payloads: str, type: str = "t", source: str = "s") -> None:
        encoded = (payload.encode() for payload in payloads)
        self.channel.publish(supplied(type, *encoded, source=source), self.account)

    def consume(self, *types: str) -> Consumer:
        """A consumer of this node's own."""
        self.consumers.append(Consumer(self, pull_supplier_of(self.channel, wanting(*types), 1_000_000)))
        self.links.send_advertisements()
        return self.consumers[-1]

    def knows(self, name: str) -> tuple[str, ...]:
        """The types that another channel wants, as far as this one knows."""
        with self.channel.lock:
            return tuple(pattern.type for pattern in self.channel.federation.interest_of(name))

    def close(self) -> None:
        """Its accounts are exact at that moment, as at any other."""
        for link in self.links.snapshots():
            for totals in (link.feed.totals, link.gateway.totals):
                assert is_balanced(totals), (self.name, link)
        self.links.close()
        self.seen.__exit__(None, None, None)
        self.store.__exit__(None, None, None)

    def _join(self, record: Peer) -> tuple[FeedWire, str]:
        there, sent = self.network.reach(self.name, record.name), time.monotonic()
        terms = there.links.join(self.name, self.name, GatewayWire(self.network, there.name, self.name).forward)
        if self.network.weather.strikes(self.network.weather.fails):
            raise NotReachable("the answer was lost")
        wire = FeedWire(self.network, self.name, there.name, *terms)
        wire.joining = wire.exchange(sent, there)
        return wire, record.name

    @staticmethod
    def _no_foreign(record: Peer) -> Attach:
        raise AssertionError(record)


class Consumer:
    """What a consumer got, in order."""

    def __init__(self, node: Node, proxy: ProxyPullSupplier) -> None:
        self.node, self.proxy = node, proxy
        self.got: list[str] = []

    def read(self) -> list[str]:
        self.got += [batch.payloads[0].decode() for batch in pulled(self.proxy)]
        return self.got

    def change(self, *types: str) -> None:
        with self.node.channel.lock:
            self.proxy.select(wanting(*types))
            changed = self.node.channel.update_routes()
        if changed:
            self.node.links.send_advertisements()


def _copy(batch: EventBatch, epoch: float) -> EventBatch:
    copy = batch.toward(dict(batch.targets or {}))
    copy.epoch = epoch
    return copy


class GatewayWire:
    """A feed's connection to the gateway of `there`."""

    def __init__(self, network: Network, here: str, there: str) -> None:
        self._network, self._here, self._there = network, here, there
        self._held: tuple[str, int, list[EventBatch]] | None = None

    def forward(self, session: str, position: int, batches: list[EventBatch], limit_s: float) -> list[EventBatch]:
        weather = self._network.weather
        try:
            there = self._network.reach(self._here, self._there)
        except NotReachable as error:
            raise NotDelivered(str(error)) from None
        later_s = there.booted_s - self._network.booted_s(self._here)
        copies = [_copy(batch, batch.epoch + later_s) for batch in batches]
        if weather.strikes(weather.lost):
            return []
        if self._held is None and weather.strikes(weather.late):
            self._held = (session, position, copies)  # comes after the next one
            return []
        if weather.strikes(weather.twice):
            there.links.forward(session, position, [_copy(batch, batch.epoch) for batch in copies])
        there.links.forward(session, position, copies)
        if self._held is not None:
            held, self._held = self._held, None
            there.links.forward(*held)
        return []


class FeedWire:
    """A gateway's connection to the feed of `there`, in one session."""

    def __init__(self, network: Network, here: str, there: str, session: str, position: int) -> None:
        self.session, self.position = session, position
        self._network, self._here, self._there = network, here, there

    joining: Exchange

    def exchange(self, sent: float, there: Node) -> Exchange:
        here_s = self._network.booted_s(self._here)
        return Exchange(sent + here_s, time.monotonic() + there.booted_s, time.monotonic() + here_s)

    def renew(self, position: int, refused: int, news: list[Advertisement]) -> tuple[list[Advertisement], Exchange]:
        there, sent = self._network.reach(self._here, self._there), time.monotonic()
        answer = there.links.renew(self.session, position, refused, news)
        if self._network.weather.strikes(self._network.weather.fails):
            raise NotReachable("the answer was lost")
        return answer, self.exchange(sent, there)

    def acknowledge(self, position: int) -> None:
        if not self._network.weather.strikes(self._network.weather.lost):
            with contextlib.suppress(NotReachable, SessionOver):
                self._network.reach(self._here, self._there).links.acknowledge(self.session, position)

    def leave(self) -> None:
        with contextlib.suppress(NotReachable, SessionOver):
            self._network.reach(self._here, self._there).links.leave(self.session)


class Network:
    """Nodes by name; ended with its `with`."""

    def __init__(self, *names: str, weather: Weather | None = None, policy: LinkPolicy = DEFAULTS) -> None:
        self.weather = weather or Weather()
        self.policy = policy
        self.cut: set[frozenset[str]] = set()
        #: Pairs of which the first can't call the second.
        self.refused: set[tuple[str, str]] = set()
        self._folder = tempfile.TemporaryDirectory()
        self.nodes: dict[str, Node] = {}
        for name in names:
            self.start(name)

    def __getitem__(self, name: str) -> Node:
        return self.nodes[name]

    def link(self, *pairs: str) -> None:
        """Link pairs of nodes with names of one letter: "AB"."""
        for here, there in pairs:
            self.nodes[here].links.add(Peer(there))

    def reach(self, here: str, there: str) -> Node:
        """Raises NotReachable where the wire is cut, or a call fails."""
        if frozenset((here, there)) in self.cut or (here, there) in self.refused or there not in self.nodes:
            raise NotReachable(f"{there} is away")
        if self.weather.strikes(self.weather.fails):
            raise NotReachable("lost on the way")
        return self.nodes[there]

    def booted_s(self, name: str) -> float:
        return self.nodes[name].booted_s if name in self.nodes else 0.0

    def start(self, name: str) -> Node:
        node = self.nodes[name] = Node(self, name, Path(self._folder.name))
        return node

    def restart(self, name: str) -> Node:
        """As after a kill: what a node kept on disk is all that it has."""
        self.nodes.pop(name).close()
        node = self.start(name)
        node.links.restore()
        return node

    def __enter__(self) -> Network:
        return self

    def __exit__(self, *_: object) -> None:
        for node in self.nodes.values():
            node.close()
        self._folder.cleanup()
