"""What the COS event service demands of a channel, its admins and its proxies, with plain clients; what a channel adds:
headers, subscriptions, batches, queues, accounts; and how it refuses."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import CosEventChannelAdmin
import CosEventComm
import msgpack
import omniORB
import pytest
from omniORB import CORBA

from robocorba.events.corba.event_client import Event, EventClient, _EventConsumerServant
from robocorba.events.corba.pair_listener import PairListener
from robocorba.orb.calls import set_call_timeout
from robocorba.robot.corba import robot_channel
from robocorba.stubs import RoboCorba
from testkit.processes import eventually, hang
from tests.system.event_place import (
    IMPATIENT,
    QUEUE,
    EventConsumer,
    Place,
    PullConsumer,
    PullSupplier,
    PushConsumer,
    PushSupplier,
    clauses,
    in_background,
    open_place,
    text,
)
from tests.system.refusals import refused
from tests.waits import head_start, pause

pytestmark = pytest.mark.system
GONE = CORBA.OBJECT_NOT_EXIST
#: By the kind of a proxy: the kind of its client, and a class of such clients.
CLIENTS: dict[str, tuple[str, Any]] = {
    "push_consumer": ("push_supplier", PushSupplier),
    "pull_consumer": ("pull_supplier", PullSupplier),
    "push_supplier": ("push_consumer", PushConsumer),
    "pull_supplier": ("pull_consumer", PullConsumer),
}
Client = Callable[[str], EventClient]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with open_place(tmp_path_factory.mktemp("channel")) as place:
        place.begin("lab")
        place.begin("desk", module=IMPATIENT)
        yield place


@pytest.fixture
def channel(place: Place) -> Iterator[Any]:
    """The channel; whoever subscribed to it in a test leaves with it."""
    yield place.channel("lab")
    place.balanced_states("lab")


@pytest.fixture
def client(place: Place) -> Iterator[Client]:
    """Makes clients by the name of their source, closed at the end."""
    with contextlib.ExitStack() as made:
        yield lambda source: made.enter_context(EventClient(place.orb, "lab", source))


class Receiver(list[Event]):
    """Keeps what a subscription receives."""

    def __call__(self, event: Event) -> None:
        self.append(event)

    @property
    def payloads(self) -> list[Any]:
        return [event.payload for event in self]


def event(type: str = "t", payload: bytes = b"\xc0", **fields: Any) -> Any:
    header = RoboCorba.EventHeader(type, "A", "", 0, 0.0, 0, 0.0, RoboCorba.MSGPACK)
    vars(header).update(fields)
    return RoboCorba.Event(header, payload)


def account(subscription: Any) -> Any:
    return subscription.proxy.state().events


# ---- headers and plain events ----


def test_each_kind_of_supplier_reaches_each_kind_of_consumer(place: Place, channel: Any, client: Client) -> None:
    plain, receive, strings = PushConsumer(), Receiver(), Receiver()
    proxy = place.push_to(plain)
    puller = channel.for_consumers().obtain_pull_supplier()
    puller.connect_pull_consumer(None)
    robot = client("A")
    robot.subscribe(receive)
    robot.subscribe(strings, "string")
    before = time.time()
    robot.push("robot.state", {"x": 1.5, "name": "říp"}, priority=3, expiry_s=60.0)
    eventually(lambda: plain.got and receive)
    (one,) = receive
    assert one[:3] == ("robot.state", "A", {"x": 1.5, "name": "říp"})
    assert (one.origin, one.priority, one.expiry) == ("lab", 3, 60.0)
    assert before <= one.time <= time.time()
    for struct in (*plain.got, puller.pull().value()):
        assert isinstance(struct, RoboCorba.Event)
        assert (struct.header.type, struct.header.origin, struct.header.number) == ("robot.state", "lab", one.number)

    supplier = place.supplier()
    supplier.push(text("řeč"))
    supplier.push(CORBA.Any(CORBA.TC_long, 7))
    supplier.push(CORBA.Any(RoboCorba._tc_Event, event("robot.state", b"\x07")))
    eventually(lambda: len(receive) == 4)
    assert [(e.type, e.source, e.payload, e.origin) for e in receive[1:]] == [
        ("string", "", "řeč", "lab"),
        ("long", "", 7, "lab"),
        ("robot.state", "A", 7, "lab"),
    ]
    assert [e.number for e in receive] == list(range(one.number, one.number + 4))
    eventually(lambda: strings.payloads == ["řeč"])
    proxy.disconnect_push_supplier()
    puller.disconnect_pull_supplier()


def test_a_client_that_publishes_what_it_receives_makes_no_loop(place: Place, client: Client) -> None:
    supplier = place.supplier()
    proxy = place.push_to(PushConsumer(take=supplier.push))
    receive, robot = Receiver(), client("A")
    robot.subscribe(receive)
    for number in range(3):
        robot.push("robot.state", number)
    eventually(lambda: supplier._narrow(RoboCorba.EventProxyPushConsumer).state().events.discarded == 3)
    robot.push("robot.state", "last")
    eventually(lambda: receive.payloads[-1:] == ["last"])
    assert receive.payloads == [0, 1, 2, "last"]
    proxy.disconnect_push_supplier()
    supplier.disconnect_push_consumer()


def test_a_robot_subscribes_again_when_the_channel_has_ended_its_subscription(
    place: Place, channel: Any, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the channel does when it does not reach the robot for a while."""
    monkeypatch.setattr(robot_channel, "CHECK_INTERVAL_S", 0.05)
    got: list[Any] = []
    with contextlib.closing(robot_channel.RobotChannel(place.orb, "lab", "B")) as robot:
        robot.subscribe([("robot.stop", "*")], lambda type, source, payload, origin: got.append(payload))
        client("A").push("robot.stop", 1)
        eventually(lambda: got == [1])
        for _ in range(2):
            with contextlib.suppress(CORBA.OBJECT_NOT_EXIST):
                robot._subscription.proxy.disconnect_push_supplier()  # type: ignore[union-attr]

        def arrives() -> bool:
            client("A").push("robot.stop", 2)
            return 2 in got

        eventually(arrives)


