"""What the COS event service demands of a channel, its admins and its proxies, with plain clients only."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import CosEventChannelAdmin
import CosEventComm
import pytest
from omniORB import CORBA

from robocorba.corba.calls import set_call_timeout
from robocorba.stubs import RoboCorba
from robocorba.testing.processes import eventually, hang
from tests.system.event_place import (
    IMPATIENT,
    MAX_PROXIES,
    InBackground,
    Place,
    PullConsumer,
    PullSupplier,
    PushConsumer,
    PushSupplier,
    open_place,
    text,
)
from tests.waits import head_start, stays

pytestmark = pytest.mark.system
GONE = CORBA.OBJECT_NOT_EXIST
#: By the kind of a proxy: the kind of its client, and a class of such clients.
CLIENTS: dict[str, tuple[str, Any]] = {
    "push_consumer": ("push_supplier", PushSupplier),
    "pull_consumer": ("pull_supplier", PullSupplier),
    "push_supplier": ("push_consumer", PushConsumer),
    "pull_supplier": ("pull_consumer", PullConsumer),
}


class Lab:
    """A channel as a plain client sees it: proxies by their kind. They go with the test."""

    def __init__(self, place: Place, name: str) -> None:
        self.place = place
        self.channel = place.orb.reference(place.uri(name), CosEventChannelAdmin.EventChannel)
        self._ends: list[Callable[[], None]] = []

    def obtain(self, kind: str) -> Any:
        admin = self.channel.for_suppliers() if kind.endswith("consumer") else self.channel.for_consumers()
        proxy = getattr(admin, f"obtain_{kind}")()
        self._ends.append(getattr(proxy, f"disconnect_{kind}"))
        return proxy

    def connect(self, proxy: Any, kind: str, client: Any) -> None:
        """Connect a proxy with its client, a servant or nil."""
        getattr(proxy, f"connect_{CLIENTS[kind][0]}")(client and self.place.orb.activate(client))

    def connected(self, kind: str, client: Any = None) -> Any:
        """A proxy that is connected."""
        proxy = self.obtain(kind)
        self.connect(proxy, kind, client)
        return proxy

    def supplier(self) -> Any:
        """A proxy to push to."""
        return self.connected("push_consumer")

    def end(self) -> None:
        for end in self._ends:
            with contextlib.suppress(GONE):
                end()


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with open_place(tmp_path_factory.mktemp("conformance")) as place:
        place.start("lab", IMPATIENT)
        yield place


@pytest.fixture
def lab(place: Place) -> Iterator[Lab]:
    lab = Lab(place, "lab")
    yield lab
    lab.end()


# ---- connecting ----


def test_only_clients_that_are_not_called_may_be_nil(lab: Lab) -> None:
    consumer = PushConsumer()
    for kind, client in (("push_supplier", consumer), ("pull_consumer", PullSupplier())):
        proxy = lab.obtain(kind)
        with pytest.raises(CORBA.BAD_PARAM):
            lab.connect(proxy, kind, None)
        lab.connect(proxy, kind, client)
    puller = lab.connected("pull_supplier")
    lab.supplier().push(text("a"))
    eventually(lambda: consumer.got == ["a"])
    assert puller.pull().value() == "a"


def test_a_proxy_of_the_same_channel_is_refused(lab: Lab) -> None:
    """Each event would come back to the channel for ever."""
    pushing, pulled = lab.supplier(), lab.obtain("pull_supplier")
    with pytest.raises(CosEventChannelAdmin.TypeError):
        lab.obtain("push_supplier").connect_push_consumer(pushing)
    with pytest.raises(CosEventChannelAdmin.TypeError):
        lab.obtain("pull_consumer").connect_pull_supplier(pulled)
    pulled.connect_pull_consumer(None)
    pushing.push(text("a"))
    assert pulled.pull().value() == "a"
    assert not pulled.try_pull()[1]


def test_a_second_connect_is_already_connected(lab: Lab) -> None:
    for kind, (_, client) in CLIENTS.items():
        proxy = lab.connected(kind, client())
        with pytest.raises(CosEventChannelAdmin.AlreadyConnected):
            lab.connect(proxy, kind, client())
    for kind in ("push_consumer", "pull_supplier"):
        for first, second in ((CLIENTS[kind][1](), None), (None, None), (None, CLIENTS[kind][1]())):
            proxy = lab.connected(kind, first)
            with pytest.raises(CosEventChannelAdmin.AlreadyConnected):
                lab.connect(proxy, kind, second)


def test_before_connect_and_after_disconnect_nothing_goes_through(lab: Lab) -> None:
    pushing, pulling = lab.obtain("push_consumer"), lab.obtain("pull_supplier")
    for call in (lambda: pushing.push(text("a")), pulling.pull, pulling.try_pull):
        with pytest.raises(CosEventComm.Disconnected):
            call()
    consumer = PushConsumer()
    lab.connected("push_supplier", consumer)
    gone, pulled, other = lab.supplier(), lab.connected("pull_supplier"), lab.supplier()
    gone.disconnect_push_consumer()
    pulled.disconnect_pull_supplier()
    for call in (lambda: gone.push(text("late")), pulled.pull, pulled.try_pull):  # never TRANSIENT
        with pytest.raises((CosEventComm.Disconnected, GONE)):
            call()
    other.push(text("marker"))
    eventually(lambda: consumer.got == ["marker"])


# ---- pulling ----


def test_pulls_wait_for_the_next_events_and_get_one_each(lab: Lab) -> None:
    proxy = lab.connected("pull_supplier")
    value, has_event = proxy.try_pull()
    assert not has_event and isinstance(value, CORBA.Any)
    waiting = [InBackground(proxy.pull) for _ in range(3)]
    stays(lambda: all(pull.is_waiting() for pull in waiting))
    supplier = lab.supplier()
    for number in range(3):
        supplier.push(text(str(number)))
    assert sorted(pull.answer().value() for pull in waiting) == ["0", "1", "2"]


def test_a_pull_that_waits_is_woken_by_disconnect(lab: Lab) -> None:
    for patience_s in (0.1, 1.0, 10.0):
        proxy = lab.connected("pull_supplier")
        pulls = [InBackground(proxy.pull) for _ in range(3)]
        head_start(patience_s)
        proxy.disconnect_pull_supplier()
        answers = {type(pull.answer()) for pull in pulls}
        if GONE not in answers:  # else one of them came later than the disconnect, on a busy machine
            break
    assert answers == {CosEventComm.Disconnected}


def test_pulls_that_timed_out_lose_no_event(lab: Lab) -> None:
    """omniORB's servants are not notified of a timeout, and go on."""
    proxy, supplier = lab.connected("pull_supplier"), lab.supplier()
    for number in range(3):
        set_call_timeout(proxy, 0.1)
        for _ in range(3):
            with pytest.raises(CORBA.TIMEOUT):
                proxy.pull()
        set_call_timeout(proxy, None)
        waiting = InBackground(proxy.pull)
        supplier.push(text(f"first {number}"))
        supplier.push(text(f"second {number}"))
        assert [waiting.answer().value(), proxy.pull().value()] == [f"first {number}", f"second {number}"]
    events = proxy._narrow(RoboCorba.EventProxyPullSupplier).state().events
    assert (events.received, events.delivered, events.queued) == (6, 6, 0)


