"""A channel whose process is killed and started again: for its clients nothing has changed, also for those to which
nobody can connect."""

from __future__ import annotations

import itertools
import json
import signal
import time
from collections.abc import Callable, Iterator
from subprocess import Popen
from typing import Any

import CosEventComm
import pytest
from omniORB import CORBA

from robocorba.errors.events import Unconfirmed
from robocorba.errors.services import NotReachable
from robocorba.events.corba.event_client import EventClient
from robocorba.stubs import RoboCorba
from testkit.processes import ROBOCORBA, eventually, refusal
from tests.system.event_place import Place, PullConsumer, PullSupplier, PushConsumer, in_background, open_place, text
from tests.waits import head_start

pytestmark = [pytest.mark.system, pytest.mark.full]
#: Of the channels.
NUMBERS = itertools.count()


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with open_place(tmp_path_factory.mktemp("restart")) as place:
        yield place


class Lab:
    """A channel of one test."""

    def __init__(self, place: Place, name: str, *more: str) -> None:
        self.place, self.name, self._more = place, name, more
        self.channel = place.begin(name, *more)

    def restart(self, number: signal.Signals = signal.SIGKILL) -> None:
        process = self.place.processes[self.name]
        process.send_signal(number)
        assert process.wait(60.0) == (0 if number == signal.SIGTERM else -number)
        self.place.begin(self.name, *self._more)

    def client(self, source: str = "") -> EventClient:
        return EventClient(self.place.orb, self.name, source)

    def state(self, proxy: str) -> Any:
        (state,) = [state for state in self.place.balanced_states(self.name) if state.name == proxy]
        return state


@pytest.fixture
def lab(place: Place, request: pytest.FixtureRequest) -> Iterator[Lab]:
    """With the arguments that the test's parameter has."""
    lab = Lab(place, f"lab-{next(NUMBERS)}", *getattr(request, "param", ()))
    yield lab
    place.kill(lab.name)


def again(call: Callable[[], Any], timeout_s: float = 60.0) -> Any:
    """The first result. Each connection that died with the other process may cost an answer."""
    deadline = time.monotonic() + timeout_s
    while True:
        try:
            return call()
        except (CORBA.COMM_FAILURE, Unconfirmed):
            assert time.monotonic() < deadline


def test_references_stay_valid_and_plain_clients_go_on(place: Place, lab: Lab) -> None:
    channel = lab.channel
    admins = (channel.for_consumers(), channel.for_suppliers())
    consumer, polled = PushConsumer(), PullSupplier()
    pushed = place.push_to(consumer, channel)
    pulled = admins[0].obtain_pull_supplier()
    pulled.connect_pull_consumer(place.orb.activate(PullConsumer()))
    admins[1].obtain_pull_consumer().connect_pull_supplier(place.orb.activate(polled))
    supplier, unconnected = place.supplier(channel), admins[1].obtain_push_consumer()
    ended = admins[1].obtain_push_consumer()
    ended.disconnect_push_consumer()
    supplier.push(text("before"))
    eventually(lambda: consumer.got == ["before"])
    assert pulled.pull().value() == "before"
    last = channel.state().lastNumber

    lab.restart()

    again(lambda: supplier.push(text("after")))
    eventually(lambda: consumer.got == ["before", "after"])
    assert pulled.pull().value() == "after"
    polled.waiting.put(text("asked for"))
    eventually(lambda: consumer.got[-1:] == ["asked for"])
    with pytest.raises(CosEventComm.Disconnected):
        unconnected.push(text("nobody is connected"))
    with pytest.raises(CORBA.OBJECT_NOT_EXIST):
        ended.push(text("gone"))
    assert channel.state().lastNumber > last + 1
    fresh = admins[1].obtain_push_consumer()
    assert not any(fresh._is_equivalent(proxy) for proxy in (supplier, unconnected, ended))
    pushed.disconnect_push_supplier()
    eventually(lambda: consumer.disconnections == 1)


def test_a_pull_that_waits_neither_holds_up_the_end_nor_is_it_disconnected(lab: Lab) -> None:
    proxy = lab.channel.for_consumers().obtain_pull_supplier()
    proxy.connect_pull_consumer(None)
    pull = in_background(proxy.pull)
    head_start(0.2)
    lab.restart(signal.SIGTERM)
    answer = pull.result() if pull.done() else None
    assert answer is None or isinstance(answer, CORBA.TRANSIENT | CORBA.COMM_FAILURE)
    with lab.client("A") as robot:
        again(lambda: robot.push("t", 1))
    if answer is not None:
        pull = in_background(lambda: again(proxy.pull))
    assert isinstance(pull.result(60.0).value(), RoboCorba.Event)


# ---- consumers to which nobody can connect: the channel calls them over their own connection ----


def tail(lab: Lab) -> Popen[str]:
    """A consumer whose reference leads nowhere."""
    naming = ("--naming", f"127.0.0.1:{lab.place.port}")
    command = (ROBOCORBA, "events", "tail", lab.name, "--behind-nat", "--type", "t", "--json", *naming)
    return lab.place.launch(*command, ORBendPointPublish="giop:tcp:127.0.0.1:1")


def is_pushed(events: EventClient) -> bool:
    try:
        events.push("t", 2)
    except (NotReachable, Unconfirmed):
        return False
    return True


@pytest.mark.parametrize("lab", [("--bidirectional",)], indirect=True)
def test_a_consumer_behind_nat_receives_events_before_and_after_a_restart_of_the_channel(lab: Lab) -> None:
    consumer = tail(lab)
    assert consumer.stdout is not None
    with lab.client() as events:
        kinds = [RoboCorba.PUSH_SUPPLIER]
        eventually(lambda: [proxy.kind for proxy in events.channel.state().proxies] == kinds, what="the subscription")
        events.push("t", 1)
        assert json.loads(consumer.stdout.readline())["payload"] == 1
        lab.restart()
        eventually(lambda: is_pushed(events), what="pushed")  # connections of before may still fail
        received = json.loads(consumer.stdout.readline())  # the client finds its way back within some seconds
        assert received["payload"] == 2


def test_a_channel_that_does_not_call_back_says_so(lab: Lab) -> None:
    assert "robocorba up --bidirectional" in refusal(tail(lab), 60.0)
