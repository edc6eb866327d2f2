"""What a channel adds to the standard: headers, subscriptions, batches, queues, accounts; and how it refuses."""

from __future__ import annotations

import contextlib
import math
import random
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import msgpack
import omniORB
import pytest
from omniORB import CORBA

from robocorba.corba.event_client import Event, EventClient, _EventConsumerServant
from robocorba.corba.remote import robot_channel
from robocorba.errors.events import InvalidEvent, InvalidSubscription
from robocorba.events.queue import OverflowRule, QueuePolicy
from robocorba.stubs import RoboCorba
from robocorba.testing.processes import eventually
from tests.system.event_place import QUEUE, EventConsumer, Place, PushConsumer, clauses, open_place, text
from tests.waits import outlast, pause

pytestmark = pytest.mark.system
#: Time after which an event expires that nobody takes [s]; it must have arrived before, also on a busy machine.
EXPIRY_S = 2.0
Client = Callable[[str], EventClient]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with open_place(tmp_path_factory.mktemp("channel")) as place:
        place.start("lab")
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

        eventually(arrives, 30.0)


def test_a_supplier_whose_proxy_another_client_has_ended_goes_on(client: Client) -> None:
    receive, robot = Receiver(), client("A")
    client("watcher").subscribe(receive, "t")
    robot.push("t", 1)
    for number in (2, 3):
        robot.channel.supply("A").disconnect_push_consumer()
        robot.push("t", number)
    eventually(lambda: receive.payloads == [1, 2, 3])


# ---- subscriptions ----


def test_wildcards_and_disjunctions_select(client: Client) -> None:
    a, b = client("A"), client("B")
    states, digits, from_b, everything = (Receiver() for _ in range(4))
    a.subscribe(states, "robot.*.state", "door")
    a.subscribe(digits, "t?")
    a.subscribe(from_b, ("*", "B"))
    a.subscribe(everything)
    for robot, type in ((a, "robot.1.state"), (b, "robot.1.state"), (b, "robot.1"), (a, "door"), (b, "t1"), (a, "t12")):
        robot.push(type, [robot.source, type])
    eventually(lambda: len(everything) == 6)
    eventually(lambda: [e.type for e in states] == ["robot.1.state", "robot.1.state", "door"])
    eventually(lambda: [e.type for e in digits] == ["t1"])
    eventually(lambda: [e.type for e in from_b] == ["robot.1.state", "robot.1", "t1"])


def test_a_change_of_subscription_takes_effect_at_once(client: Client) -> None:
    robot, receive = client("A"), Receiver()
    subscription = robot.subscribe(receive, "a")
    for round_ in range(10):
        subscription.change("b" if round_ % 2 else "a")
        robot.push("a", f"a{round_}")
        robot.push("b", f"b{round_}")
    eventually(lambda: len(receive) == 10)
    assert receive.payloads == [f"{'b' if round_ % 2 else 'a'}{round_}" for round_ in range(10)]


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
    counts = proxy.state().events
    assert (counts.received, counts.delivered, counts.expired, counts.queued) == (4, 3, 1, 0)
    proxy.disconnect_push_supplier()


# ---- order, batches, queues ----