# ---- disconnecting ----


def test_a_mutual_disconnect_does_not_recur_and_a_second_one_does_not_exist(lab: Lab) -> None:
    """Each peer is told once; one disconnects its proxy meanwhile, and finds that it does not exist any more."""
    for kind, (_, kind_of_client) in CLIENTS.items():
        proxies: list[Any] = []
        found: list[bool] = []

        def farewell(kind: str = kind, proxies: list[Any] = proxies, found: list[bool] = found) -> None:
            with pytest.raises(GONE):
                getattr(proxies[0], f"disconnect_{kind}")()
            found.append(True)

        clients = kind_of_client(farewell), kind_of_client()
        proxies += [lab.connected(kind, client) for client in clients]
        for proxy in proxies:
            getattr(proxy, f"disconnect_{kind}")()
            with pytest.raises(GONE):
                getattr(proxy, f"disconnect_{kind}")()
            assert proxy._non_existent()
        stays(lambda clients=clients: [client.disconnections for client in clients] == [1, 1])
        assert found == [True]


def test_destroy_disconnects_all_kinds_and_nothing_exists_afterwards(place: Place) -> None:
    """A callback that raises keeps no other from being called."""

    def fail() -> None:
        raise CORBA.INTERNAL

    place.start("ending")
    lab = Lab(place, "ending")
    clients = [kind_of_client(fail) for _, kind_of_client in CLIENTS.values()]
    clients += [kind_of_client() for _, kind_of_client in CLIENTS.values()]
    proxies = [lab.connected(kind, client) for kind, client in zip([*CLIENTS, *CLIENTS], clients, strict=True)]
    admins = (lab.channel.for_consumers(), lab.channel.for_suppliers())
    pull = InBackground(proxies[3].pull)
    head_start()
    lab.channel.destroy()
    assert isinstance(pull.answer(), (CosEventComm.Disconnected, GONE))  # gone: on a busy machine it came too late
    assert [client.disconnections for client in clients] == [1] * 8
    for call in (
        lab.channel.for_consumers,
        lab.channel.destroy,
        admins[0].obtain_push_supplier,
        admins[1].obtain_pull_consumer,
        proxies[2].disconnect_push_supplier,
        lambda: proxies[0].push(text("late")),
    ):
        with pytest.raises(GONE):
            call()


