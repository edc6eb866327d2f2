"""Proxies through their lives, and through restarts of the channel."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from robocorba.errors import events as errors
from robocorba.events.account import Account
from robocorba.events.channel import Channel
from robocorba.events.channel_store import ChannelStore, Peer
from robocorba.events.event import EventBatch
from robocorba.events.event_numbers import life_of
from robocorba.events.federation import Advertisement
from robocorba.events.policies import DeliveryPolicy, ProxyPolicy
from robocorba.events.proxies import Proxies
from robocorba.events.proxy import ProxyCondition, ProxyKind
from robocorba.events.proxy_consumer import ORDERS, ProxyConsumer, ProxyPullConsumer, own_supplier
from robocorba.events.proxy_push_supplier import ProxyPushSupplier
from robocorba.events.proxy_supplier import ProxyPullSupplier
from robocorba.events.queue import OverflowRule, QueuePolicy
from robocorba.events.subscription import ALL
from robocorba.system.backoff import Backoff
from robocorba.system.names import STOP_EVENT
from testkit.processes import eventually
from tests.events.samples import BOTH, Consumer, Supplier, failing, open_channel, supplied, wanting
from tests.waits import stays

POLICY = QueuePolicy(100)
DEFAULTS = ProxyPolicy()


class Lab:
    """A channel's proxies, their clients by reference, and what was removed."""

    def __init__(self, channel: Channel, store: ChannelStore, clients: dict[str, Any], policy: ProxyPolicy) -> None:
        self.channel, self.clients = channel, clients
        self.removed: list[str] = []
        self.proxies = Proxies(channel, store, POLICY, lambda: None, self.removed.append, policy)

    def find(self, kind: ProxyKind, reference: str) -> Any:
        return self.clients[reference]

    def known(self, client: Any) -> Any:
        self.clients[client.reference] = client
        return client

    def publish(self, *payloads: bytes) -> None:
        proxy = self.proxies.supply("A")
        for payload in payloads:
            proxy.push(supplied("t", payload))


@contextmanager
def lab_in(folder: Path, clients: dict[str, Any] | None = None, policy: ProxyPolicy = DEFAULTS) -> Iterator[Lab]:
    with ChannelStore(folder / "lab.sqlite") as store, open_channel(folder, store.first_number()) as channel:
        lab = Lab(channel, store, clients if clients is not None else {}, policy)
        lab.proxies.restore(lab.find)
        yield lab
        with channel.lock:
            for state in lab.proxies._all.values():
                state.end()


@pytest.fixture
def lab(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Lab]:
    """`request.param`: its policy, if not the default."""
    with lab_in(tmp_path, policy=getattr(request, "param", DEFAULTS)) as lab:
        yield lab


def client_of(kind: ProxyKind) -> Any:
    return Supplier() if kind in (ProxyKind.PUSH_CONSUMER, ProxyKind.PULL_CONSUMER) else Consumer()


NAMELESS = (ProxyKind.PUSH_CONSUMER, None), (ProxyKind.PULL_SUPPLIER, None)


@pytest.mark.parametrize(("kind", "client"), [*((kind, client_of(kind)) for kind in ProxyKind), *NAMELESS])
def test_each_kind_is_connected_once_and_disconnected_once(lab: Lab, kind: ProxyKind, client: Any) -> None:
    proxy = lab.proxies.obtain(kind)
    assert lab.proxies.snapshot(proxy).condition is ProxyCondition.WAITING
    with lab.channel.lock:
        lab.channel.update_routes()
    assert lab.channel.interest() == ()
    lab.proxies.connect(proxy, client)
    with pytest.raises(errors.AlreadyConnected):
        lab.proxies.connect(proxy, client and client_of(kind))
    state = lab.proxies.snapshot(proxy)
    assert (state.kind, state.condition) == (kind, ProxyCondition.CONNECTED)
    assert state.client == (client.address if client else "")

    def check_gone() -> None:
        for act in (
            lambda: lab.proxies.disconnect(proxy),
            lambda: lab.proxies.connect(proxy, client),
            lambda: lab.proxies.snapshot(proxy),
        ):
            with pytest.raises(errors.ProxyGone):
                act()
        assert (lab.removed, lab.proxies.snapshots()) == ([proxy.id], [])

    if client:
        client.on_disconnect = check_gone  # before the client is notified
    lab.proxies.disconnect(proxy)
    check_gone()
    assert client is None or client.disconnections == 1


