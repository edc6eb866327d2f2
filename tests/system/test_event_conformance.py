"""What the COS event service demands of a channel, its admins and its proxies, with plain clients only."""

from __future__ import annotations

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


class Lab:
    """A channel as a plain client sees it: proxies by what is connected to them. They go with the test."""

    def __init__(self, place: Place, name: str) -> None:
        self.place, self.name = place, name
        self.channel = place.orb.reference(place.uri(name), CosEventChannelAdmin.EventChannel)
        self._ends: list[Callable[[], None]] = []

    def for_push_supplier(self) -> Any:
        proxy = self.channel.for_suppliers().obtain_push_consumer()
        self._ends.append(proxy.disconnect_push_consumer)
        return proxy

    def for_pull_supplier(self) -> Any:
        proxy = self.channel.for_suppliers().obtain_pull_consumer()
        self._ends.append(proxy.disconnect_pull_consumer)
        return proxy

    def for_push_consumer(self) -> Any:
        proxy = self.channel.for_consumers().obtain_push_supplier()
        self._ends.append(proxy.disconnect_push_supplier)
        return proxy

    def for_pull_consumer(self) -> Any:
        proxy = self.channel.for_consumers().obtain_pull_supplier()
        self._ends.append(proxy.disconnect_pull_supplier)
        return proxy

    def supplier(self) -> Any:
        """A proxy to push to."""
        proxy = self.for_push_supplier()
        proxy.connect_push_supplier(None)
        return proxy

    def reference(self, servant: Any) -> Any:
        return self.place.orb.activate(servant)

    def end(self) -> None:
        for end in self._ends:
            try:
                end()
            except GONE:
                continue


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


@pytest.fixture
def ending(place: Place, request: pytest.FixtureRequest) -> Lab:
    """A channel of the test's own, to be destroyed."""
    name = f"ending-{len(request.node.name)}"
    place.start(name)
    return Lab(place, name)


# ---- connecting ----


def test_push_supplier_nil_is_accepted_and_its_events_flow(lab: Lab) -> None:
    consumer = PushConsumer()
    lab.for_push_consumer().connect_push_consumer(lab.reference(consumer))
    supplier = lab.for_push_supplier()
    supplier.connect_push_supplier(None)
    supplier.push(text("a"))
    eventually(lambda: consumer.got == ["a"])
    supplier.disconnect_push_consumer()


def test_pull_consumer_nil_is_accepted_and_events_flow_to_it(lab: Lab) -> None:
    proxy = lab.for_pull_consumer()
    proxy.connect_pull_consumer(None)
    lab.supplier().push(text("a"))
    assert proxy.pull().value() == "a"
    proxy.disconnect_pull_supplier()


def test_push_consumer_nil_is_a_bad_param(lab: Lab) -> None:
    proxy = lab.for_push_consumer()
    with pytest.raises(CORBA.BAD_PARAM):
        proxy.connect_push_consumer(None)
    proxy.connect_push_consumer(lab.reference(PushConsumer()))


def test_pull_supplier_nil_is_a_bad_param(lab: Lab) -> None:
    proxy = lab.for_pull_supplier()
    with pytest.raises(CORBA.BAD_PARAM):
        proxy.connect_pull_supplier(None)
    proxy.connect_pull_supplier(lab.reference(PullSupplier()))


def test_a_proxy_of_the_same_channel_is_refused(lab: Lab) -> None:
    """Each event would come back to the channel for ever."""
    pushing, pulled = lab.supplier(), lab.for_pull_consumer()
    with pytest.raises(CosEventChannelAdmin.TypeError):
        lab.for_push_consumer().connect_push_consumer(pushing)
    with pytest.raises(CosEventChannelAdmin.TypeError):
        lab.for_pull_supplier().connect_pull_supplier(pulled)
    pulled.connect_pull_consumer(None)
    pushing.push(text("a"))
    assert pulled.pull().value() == "a"
    assert not pulled.try_pull()[1]