def test_a_supplier_whose_proxy_another_client_has_ended_goes_on(client: Client) -> None:
    receive, robot = Receiver(), client("A")
    client("watcher").subscribe(receive, "t")
    robot.push("t", 1)
    for number in (2, 3):
        robot.channel.supply("A").disconnect_push_consumer()
        robot.push("t", number)
    eventually(lambda: receive.payloads == [1, 2, 3])


# ---- subscriptions ----


def test_a_conjunction_delivers_its_events_together_within_the_window(
    place: Place, channel: Any, client: Client
) -> None:
    consumer, pairs = EventConsumer(), list[Any]()
    both = [RoboCorba.EventPattern("arm", "A"), RoboCorba.EventPattern("gate", "")]
    wanted = [*clauses("x"), RoboCorba.Clause(both, 5.0)]
    proxy = channel.subscribe("", place.orb.activate(consumer), wanted, QUEUE)
    client("A").subscribe_together(pairs.append, "arm", "gate")
    supplier = channel.supply("A")
    now = time.time()
    for type, age, payload in (("arm", 20.0, b"1"), ("gate", 10.0, b"2"), ("x", 0.0, b"3"), ("arm", 8.0, b"4")):
        supplier.pushEvent(event(type, payload, time=now - age))
    eventually(lambda: consumer.together)
    ((which, events),) = consumer.together
    assert (which, [e.payload for e in events]) == (1, [b"4", b"2"])
    assert consumer.payloads == [b"3"]
    assert len({e.header.number for e in events}) == 2
    eventually(lambda: len(pairs) == 1)  # without a window, of the first two
    assert [e.payload for e in pairs[0]] == [1 + 48, 2 + 48]  # msgpack's small integers

    def counts() -> tuple[int, ...]:
        found = proxy.state().events
        return found.received, found.delivered, found.expired, found.queued

    eventually(lambda: counts() == (4, 3, 1, 0), what="the account of all deliveries")
    proxy.disconnect_push_supplier()


def test_pairs_of_any_two_of_many_sources(client: Client) -> None:
    names, pairs = [f"R{number}" for number in range(25)], list[list[str]]()
    observer = client("")
    made = observer.subscribe_pairs(
        lambda events: pairs.append(sorted(each.source for each in events)), "seen", names, window_s=60.0
    )
    assert len(made) == 2  # of 300 pairs, 200 in one subscription
    for name in ("R3", "R3", "stranger", "R24", "R11"):
        client(name).push("seen", None)
    eventually(lambda: len(pairs) >= 3)
    assert sorted(pairs) == [["R11", "R24"], ["R11", "R3"], ["R24", "R3"]]