def test_there_are_no_more_proxies_than_the_limit(lab: Lab) -> None:
    kinds = list(CLIENTS)
    for number in range(MAX_PROXIES - len(lab.place.balanced_states("lab"))):
        lab.obtain(kinds[number % 4])
    for kind in kinds:
        with pytest.raises(CORBA.IMP_LIMIT):
            lab.obtain(kind)
    with pytest.raises(RoboCorba.TooManyProxies) as refused:
        lab.place.channel("lab").supply("one too many")
    assert refused.value.limit == MAX_PROXIES


# ---- delivery ----


def test_pull_suppliers_are_asked_also_while_nobody_consumes(lab: Lab) -> None:
    supplier = PullSupplier()
    lab.connected("pull_consumer", supplier)
    supplier.waiting.put(text("unheard"))
    eventually(supplier.waiting.empty)
    eventually(lambda: supplier.asked > 5)


def test_all_mixes_work_with_several_proxies_in_one_process(lab: Lab) -> None:
    pushed = [PushConsumer() for _ in range(2)]
    for consumer in pushed:
        lab.connected("push_supplier", consumer)
    pulling = [lab.connected("pull_supplier") for _ in range(2)]
    suppliers = [PullSupplier() for _ in range(2)]
    for supplier in suppliers:
        lab.connected("pull_consumer", supplier)
    sources = [lab.supplier().push for _ in range(2)] + [supplier.waiting.put for supplier in suppliers]
    for number in range(20):
        for source, say in enumerate(sources):
            say(text(f"{source} {number}"))
    eventually(lambda: all(len(consumer.got) >= 80 for consumer in pushed))
    for got in [consumer.got for consumer in pushed] + [[proxy.pull().value() for _ in range(80)] for proxy in pulling]:
        assert len(got) == 80
        for source in "0123":
            assert [each for each in got if each[0] == source] == [f"{source} {number}" for number in range(20)]
    assert not any(proxy.try_pull()[1] for proxy in pulling)


# ---- consumers that stall or die ----


def lines(file: Path) -> list[str]:
    return file.read_text(encoding="utf-8").splitlines() if file.exists() else []


def test_a_full_queue_loses_exactly_the_oldest_and_counts_them(lab: Lab, tmp_path: Path) -> None:
    supplier, file = lab.supplier(), tmp_path / "got"
    stalled = lab.place.consumer("lab", file, "--queue", "10")
    (id,) = [state.id for state in lab.place.balanced_states("lab") if state.queue.size == 10]

    def account() -> Any:
        (state,) = [state for state in lab.place.balanced_states("lab") if state.id == id]
        return state.events

    supplier.push(text("0"))
    eventually(lambda: lines(file) == ["0"])
    eventually(lambda: account().delivered == 1)
    hang(stalled.pid)
    supplier.push(text("1"))
    eventually(lambda: account().unconfirmed == 1)  # it is on its way; whatever comes now waits
    for number in range(2, 17):
        supplier.push(text(str(number)))
    assert account().discarded == 5
    assert account().queued + account().unconfirmed == 11
    stalled.send_signal(signal.SIGCONT)
    eventually(lambda: len(lines(file)) == 12)
    assert lines(file) == ["0", "1", *map(str, range(7, 17))]
    eventually(lambda: account().delivered == 12)
    assert (account().received, account().discarded, account().queued) == (17, 5, 0)


def test_consumers_that_stall_or_die_delay_nobody_and_are_evicted_in_the_end(lab: Lab, tmp_path: Path) -> None:
    supplier, healthy = lab.supplier(), PushConsumer()
    lab.connected("push_supplier", healthy)
    before, count = lab.place.evicted("lab"), len(lab.place.balanced_states("lab"))
    files = [tmp_path / str(number) for number in range(4)]
    plain = [lab.place.consumer("lab", file) for file in files[:2]]
    with_header = [lab.place.consumer("lab", file, "--queue", "100") for file in files[2:]]
    supplier.push(text("first"))
    eventually(lambda: all(lines(file) == ["first"] for file in files))
    for stalls, dies in (plain, with_header):
        hang(stalls.pid)
        os.kill(dies.pid, signal.SIGKILL)
    for number in range(50):
        supplier.push(text(str(number)))
    eventually(lambda: healthy.got[-1:] == ["49"])
    eventually(lambda: lab.place.evicted("lab") == before + 4, 60.0, "eviction")
    assert len(lab.place.balanced_states("lab")) == count
    supplier.push(text("after"))
    eventually(lambda: healthy.got == ["first", *map(str, range(50)), "after"])