@pytest.mark.parametrize("first_is_nil", [False, True])
def test_a_second_connect_is_already_connected(lab: Lab, first_is_nil: bool) -> None:
    def of(servant: Any) -> Any:
        return None if first_is_nil else lab.reference(servant)

    pushing, pulling = lab.for_push_supplier(), lab.for_pull_consumer()
    pushing.connect_push_supplier(of(PushSupplier()))
    pulling.connect_pull_consumer(of(PullConsumer()))
    for connect in (pushing.connect_push_supplier, pulling.connect_pull_consumer):
        with pytest.raises(CosEventChannelAdmin.AlreadyConnected):
            connect(None)
    with pytest.raises(CosEventChannelAdmin.AlreadyConnected):
        pushing.connect_push_supplier(lab.reference(PushSupplier()))
    if not first_is_nil:
        pushed, polled = lab.for_push_consumer(), lab.for_pull_supplier()
        pushed.connect_push_consumer(lab.reference(PushConsumer()))
        polled.connect_pull_supplier(lab.reference(PullSupplier()))
        with pytest.raises(CosEventChannelAdmin.AlreadyConnected):
            pushed.connect_push_consumer(lab.reference(PushConsumer()))
        with pytest.raises(CosEventChannelAdmin.AlreadyConnected):
            polled.connect_pull_supplier(lab.reference(PullSupplier()))


def test_before_connect_everybody_is_disconnected(lab: Lab) -> None:
    pushing, pulling = lab.for_push_supplier(), lab.for_pull_consumer()
    for call in (lambda: pushing.push(text("a")), pulling.pull, pulling.try_pull):
        with pytest.raises(CosEventComm.Disconnected):
            call()


# ---- pulling ----


def test_a_pull_waits_for_the_next_event(lab: Lab) -> None:
    proxy = lab.for_pull_consumer()
    proxy.connect_pull_consumer(None)
    pull = InBackground(proxy.pull)
    stays(pull.is_waiting)
    lab.supplier().push(text("a"))
    assert pull.answer().value() == "a"


def test_a_pull_that_waits_is_woken_by_disconnect(lab: Lab) -> None:
    for patience_s in (0.1, 1.0, 10.0):
        proxy = lab.for_pull_consumer()
        proxy.connect_pull_consumer(None)
        pulls = [InBackground(proxy.pull) for _ in range(3)]
        head_start(patience_s)
        proxy.disconnect_pull_supplier()
        answers = {type(pull.answer()) for pull in pulls}
        if GONE not in answers:  # else one of them came later than the disconnect, on a busy machine
            break
    assert answers == {CosEventComm.Disconnected}


def test_try_pull_of_nothing_says_so(lab: Lab) -> None:
    proxy = lab.for_pull_consumer()
    proxy.connect_pull_consumer(None)
    value, has_event = proxy.try_pull()
    assert not has_event and isinstance(value, CORBA.Any)


def test_pulls_that_timed_out_lose_no_event(lab: Lab) -> None:
    """omniORB's servants are not notified of a timeout, and go on."""
    proxy, supplier = lab.for_pull_consumer(), lab.supplier()
    proxy.connect_pull_consumer(None)
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


def test_several_pulls_at_one_proxy_get_an_event_each(lab: Lab) -> None:
    proxy, supplier = lab.for_pull_consumer(), lab.supplier()
    proxy.connect_pull_consumer(None)
    waiting = [InBackground(proxy.pull) for _ in range(3)]
    for number in range(3):
        supplier.push(text(str(number)))
    assert sorted(call.answer().value() for call in waiting) == ["0", "1", "2"]


def test_pull_after_disconnect_is_never_transient(lab: Lab) -> None:
    proxy = lab.for_pull_consumer()
    proxy.connect_pull_consumer(None)
    proxy.disconnect_pull_supplier()
    for call in (proxy.pull, proxy.try_pull):
        with pytest.raises((CosEventComm.Disconnected, GONE)):
            call()


# ---- disconnecting ----


def test_push_after_disconnect_is_not_delivered(lab: Lab) -> None:
    consumer = PushConsumer()
    lab.for_push_consumer().connect_push_consumer(lab.reference(consumer))
    gone, other = lab.supplier(), lab.supplier()
    gone.disconnect_push_consumer()
    with pytest.raises((CosEventComm.Disconnected, GONE)):
        gone.push(text("late"))
    other.push(text("marker"))
    eventually(lambda: consumer.got == ["marker"])