def test_destroy_notifies_all_clients_once_and_refuses_later_calls(lab: Lab) -> None:
    clients = [client_of(kind) for kind in ProxyKind]
    for kind, client in zip(ProxyKind, clients, strict=True):
        lab.proxies.connect(lab.proxies.obtain(kind), client)
    waiting = lab.proxies.obtain(ProxyKind.PUSH_SUPPLIER)
    lab.proxies.destroy()
    assert [client.disconnections for client in clients] == [1] * len(ProxyKind)
    for act in (
        lab.proxies.destroy,
        lambda: lab.proxies.obtain(ProxyKind.PUSH_SUPPLIER),
        lambda: lab.proxies.connect(waiting, Consumer()),
        lambda: lab.proxies.supply("A"),
        lambda: lab.proxies.subscribe("", Consumer(), ALL, POLICY),
    ):
        with pytest.raises(errors.ProxyGone):
            act()


@pytest.mark.parametrize("end", ["destroy", "close"])
def test_the_end_ends_a_pull_that_waits(lab: Lab, end: str) -> None:
    """One in progress finds a destroyed proxy disconnected, a later one finds it gone."""
    proxy = lab.proxies.obtain(ProxyKind.PULL_SUPPLIER)
    assert isinstance(proxy, ProxyPullSupplier)
    lab.proxies.connect(proxy, None)
    with ThreadPoolExecutor(1) as caller:
        pull = caller.submit(proxy.pull, 60.0)
        eventually(lambda: proxy.pulls == 1, what="the pull")
        getattr(lab.proxies, end)()
        error = pull.exception(120.0)
    if end == "close":
        assert error is None and pull.result() is None
    else:
        assert isinstance(error, errors.Disconnected)
        with pytest.raises(errors.ProxyGone):
            proxy.pull(0.0)


def test_a_durable_subscription_collects_while_its_consumer_is_away_and_goes_to_the_next(lab: Lab) -> None:
    first, second, third = Consumer(), Consumer(), Consumer()
    proxy = lab.proxies.subscribe("log", first, ALL, POLICY)
    lab.publish(b"1")
    eventually(lambda: first.payloads == [b"1"])
    lab.proxies.disconnect(proxy)
    with pytest.raises(errors.ProxyGone):
        lab.proxies.disconnect(proxy)
    assert (first.disconnections, lab.removed, proxy.condition) == (1, [proxy.id], ProxyCondition.WAITING)
    lab.publish(b"2", b"3")
    assert lab.proxies.subscribe("log", second, ALL, POLICY) is proxy
    eventually(lambda: second.payloads == [b"2", b"3"])
    lab.proxies.subscribe("log", third, wanting("t"), QueuePolicy(7))  # replaces one that is there
    lab.publish(b"4")
    eventually(lambda: third.payloads == [b"4"])
    (state,) = [state for state in lab.proxies.snapshots() if state.name == "log"]
    assert (state.subscription, state.policy) == (wanting("t"), QueuePolicy(7))
    lab.proxies.unsubscribe("log")
    assert [one.disconnections for one in (first, second, third)] == [1, 1, 1]
    assert second.payloads == [b"2", b"3"]
    with pytest.raises(errors.UnknownSubscription):
        lab.proxies.unsubscribe("log")


def test_a_consumer_that_is_gone_is_disconnected_and_its_durable_subscription_stays(lab: Lab) -> None:
    gone = [Consumer(answer=failing(errors.ClientGone("gone"))) for _ in range(2)]
    lab.proxies.subscribe("", gone[0], ALL, POLICY)
    durable = lab.proxies.subscribe("log", gone[1], ALL, POLICY)
    lab.publish(b"1")
    eventually(lambda: lab.proxies.lost_clients == 2)
    assert [state.name for state in lab.proxies.snapshots() if state.kind is ProxyKind.PUSH_SUPPLIER] == ["log"]
    assert durable.condition is ProxyCondition.WAITING
    successor = Consumer()
    lab.proxies.subscribe("log", successor, ALL, POLICY)
    eventually(lambda: successor.payloads == [b"1"])