def test_events_of_each_supplier_keep_their_order(client: Client) -> None:
    receivers = [Receiver() for _ in range(3)]
    observer = client("observer")
    subscriptions = [observer.subscribe(receive) for receive in receivers]

    def talk(robot: EventClient) -> None:
        for number in range(0, 120, 4):
            robot.push("count", number)
            robot.push_many("count", [number + 1, number + 2, number + 3])

    threads = [threading.Thread(target=talk, args=(client(name),)) for name in "ABC"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    eventually(lambda: all(account(subscription).delivered == 360 for subscription in subscriptions))
    for receive in receivers:
        assert [e.number for e in receive] == list(range(receive[0].number, receive[0].number + 360))
        for name in "ABC":
            assert [e.payload for e in receive if e.source == name] == list(range(120))


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
    eventually(others_end.is_set, 60)
    eventually(lambda: account(subscription).queued == 0 and len(got) >= 10, 60)
    assert got.payloads == list(range(10))
    assert account(subscription).unconfirmed == 0


def test_a_batch_is_taken_in_and_passed_on_in_one_call(place: Place, channel: Any) -> None:
    consumer = EventConsumer()
    proxy = channel.subscribe("", place.orb.activate(consumer), clauses("t"), QUEUE)
    payloads = [bytes([k]) for k in range(100)]
    channel.supply("A").pushRuns([RoboCorba.EventRun(event().header, [0.0] * 100, payloads)])
    eventually(lambda: len(consumer.got) == 100)
    assert (consumer.payloads, consumer.calls) == (payloads, 1)
    proxy.disconnect_push_supplier()


def test_a_supplier_is_blocked_until_there_is_room(client: Client) -> None:
    robot, receive = client("A"), Receiver()
    subscription = robot.subscribe(receive, queue=QueuePolicy(4, OverflowRule.BLOCK_SUPPLIER, 9.0))
    subscription.proxy.suspend()
    assert subscription.proxy.state().condition == RoboCorba.SUSPENDED
    pushing = threading.Thread(target=robot.push_many, args=("t", range(10)))
    pushing.start()
    eventually(lambda: account(subscription).queued == 4)
    assert pushing.is_alive() and not receive
    subscription.proxy.resume()
    pushing.join(60.0)
    assert not pushing.is_alive()
    eventually(lambda: receive.payloads == list(range(10)))
    eventually(lambda: account(subscription).delivered == 10)
    assert subscription.proxy.state().condition == RoboCorba.CONNECTED


def test_the_lowest_priority_goes_first_and_the_expired_are_not_delivered(client: Client) -> None:
    robot, receive = client("A"), Receiver()
    subscription = robot.subscribe(receive, queue=QueuePolicy(3))
    subscription.proxy.suspend()
    for number, priority in enumerate((1, 0, 2, 0, 2)):
        robot.push("t", number, priority=priority)
    robot.push("t", "expires", priority=9, expiry_s=EXPIRY_S)  # the last: it still counts when it gets there
    outlast(EXPIRY_S)
    subscription.proxy.resume()
    eventually(lambda: receive.payloads == [2, 4])
    eventually(lambda: account(subscription).queued == 0)
    events = account(subscription)
    assert (events.received, events.delivered, events.discarded, events.expired) == (6, 2, 3, 1)


def test_a_consumer_that_raises_loses_that_event_only(place: Place, channel: Any) -> None:
    class Moody(EventConsumer):
        def pushRuns(self, runs: Any) -> None:
            if runs[0].payloads[0] == b"bad":
                raise ValueError("a fault of the consumer")
            super().pushRuns(runs)

    consumer = Moody()
    proxy = channel.subscribe("", place.orb.activate(consumer), clauses("t"), QUEUE)
    supplier = channel.supply("A")
    for number, payload in enumerate([b"1", b"bad", b"2"], start=1):
        supplier.pushEvent(event(payload=payload))
        eventually(lambda number=number: proxy.state().events.queued == 0 and proxy.state().events.received == number)
    assert consumer.payloads == [b"1", b"2"]
    assert (proxy.state().events.delivered, proxy.state().events.discarded) == (2, 1)
    assert proxy.state().condition == RoboCorba.CONNECTED
    proxy.disconnect_push_supplier()


# ---- what is refused ----


def test_an_event_that_is_refused_names_its_field(channel: Any) -> None:
    supplier = channel.supply("A")
    last = channel.state().lastNumber
    good = RoboCorba.EventRun(event().header, [0.0], [b""])
    for field, one in (
        ("type", event("")),
        ("source", event(source="x" * 201)),
        ("expiry", event(expiry=math.nan)),
        ("time", event(time=math.inf)),
        ("payload", event(payload=bytes(8 * 2**20 + 1))),
    ):
        with pytest.raises(RoboCorba.InvalidEvent) as refused:
            supplier.pushEvent(one)
        assert refused.value.field == field and refused.value.reason
        with pytest.raises(RoboCorba.InvalidEvent) as refused:
            supplier.pushRuns([good, RoboCorba.EventRun(one.header, [one.header.time], [one.payload])])
        assert refused.value.field == field
        with pytest.raises(CORBA.IMP_LIMIT if field == "payload" else CORBA.BAD_PARAM):
            supplier.push(CORBA.Any(RoboCorba._tc_Event, one))
    with pytest.raises(RoboCorba.InvalidEvent) as refused:
        supplier.pushRuns([RoboCorba.EventRun(event().header, [0.0], [b"", b""])])
    assert refused.value.field == "times"
    assert channel.state().lastNumber == last  # of a call that is refused nothing is taken in


def test_a_subscription_that_is_refused_names_the_place(place: Place, channel: Any) -> None:
    consumer, pattern = place.orb.activate(EventConsumer()), RoboCorba.EventPattern
    proxy = channel.subscribe("", consumer, clauses("a"), QUEUE)
    for where, wrong in (
        ("[1].patterns", [*clauses("a"), RoboCorba.Clause([], 0.0)]),
        ("[0].window", [RoboCorba.Clause([pattern("a", "")], -1.0)]),
        ("[0].patterns[1].source", [RoboCorba.Clause([pattern("a", ""), pattern("b", "x" * 201)], 0.0)]),
    ):
        with pytest.raises(RoboCorba.InvalidSubscription) as refused:
            channel.subscribe("", consumer, wrong, QUEUE)
        assert refused.value.where == where and refused.value.reason
        with pytest.raises(RoboCorba.InvalidSubscription) as refused:
            proxy.changeSubscription(wrong)
        assert refused.value.where == where
    assert [clause.patterns[0].type for clause in proxy.state().subscribed] == ["a"]
    proxy.disconnect_push_supplier()
    for field, queue in (
        ("size", RoboCorba.QueuePolicy(1_000_001, RoboCorba.DISCARD_OLDEST, 0.0)),
        ("blockLimit", RoboCorba.QueuePolicy(1, RoboCorba.BLOCK_SUPPLIER, math.nan)),
    ):
        with pytest.raises(RoboCorba.InvalidQueue) as refused:
            channel.subscribe("", consumer, clauses("a"), queue)
        assert refused.value.field == field and refused.value.reason
    with pytest.raises(RoboCorba.UnknownSubscription) as refused:
        channel.unsubscribe("nobody")
    assert refused.value.name == "nobody"
    with pytest.raises(CORBA.BAD_PARAM):
        channel.subscribe("", None, clauses("a"), QUEUE)


def test_the_client_refuses_before_it_asks(client: Client) -> None:
    robot = client("A")
    with pytest.raises(InvalidEvent) as refused:
        robot.push("t", object())
    assert refused.value.field == "payload"
    with pytest.raises(InvalidEvent):
        robot.push("", 1)
    with pytest.raises(InvalidSubscription):
        robot.subscribe(Receiver(), "x" * 201)


def test_garbage_leaves_the_server_alive(place: Place, channel: Any, client: Client) -> None:
    # Not GIOP, then GIOP with a random body.
    chance = random.Random(1)
    giop = (b"", b"\x40\0\0\0", b"\xff\xff\xff\x7f")
    for start in (b"", b"GET / HTTP/1.0\r\n\r\n", *(b"GIOP\1\2\1\0" + length for length in giop)):
        with socket.create_connection(("127.0.0.1", place.port + 1), 5) as connection:
            connection.sendall(start + chance.randbytes(200))
    # Payloads that are not what they say; in one another struct goes by the name of our own.
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