def test_disconnect_twice_does_not_exist(lab: Lab) -> None:
    for proxy, name in (
        (lab.for_push_supplier(), "disconnect_push_consumer"),
        (lab.for_pull_supplier(), "disconnect_pull_consumer"),
        (lab.for_push_consumer(), "disconnect_push_supplier"),
        (lab.for_pull_consumer(), "disconnect_pull_supplier"),
    ):
        getattr(proxy, name)()
        with pytest.raises(GONE):
            getattr(proxy, name)()
        assert proxy._non_existent()


def connect_all(lab: Lab, clients: tuple[Any, Any, Any, Any]) -> list[tuple[Any, str]]:
    """Proxies for a client of each kind, and how to disconnect them."""
    pushing, polled, pushed, pulling = clients
    proxies = (lab.for_push_supplier(), lab.for_pull_supplier(), lab.for_push_consumer(), lab.for_pull_consumer())
    proxies[0].connect_push_supplier(lab.reference(pushing))
    proxies[1].connect_pull_supplier(lab.reference(polled))
    proxies[2].connect_push_consumer(lab.reference(pushed))
    proxies[3].connect_pull_consumer(lab.reference(pulling))
    names = ("push_consumer", "pull_consumer", "push_supplier", "pull_supplier")
    return [(proxy, f"disconnect_{name}") for proxy, name in zip(proxies, names, strict=True)]


def test_each_peer_is_told_once_that_it_was_disconnected(lab: Lab) -> None:
    clients = (PushSupplier(), PullSupplier(), PushConsumer(), PullConsumer())
    for proxy, disconnect in connect_all(lab, clients):
        getattr(proxy, disconnect)()
    stays(lambda: [client.disconnections for client in clients] == [1, 1, 1, 1])


def test_a_mutual_disconnect_does_not_recur(lab: Lab) -> None:
    """Each peer disconnects its proxy while it is told, and finds that it does not exist any more."""
    proxies: list[tuple[Any, str]] = []
    found: list[bool] = []

    def of(place: int) -> Callable[[], None]:
        def farewell() -> None:
            proxy, disconnect = proxies[place]
            try:
                getattr(proxy, disconnect)()
            except GONE:
                found.append(True)

        return farewell

    clients = (PushSupplier(of(0)), PullSupplier(of(1)), PushConsumer(of(2)), PullConsumer(of(3)))
    proxies += connect_all(lab, clients)
    for proxy, disconnect in proxies:
        getattr(proxy, disconnect)()
    assert [client.disconnections for client in clients] == [1, 1, 1, 1]
    assert found == [True] * 4


# ---- the channel's end ----


def test_destroy_disconnects_all_kinds_and_nothing_exists_afterwards(ending: Lab) -> None:
    clients = (PushSupplier(), PullSupplier(), PushConsumer(), PullConsumer())
    proxies = connect_all(ending, clients)
    admins = (ending.channel.for_consumers(), ending.channel.for_suppliers())
    pull = InBackground(proxies[3][0].pull)
    head_start()
    ending.channel.destroy()
    assert isinstance(pull.answer(), (CosEventComm.Disconnected, GONE))  # gone: on a busy machine it came too late
    assert [client.disconnections for client in clients] == [1, 1, 1, 1]
    for call in (
        ending.channel.for_consumers,
        ending.channel.destroy,
        admins[0].obtain_push_supplier,
        admins[1].obtain_pull_consumer,
        proxies[2][0].disconnect_push_supplier,
        lambda: proxies[0][0].push(text("late")),
    ):
        with pytest.raises(GONE):
            call()


def test_a_callback_that_raises_keeps_no_other_from_being_called(ending: Lab) -> None:
    def fail() -> None:
        raise CORBA.INTERNAL

    clients = (PushSupplier(fail), PullSupplier(fail), PushConsumer(fail), PullConsumer(fail))
    connect_all(ending, clients)
    quiet = (PushSupplier(), PullSupplier(), PushConsumer(), PullConsumer())
    connect_all(ending, quiet)
    ending.channel.destroy()
    assert [client.disconnections for client in (*clients, *quiet)] == [1] * 8