@pytest.mark.parametrize("lab", [ProxyPolicy(max_proxies=4, unused_s=10.0)], indirect=True)
def test_at_the_limit_forgotten_proxies_make_room_and_those_in_use_stay(lab: Lab) -> None:
    lab.proxies.subscribe("", Consumer(), ALL, POLICY)
    lab.proxies.subscribe("log", Consumer(), ALL, POLICY)
    forgotten, waiting = lab.proxies.obtain(ProxyKind.PULL_SUPPLIER), lab.proxies.obtain(ProxyKind.PUSH_SUPPLIER)
    lab.proxies.connect(forgotten, None)
    with pytest.raises(errors.TooManyProxies) as refused:
        lab.proxies.supply("A")
    assert refused.value.limit == 4
    for proxy in lab.proxies._all.values():
        proxy.used_at -= 11.0
    assert isinstance(forgotten, ProxyPullSupplier)
    assert forgotten.pull(0.0) is None  # it is used again
    supplier = lab.proxies.supply("A")
    assert waiting.is_ended and not forgotten.is_ended
    with pytest.raises(errors.TooManyProxies):
        lab.proxies.supply("B")
    forgotten.used_at -= 11.0
    lab.proxies.supply("B")
    assert forgotten.is_ended
    supplier.used_at -= 11.0
    lab.proxies.supply("C")
    assert supplier.is_ended
    assert {proxy.name for proxy in lab.proxies.snapshots()} == {"", "log", "B", "C"}


def test_a_named_supplier_gets_its_proxy_again_and_that_of_its_own_events_publishes_no_others(lab: Lab) -> None:
    assert lab.proxies.supply("A") is lab.proxies.supply("A")
    assert lab.proxies.supply("B") is not lab.proxies.supply("A")
    assert lab.proxies.supply("") is not lab.proxies.supply("")
    lab.proxies.supply(own_supplier("A")).push(supplied("t", b"1"))
    with pytest.raises(errors.InvalidEvent, match="'B'"):
        lab.proxies.supply(own_supplier("B")).push(supplied("t", b"1"))
    assert STOP_EVENT in ORDERS
    with pytest.raises(errors.InvalidEvent, match=STOP_EVENT):
        lab.proxies.supply(own_supplier("A")).push(supplied(STOP_EVENT, b"1"))


@pytest.mark.parametrize("change", ["select", "end"])
def test_events_that_come_during_a_change_of_a_conjunction_reach_the_others(lab: Lab, change: str) -> None:
    """Their route was found before."""
    other = Consumer()
    proxy = lab.proxies.subscribe("", Consumer(), (*wanting("u"), *BOTH), POLICY)
    lab.proxies.subscribe("", other, wanting("a"), POLICY)
    supplier = lab.proxies.supply("A")
    supplier.push(supplied("a", b"before"))
    for write in ("save_proxy", "forget_proxy"):
        setattr(lab.proxies._store, write, lambda stored: supplier.push(supplied("a", b"meanwhile")))
    if change == "select":
        lab.proxies.change(proxy, ALL)
    else:
        lab.proxies.disconnect(proxy)
    eventually(lambda: other.payloads == [b"before", b"meanwhile"], what="both events")


#: Shorter pauses, and fewer failures, than the defaults.
POLLING = DeliveryPolicy(backoff=Backoff(0.001, 0.002), max_failures=4)


class Published:
    """What a proxy published, and the reasons why clients were lost."""

    def __init__(self) -> None:
        self.payloads: list[object] = []
        self.reasons: list[str] = []
        self.lock = threading.Lock()

    def publish(self, batch: EventBatch, account: Account) -> None:
        assert not batch.header.origin
        self.payloads += batch.payloads

    @staticmethod
    def has_had(origin: str, number: int) -> bool:
        return origin == "east" and number <= 5

    def polled(self, supplier: Supplier, policy: DeliveryPolicy = POLLING) -> ProxyPullConsumer:
        def lost(proxy: ProxyPullConsumer, reason: str) -> None:
            self.reasons.append(reason)

        one = ProxyPullConsumer(self.lock, "1", self.publish, self.has_had, policy, lost)
        one.connect(supplier)
        return one