def test_a_listener_of_pairs_follows_sources_and_survives_the_loss_of_its_subscription(
    place: Place, client: Client
) -> None:
    names, pairs = ["A"], list[list[str]]()
    listener = PairListener(
        place.orb, "lab", "seen", lambda: names, 60.0, lambda events: pairs.append([each.source for each in events])
    )
    with contextlib.closing(listener.start()):
        names[:] = ["A", "B"]
        speakers = [client(name) for name in names]

        def speak() -> bool:
            for speaker in speakers:
                speaker.push("seen", None)
            return len(pairs) > 0

        eventually(speak, what="a pair")
        assert set(map(tuple, pairs)) == {("A", "B")}
        for subscription in listener._subscriptions:
            subscription.proxy.disconnect_push_supplier()
        pairs.clear()
        eventually(speak, what="a pair after the loss")


# ---- order, batches, queues ----


def test_a_late_call_is_not_overtaken(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    """A call times out while its thread waits for the interpreter, and goes on when the next one has ended."""
    push_runs, is_waiting, others_end = _EventConsumerServant.pushRuns, threading.Event(), threading.Event()

    def delayed(servant: Any, runs: Any) -> None:
        if not is_waiting.is_set() and any(msgpack.packb(1) in run.payloads for run in runs):
            is_waiting.set()
            others_end.wait(30)
        push_runs(servant, runs)
        if is_waiting.is_set():
            others_end.set()

    monkeypatch.setattr(_EventConsumerServant, "pushRuns", delayed)
    robot, got = client("A"), Receiver()
    subscription = client("").subscribe(got, "t")
    for number in range(10):
        robot.push("t", number)
        pause(0.01)  # so that the supplier's thread makes the call, which has a shorter time limit
    eventually(others_end.is_set)
    eventually(lambda: account(subscription).queued == 0 and len(got) >= 10)
    assert got.payloads == list(range(10))
    assert account(subscription).unconfirmed == 0


# ---- what is refused ----


def test_payloads_that_are_not_what_they_say_leave_the_server_alive(place: Place, channel: Any, client: Client) -> None:
    """In one another struct goes by the name of our own."""
    members = [CORBA.StructMember("x", CORBA.TC_long, None)]
    type = CORBA.ORB_init().create_struct_tc("IDL:RoboCorba/Evens:1.0", "Evens", members)
    made = omniORB.createUnknownStruct("IDL:RoboCorba/Evens:1.0", ["x"])
    forged = omniORB.cdrMarshal(CORBA.TC_any, CORBA.Any(type, made(5))).replace(b"/Evens:", b"/Event:")
    plain, receive = PushConsumer(), Receiver()
    proxy = place.push_to(plain)
    robot = client("A")
    robot.subscribe(receive)
    supplier = channel.supply("B")
    supplier.pushEvent(event(payload=b"\xc1 not msgpack"))
    supplier.pushEvent(event(payload=b"no any", encoding=RoboCorba.CDR_ANY))
    supplier.pushEvent(event(payload=forged, encoding=RoboCorba.CDR_ANY))
    robot.push("t", "end")
    eventually(lambda: receive.payloads[-1:] == ["end"])
    assert receive.payloads[:2] == [b"\xc1 not msgpack", b"no any"]
    eventually(lambda: plain.got and plain.got[-1].header.source == "A")
    assert proxy.state().condition == RoboCorba.CONNECTED
    proxy.disconnect_push_supplier()


# ---- the standard, with plain clients only ----


class Lab:
    """A channel as a plain client sees it: proxies by their kind. They go with the test."""

    def __init__(self, place: Place, name: str) -> None:
        self.place, self.name = place, name
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


@pytest.fixture
def lab(place: Place) -> Iterator[Lab]:
    lab = Lab(place, "desk")
    yield lab
    lab.end()


def test_only_clients_that_are_not_called_may_be_nil(lab: Lab) -> None:
    consumer = PushConsumer()
    for kind, client in (("push_supplier", consumer), ("pull_consumer", PullSupplier())):
        proxy = lab.obtain(kind)
        refused(CORBA.BAD_PARAM, lab.connect, proxy, kind, None)
        lab.connect(proxy, kind, client)
    puller = lab.connected("pull_supplier")
    lab.supplier().push(text("a"))
    eventually(lambda: consumer.got == ["a"])
    assert puller.pull().value() == "a"


def test_a_proxy_of_the_same_channel_is_refused(lab: Lab) -> None:
    """Each event would come back to the channel for ever."""
    pushing, pulled = lab.supplier(), lab.obtain("pull_supplier")
    refused(CosEventChannelAdmin.TypeError, lab.obtain("push_supplier").connect_push_consumer, pushing)
    refused(CosEventChannelAdmin.TypeError, lab.obtain("pull_consumer").connect_pull_supplier, pulled)
    pulled.connect_pull_consumer(None)
    pushing.push(text("a"))
    assert pulled.pull().value() == "a"
    assert not pulled.try_pull()[1]


# ---- pulling ----


def test_a_pull_that_waits_is_woken_by_disconnect(lab: Lab) -> None:
    for patience_s in (0.1, 1.0, 10.0):
        proxy = lab.connected("pull_supplier")
        pulls = [in_background(proxy.pull) for _ in range(3)]
        head_start(patience_s)
        proxy.disconnect_pull_supplier()
        answers = {type(pull.result(60.0)) for pull in pulls}
        if GONE not in answers:  # else one of them came later than the disconnect, on a busy machine
            break
    assert answers == {CosEventComm.Disconnected}


def test_pulls_that_timed_out_lose_no_event(lab: Lab) -> None:
    """omniORB's servants are not notified of a timeout, and go on."""
    proxy, supplier = lab.connected("pull_supplier"), lab.supplier()
    for number in range(3):
        set_call_timeout(proxy, 0.1)
        for _ in range(3):
            refused(CORBA.TIMEOUT, proxy.pull)
        set_call_timeout(proxy, None)
        waiting = in_background(proxy.pull)
        supplier.push(text(f"first {number}"))
        supplier.push(text(f"second {number}"))
        assert [waiting.result(60.0).value(), proxy.pull().value()] == [f"first {number}", f"second {number}"]
    events = proxy._narrow(RoboCorba.EventProxyPullSupplier).state().events
    assert (events.received, events.delivered, events.queued) == (6, 6, 0)


# ---- disconnecting, and the channel's end ----


def test_destroy_disconnects_all_kinds_and_nothing_exists_afterwards(place: Place) -> None:
    """A callback that raises keeps no other from being called."""

    def fail() -> None:
        raise CORBA.INTERNAL

    place.begin("ending")
    lab = Lab(place, "ending")
    clients = [kind_of_client(fail) for _, kind_of_client in CLIENTS.values()]
    clients += [kind_of_client() for _, kind_of_client in CLIENTS.values()]
    proxies = [lab.connected(kind, client) for kind, client in zip([*CLIENTS, *CLIENTS], clients, strict=True)]
    admins = (lab.channel.for_consumers(), lab.channel.for_suppliers())
    pull = in_background(proxies[3].pull)
    head_start()
    lab.channel.destroy()
    assert isinstance(pull.result(60.0), (CosEventComm.Disconnected, GONE))  # gone: on a busy machine it came too late
    assert [client.disconnections for client in clients] == [1] * 8
    for call in (
        lab.channel.for_consumers,
        lab.channel.destroy,
        admins[0].obtain_push_supplier,
        admins[1].obtain_pull_consumer,
        proxies[2].disconnect_push_supplier,
        lambda: proxies[0].push(text("late")),
    ):
        refused(GONE, call)


# ---- consumers that stall or die ----


def test_consumers_that_stall_or_die_delay_nobody_and_are_evicted_in_the_end(lab: Lab) -> None:
    supplier, healthy = lab.supplier(), PushConsumer()
    lab.connected("push_supplier", healthy)
    before, count = lab.place.evicted(lab.name), len(lab.place.balanced_states(lab.name))
    consumers = [lab.place.consumer(lab.name, queue) for queue in (0, 100, 0, 100)]
    supplier.push(text("first"))
    assert all(consumer.stdout and "first" in consumer.stdout.readline() for consumer in consumers)
    for consumer in consumers[:2]:
        hang(consumer.pid)
    for consumer in consumers[2:]:
        consumer.kill()
    for number in range(50):
        supplier.push(text(str(number)))
    eventually(lambda: healthy.got[-1:] == ["49"])
    eventually(lambda: lab.place.evicted(lab.name) == before + 4, what="eviction")
    eventually(lambda: len(lab.place.balanced_states(lab.name)) == count, what="the end of their proxies")
    supplier.push(text("after"))
    eventually(lambda: healthy.got == ["first", *map(str, range(50)), "after"])