# ---- limits ----


def test_there_are_no_more_proxies_than_the_limit(lab: Lab) -> None:
    makers = (lab.for_push_supplier, lab.for_pull_supplier, lab.for_push_consumer, lab.for_pull_consumer)
    for number in range(MAX_PROXIES - len(lab.place.balanced_states("lab"))):
        makers[number % 4]()
    for make in makers:
        with pytest.raises(CORBA.IMP_LIMIT):
            make()
    with pytest.raises(RoboCorba.TooManyProxies) as refused:
        lab.place.channel("lab").supply("one too many")
    assert refused.value.limit == MAX_PROXIES


# ---- delivery ----


def test_pull_suppliers_are_asked_also_while_nobody_consumes(lab: Lab) -> None:
    supplier = PullSupplier()
    lab.for_pull_supplier().connect_pull_supplier(lab.reference(supplier))
    supplier.waiting.put(text("unheard"))
    eventually(supplier.waiting.empty)
    eventually(lambda: supplier.asked > 5)


@pytest.mark.parametrize("pulls_from_supplier", [False, True])
@pytest.mark.parametrize("consumer_pulls", [False, True])
def test_all_mixes_work_with_several_proxies_in_one_process(
    lab: Lab, pulls_from_supplier: bool, consumer_pulls: bool
) -> None:
    pushed = [PushConsumer() for _ in range(2)]
    pulling = [lab.for_pull_consumer() for _ in range(2)]
    if consumer_pulls:
        for proxy in pulling:
            proxy.connect_pull_consumer(None)
    else:
        for consumer in pushed:
            lab.for_push_consumer().connect_push_consumer(lab.reference(consumer))
    expected = {f"{place} {number}" for place in range(2) for number in range(20)}
    if pulls_from_supplier:
        suppliers = [PullSupplier() for _ in range(2)]
        for place, supplier in enumerate(suppliers):
            for number in range(20):
                supplier.waiting.put(text(f"{place} {number}"))
            lab.for_pull_supplier().connect_pull_supplier(lab.reference(supplier))
    else:
        proxies = [lab.supplier() for _ in range(2)]
        for number in range(20):
            for place, proxy in enumerate(proxies):
                proxy.push(text(f"{place} {number}"))
    for place in range(2):
        if consumer_pulls:
            got = [pulling[place].pull().value() for _ in expected]
            assert not pulling[place].try_pull()[1]
        else:
            got = eventually(lambda place=place: len(pushed[place].got) >= len(expected) and pushed[place].got)
        assert set(got) == expected and len(got) == len(expected)
        for source in "01":
            assert [t for t in got if t[0] == source] == [f"{source} {number}" for number in range(20)]


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


def kill(pid: int) -> None:
    os.kill(pid, signal.SIGKILL)


@pytest.mark.parametrize("fate", [hang, kill])
@pytest.mark.parametrize("queue", [[], ["--queue", "100"]], ids=["plain", "header"])
def test_a_consumer_that_stalls_or_dies_delays_nobody_and_is_evicted_in_the_end(
    lab: Lab, tmp_path: Path, fate: Callable[[int], None], queue: list[str]
) -> None:
    supplier, healthy = lab.supplier(), PushConsumer()
    lab.for_push_consumer().connect_push_consumer(lab.reference(healthy))
    before = lab.place.evicted("lab")
    unlucky = lab.place.consumer("lab", tmp_path / "got", *queue)
    supplier.push(text("first"))
    eventually(lambda: lines(tmp_path / "got") == ["first"])
    fate(unlucky.pid)
    count = len(lab.place.balanced_states("lab"))
    for number in range(50):
        supplier.push(text(str(number)))
    eventually(lambda: healthy.got[-1:] == ["49"])
    # Its failures are counted, not yet too many.
    assert lab.place.evicted("lab") == before
    assert len(lab.place.balanced_states("lab")) == count
    eventually(lambda: lab.place.evicted("lab") == before + 1, 60.0, "eviction")
    assert len(lab.place.balanced_states("lab")) == count - 1
    supplier.push(text("after"))
    eventually(lambda: healthy.got == ["first", *map(str, range(50)), "after"])