@pytest.fixture
def published() -> Published:
    return Published()


def test_a_push_is_published_once_while_connected(published: Published, caplog: pytest.LogCaptureFixture) -> None:
    one = ProxyConsumer(published.lock, "7", published.publish, published.has_had)

    def push(origin: str, first: int, *payloads: bytes) -> None:
        batch = supplied("t", *payloads)
        batch.header, batch.first = batch.header._replace(origin=origin), first
        one.push(batch)

    with pytest.raises(errors.Disconnected):
        one.push(supplied("t", b"early"))
    one.connect(None)
    push("east", 4, b"again", b"again")
    push("east", 5, b"again")
    push("east", 5, b"new", b"new")
    push("west", 1, b"new")
    assert published.payloads == [b"new"] * 3
    assert (one.account.received, one.account.discarded) == (3, 3)  # those published are counted by the channel
    assert caplog.messages == ["the supplier of 7 publishes events that it has received; they are discarded"]
    one.end()
    with pytest.raises(errors.ProxyGone):
        one.push(supplied("t", b"late"))


def test_a_supplier_is_polled_continuously_until_the_end_and_after_an_event_rarely(published: Published) -> None:
    supplier = Supplier(supplied("t", b"a"), supplied("t", b"b"))
    one = published.polled(supplier)
    eventually(lambda: supplier.asked > 5)
    supplier.batches.append(supplied("t", b"c"))
    eventually(lambda: published.payloads == [b"a", b"b", b"c"])
    one.end()
    eventually(lambda: not any(thread.name == "from 1" for thread in threading.enumerate()))
    supplier = Supplier(supplied("t", b"d"))
    one = published.polled(supplier, DeliveryPolicy(poll_intervals=Backoff(0.001, 3600.0, factor=1e7)))
    eventually(lambda: supplier.asked == 3, what="the poll with the event and two without")
    stays(lambda: supplier.asked == 3, 0.2)
    one.end()


@pytest.mark.parametrize(
    "error", [errors.NotDelivered("away"), errors.Unconfirmed("no answer"), errors.Refused("a fault of its own")]
)
def test_a_supplier_is_disconnected_after_max_failures_in_a_row(published: Published, error: errors.EventError) -> None:
    supplier = Supplier(error, error, error, supplied("t", b"a"), error, error, error, supplied("t", b"b"))
    one = published.polled(supplier)
    eventually(lambda: published.payloads == [b"a", b"b"])
    eventually(lambda: one.condition is ProxyCondition.CONNECTED and one.failures == 0)
    assert published.reasons == []
    supplier.batches += [error] * 9
    eventually(lambda: published.reasons)
    assert published.reasons == [f"4 failures in a row ({error})"]


def test_an_event_that_is_refused_is_counted_and_a_supplier_that_is_gone_is_lost(published: Published) -> None:
    refused = errors.EventTooLarge(9, 8), errors.InvalidEvent("type", "is empty")
    supplier = Supplier(*refused, supplied("t", b"a"), errors.ClientGone("gone"), supplied("t", b"b"))
    one = published.polled(supplier)
    eventually(lambda: published.reasons == ["gone"])
    assert (supplier.asked, published.payloads) == (4, [b"a"])
    assert (one.account.received, one.account.discarded) == (2, 2)  # the one published is counted by the channel


