"""Channels of one process, linked without an ORB: the same feeds, gateways and links, over wires that can fail."""

from __future__ import annotations

import random
import tempfile
import threading
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType

from robocorba.errors.events import NotDelivered, SessionOver
from robocorba.errors.services import NotReachable
from robocorba.events.account import Account
from robocorba.events.channel import Channel
from robocorba.events.channel_store import Peer
from robocorba.events.event import EventBatch, EventHeader
from robocorba.events.federation import Advertisement, Federation
from robocorba.events.foreign import Attach
from robocorba.events.links import Links
from robocorba.events.policies import LinkPolicy
from robocorba.events.proxy_supplier import ProxyPullSupplier
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import checked
from robocorba.events.watermarks import Watermarks

DEFAULTS = LinkPolicy()


def batch_of(*payloads: str, type: str = "t", source: str = "s", expiry: float = 0.0) -> EventBatch:
    """Events of one supplier; the channel sets their time."""
    return EventBatch(
        EventHeader(type, source, expiry=expiry), [0.0] * len(payloads), [payload.encode() for payload in payloads]
    )


class MemoryStore:
    """What Links keeps, as long as the test."""

    def __init__(self) -> None:
        self.records: dict[str, Peer] = {}
        self.kept: list[Advertisement] = []

    def peers(self) -> list[Peer]:
        return list(self.records.values())

    def save_peer(self, record: Peer) -> None:
        self.records[record.name] = record

    def forget_peer(self, name: str) -> None:
        self.records.pop(name, None)

    def save_advertisements(self, advertisements: Iterable[Advertisement]) -> None:
        self.kept = list(advertisements)


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
    """A channel with its links."""

    def __init__(self, network: Network, name: str, folder: Path, store: MemoryStore | None = None) -> None:
        self.name, self.network = name, network
        self.store = store or MemoryStore()
        self.watermarks = Watermarks(folder / f"{name}.seen")
        self.channel = Channel(Federation(name, self.store.kept), self.watermarks, 1)
        self.links = Links(self.channel, self.store, self._join, self._no_foreign, network.policy)  # type: ignore[arg-type]
        self.account = Account()
        self.consumers: list[Consumer] = []

    def publish(self, *payloads: str, type: str = "t", source: str = "s", expiry: float = 0.0) -> None:
        self.channel.publish(batch_of(*payloads, type=type, source=source, expiry=expiry), self.account)

    def consume(self, *types: str, size: int = 1_000_000) -> Consumer:
        """A consumer of this node's own."""
        subscription = checked([([(type, "*")], 0.0) for type in types])
        proxy = ProxyPullSupplier(self.channel.lock, str(len(self.consumers)), subscription, QueuePolicy(size))
        with self.channel.lock:
            self.channel.proxy_suppliers[proxy.id] = proxy
            proxy.connect(None)
        self.consumers.append(Consumer(self, proxy))
        self.consumers[-1].update_interest()
        return self.consumers[-1]

    def knows(self, name: str) -> tuple[str, ...]:
        """The types that another channel wants, as far as this one knows."""
        with self.channel.lock:
            return tuple(pattern.type for pattern in self.channel.federation.interest_of(name))

    def close(self) -> None:
        self.links.close()

    def _join(self, record: Peer) -> tuple[FeedWire, str]:
        there = self.network.reach(self.name, record.name)
        terms = there.links.join(self.name, self.name, GatewayWire(self.network, there.name, self.name))
        if self.network.weather.strikes(self.network.weather.fails):
            raise NotReachable("the answer was lost")
        return FeedWire(self.network, self.name, there.name, *terms), record.name

    @staticmethod
    def _no_foreign(record: Peer) -> Attach:
        raise AssertionError(record)


class Consumer:
    """What a consumer got, in order."""

    def __init__(self, node: Node, proxy: ProxyPullSupplier) -> None:
        self.node, self.proxy = node, proxy
        self.got: list[str] = []

    def read(self) -> list[str]:
        while (batch := self.proxy.pull(0.0)) is not None:
            self.got += [payload.decode() for payload in batch.payloads]
        return self.got

    def change(self, *types: str) -> None:
        with self.node.channel.lock:
            self.proxy.select(checked([([(type, "*")], 0.0) for type in types]))
        self.update_interest()

    def leave(self) -> None:
        with self.node.channel.lock:
            del self.node.channel.proxy_suppliers[self.proxy.id]
            self.proxy.end()
        self.update_interest()

    def update_interest(self) -> None:
        with self.node.channel.lock:
            changed = self.node.channel.update_routes()
        if changed:
            self.node.links.send_advertisements()


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
        copies = [EventBatch(batch.header, batch.times, batch.payloads, batch.first) for batch in batches]
        if weather.strikes(weather.lost):
            return []
        if self._held is None and weather.strikes(weather.late):
            self._held = (session, position, copies)  # comes after the next one
            return []
        there.links.forward(session, position, copies)
        if weather.strikes(weather.twice):
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

    def renew(self, position: int, news: list[Advertisement]) -> list[Advertisement]:
        answer = self._network.reach(self._here, self._there).links.renew(self.session, position, news)
        if self._network.weather.strikes(self._network.weather.fails):
            raise NotReachable("the answer was lost")
        return answer

    def acknowledge(self, position: int) -> None:
        if self._network.weather.strikes(self._network.weather.lost):
            return
        try:
            self._network.reach(self._here, self._there).links.acknowledge(self.session, position)
        except (NotReachable, SessionOver):
            return

    def leave(self) -> None:
        try:
            self._network.reach(self._here, self._there).links.leave(self.session)
        except (NotReachable, SessionOver):
            return


class Network:
    """Nodes by name; ended with its `with`."""

    def __init__(self, *names: str, weather: Weather | None = None, policy: LinkPolicy = DEFAULTS) -> None:
        self.weather = weather or Weather()
        self.policy = policy
        self.cut: set[frozenset[str]] = set()
        #: Pairs of which the first can't call the second.
        self.refused: set[tuple[str, str]] = set()
        self._folder = tempfile.TemporaryDirectory()
        self.nodes = {name: Node(self, name, Path(self._folder.name)) for name in names}

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

    def restart(self, name: str, *types: str) -> Node:
        """As after a kill: what a node kept on disk is all that it has, a consumer of these types included."""
        before = self.nodes.pop(name)
        before.close()
        before.watermarks.__exit__(None, None, None)
        node = Node(self, name, Path(self._folder.name), before.store)
        node.channel._number = 1 << 32  # numbers rise with each start
        self.nodes[name] = node
        if types:
            node.consume(*types)
        node.links.restore()
        return node

    def __enter__(self) -> Network:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for node in self.nodes.values():
            node.close()
        self._folder.cleanup()