def test_a_restarted_channel_has_its_proxies_again(tmp_path: Path) -> None:
    clients: dict[str, Any] = {}
    policy = QueuePolicy(7, OverflowRule.BLOCK_SUPPLIER, 0.5)
    with lab_in(tmp_path, clients) as lab:
        consumer, supplier = lab.known(Consumer()), lab.known(Supplier())
        waiting = lab.proxies.obtain(ProxyKind.PUSH_SUPPLIER)
        pulled = lab.proxies.obtain(ProxyKind.PULL_SUPPLIER)
        lab.proxies.connect(pulled, None)
        polled = lab.proxies.obtain(ProxyKind.PULL_CONSUMER)
        lab.proxies.connect(polled, supplier)
        proxy = lab.proxies.supply("A")
        durable = lab.proxies.subscribe("log", consumer, wanting("t", "u"), policy)
        lab.proxies.suspend(durable, True)
        away = lab.proxies.subscribe("away", lab.known(Consumer()), ALL, policy)
        lab.proxies.disconnect(away)
        ended = lab.proxies.obtain(ProxyKind.PUSH_CONSUMER)
        lab.proxies.disconnect(ended)
        before = {state.id: state._replace(totals=None) for state in lab.proxies.snapshots()}  # type: ignore[arg-type]
        last = lab.channel.last_number
    with lab_in(tmp_path, clients) as lab:
        after = {state.id: state._replace(totals=None) for state in lab.proxies.snapshots()}  # type: ignore[arg-type]
        assert after == before
        assert set(after) == {proxy.id for proxy in (waiting, pulled, polled, proxy, durable, away)}
        assert after[durable.id].condition is ProxyCondition.SUSPENDED
        assert lab.channel.last_number > last
        lab.publish(b"1")
        again = lab.proxies._all[durable.id]
        assert isinstance(again, ProxyPushSupplier) and again.totals().queued == 1
        lab.proxies.suspend(again, False)
        eventually(lambda: consumer.payloads == [b"1"])
        fresh = lab.proxies.obtain(ProxyKind.PUSH_CONSUMER)
        assert isinstance(fresh, ProxyConsumer) and fresh.id not in {*before, ended.id}
        with pytest.raises(errors.Disconnected):
            fresh.push(supplied("t", b"x"))


@pytest.mark.parametrize("is_put_back", [False, True])
def test_no_clock_and_no_lost_state_makes_a_channel_repeat_its_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_put_back: bool
) -> None:
    """Peers would take its events for those that they have had, and clients its proxies for theirs. A computer without
    a real-time clock starts at the same time each day."""
    monkeypatch.setattr(time, "time", lambda: 1.6e9)
    numbers, ids = [], []
    with ChannelStore(tmp_path / "s") as store:
        numbers.append(store.first_number())
        ids.append(store.next_id())
    copy = (tmp_path / "s").read_bytes()
    for _ in range(4):  # they are random: with many, two are equal once in a while
        for file in tmp_path.iterdir():
            file.unlink()
        if is_put_back:
            (tmp_path / "s").write_bytes(copy)
        with ChannelStore(tmp_path / "s") as store:
            numbers.append(store.first_number())
            ids += [store.next_id() for _ in range(100)]
    assert len({life_of(number) for number in numbers}) == len(numbers)
    assert len(set(ids)) == len(ids)


def test_threads_do_not_disturb_each_other(tmp_path: Path) -> None:
    with ChannelStore(tmp_path / "s") as store, ThreadPoolExecutor(5) as threads:

        def number() -> list[int]:
            return [store.next_id() for _ in range(300)]

        def note(name: str) -> None:
            for version in range(100):
                store.save_advertisements([Advertisement(name, version, (), ())])
                store.save_peer(Peer(name, str(version)))

        numbering, noting = [threads.submit(number) for _ in range(3)], threads.map(note, ("hall", "yard"))
        assert len({id for each in numbering for id in each.result(60.0)}) == 900
        list(noting)
        assert sorted((peer.name, peer.address) for peer in store.peers()) == [("hall", "99"), ("yard", "99")]


def test_peers_are_kept_in_order_and_changed_in_place_and_a_cleared_store_keeps_its_numbers(tmp_path: Path) -> None:
    with ChannelStore(tmp_path / "s") as store:
        first, id = store.first_number(), store.next_id()
        for name in ("hall", "yard"):
            store.save_peer(Peer(name))
        store.save_peer(Peer("hall", "127.0.0.1:1", removed=True))
    with ChannelStore(tmp_path / "s") as store:
        assert store.peers() == [Peer("hall", "127.0.0.1:1", removed=True), Peer("yard")]
        store.forget_peer("hall")
        assert store.peers() == [Peer("yard")]
        store.clear()
        assert (store.proxies(), store.peers()) == ([], [])
    with ChannelStore(tmp_path / "s") as store:
        assert store.first_number() > first + 1e9
        assert store.next_id() > id
